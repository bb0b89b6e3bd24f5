"""Small bodies for the tests of the mechanics."""

import numpy as np

import sim


def grid(n=(2, 2, 2), size=(0.02, 0.02, 0.02), wedges=(), distort=0.0, seed=0) -> sim.Mesh:
    """Box of hexahedra; the columns of cells along z numbered in `wedges` are split into wedges.

    Whole columns are split, so that triangles are not adjacent to quadrilaterals. distort moves the
    inner nodes at random by that fraction of a cell.
    """
    axes = [np.linspace(0.0, s, k + 1) for s, k in zip(size, n, strict=True)]
    X = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    if distort:
        rng = np.random.default_rng(seed)
        cell = np.array(size) / np.array(n)
        X[1:-1, 1:-1, 1:-1] += rng.uniform(-distort, distort, X[1:-1, 1:-1, 1:-1].shape) * cell
    cells = sim.grid_cells(tuple(n))
    split = np.isin(np.arange(len(cells)) // n[2], wedges)
    w = cells[split]
    halves = np.concatenate([w[:, [0, 1, 2, 4, 5, 6]], w[:, [0, 2, 3, 4, 6, 7]]])
    return sim.mesh_from_arrays(X.reshape(-1, 3), hex8=cells[~split], wedge6=halves)


def tetrahedra(n=(2, 2, 2), size=(0.02, 0.02, 0.02), distort=0.0, seed=0) -> sim.Mesh:
    """Box of cells divided into the six tetrahedra around a diagonal."""
    boxes = grid(n, size, distort=distort, seed=seed)
    # Each tetrahedron has three edges from corner 0 to corner 6, in one order of the axes.
    paths = [[1, 2], [2, 3], [3, 7], [7, 4], [4, 5], [5, 1]]
    corners = np.array([[0, a, b, 6] for a, b in paths])
    tets = boxes.blocks[0].nodes[:, corners].reshape(-1, 4)
    return sim.mesh_from_arrays(boxes.X, tet4=tets)


def boundary(mesh: sim.Mesh) -> np.ndarray:
    """Indices of the nodes on the faces of the bounding box."""
    low, high = mesh.X.min(axis=0), mesh.X.max(axis=0)
    return np.flatnonzero((np.isclose(mesh.X, low) | np.isclose(mesh.X, high)).any(axis=1))


def crossed_muscles(mesh: sim.Mesh, law=None) -> sim.Muscles:
    """Two muscles in every element."""
    n = mesh.n_elements
    rng = np.random.default_rng(1)
    return sim.Muscles(
        ("first", "second"),
        np.tile(np.arange(n), 2),
        np.repeat([0, 1], n),
        rng.normal(size=(2 * n, 3)),
        law if law is not None else sim.Blemker(sigma_max=50e3),
    )


def solid_system(mesh, law=None, bulk=None, muscles=None, **scene) -> sim.System:
    material = sim.Material(
        law or sim.MooneyRivlin(), bulk, relaxation=scene.pop("relaxation", None)
    )
    axes = np.broadcast_to(rotation(8), (mesh.n_elements, 3, 3)) if material.needs_axes else None
    solid = sim.Solid((material,), muscles=muscles, axes=axes)
    more = scene.pop("terms", ())
    return sim.compile_scene(sim.Scene(mesh, (solid, *more), **scene))


def fixed_block(mesh, active, law=None, **scene) -> sim.System:
    """Tissue that is fixed at its lower side, with two muscles of a law in every element."""
    base = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    return solid_system(
        mesh, law, muscles=crossed_muscles(mesh, active), reductions=(base,), **scene
    )


def dense(system: sim.System, values: np.ndarray) -> np.ndarray:
    """Full matrix over the free unknowns from the values of the upper triangle."""
    p = system.pattern
    A = np.zeros((p.n, p.n))
    row = np.repeat(np.arange(p.n), np.diff(p.indptr))
    A[row, p.indices] = values
    A[p.indices, row] = values
    return A


def rotation(seed: int = 0) -> np.ndarray:
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return Q * np.sign(np.linalg.det(Q))


def mean_stress(system: sim.System, F: np.ndarray, activation) -> np.ndarray:
    """Mean first Piola-Kirchhoff stress P of a body under the homogeneous deformation x = F X.

    From the nodal forces alone: sum_a f_a X_a' = V P, since sum_a g_a X_a' = I.
    """
    X = system.scene.mesh.X
    f = -system.force(X @ F.T, system.control(np.asarray(activation, float))).f
    return f.T @ X / system.scene.mesh.volumes().sum()


def free_components(system: sim.System, x: np.ndarray) -> np.ndarray:
    """Components (n_free,) of a nodal vector that are not fixed."""
    return x.reshape(-1)[system.free]
