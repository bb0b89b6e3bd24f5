"""Outcomes of a motion of a head at its end, in mm and mm2."""

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.head.model import Head
from emgface.face.lip_shape import lip_rim, lip_shape

Measure = Callable[[xr.Dataset, Head], Mapping[str, float]]

_POINTS: Final = ("lower_incisor", "hyoid", "tip", "back")
_TWO_SIDED: Final = ("corner_left", "corner_right")


def outcomes(motion: xr.Dataset, head: Head) -> dict[str, float]:
    """Outcomes at the end of a motion, as displacements from its start unless they are absolute.

    Of a face: `opening_mm` between the margins in the midline (negative if they have passed each
    other), `area_mm2` through which one sees from the front, and `width_mm` between the ends of the
    margins, all absolute; `protrusion_mm` of the margins; `corner_in_mm`, `corner_forward_mm` and
    `corner_up_mm`, the means of both corners; `upper_up_mm` and `lower_up_mm` of the margins. Of jaw,
    hyoid and tongue: lower incisor, hyoid, tip and back of the tongue forward and up. `smallest_J` is
    the smallest det F of the motion, and `speed_mm_s` the largest speed of a named point at the end.
    """
    x = motion["position"].transpose("time", "marker", "axis")
    d = 1e3 * (x - x.isel(time=0))
    last = d.isel(time=-1)
    values = dict[str, float]()
    if "face" in head.parts:
        values |= _of_mouth(motion, head.parts["face"])
        left, right = (last.sel(marker=name).values for name in _TWO_SIDED)
        values["corner_in_mm"] = float(0.5 * (left[0] - right[0]))
        values["corner_forward_mm"] = float(0.5 * (left[1] + right[1]))
        values["corner_up_mm"] = float(0.5 * (left[2] + right[2]))
    for name in _POINTS:
        if name in x["marker"].values:
            values[f"{name}_forward_mm"], values[f"{name}_up_mm"] = map(
                float, last.sel(marker=name).values[1:]
            )
    if "smallest_J" in motion:
        values["smallest_J"] = float(motion["smallest_J"].min())
    t = motion["time"].values
    moved = np.linalg.norm(d.values[-1] - d.values[-2], axis=-1)
    values["speed_mm_s"] = float(moved.max() / (t[-1] - t[-2]))
    return values


def _of_mouth(motion: xr.Dataset, face: xr.Dataset) -> dict[str, float]:
    n = face.sizes["node"]
    q = motion["node_position"].transpose("time", "node", "axis").values[[0, -1], :n]
    margins = face["lip_opening_node"].values
    upper, lower = 1e3 * (q[1] - q[0])[margins]
    return {
        "opening_mm": 1e3 * float(motion["lip_opening"][-1]),
        "area_mm2": 1e6 * float(motion["mouth_area"][-1]),
        "width_mm": 1e3 * lip_shape(face, lip_rim(face), q[1])["width"],
        "protrusion_mm": 0.5 * float(upper[1] + lower[1]),
        "upper_up_mm": float(upper[2]),
        "lower_up_mm": float(lower[2]),
    }
