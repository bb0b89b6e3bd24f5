"""Reduction of a compiled scene to the coordinates of modes."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sim.compile import compile_scene
from sim.errors import SceneError
from sim.linear.contract import symmetric_product
from sim.pattern import Index, SymmetricPattern
from sim.reduced.cubature import Sample, sampled
from sim.reduced.points import point_table, solid_of, weighted
from sim.reduced.tissue import ReducedDamping, ReducedSolid
from sim.scene import NO_TISSUE, Scene
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
        self,
        states: Array,
        activations: Array,
        total_mass: float,
        **options: Any,
    ) -> tuple["ReducedModel", Sample]:
        """Model with the points chosen by `sampled`, whose options are passed, at states (k, r)."""
        table, K = self.solid.table, self.solid.stiffness
        sample = sampled(table, states, activations, K, total_mass, **options)
        chosen = weighted(table, sample.points, sample.weights)
        return ReducedModel(replace(self.solid, table=chosen), self.n_moving), sample


def reduce_system(
    system: System,
    q0: Array,
    modes: Array,
    n_moving: int,
    sample: tuple[Index, Array] | None = None,
) -> ReducedModel:
    """Galerkin projection of a scene, with all points of its solid or with weighted ones.

    Parameters
    ----------
    system : System
        One `Solid` with laws of invariants, and gravity; damping with the tangent at rest.
    q0 : (n_nodes, 3) reference positions [m], where the coordinates are zero.
    modes : (3 n_nodes, n) orthonormal in the mass, zero where nodes are fixed.
    n_moving : int
        Number of modes that move, a multiple of three.
    sample : (places, weights), optional
        Chosen points, 8 e + k for point k of element e, and factors on their volumes.

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
    free = np.ascontiguousarray(modes[system.free])
    pattern = system.point_pattern
    load = np.zeros_like(q0)
    for term in system.terms:
        if term is not solid:
            term.add(q0, silent, load)
    if sample is None:
        table = point_table(solid, q0, modes)
    else:
        near = point_table(solid, q0, modes, np.unique(sample[0] // 8))
        order = np.argsort(near.place)
        at = order[np.searchsorted(near.place[order], sample[0])]
        table = weighted(near, at.astype(np.int64), sample[1])
    K = system.tangent(q0, silent)[1]
    D = np.zeros(pattern.nnz) if law is None else system.damping(q0, silent)
    reduced = ReducedSolid(
        system.muscles,
        table,
        modes.T @ load.reshape(-1),
        _projected(pattern, D, free),
        _projected(pattern, K, free),
    )
    return ReducedModel(reduced, n_moving)


def _projected(pattern: SymmetricPattern, values: Array, modes: Array) -> Array:
    """Phi' K Phi of values K of the upper triangle, for modes over the free components."""
    columns = np.array([symmetric_product(pattern, values, mode) for mode in modes.T])
    found: Array = np.ascontiguousarray(columns @ modes)
    return found
