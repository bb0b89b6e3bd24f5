"""Small bodies for the battery: a layered block with two muscles, fixed at its base or free."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

import sim
from sim.scene import Constraint, Term

Floats = NDArray[np.float64]

SIZE = 0.02  #: edge of the block [m]
MODERATE, FULL = (0.5, 0.2), (1.0, 1.0)  #: levels of the two muscles


@dataclass(frozen=True)
class Block:
    """A cube of 3 x 3 x 3 hexahedra in three layers along z, with one muscle along x and one along z."""

    sigma_max: float = 100e3  #: largest active stress [Pa]
    kappa: float = 25e3  #: bulk modulus [Pa]
    volume: str = "pointwise"  #: "pointwise", "element", "nodal" or "hard"
    stiff: float = 1.0  #: factor on the passive stiffness of the uppermost layer
    dense: float = 1.0  #: factor on its density
    gravity: float = -9.8  #: acceleration along z [m/s^2]
    fixed: bool = True  #: the base is fixed
    damped: bool = True  #: Rayleigh damping acts
    #: factor on the height of the middle layer, whose elements become slivers
    squeezed: float = 1.0
    #: scaled Jacobian at one inner corner, whose node is moved accordingly; 1 for no change
    corner: float = 1.0

    def mesh(self) -> sim.Mesh:
        """Nodes and hexahedra."""
        levels = np.array([0.0, 1.0, 1.0 + self.squeezed, 2.0 + self.squeezed]) * SIZE / 3.0
        side = np.linspace(0.0, SIZE, 4)
        X = np.stack(np.meshgrid(side, side, levels, indexing="ij"), axis=-1)
        X[1, 1, 1] *= _drawn_in(self.corner)
        return sim.grid_mesh(X)

    def scene(self) -> sim.Scene:
        """Parts of the scene."""
        mesh = self.mesh()
        pointwise = self.kappa if self.volume == "pointwise" else 0.0

        def tissue(stiffness: float, density: float) -> sim.Material:
            law = sim.MooneyRivlin(2500.0 * stiffness, 1175.0 * stiffness)
            return sim.Material(law, sim.QuadraticBulk(pointwise * stiffness), 1040.0 * density)

        elements = np.arange(27)
        muscles = sim.Muscles(
            ("along", "up"),
            np.tile(elements, 2),
            np.repeat([0, 1], 27),
            np.repeat(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), 27, axis=0),
            sim.Blemker(self.sigma_max),
        )
        solid = sim.Solid(
            (tissue(1.0, 1.0), tissue(self.stiff, self.dense)),
            region=(elements % 3 == 2).astype(np.int64),
            muscles=muscles,
        )
        terms: list[Term] = [solid, sim.Gravity((0.0, 0.0, self.gravity))]
        constraints: tuple[Constraint, ...] = ()
        if self.volume == "element":
            terms.append(sim.ElementVolume(self.kappa))
        elif self.volume == "nodal":
            terms.append(sim.NodalVolume(self.kappa, at_fixed=True))
        elif self.volume == "hard":
            constraints = (sim.HardElementVolume(),)
        base = np.flatnonzero(mesh.X[:, 2] == 0.0)
        return sim.Scene(
            mesh,
            tuple(terms),
            (sim.Fixed(base),) if self.fixed else (),
            sim.RestRayleigh(19.0, 0.055) if self.damped else None,
            constraints,
        )

    def system(self) -> sim.System:
        """The compiled scene."""
        return sim.compile_scene(self.scene())

    def but(self, **changes: object) -> "Block":
        """The same block with changes."""
        return replace(self, **changes)  # pyright: ignore[reportArgumentType]


def _drawn_in(jacobian: float) -> float:
    """Factor on the position of the corner (1, 1, 1) of a unit cube for a scaled Jacobian.

    At 2/3 the corner lies in the plane of its three neighbours.
    """

    def at(c: float) -> float:
        edges = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]]) - c
        return float(abs(np.linalg.det(edges / np.linalg.norm(edges, axis=1)[:, None])))

    if jacobian >= 1.0:
        return 1.0
    return float(brentq(lambda c: at(c) - jacobian, 2.0 / 3.0, 1.0))  # pyright: ignore[reportArgumentType]


def driven(levels: tuple[float, float], ramp: float) -> Callable[[sim.System], sim.Activation]:
    """Activation of a trial: both muscles to their levels within the ramp [s]."""
    values = np.stack([np.zeros(2), np.array(levels)])
    return lambda system: sim.Activation(np.array([0.0, ramp]), values)
