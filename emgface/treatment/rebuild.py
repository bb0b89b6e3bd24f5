"""Face model after an excision: elements, muscles, surfaces and markers carried over."""

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.face.bundles import project_into_mesh
from emgface.face.check import sheet_nodes
from emgface.face.lip_shape import lip_rim
from emgface.face.parts import FREE, LIPS, OUTER
from emgface.face.surface import boundary_faces
from emgface.treatment.excise import Wound

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

LIP_NODES: Final = "lip_opening_node", "mouth_corner_node"
NEIGHBOUR_NODES: Final = 8  #: nodes whose displacement moves a point of a fibre


def rebuilt(
    face: xr.Dataset, wound: Wound, same: Integers, position: Floats
) -> tuple[xr.Dataset, Integers]:
    """Face of the elements of a wound, whose nodes n become same[n], at `position` (nodes, 3) [m].

    Returns the face, not yet checked, and the new number of every node of the wound, -1 of unused ones.
    Named surfaces are found again by the original nodes of their facets; a marker whose node was
    removed is moved to the nearest node of the same kind, and listed in the attribute
    ``moved_markers``. Closed surfaces of the lips are dropped, and derived from the elements.
    """
    merged = np.where(wound.connectivity < 0, -1, same[wound.connectivity])
    used = np.unique(merged[merged >= 0])
    number = np.full(len(wound.position), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    number = np.where(number[same] >= 0, number[same], -1)
    connectivity = np.where(wound.connectivity < 0, -1, number[wound.connectivity])
    old = face.sizes["node"]
    values: dict[str, Any] = {
        "position": (("node", "axis"), position[used]),
        "node_id": ("node", _ids(face["node_id"].values, used, old)),
        "connectivity": (("element", "element_node"), connectivity.astype(np.int32)),
        "element_id": ("element", _element_ids(face, wound)),
        "layer": ("element", face["layer"].values[wound.parent]),
        "fixed": ("node", _fixed(face, wound, used, old)),
        "stress_free_position": (("element", "element_node", "axis"), wound.stress_free),
        **_muscles(face, wound),
        **_surfaces(face, wound, number),
    }
    if "tissue_factor" in face:
        values["tissue_factor"] = ("element", face["tissue_factor"].values[wound.parent])
    dropped = [name for name in ("lip_triangle", "lip_of_triangle") if name in face]
    replaced = [name for name in values if name in face]
    kept = face.drop_vars([*replaced, *dropped, *_of_nodes(face)])
    for name, (dims, array) in values.items():
        units = "m" if name.endswith("position") else "1"
        kept[name] = (dims, array, {"units": units})
    placed, moved = _placed(face, wound, number, used)
    for name, (dims, array) in placed.items():
        kept[name] = (dims, array, {"units": "1"})
    _carry_fibres(kept, face, wound, used, position)
    kept.attrs["moved_markers"] = ", ".join(moved)
    return kept, number


def _of_nodes(face: xr.Dataset) -> list[str]:
    """Variables that name single nodes, or earlier sutures."""
    names = ("marker_node", *LIP_NODES, "suture_node", "suture_traction", "suture_cut")
    return [name for name in names if name in face]


def _ids(ids: Integers, used: Integers, old: int) -> NDArray[np.int32]:
    new = int(ids.max()) + 1 + np.arange(max(0, int(used.max(initial=0)) + 1 - old))
    return np.concatenate([ids, new])[used].astype(np.int32)


def _element_ids(face: xr.Dataset, wound: Wound) -> NDArray[np.int32]:
    ids = face["element_id"].values
    element_ids = ids[wound.parent].astype(np.int32)
    n = int(wound.changed.sum())
    element_ids[wound.changed] = int(ids.max()) + 1 + np.arange(n)
    return element_ids


def _fixed(face: xr.Dataset, wound: Wound, used: Integers, old: int) -> NDArray[np.int8]:
    """Attachment of the nodes; an added node is fixed if all its parents are."""
    before = face["fixed"].values
    attachment = np.zeros(len(used), dtype=np.int8)
    for k, node in enumerate(used.tolist()):
        parents = wound.node_parents.get(node, frozenset((node,)))
        own = before[list(parents)] if max(parents) < old else np.array([FREE])
        attachment[k] = own[0] if (own != FREE).all() else FREE
    return attachment


def _muscles(face: xr.Dataset, wound: Wound) -> dict[str, Any]:
    """Rows of the muscles of every remaining element, in the order of the muscles."""
    element, row = _rows(face["bundle_index"].values, wound.parent, face.sizes["element"])
    order = np.lexsort((element, face["bundle_muscle"].values[row]))
    element, row = element[order], row[order]
    muscles: dict[str, Any] = {
        "bundle_muscle": ("bundle_element", face["bundle_muscle"].values[row]),
        "bundle_index": ("bundle_element", element.astype(np.int32)),
        "bundle_direction": (("bundle_element", "axis"), face["bundle_direction"].values[row]),
    }
    if "bundle_weight" in face:
        muscles["bundle_weight"] = ("bundle_element", face["bundle_weight"].values[row])
    return muscles


def _rows(kept: Integers, parent: Integers, n: int) -> tuple[Integers, Integers]:
    """Elements, and the rows of their parents among `kept`."""
    order = np.argsort(kept, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(kept, minlength=n))])
    count = start[parent + 1] - start[parent]
    element = np.repeat(np.arange(len(parent)), count)
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return element, order[start[parent[element]] + within]


def _surfaces(face: xr.Dataset, wound: Wound, number: Integers) -> dict[str, Any]:
    """Facets of the named parts of the boundary."""
    if "facet_node" not in face:
        return {}
    facets, names = face["facet_node"].values, face["facet_surface"].values
    at: dict[int, list[int]] = {}
    for k, row in enumerate(facets.tolist()):
        for node in set(row):
            at.setdefault(node, []).append(k)
    sets = [frozenset(row) for row in facets.tolist()]
    faces, _ = boundary_faces(wound.connectivity)
    rows: list[list[int]] = []
    surface_of: list[int] = []
    for row in faces.tolist():
        parents = frozenset[int]().union(*(wound.node_parents.get(v, frozenset((v,))) for v in row))
        for k in at.get(next(iter(parents)), ()):
            if parents <= sets[k]:
                rows.append(number[row].tolist())
                surface_of.append(int(names[k]))
                break
    order = np.argsort(surface_of, kind="stable")
    return {
        "facet_node": (("facet", "facet_corner"), np.array(rows, dtype=np.int32)[order]),
        "facet_surface": ("facet", np.array(surface_of, dtype=np.int32)[order]),
    }


def _placed(
    face: xr.Dataset, wound: Wound, number: Integers, used: Integers
) -> tuple[dict[str, Any], list[str]]:
    """Nodes of markers, lip opening and mouth corners; those that were removed are moved."""
    old, position = face.sizes["node"], face["position"].values
    rim = lip_rim(face)
    skin, moved = sheet_nodes(face, OUTER), list[str]()

    def among(nodes: Integers) -> Integers:
        """Remaining nodes whose parents are all of one kind, with added ones."""
        kind = set(nodes.tolist())
        added = [n for n, parents in wound.node_parents.items() if parents <= kind]
        both = np.array([*nodes.tolist(), *added], dtype=np.int64)
        return both[number[both] >= 0]

    def nearest(node: int, kind: Integers, label: str, taken: set[int]) -> int:
        if number[node] >= 0 and int(number[node]) not in taken:
            if np.linalg.norm(wound.position[node] - position[node]) > 1e-9:
                moved.append(label)  # with its node, onto the cut
            return int(number[node])
        moved.append(label)
        at = among(kind)
        away = np.linalg.norm(wound.position[at] - position[node], axis=1)
        for k in np.lexsort((at, np.round(away, 9))):
            if int(number[at[k]]) not in taken:
                return int(number[at[k]])
        return int(number[at[0]])

    taken: set[int] = set()
    markers: list[int] = []
    for label, node in zip(face["marker"].values, face["marker_node"].values, strict=True):
        margin = np.union1d(rim.upper, rim.lower)
        kind = margin if node in margin else skin
        markers.append(nearest(int(node), kind, str(label), taken))
        taken.add(markers[-1])
    variables: dict[str, Any] = {"marker_node": ("marker", np.array(markers, dtype=np.int32))}
    if "lip_opening_node" in face:
        nodes = face["lip_opening_node"].values
        lips = [
            nearest(int(n), getattr(rim, lip), f"margin of the {lip} lip", set())
            for lip, n in zip(LIPS, nodes, strict=True)
        ]
        variables["lip_opening_node"] = ("lip", np.array(lips, dtype=np.int32))
        both = np.intersect1d(rim.upper, rim.lower)
        corners = [nearest(int(rim.upper[k]), both, f"{side} corner of the mouth", set())
                   for k, side in ((0, "left"), (-1, "right"))]  # fmt: skip
        variables["mouth_corner_node"] = ("mouth_corner", np.array(corners, dtype=np.int32))
    del old, used
    return variables, moved


def _carry_fibres(
    kept: xr.Dataset, face: xr.Dataset, wound: Wound, used: Integers, position: Floats
) -> None:
    """Move the points of the fibres with the nearest nodes, and drop those in removed tissue."""
    if "fibre_position" not in face:
        return
    points = face["fibre_position"].values
    away, near = KDTree(wound.position[used]).query(points, k=NEIGHBOUR_NODES)
    weight = 1.0 / np.maximum(away, 1e-6) ** 2
    weight /= weight.sum(axis=1, keepdims=True)
    shift = (position - wound.position)[used]
    carried = points + np.einsum("pk,pki->pi", weight, shift[near])
    _, outside = project_into_mesh(points, wound.position, wound.connectivity)
    _, before = project_into_mesh(points, face["position"].values, face["connectivity"].values)
    gone = outside & ~before
    owner = face["fibre_of_point"].values
    n = face.sizes["fibre"]
    left = np.bincount(owner[~gone], minlength=n)
    gone |= (left < 2)[owner]
    if gone.all():
        gone[:] = False
    still = np.unique(owner[~gone])
    renumbered = np.full(n, -1)
    renumbered[still] = np.arange(len(still))
    names = ["fibre_position", "fibre_of_point", "fibre_muscle"]
    muscle = kept["fibre_muscle"].values[still]
    kept_attrs = {name: kept[name].attrs for name in names}
    for name in names:
        del kept[name]
    kept["fibre_position"] = (("fibre_point", "axis"), carried[~gone], kept_attrs["fibre_position"])
    kept["fibre_of_point"] = (
        "fibre_point", renumbered[owner[~gone]].astype(np.int32), kept_attrs["fibre_of_point"],
    )  # fmt: skip
    kept["fibre_muscle"] = ("fibre", muscle, kept_attrs["fibre_muscle"])
