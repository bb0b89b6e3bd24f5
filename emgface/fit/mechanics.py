"""Fit by mechanics: tissue of corner tetrahedra in equilibrium with springs to its targets."""

from dataclasses import dataclass, replace

import numpy as np

import sim
from emgface.errors import FitError
from emgface.fit.corners import Corners
from emgface.fit.springs import CompiledSprings, Rows, Springs
from emgface.fit.triangulated import Floats

SHEAR, BULK = 1000.0, 1000.0
"""Moduli of the tissue of the fit [Pa].

Only their ratio to the stiffness of the springs has an effect.
"""

COARSE_TOLERANCE, FINE_TOLERANCE = (
    5e-4,
    1e-4,
)  #: tolerance of positions of intermediate and last equilibria [m]
LARGEST_RESIDUAL = 0.1  #: largest residual force of an equilibrium [N]
CLASSES = 20  #: number of classes of stiffness by volume in the relaxation
LARGEST_STIFFNESS_FACTOR = 50.0  #: largest factor on the stiffness of small corners


@dataclass
class FitTissue:
    """Tissue in a configuration (n_nodes, 3) [m], moved from equilibrium to equilibrium.

    Every accepted configuration has a positive determinant at every corner of every element.
    """

    system: sim.System
    work: sim.Workspace
    q: Floats
    iterations: int = 0

    @classmethod
    def at_rest(cls, corners: Corners, rest: Floats) -> "FitTissue":
        """Homogeneous tissue whose rest is a configuration without inverted corner."""
        material = sim.Material(sim.NeoHooke(SHEAR), sim.LogarithmicBulk(BULK))
        return cls._from_mesh(corners, rest, sim.Solid((material,)))

    @classmethod
    def toward_rectangles(
        cls, corners: Corners, q: Floats, *, below: float, stiffening: float
    ) -> "FitTissue":
        """Tissue in q whose elements with a scaled Jacobian `below` are at rest with right angles.

        Their corners are stiffer by `stiffening`; stiffness is divided by volume, so that small
        elements resist like large ones.
        """
        bad = np.unique(corners.element[corners.scaled_jacobians(q) < below])
        chosen = np.isin(corners.element, bad)
        A, W = corners.edges(q), corners.rectangular(q)
        W[~chosen] = A[~chosen]
        volume = np.linalg.det(A) / 6.0
        weight = np.log(np.median(volume) / volume)
        edges = np.linspace(weight.min(), weight.max() + 1e-9, CLASSES + 1)
        own = np.clip(np.digitize(weight, edges) - 1, 0, CLASSES - 1)
        factor = np.exp(0.5 * (edges[:-1] + edges[1:]))
        factors = np.concatenate(
            [np.minimum(factor, LARGEST_STIFFNESS_FACTOR), stiffening * factor]
        )
        materials = tuple(
            sim.Material(sim.NeoHooke(SHEAR * s), sim.LogarithmicBulk(0.2 * BULK * s))
            for s in factors
        )
        region = (own + CLASSES * chosen).astype(np.int64)
        return cls._from_mesh(
            corners, q, sim.Solid(materials, region, prestretch=A @ np.linalg.inv(W))
        )

    @classmethod
    def _from_mesh(cls, corners: Corners, q: Floats, solid: sim.Solid) -> "FitTissue":
        mesh = sim.mesh_from_arrays(q, tet4=corners.nodes)
        system = sim.compile_scene(sim.Scene(mesh, terms=(solid, Springs())))
        return cls(system, sim.Workspace(system), np.ascontiguousarray(q))

    def settle(self, rows: Rows, tolerance: float = COARSE_TOLERANCE) -> Floats:
        """Equilibrium with springs, which becomes the configuration; FitError if there is none."""
        solid, springs = self.system.terms
        assert isinstance(springs, CompiledSprings)
        system = replace(self.system, terms=(solid, springs.to(rows)))
        self.work.newton.forget()
        state = sim.State(0.0, self.q, np.zeros_like(self.q))
        find = sim.Static(
            tolerance=tolerance, residual_tolerance=LARGEST_RESIDUAL, max_iterations=200
        )
        silent = sim.Control(np.zeros(0))
        try:
            state, report = find.step(system, state, silent, 1.0, self.work)
        except (sim.NotConverged, sim.SingularSystem) as error:
            raise FitError(
                f"the tissue found no equilibrium with its targets ({error}), expected targets that "
                "it can reach without folding: check landmarks, scale and sides of the surfaces"
            ) from error
        self.q, self.iterations = state.q, self.iterations + report.iterations
        return self.q
