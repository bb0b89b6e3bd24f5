"""Counts and measures of a face: mesh, fixed nodes, layers, quality, muscles."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from emgface.face.parts import (
    FREE,
    INNER,
    MANDIBLE,
    OUTER,
    SKULL,
    elements_of,
    fibres_of,
    shares_of,
)
from emgface.face.quality import element_quality, is_wedge
from emgface.face.surface import boundary_faces, element_edges, face_areas

TISSUE_DENSITY: Final = 1040.0  #: density of the tissue [kg/m3] (Eskes et al. 2017)

LAYER_NAMES: Final = ("inner", "centre", "outer")
TO_MM, TO_MM2, TO_MM3 = 1e3, 1e6, 1e9


@dataclass(frozen=True)
class FaceReport:
    """Tables of one face.

    `summary` has the index `quantity` and the columns `value` and `unit`; `muscles` the index
    `muscle` and the columns `fibres`, `elements`, `hexahedra`, `wedges`, `inner`, `centre`,
    `outer`, `volume` [mm3] and `shared`, the number of elements shared with the same muscle of the
    other side.
    """

    summary: pd.DataFrame
    muscles: pd.DataFrame


def face_report(ds: xr.Dataset, *, density: float = TISSUE_DENSITY) -> FaceReport:
    """Count and measure a face; lengths in mm, areas in mm2, volumes in mm3, mass in kg.

    `density` [kg/m3] determines the mass.
    """
    position, connectivity = ds["position"].values, ds["connectivity"].values
    layer, fixed = ds["layer"].values, ds["fixed"].values
    wedge = is_wedge(connectivity)
    quality = element_quality(position, connectivity)
    rows: list[tuple[str, float, str]] = []

    def add(quantity: str, value: float, unit: str = "1") -> None:
        rows.append((quantity, float(value), unit))

    add("nodes", len(position))
    add("elements", len(connectivity))
    add("hexahedra", int((~wedge).sum()))
    add("wedges", int(wedge.sum()))
    for k, name in enumerate(LAYER_NAMES):
        add(f"hexahedra, {name} layer", int((~wedge & (layer == k)).sum()))
        add(f"wedges, {name} layer", int((wedge & (layer == k)).sum()))
    add("volume", quality.volume.sum() * TO_MM3, "mm3")
    add("volume of hexahedra", quality.volume[~wedge].sum() * TO_MM3, "mm3")
    add("volume of wedges", quality.volume[wedge].sum() * TO_MM3, "mm3")
    add("mass", quality.volume.sum() * density, "kg")
    add("fixed nodes", int((fixed != FREE).sum()))
    add("fixed to mandible", int((fixed == MANDIBLE).sum()))
    add("fixed to skull", int((fixed == SKULL).sum()))
    add("free nodes", int((fixed == FREE).sum()))
    add("unknowns", 3 * int((fixed == FREE).sum()))
    for axis, low, high in zip("xyz", position.min(axis=0), position.max(axis=0), strict=True):
        add(f"smallest {axis}", low * TO_MM, "mm")
        add(f"largest {axis}", high * TO_MM, "mm")
    add("inverted elements", int((quality.smallest_det <= 0).sum()))
    for name, chosen in (("hexahedra", ~wedge), ("wedges", wedge)):
        if chosen.any():
            _quality_rows(rows, name, quality.volume[chosen], quality.scaled_jacobian[chosen])
    _edge_rows(rows, position, connectivity)
    _surface_rows(rows, position, connectivity, layer)
    membership = _membership(ds)
    add("muscle elements", int((membership > 0).sum()))
    add("elements of several muscles", int((membership > 1).sum()))
    add("most muscles of one element", int(membership.max(initial=0)))
    summary = pd.DataFrame(rows, columns=["quantity", "value", "unit"]).set_index("quantity")
    return FaceReport(summary, _muscle_table(ds, wedge, quality.volume))


def sheet_nodes(ds: xr.Dataset, layer: int) -> NDArray[np.int64]:
    """Nodes that belong only to elements of one layer: 0 for the inner surface, 2 for the skin."""
    connectivity = ds["connectivity"].values
    mine = connectivity[ds["layer"].values == layer]
    rest = connectivity[ds["layer"].values != layer]
    return np.setdiff1d(mine[mine >= 0], rest[rest >= 0]).astype(np.int64)


def _quality_rows(
    rows: list[tuple[str, float, str]],
    name: str,
    volume: NDArray[np.float64],
    scaled: NDArray[np.float64],
) -> None:
    for label, value in zip(
        ("smallest", "median", "largest"), np.quantile(volume, [0, 0.5, 1]) * TO_MM3, strict=True
    ):
        rows.append((f"{label} volume of {name}", float(value), "mm3"))
    for label, value in zip(
        ("smallest", "1 % of", "5 % of", "median"),
        np.quantile(scaled, [0, 0.01, 0.05, 0.5]),
        strict=True,
    ):
        rows.append((f"{label} scaled Jacobian of {name}", float(value), "1"))
    for limit in (0.1, 0.2, 0.3):
        count = int((scaled < limit).sum())
        rows.append((f"{name} with scaled Jacobian below {limit}", float(count), "1"))


def _edge_rows(
    rows: list[tuple[str, float, str]],
    position: NDArray[np.float64],
    connectivity: NDArray[np.integer],
) -> None:
    edges, element = element_edges(connectivity)
    length = np.linalg.norm(position[edges[:, 0]] - position[edges[:, 1]], axis=1)
    _, first = np.unique(edges, axis=0, return_index=True)
    for label, value in zip(
        ("smallest", "median", "largest"), np.quantile(length[first], [0, 0.5, 1]), strict=True
    ):
        rows.append((f"{label} edge length", float(value * TO_MM), "mm"))
    longest, shortest = np.zeros(len(connectivity)), np.full(len(connectivity), np.inf)
    np.maximum.at(longest, element, length)
    np.minimum.at(shortest, element, length)
    rows.append(("largest edge ratio", float(np.max(longest / shortest)), "1"))


def _surface_rows(
    rows: list[tuple[str, float, str]],
    position: NDArray[np.float64],
    connectivity: NDArray[np.integer],
    layer: NDArray[np.integer],
) -> None:
    faces, element = boundary_faces(connectivity)
    shared = np.zeros((len(LAYER_NAMES), len(position)), dtype=bool)
    for k in range(len(LAYER_NAMES)):
        nodes = connectivity[layer == k]
        shared[k, nodes[nodes >= 0]] = True
    alone = shared & (shared.sum(axis=0) == 1)
    rims = np.ones(len(faces), dtype=bool)
    for name, k in (("outer", OUTER), ("inner", INNER)):
        mine = (layer[element] == k) & alone[k][faces].all(axis=1)
        rims &= ~mine
        area = face_areas(position, faces[mine]).sum()
        rows.append((f"{name} boundary faces", float(mine.sum()), "1"))
        rows.append((f"{name} area", float(area * TO_MM2), "mm2"))
    rows.append(("rim boundary faces", float(rims.sum()), "1"))


def _membership(ds: xr.Dataset) -> NDArray[np.int64]:
    """Number of muscles of each element; left and right of a muscle are counted once."""
    count = np.zeros(ds.sizes["element"], dtype=np.int64)
    names = [str(name) for name in ds["muscle"].values]
    for muscle in dict.fromkeys(name.rpartition("_")[0] for name in names):
        parts = [elements_of(ds, name) for name in names if name.rpartition("_")[0] == muscle]
        count[np.unique(np.concatenate(parts))] += 1
    return count


def _muscle_table(
    ds: xr.Dataset, wedge: NDArray[np.bool_], volume: NDArray[np.float64]
) -> pd.DataFrame:
    layer = ds["layer"].values
    names = [str(name) for name in ds["muscle"].values]
    rows = {}
    for name in names:
        mine = elements_of(ds, name)
        muscle, _, side = name.rpartition("_")
        other = f"{muscle}_{'R' if side == 'L' else 'L'}"
        shared = np.intersect1d(mine, elements_of(ds, other)) if other in names else []
        rows[name] = {
            "fibres": len(fibres_of(ds, name)),
            "elements": len(mine),
            "hexahedra": int((~wedge[mine]).sum()),
            "wedges": int(wedge[mine].sum()),
            **{label: int((layer[mine] == k).sum()) for k, label in enumerate(LAYER_NAMES)},
            "volume": float((volume[mine] * shares_of(ds, name)).sum() * TO_MM3),
            "shared": len(shared),
        }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("muscle")
