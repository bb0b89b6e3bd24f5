"""Volumetric locking: Cook's membrane and a bending beam, for every treatment of the volume.

    python -m benchmarks locking [--body cook] [--out FOLDER]

Cook's membrane in plane strain at small strains: E = 250 Pa, side 44 to 16 m over 48 m, a shear
traction on the right side; vertical displacement of the upper right corner for a traction of 6.25
Pa. The deflection of the beam under its weight is relative to slender-beam theory.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish

PARTS = ("pointwise", "element", "nodal", "hard")


@dataclass(frozen=True)
class Elastic:
    """Neo-Hookean tissue with a Poisson ratio and a treatment of the volume."""

    mu: float
    poisson: float
    part: str

    @property
    def kappa(self) -> float:
        """Bulk modulus 2 mu (1 + nu)/(3 (1 - 2 nu)) [Pa]."""
        return 2.0 * self.mu * (1.0 + self.poisson) / (3.0 * (1.0 - 2.0 * self.poisson))

    def scene(self, mesh: sim.Mesh, *terms: object, fixed: tuple[sim.Fixed, ...]) -> sim.System:
        """Compile the body with its loads."""
        bulk = sim.QuadraticBulk(self.kappa if self.part == "pointwise" else 0.0)
        solid = sim.Solid((sim.Material(sim.NeoHooke(self.mu), bulk),))
        soft = {
            "element": (sim.ElementVolume(self.kappa),),
            "nodal": (sim.NodalVolume(self.kappa, at_fixed=True),),
        }
        constraints = (sim.HardElementVolume(),) if self.part == "hard" else ()
        return sim.compile_scene(
            sim.Scene(mesh, (solid, *soft.get(self.part, ()), *terms), fixed, None, constraints)
        )


def equilibrium(system: sim.System, residual: float, position: float) -> np.ndarray:
    """Displacements (n_nodes, 3) in equilibrium [m]."""
    static = sim.Static(tolerance=position, residual_tolerance=residual)
    control = system.control(np.zeros(0))
    # The iterative default does not converge for nodal volumes with kappa = 5000 mu.
    work = sim.Workspace(system, "superlu")
    state, _ = static.step(system, system.rest_state(), control, 1.0, work)
    return state.q - system.scene.mesh.X


def cook(n: int, poisson: float, part: str) -> float:
    """Vertical displacement [m] of the corner of Cook's membrane with n x n elements."""
    traction, thickness, E = 0.01, 48.0 / n, 250.0
    s, t = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    plane = np.stack([48.0 * s, 44.0 * s + (44.0 - 28.0 * s) * t], axis=-1)
    X = np.zeros((n + 1, n + 1, 2, 3))
    X[..., :2], X[:, :, 1, 2] = plane[:, :, None], thickness
    mesh = sim.grid_mesh(X)
    right = np.flatnonzero(mesh.X[:, 0] == 48.0).reshape(n + 1, 2)
    share = np.full(n + 1, 16.0 / n)
    share[[0, -1]] /= 2.0
    force = np.zeros((n + 1, 2, 3))
    force[..., 1] = (traction * share * thickness / 2.0)[:, None]
    load = sim.NodeLoad(right.ravel(), force.reshape(-1, 3))
    fixed = (
        sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0)),
        sim.Fixed(np.arange(mesh.n_nodes), axes=(2,)),
    )
    system = Elastic(E / (2.0 * (1.0 + poisson)), poisson, part).scene(mesh, load, fixed=fixed)
    u = equilibrium(system, 1e-5 * traction * 16.0 * thickness, 1e-5)
    return float(u[right[-1], 1].mean() * 6.25 / traction)


def beam(cells: int, poisson: float, part: str) -> float:
    """Deflection of a cantilever of 100 x 10 x 10 mm relative to slender-beam theory.

    w = rho g A L^4/(8 E I); cells is the number of elements over the height.
    """
    length, height, mu, density, g = 0.1, 0.01, 5000.0, 1040.0, 0.01
    axes = [np.linspace(0, length, 5 * cells + 1), np.linspace(0, height, 3)]
    X = np.stack(np.meshgrid(*axes, np.linspace(0, height, cells + 1), indexing="ij"), axis=-1)
    mesh = sim.grid_mesh(X)
    fixed = (sim.Fixed(np.flatnonzero(mesh.X[:, 0] == 0.0)),)
    tissue = Elastic(mu, poisson, part)
    u = equilibrium(tissue.scene(mesh, sim.Gravity((0.0, 0.0, -g)), fixed=fixed), 1e-8, 1e-7)
    E = 2.0 * mu * (1.0 + poisson)
    slender = density * g * height**2 * length**4 / (8.0 * E * height**4 / 12.0)
    return float(-u[mesh.X[:, 0] == length, 2].mean() / slender)


BODIES = {"cook": (cook, (4, 8, 16, 32)), "beam": (beam, (2, 4, 6))}


def main(body: list[str] = list(BODIES), out: Path | None = None) -> None:  # noqa: B006
    """Print and store a table for every body, with one column for every number of elements."""
    for name in body:
        function, sizes = BODIES[name]
        rows: list[dict[str, object]] = []
        for poisson in (0.3, 0.4999, 0.49999):
            for part in PARTS:
                if part == "hard" and poisson < 0.49999:
                    continue  # its Poisson ratio is always 0.5
                row = {"Poisson ratio": f"{0.5 if part == 'hard' else poisson:g}", "volume": part}
                rows.append(row | {str(n): f"{function(n, poisson, part):.3g}" for n in sizes})
        finish(f"locking-{name}", pd.DataFrame(rows), out)
