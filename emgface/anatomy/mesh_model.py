"""Elements, muscles and facets of a deformable part as arrays of a model, and their checks.

Faces and tongues share these variables (`data_schema/face_model.json`, `tongue_model.json`).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.anatomy.frame import to_the_right
from emgface.errors import DataError
from emgface.face.parts import Bundle, Fibre, Floats, Integers
from emgface.face.quality import element_quality
from sim.indices import indices, whole_numbers


def muscle_arrays(
    fibres: Sequence[Fibre],
    bundles: Sequence[Bundle],
    muscles: Sequence[str],
    n_elements: int,
    error: type[DataError],
) -> dict[str, NDArray[Any]]:
    """Fibres, and elements with directions, in the order of the muscles.

    Raises the `error` if a muscle is unknown, some bundles have weights and others have none, or
    elements are neither indices nor a mask, or directions are not one per element.
    """
    order = {muscle: k for k, muscle in enumerate(muscles)}
    for muscle in [*(f.muscle for f in fibres), *(b.muscle for b in bundles)]:
        if muscle not in order:
            raise error(f"unknown muscle {muscle!r}: expected one of {', '.join(muscles)}")
    bundles = sorted(bundles, key=lambda bundle: order[bundle.muscle])
    own = [
        indices(f"the bundle of {b.muscle}", "element", b.element, n_elements, error=error)
        for b in bundles
    ]
    for bundle, rows in zip(bundles, own, strict=True):
        for what, values in (("directions", bundle.direction), ("weights", bundle.weight)):
            if values is not None and len(values) != len(rows):
                raise error(
                    f"the bundle of {bundle.muscle} has {len(rows)} elements and {len(values)} {what}, "
                    "expected one for each element"
                )
    points, elements = [len(f.position) for f in fibres], [len(rows) for rows in own]
    of_element = [order[bundle.muscle] for bundle in bundles]
    arrays: dict[str, NDArray[Any]] = {
        "fibre_position": stacked([f.position for f in fibres]),
        "fibre_of_point": integers(np.repeat(np.arange(len(fibres)), points)),
        "fibre_muscle": integers([order[fibre.muscle] for fibre in fibres]),
        "bundle_muscle": integers(np.repeat(of_element, elements)),
        "bundle_index": integers(np.concatenate([np.empty(0, dtype=np.int64), *own])),
        "bundle_direction": stacked([b.direction for b in bundles]),
    }
    weighted = [bundle.muscle for bundle in bundles if bundle.weight is not None]
    if weighted and len(weighted) < len(bundles):
        raise error(
            f"{weighted[0]} has weights and {len(bundles) - len(weighted)} muscles have none, "
            "expected weights for all muscles or for none"
        )
    if weighted:
        arrays["bundle_weight"] = np.concatenate(
            [float_array(b.weight) for b in bundles if b.weight is not None]
        )
    return arrays


def facet_arrays(facets: Mapping[str, Integers] | None) -> dict[str, Any]:
    """Nodes of the named parts of the boundary, one after the other, and the names."""
    if not facets:
        return {}
    sizes = [len(nodes) for nodes in facets.values()]
    return {
        "surface": list(facets),
        "facet_node": np.concatenate([integers(rows) for rows in facets.values()]),
        "facet_surface": integers(np.repeat(np.arange(len(facets)), sizes)),
    }


def stacked(parts: Sequence[Floats]) -> Floats:
    """Rows (n, 3) of all parts."""
    return np.concatenate([float_array(part) for part in parts]) if parts else np.empty((0, 3))


def float_array(values: Floats) -> Floats:
    """Contiguous numbers of double precision."""
    return np.ascontiguousarray(values, dtype=np.float64)


def integers(values: object) -> NDArray[np.int32]:
    """Contiguous integers of 32 bits; raises DataError for masks and numbers that are not whole."""
    numbers = whole_numbers("a model", "number", np.asarray(values), error=DataError)
    if numbers.size and np.abs(numbers).max() > np.iinfo(np.int32).max:
        raise DataError(f"a model refers to number {numbers.max()}, expected at most {2**31 - 1}")
    return np.ascontiguousarray(numbers, dtype=np.int32)


def codes(values: object) -> NDArray[np.int8]:
    """Contiguous codes of 8 bits; raises DataError as `integers`, and for other numbers."""
    numbers = integers(values)
    if numbers.size and not (numbers.min() >= -128 and numbers.max() <= 127):
        raise DataError(f"a model contains the code {numbers.max()}, expected a small whole number")
    return numbers.astype(np.int8)


def check_references(
    ds: xr.Dataset, nodes: Sequence[tuple[str, str]], error: type[DataError]
) -> None:
    """Check that elements and named nodes refer to nodes, with the ids of the source in messages.

    `nodes` are variables with the dim of their names. Absent variables are left to the schema.
    """
    needed = ("position", "node_id", "element_id", "connectivity", "bundle_index")
    if any(name not in ds for name in (*needed, nodes[0][0])):
        return
    n = ds.sizes.get("node", 0)
    connectivity = ds["connectivity"].values
    if connectivity.ndim != 2 or connectivity.shape[1] != 8:
        return
    wedge = (connectivity[:, 6:] == -1).all(axis=1)
    bad = (connectivity >= n) | (connectivity < 0)
    bad[wedge, 6:] = False
    if bad.any():
        row, column = (int(k[0]) for k in np.nonzero(bad))
        raise error(
            f"element {ds['element_id'].values[row]} refers to node index "
            f"{connectivity[row, column]}, expected 0 to {n - 1}"
            + (" (-1 only in the last two of a wedge)" if connectivity[row, column] < 0 else "")
        )
    for variable, dim in nodes:
        if variable not in ds or dim not in ds.coords:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if not 0 <= node < n:
                raise error(f"{dim} {label} refers to node index {node}, expected 0 to {n - 1}")


def check_elements(ds: xr.Dataset, error: type[DataError], *, corners: bool = True) -> None:
    """Refuse nodes without element, and elements inverted at rest; `corners` includes their corners."""
    connectivity = ds["connectivity"].values
    used = np.zeros(ds.sizes["node"], dtype=bool)
    used[connectivity[connectivity >= 0]] = True
    if not used.all():
        node = int(np.flatnonzero(~used)[0])
        on_it = [
            str(label)
            for label, place in zip(ds["marker"].values, ds["marker_node"].values, strict=True)
            if place == node
        ]
        raise error(
            f"node {ds['node_id'].values[node]} belongs to no element"
            + (f" (marker {on_it[0]} is at this node)" if on_it else "")
            + ": expected every node to be used, remove it"
        )
    quality = element_quality(ds["position"].values, connectivity)
    smallest = quality.smallest_det if corners else quality.smallest_det_inside
    bad = np.flatnonzero(~(smallest > 0))
    if len(bad):
        worst = int(bad[np.argmin(smallest[bad])])
        others = f" ({len(bad)} such elements)" if len(bad) > 1 else ""
        raise error(
            f"element {ds['element_id'].values[worst]} is inverted at rest{others}: its smallest "
            f"Jacobian determinant is {smallest[worst]:.3g} m3, expected a positive one; check its "
            "node order and positions"
        )


def check_muscles(ds: xr.Dataset, error: type[DataError]) -> None:
    """Refuse muscles without element, or with one twice."""
    owner, element = ds["bundle_muscle"].values, ds["bundle_index"].values
    for k, muscle in enumerate(ds["muscle"].values):
        mine = element[owner == k]
        if len(mine) == 0:
            raise error(
                f"muscle {muscle} has no element: expected at least one, try a larger radius "
                "or check its fibres"
            )
        values, counts = np.unique(mine, return_counts=True)
        if (counts > 1).any():
            raise error(
                f"muscle {muscle} lists element {ds['element_id'].values[values[counts > 1][0]]} "
                "twice, expected once"
            )


def muscles_to_the_right(ds: xr.Dataset) -> Floats | None:
    """Mean vector (3,) [m] from the muscles of the left to those of the right; None without pairs."""
    names = [str(name) for name in ds["muscle"].values]
    owner = ds["bundle_muscle"].values
    connectivity = ds["connectivity"].values[ds["bundle_index"].values]
    corner = np.where(connectivity[:, 6:] < 0, connectivity[:, :2], connectivity[:, 6:])
    nodes = np.concatenate([connectivity[:, :6], corner], axis=1)  # wedges end in -1
    centres = ds["position"].values[nodes].mean(axis=1)
    return to_the_right(
        names, np.stack([centres[owner == k].mean(axis=0) for k in range(len(names))])
    )
