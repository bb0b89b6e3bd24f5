"""Triangulated surfaces of .ply, .obj and .stl files, read by trimesh and made consistent.

Only the given file is read: materials and textures that it names are ignored. Points are merged if they
coincide, triangles without area are removed, and neighbouring triangles are oriented alike. No format
states its unit.
"""

import io
import os
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, connected_components

from emgface.errors import FitError
from emgface.fit.readers.guard import FACE, MOST_GEOMETRY_BYTES, content_of, metres
from emgface.fit.triangulated import Floats, Integers, Surface
from sim.indices import whole_numbers

MOST_TRIANGLES: Final = 1_500_000
LEAST_TRIANGLES: Final = 50
SURFACE_ENDINGS: Final = (".ply", ".obj", ".stl")
MERGED_DISTANCE: Final = 1e-6  #: distance of points that are merged, relative to the extent [1]
REMOVED_AREA: Final = 1e-15  #: area of a triangle that is removed [m2]
SMALL: Final = 0.02  #: parts with a smaller share of the area are removed [1]


@dataclass(frozen=True)
class Scan:
    """Surface of a file, with its digest and what was changed in it."""

    surface: Surface
    source: str = "given as numbers"
    digest: str = ""
    notes: list[str] = field(default_factory=list)


def read_surface(
    path: str | os.PathLike[str], *, unit: str | None = None, least: float = FACE[0]
) -> Scan:
    """Read a surface; FitError if the file is damaged, too large, or its unit is not known.

    `least` [m] is the smallest extent of the surface.
    """
    content = content_of(path, MOST_GEOMETRY_BYTES)
    ending = next((e for e in SURFACE_ENDINGS if content.name.lower().endswith(e)), None)
    if ending is None:
        raise FitError(
            f"{content.name} has an unknown ending, expected one of {', '.join(SURFACE_ENDINGS)}: "
            "export the surface as one of them"
        )
    points, triangles = _loaded(content.data, ending, content.name)
    scan = surface_of(points, triangles, unit=unit, name=content.name, least=least)
    return Scan(scan.surface, content.name, content.digest, scan.notes)


def surface_of(
    points: Any,
    triangles: Any,
    *,
    unit: str | None = "m",
    name: str = "surface",
    least: float = FACE[0],
) -> Scan:
    """Check points (n, 3) and triangles (m, 3), and make their orientation consistent."""
    if np.iscomplexobj(points):
        raise FitError(f"{name} has complex points, expected real numbers")
    x = np.asarray(points, dtype=np.float64)
    t = whole_numbers(f"{name}: triangles", "point", triangles, error=FitError)
    if x.ndim != 2 or x.shape[1] != 3 or t.ndim != 2 or t.shape[1] != 3 or len(t) < LEAST_TRIANGLES:
        raise FitError(
            f"{name} has points of shape {x.shape} and triangles of shape {t.shape}, expected at least "
            f"{LEAST_TRIANGLES} triangles: export the surface again"
        )
    if len(t) > MOST_TRIANGLES:
        raise FitError(
            f"{name} has {len(t)} triangles, expected at most {MOST_TRIANGLES}: simplify the surface"
        )
    if t.min() < 0 or t.max() >= len(x):
        bad = int(np.argmax(((t < 0) | (t >= len(x))).any(axis=1)))
        raise FitError(f"{name}: triangle {bad} refers to a point that does not exist")
    used, corner = np.unique(t, return_inverse=True)
    x, t = metres(x[used], unit, name, least=least), corner.reshape(-1, 3).astype(np.int64)
    notes: list[str] = []
    x, t = _merged(x, t)
    area = Surface(x, t).areas
    if (flat := int((area <= REMOVED_AREA).sum())) > 0:
        notes.append(f"{flat} triangles without area were removed")
        t = t[area > REMOVED_AREA]
    if len(t) < LEAST_TRIANGLES:
        raise FitError(f"{name} has {len(t)} triangles with an area, expected {LEAST_TRIANGLES}")
    t, turned, crowded = _oriented(t, len(x))
    if turned:
        notes.append(f"{turned} triangles were turned to agree with their neighbours")
    if crowded:
        notes.append(f"{crowded} edges belong to more than two triangles")
    t = _large_parts(x, t, notes)
    used, corner = np.unique(t, return_inverse=True)
    return Scan(Surface(x[used], corner.reshape(-1, 3).astype(np.int64)), name, "", notes)


def _loaded(data: bytes, ending: str, name: str) -> tuple[Floats, Integers]:
    try:
        import trimesh
    except ImportError as error:
        raise FitError(
            "reading surfaces requires trimesh: install the extra with pip install 'emgface[fit]'"
        ) from error
    options: dict[str, Any] = {"skip_materials": True} if ending == ".obj" else {}
    try:
        loaded: Any = trimesh.load_mesh(
            io.BytesIO(data), file_type=ending[1:], process=False, maintain_order=True, **options
        )
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
        return np.asarray(loaded.vertices, dtype=np.float64), np.asarray(loaded.faces, np.int64)
    except (Exception, MemoryError) as error:  # the readers of formats raise any kind
        raise FitError(
            f"{name} cannot be read as {ending} ({type(error).__name__}: {str(error)[:100]}), expected "
            "a surface of triangles: export it again"
        ) from error


def _merged(x: Floats, t: Integers) -> tuple[Floats, Integers]:
    """Merge points that coincide, as of .stl files, and drop triangles that collapse."""
    step = MERGED_DISTANCE * max(float(np.ptp(x, axis=0).max()), 1e-12)
    _, first, inverse = np.unique(
        np.round((x - x.min(axis=0)) / step).astype(np.int64), axis=0,
        return_index=True, return_inverse=True,
    )  # fmt: skip
    t = inverse.reshape(-1)[t]
    whole = (t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])
    kept = np.unique(np.sort(t[whole], axis=1), axis=0, return_index=True)[1]
    return x[first], t[whole][np.sort(kept)]


def _neighbours(t: Integers, n: int) -> tuple[Integers, Integers, np.ndarray, int]:
    """Pairs of triangles with a common edge, and whether both run along it in one direction."""
    edges = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    owner = np.tile(np.arange(len(t)), 3)
    upward = edges[:, 0] < edges[:, 1]
    key = edges.min(axis=1) * n + edges.max(axis=1)
    order = np.argsort(key, kind="stable")
    key, owner, upward = key[order], owner[order], upward[order]
    _, start, counts = np.unique(key, return_index=True, return_counts=True)
    two = start[counts == 2]
    return owner[two], owner[two + 1], upward[two] == upward[two + 1], int((counts > 2).sum())


def _oriented(t: Integers, n: int) -> tuple[Integers, int, int]:
    """Turn triangles so that neighbours agree; the majority of each part keeps its orientation."""
    a, b, against, crowded = _neighbours(t, n)
    m = len(t)
    if not against.any():
        return t, 0, crowded
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(m, m)).tocsr()
    count, part = connected_components(graph, directed=False)
    sign = {(int(i), int(j)): bool(s) for i, j, s in zip(a, b, against, strict=True)}
    turned = np.zeros(m, dtype=bool)
    for k in range(count):
        if not against[part[a] == k].any():
            continue
        own = np.flatnonzero(part == k)
        order, parent = breadth_first_order(graph, int(own[0]), directed=False)
        for face in order[1:].tolist():
            before = int(parent[face])
            pair = (before, face) if (before, face) in sign else (face, before)
            turned[face] = turned[before] ^ sign[pair]
        if turned[own].sum() > len(own) / 2:
            turned[own] = ~turned[own]
    t = t.copy()
    t[turned] = t[turned][:, ::-1]
    return t, int(turned.sum()), crowded


def _large_parts(x: Floats, t: Integers, notes: list[str]) -> Integers:
    """Remove parts with a very small share of the area, such as specks of a scan."""
    a, b, _, _ = _neighbours(t, len(x))
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(len(t), len(t)))
    count, part = connected_components(graph, directed=False)
    share = np.bincount(part, Surface(x, t).areas, minlength=count)
    share /= share.sum()
    if (small := share < SMALL).any() and not small.all():
        notes.append(
            f"{int(small.sum())} parts with less than {SMALL:.0%} of the area were removed"
        )
        return t[~small[part]]
    return t
