"""Reduction of a compiled scene to the coordinates of modes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sim.compile import compile_scene
from sim.errors import SceneError
from sim.reduced.cubature import Sample, sampled
from sim.reduced.tissue import ReducedDamping, ReducedSolid, projected_matrix, solid_of
from sim.scene import NO_TISSUE, Index, Scene
from sim.state import Array
from sim.system import System


@dataclass(frozen=True, eq=False)
class ReducedModel:
    """Reduced solid about a reference."""

    solid: ReducedSolid
    #: number r of coordinates that move, a multiple of three. The others estimate the error
    n_moving: int

    @cached_property
    def system(self) -> System:
        """Compiled scene of points of unit mass whose positions are the coordinates, 0 at rest."""
        r = self.n_moving
        damping = ReducedDamping(self.solid.damping[:r, :r])
        points = np.zeros((r // 3, 3))
        return compile_scene(Scene(NO_TISSUE, (self.solid,), damping=damping, points=points))

    def sampled_at(
        self, states: Array, activations: Array, **options: Any
    ) -> tuple["ReducedModel", Sample]:
        """Model with the elements chosen by `sampled`, whose options are passed, at states (k, r)."""
        sample = sampled(self.solid, states, activations, **options)
        weight = np.zeros(len(self.solid.weight))
        weight[sample.elements] = sample.weights
        return ReducedModel(replace(self.solid, weight=weight), self.n_moving), sample


def reduce_system(
    system: System,
    q0: Array,
    modes: Array,
    n_moving: int,
    sample: tuple[Index, Array] | None = None,
) -> ReducedModel:
    """Galerkin projection of a scene, with all elements of its solid or with weighted ones.

    Parameters
    ----------
    system : System
        One `Solid` with laws of invariants, and gravity; damping with the tangent at rest.
    q0 : (n_nodes, 3) reference positions [m], where the coordinates are zero.
    modes : (3 n_nodes, n) orthonormal in the mass, zero where nodes are fixed.
    n_moving : int
        Number of modes that move, a multiple of three.
    sample : (elements, weights), optional
        Chosen elements, and factors on their energies.

    Raises
    ------
    SceneError
        The scene has other parts, or another damping; `n_moving` does not fit.
    """
    if n_moving % 3 or not 0 < n_moving <= modes.shape[1]:
        raise SceneError(
            f"{n_moving} moving modes of {modes.shape[1]}, expected a multiple of three within them"
        )
    solid = solid_of(system)
    law = system.damping_law
    if law is not None and law.rest is None:
        raise SceneError(
            "a reduced model requires damping by the stiffness at rest: use RestRayleigh "
            "(damping_tangent = 'rest')"
        )
    silent = system.control(np.zeros(len(system.muscles)))
    load = np.zeros_like(q0)
    for term in system.terms:
        if term is not solid:
            term.add(q0, silent, load)
    weight = np.ones(system.scene.mesh.n_elements)
    if sample is not None:
        weight[:] = 0.0
        weight[sample[0]] = sample[1]
    K = projected_matrix(system, system.tangent(q0, silent)[1], modes)
    damped = law is not None
    D = projected_matrix(system, system.damping(q0, silent), modes) if damped else np.zeros_like(K)
    reduced = ReducedSolid(system, q0, modes, weight, modes.T @ load.reshape(-1), D, K)
    return ReducedModel(reduced, n_moving)
