"""Forces of a probe glued to tissue that is held around it, by finite elements and the laws of `sim`.

A block of tissue (x along the tension line, y across, z outward) is fixed at its bottom and its sides. A
probe on its free top, a square with the area of the circular one, moves inward, along x or along y, with
all nodes under it; its force is the sum of theirs. The tissue may have a pre-stress along x and y, whose
stretches follow from the law (`sim.prestretch.initial_stretch`); before the
probe moves, the block is in equilibrium with it. The rim of the probe is a singularity: with the 10 x 10
x 5 elements of the default, forces are about half larger than those of a fine mesh.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import brentq

import sim
from emgface.errors import FitError
from emgface.fit.triangulated import Floats, Integers
from sim.prestretch import initial_stretch, stretch_field

PROBE_DIRECTIONS: Final[Mapping[str, Floats]] = {
    "inward": np.array([0.0, 0.0, -1.0]),
    "along": np.array([1.0, 0.0, 0.0]),
    "across": np.array([0.0, 1.0, 0.0]),
}
"""Directions in which the probe moves; the force of a curve is that along its direction."""
BALANCE: Final = sim.Static(tolerance=1e-9, residual_tolerance=1e-7)
LARGEST_PROBE_STEP: Final = 0.5e-3  #: largest motion of the probe between two equilibria [m]


@dataclass(frozen=True)
class Block:
    """Block of tissue and probe of an experiment."""

    width: float = 37.5e-3  #: distance of the fixed sides, the inner diameter of a ring [m]
    depth: float = 10e-3  #: thickness of the tissue [m]
    probe: float = 2e-3  #: radius of the probe [m]
    elements: int = 10  #: elements along each side, even; half as many through the thickness


@dataclass(frozen=True, eq=False)
class _Grid:
    mesh: sim.Mesh
    fixed: Integers
    probe: Integers
    elements: int


def probe_forces(
    block: Block,
    material: sim.Material,
    curves: Mapping[str, Sequence[float] | Floats],
    prestress: tuple[float, float] = (0.0, 0.0),
) -> dict[str, Floats]:
    """Forces [N] of the probe at its displacements [m], by direction (`PROBE_DIRECTIONS`).

    `prestress` is that along x and y [Pa]. Raises FitError if there is no equilibrium.
    """
    grid = _grid(block)
    stretch = None
    if any(prestress):
        try:
            stretches = initial_stretch(material, (*prestress, 0.0))
        except sim.SceneError as error:
            raise FitError(
                f"the law cannot bear the pre-stress of the probed tissue: {error}"
            ) from error
        stretch = stretch_field(np.tile(np.eye(3), (grid.elements, 1, 1)), stretches)
    return {
        name: _forces(
            grid, material, stretch, PROBE_DIRECTIONS[name], np.asarray(given, dtype=np.float64)
        )
        for name, given in curves.items()
    }


def _forces(
    grid: _Grid, material: sim.Material, stretch: Floats | None, along: Floats, given: Floats
) -> Floats:
    """Forces at displacements, each from the equilibrium of the one before."""
    ends = np.concatenate([[0.0], given])
    parts = np.maximum(1, np.ceil(np.diff(ends) / LARGEST_PROBE_STEP)).astype(int)
    path = np.concatenate([[0.0], *(
        a + (b - a) * np.arange(1, n + 1) / n
        for a, b, n in zip(ends[:-1], ends[1:], parts, strict=True)
    )])  # fmt: skip
    times, wanted = np.arange(float(len(path))), np.cumsum(parts)
    home = grid.mesh.X[grid.probe]

    def place(t: float) -> Floats:
        return home + np.interp(t, times, path) * along

    system = sim.compile_scene(
        sim.Scene(
            grid.mesh, (sim.Solid((material,), prestretch=stretch),),
            reductions=(sim.Fixed(grid.fixed), sim.PrescribedNodes(grid.probe, place)),
        )
    )  # fmt: skip
    state, work, control = system.rest_state(), sim.Workspace(system), system.control(np.zeros(0))
    forces, k = np.empty(len(path)), 0
    try:
        for k in range(1, len(path)):
            state, _ = BALANCE.step(system, state, control, 1.0, work)
            forces[k] = -(system.force(state.q, control).f[grid.probe] @ along).sum()
    except sim.SimulationError as error:
        raise FitError(
            f"the tissue under the probe has no equilibrium at {1e3 * path[k]:.3g} mm ({error}), "
            "expected smaller displacements or a stiffer law"
        ) from error
    return forces[wanted]


def _grid(block: Block) -> _Grid:
    """Hexahedra: four across the probe, larger toward the sides and the bottom by a constant factor."""
    n, m = block.elements, block.elements // 2
    if block.elements < 8 or block.elements % 2 or not 0.0 < 3.0 * block.probe < block.width:
        raise FitError(
            f"the block has {block.elements} elements along a side and a probe of {block.probe} m "
            "radius, expected an even number of at least 8, and a probe much smaller than the block"
        )
    half = 0.5 * np.sqrt(np.pi) * block.probe
    inner = np.array([0.0, 0.5, 1.0]) * half
    outer = half + _graded(0.5 * block.width - half, 0.5 * half, n // 2 - 2)
    x = np.concatenate([-outer[::-1], -inner[:0:-1], inner, outer])
    z = -np.concatenate([[0.0], _graded(block.depth, 0.5 * half, m)])[::-1]
    X = np.stack(np.meshgrid(x, x, z, indexing="ij"), axis=-1).reshape(-1, 3)
    index = np.arange(len(X)).reshape(n + 1, n + 1, m + 1)
    corners = [
        index[i : n + i, j : n + j, k : m + k].ravel()
        for i, j, k in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0),
                        (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
    ]  # fmt: skip
    mesh = sim.mesh_from_arrays(X, hex8=np.stack(corners, axis=1))
    side = 0.5 * block.width - 1e-9
    fixed = (X[:, 2] < 1e-9 - block.depth) | (np.abs(X[:, :2]) > side).any(axis=1)
    probe = (X[:, 2] > -1e-9) & (np.abs(X[:, :2]) <= half + 1e-9).all(axis=1)
    return _Grid(mesh, np.flatnonzero(fixed), np.flatnonzero(probe), n * n * m)


def _graded(length: float, first: float, count: int) -> Floats:
    """Ends (count,) of steps from 0 to a length, each larger than the last by a constant factor."""
    grow = brentq(lambda r: first * sum(r**k for k in range(count)) - length, 0.2, 1e3)
    steps = first * float(np.asarray(grow)) ** np.arange(count)
    return np.cumsum(steps) * length / steps.sum()
