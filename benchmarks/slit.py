"""Closure of a lens-shaped slit in a stretched sheet, whose force has a closed form.

python -m benchmarks treatment --only slit
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial import KDTree

import sim
from benchmarks.report import Row
from emgface.treatment.closure import drawn_together, relaxed, ties
from sim.mesh import grid_mesh


def sheet(
    cells: int = 20, width: float = 16.0, opening: float = 1e-3
) -> tuple[float, float, float, float]:
    """Force that closes a lens in a sheet, its closed form [N], the final gap [m], and imbalance [N].

    A crack of length 2 a under the stress s opens by 4 s/E sqrt(a^2 - x^2); a lens of this shape is
    therefore closed by the uniform traction s, with the force 2 a t s = E d t/2 for the opening d in
    its middle. Plane stress, small strain, a = 1 m, thickness t = 0.05 m.
    """
    E, t = 1e4, 0.05
    inner = np.linspace(0.0, 1.0, cells + 1)
    ratio, outer = 1.25, [1.0]
    while outer[-1] < width:
        outer.append(
            outer[-1] + (outer[-1] - (outer[-2] if len(outer) > 1 else 1.0 - inner[1])) * ratio
        )
    half = np.append(inner, outer[1:])
    x = np.append(-half[:0:-1], half)
    blocks: list[Any] = []
    for sign in (1.0, -1.0):
        y = half if sign > 0 else -half[::-1]
        X, Y, Z = np.meshgrid(x, y, [0.0, t], indexing="ij")
        lens = 0.5 * opening * np.sqrt(np.maximum(1.0 - X**2, 0.0)) * np.exp(-np.abs(Y))
        blocks.append(grid_mesh(np.stack([X, Y + sign * lens, Z], axis=-1)))
    n = blocks[0].n_nodes
    X = np.concatenate([b.X for b in blocks])
    hexahedra = np.concatenate([blocks[0].blocks[0].nodes, blocks[1].blocks[0].nodes + n])
    low = np.flatnonzero(np.abs(blocks[0].X[:, 1]) < opening)
    high = np.flatnonzero(np.abs(X[n:, 1]) < opening)
    partner = high[KDTree(X[n:][high][:, [0, 2]]).query(X[low][:, [0, 2]])[1]] + n
    outside = np.abs(X[low, 0]) >= 1.0 - 1e-9
    welded = ties(np.stack([low[outside], partner[outside]], axis=1), 2 * n)
    used, number = np.unique(welded, return_inverse=True)
    elements, at = number[hexahedra], X[used]
    pairs = number[np.stack([low[~outside], partner[~outside]], axis=1)]
    solid = sim.Solid((sim.Material(sim.LinearElastic(E, 0.3)),))
    fixed = sim.Fixed(np.flatnonzero(np.abs(at[:, 1]) > half[-1] - 1e-9))
    scene = sim.Scene(sim.mesh_from_arrays(at, hex8=elements), (solid,), (fixed,))
    same = ties(pairs, len(at))
    met = drawn_together(scene, same, steps=2)
    gap = float(np.linalg.norm(met[pairs[:, 0]] - met[pairs[:, 1]], axis=1).max())
    kept, merged = np.unique(same, return_inverse=True)
    tied = merged[elements]
    free = at[elements]
    mesh = sim.mesh_from_arrays(met[kept], hex8=tied)
    both = sim.Scene(
        mesh, (replace(solid, stress_free=free),),
        (sim.Fixed(np.flatnonzero(np.abs(mesh.X[:, 1]) > half[-1] - 1e-9)),),
    )  # fmt: skip
    side = np.arange(len(tied)) < len(tied) // 2
    suture = np.unique(merged[pairs[:, 0]])
    closed = relaxed(both, mesh.X, side, suture)
    force = float(np.abs(closed.traction[suture, 1].sum()))
    return force, 0.5 * E * opening * t, gap, closed.imbalance


def slit() -> list[Row]:
    """Closure of a lens in a sheet against its closed form, for two meshes."""
    rows: list[Row] = []
    for cells in (10, 20, 40):
        force, exact, gap, imbalance = sheet(cells)
        error = force / exact - 1.0
        rows.append((f"sheet, {cells} elements over half the slit: force", f"{100 * error:+.2f} %",
                     "3 % (finest)", abs(error) < 0.03 or cells < 40))  # fmt: skip
    rows.append(("edges meet within", f"{1e3 * gap:.2g} mm", "1e-3 mm", gap < 1e-6))
    rows.append(("largest force on a free node", f"{imbalance:.2g} N", "1e-9 N", imbalance < 1e-9))
    return rows
