"""Encoding of surfaces, motions and activations as JSON for pages."""

import base64
import json
import re
import zlib
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.muscles import MUSCLE_NAMES
from emgface.pictures.body import MOUTH, Body
from emgface.pictures.render import DISPLACEMENT, LIGHT, VIEWS

QUANTUM: Final = 20e-6  #: quantum of the positions [m], below visible differences
ABSENT_MARKER: Final = -32768  #: value of a marker without measurement


def body_data(body: Body, rest: NDArray[np.floating]) -> dict[str, Any]:
    """Encode the drawn surface, relative to the centre of the nodes of its skin at rest (n, 3) [m].

    Positions are multiples of `QUANTUM` relative to `centre`; arrays are deflated, in base 64.
    """
    centre = middle_of(rest)
    return {
        "quantum": QUANTUM,
        "absent": ABSENT_MARKER,
        "nodes": body.n,
        "tissue": body.tissue,
        "rules": packed(body.rules.astype("<u4")),
        "teeth": packed(whole(body.teeth, centre).astype("<i2")),
        "triangle": packed(body.triangle.astype("<u4")),
        "colour": packed(np.round(255.0 * body.colour).astype(np.uint8)),
        "mouth": MOUTH,
        "views": VIEWS,
        "light": LIGHT,
        "displacement": DISPLACEMENT,
    }


def middle_of(rest: NDArray[np.floating]) -> NDArray[np.float64]:
    """Centre of the bounding box of points (n, 3), the origin of positions in a page."""
    return np.asarray(rest.min(axis=0) + rest.max(axis=0), dtype=np.float64) / 2.0


def muscle_names(
    muscles: NDArray[Any], names: Mapping[str, str] = MUSCLE_NAMES
) -> list[dict[str, str]]:
    """Names of muscles such as ``ZYG_L`` for the panel of activations, without their side."""
    plain = [(str(m), re.sub("_[LR]$", "", str(m))) for m in muscles]
    return [{"id": m, "name": names.get(own, own)} for m, own in plain]


def scaling(activation: xr.Dataset) -> str:
    """Sentence for the panel on the scaling of an activation, empty if its parameters are unknown."""
    chain = json.loads(activation.attrs.get("parameters", "{}"))
    if chain.get("normalisation", {}).get("reach") != "trial":
        return ""
    return (
        "Each muscle is scaled to its own range in the trial (Eq. 8), so that the noise of an "
        "inactive muscle also reaches the full bar."
    )


def levels(activation: xr.DataArray, at: NDArray[np.floating]) -> str:
    """Encode activation (muscle, time) at some of its instants [s], one byte each.

    It is limited to 0-1, and 0 where it is NaN, because a byte would wrap around.
    """
    values = activation.transpose("time", "muscle")
    place = np.searchsorted(values["time"].values, at - 1e-9)
    chosen = values.values[np.clip(place, 0, len(values) - 1)]
    limited = np.clip(np.where(np.isnan(chosen), 0.0, chosen), 0.0, 1.0)
    return packed(np.round(255.0 * limited).astype(np.uint8))


def measured_frames(aligned: xr.Dataset, moved: xr.Dataset) -> NDArray[np.float64]:
    """Aligned measured markers at the frames (frame, marker, axis) [m], NaN if there are none.

    They are shifted by one vector, so that their mean in the first complete frame is that of the
    simulated markers, because the position of the lips in the head differs between a person and the
    face model.
    """
    position = aligned["position"].transpose("time", "marker", "axis")
    order = [str(name) for name in moved["marker"].values]
    wanted = np.searchsorted(position["time"].values, moved["time"].values - 1e-9)
    frames = position.sel(marker=order).values[np.minimum(wanted, position.sizes["time"] - 1)]
    complete = np.isfinite(frames).all(axis=(1, 2))
    if not complete.any():
        return frames
    first = int(np.argmax(complete))
    own = moved["position"].transpose("time", "marker", "axis").values[first]
    return frames + (own - frames[first]).mean(axis=0)


def measured_markers(aligned: xr.Dataset, sampled: xr.Dataset) -> NDArray[np.float64]:
    """Measured at the simulated instants (n, marker, axis) [m], NaN for markers without measurement."""
    names, seen = list(map(str, sampled["marker"].values)), set(map(str, aligned["marker"].values))
    known = [name for name in names if name in seen]
    frames = np.full((sampled.sizes["time"], len(names), 3), np.nan)
    frames[:, [names.index(name) for name in known]] = measured_frames(
        aligned, sampled.sel(marker=known)
    )
    return frames


def whole(position: NDArray[Any], centre: NDArray[np.float64]) -> NDArray[np.int16]:
    """Round positions [m] to multiples of `QUANTUM` about a centre; NaN becomes `ABSENT_MARKER`."""
    steps = np.round((np.asarray(position, dtype=np.float64) - centre) / QUANTUM)
    steps = np.where(np.isfinite(steps), np.clip(steps, -32767, 32767), ABSENT_MARKER)
    return steps.astype(np.int16)


def quanta(position: NDArray[np.float64]) -> bytes:
    """Positions as multiples of `QUANTUM`, limited to the range of int16."""
    return np.clip(np.round(position / QUANTUM), -32767, 32767).astype("<i2").tobytes()


def deltas(values: NDArray[np.int16]) -> str:
    """Encode frames of integers, with time as the first dim, as differences.

    Each frame is the difference to the preceding one, all low bytes before all high bytes.
    """
    flat = values.reshape(len(values), -1)
    with np.errstate(over="ignore"):
        change = np.diff(flat, axis=0, prepend=np.zeros((1, flat.shape[1]), dtype=np.int16))
    raw = change.astype("<i2").tobytes()
    planes = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 2)
    return packed(np.concatenate([planes[:, 0], planes[:, 1]]))


def packed(values: NDArray[Any]) -> str:
    """Deflate the bytes of an array and write them in base 64."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode("ascii")
