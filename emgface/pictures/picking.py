"""Element, layer, muscle, channel and place on a lip of every drawn node of a face, for picking."""

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.face.lip_shape import has_mouth, lip_rim
from emgface.face.parts import LIPS
from emgface.muscles import CHANNELS
from emgface.pictures.body import Skin

Floats = NDArray[np.float64]

LAYERS: Final = ("inner", "centre", "outer")  #: names of the layers, by number
#: distance from a fibre, or from the margin of a lip, that is offered [m]
OFFERED_DISTANCE: Final = 0.015
#: Channels over the orbicularis oris, whose fibres do not distinguish the lips.
RING: Final = {"upper": "OOS", "lower": "OOI"}


def pick_data(face: xr.Dataset, skin: Skin) -> dict[str, Any]:
    """Tables for a page, with one entry for each node of the skin.

    ``node`` is its index in the face, ``element`` that of an element at it, ``layer`` of that element,
    ``muscle`` the one of the nearest fibre, ``channel`` the electrode position of the montage over it,
    and ``lip`` and ``place`` those of a step of a treatment; empty or None where there is none.
    """
    rest = face["position"].values
    points = rest[skin.node]
    element, layer = _elements(face, skin.node)
    lips, places = _places(face, points)
    muscles = _muscles(face, points)
    return {
        "node": skin.node.tolist(),
        "position": np.round(1e3 * points, 4).tolist(),
        "element": element.tolist(),
        "layer": [LAYERS[k] if k < len(LAYERS) else str(k) for k in layer],
        "muscle": muscles,
        "channel": [_channel(m, lip) for m, lip in zip(muscles, lips, strict=True)],
        "lip": lips,
        "place": places,
    }


def _elements(face: xr.Dataset, nodes: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Outermost element at each node, and its layer."""
    connectivity, layer = face["connectivity"].values, face["layer"].values
    outermost = np.zeros(face.sizes["node"], dtype=np.int64)
    for k in np.argsort(layer, kind="stable"):
        outermost[connectivity[k][connectivity[k] >= 0]] = k  # short elements are filled with -1
    return outermost[nodes], layer[outermost[nodes]]


def _muscles(face: xr.Dataset, points: Floats) -> list[str]:
    """Muscle of the fibre that passes nearest to each point, within `OFFERED_DISTANCE`."""
    if "fibre_position" not in face or not face.sizes["fibre_point"]:
        return [""] * len(points)
    tree = KDTree(face["fibre_position"].values)
    away, nearest = (np.asarray(array) for array in tree.query(points))
    own = face["fibre_muscle"].values[face["fibre_of_point"].values[nearest]]
    names = [str(m) for m in face["muscle"].values[own]]
    return [name if d < OFFERED_DISTANCE else "" for name, d in zip(names, away, strict=True)]


def _places(face: xr.Dataset, points: Floats) -> tuple[list[str], list[float | None]]:
    """Lip and relative arc length of the margin nearest to each point, within `OFFERED_DISTANCE`."""
    if not has_mouth(face):
        return [""] * len(points), [None] * len(points)
    rim, rest = lip_rim(face), face["position"].values
    away, place = np.empty((2, 2, len(points)))
    for k, nodes in enumerate((rim.upper, rim.lower)):
        margin = rest[nodes]
        length = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(margin, axis=0), axis=1)))
        s = np.linspace(0.0, length[-1], 401)
        fine = np.stack([np.interp(s, length, margin[:, c]) for c in range(3)], axis=1)
        away[k], at = KDTree(fine).query(points)
        place[k] = s[at] / length[-1]
    own = np.argmin(away, axis=0)
    near = away.min(axis=0) < OFFERED_DISTANCE
    chosen = np.take_along_axis(place, own[None], axis=0)[0]
    lips = [LIPS[k] if ok else "" for k, ok in zip(own, near, strict=True)]
    return lips, [round(float(p), 3) if ok else None for p, ok in zip(chosen, near, strict=True)]


def _channel(muscle: str, lip: str) -> str:
    """Electrode position over a muscle."""
    stem, _, side = muscle.rpartition("_")
    name = f"{RING[lip]}_{side}" if stem in ("OOP", "OOM") and lip else muscle
    return name if name in CHANNELS else ""
