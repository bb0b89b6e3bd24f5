"""Removal of the rigid motion of the head by the face markers.

Each frame is rotated and translated so that its face markers fit a reference configuration in the
least-squares sense; the remaining motion of the lip markers is motion of the lips.

Source: Kabsch 1976, Acta Cryst A 32:922; Eskes et al. 2017, Methods (six face markers).
"""

from typing import Literal

import numpy as np
import xarray as xr
from scipy.interpolate import PchipInterpolator

from emgface.errors import MarkerError, UnitsError, listed
from emgface.muscles import AXES, FACE_MARKERS, LIP_MARKERS
from emgface.signals.filters import sampling_rate
from emgface.signals.parameters import HeadFrameParameters

COLLINEAR = 1e-2  #: second over first singular value below which markers are regarded as collinear
MIRRORED_AXES_RATIO = 0.75
"""Misfit of the mirror image over that of the markers below which the axes are regarded as mirrored."""
LARGEST_RATIO = 2.0  #: ratio of the sizes of two heads above which a unit is regarded as wrong


def in_head_frame(
    recording_position: xr.DataArray,
    parameters: HeadFrameParameters,
    reference: xr.DataArray | None = None,
    *,
    lost: Literal["refused", "kept"] = "refused",
) -> xr.DataArray:
    """Remove the rigid motion of the head from marker positions.

    For every frame the rotation R and the translation minimise the sum over the face markers
    present of |R (p - mean p) - (q - mean q)|^2, with the reference positions q; they are applied
    to all markers of the frame. A missing face marker is omitted in its frames as long as three
    that are not collinear remain. If a reference (marker or face_marker, axis) [m] is specified,
    for example ``face_marker_position`` of a face model, q is the person's own mean configuration,
    fitted to that reference once: a head differs in shape from a face model, and a fit of the
    present markers to the model itself would shift the frame whenever a marker is missing. Without
    a reference, q is the trial's own configuration. Afterwards, in the head frame, gaps up to
    `max_gap` are interpolated by monotone cubics.

    Positions have the dims (marker, axis, time_marker) [m]; measured ones are NaN if not visible,
    and the result is NaN where a marker was lost at either end of the recording, or a face marker
    for longer than `max_gap`. Its attrs are ``head_reference``, ``residual_rms`` and
    ``residual_max`` [m] of the face markers about the reference (shape differences, skin motion,
    noise), ``bridged`` (number of interpolated marker frames), ``face_markers_left_out`` (names,
    lost in any frame). With `lost` = "kept", a lip marker that is lost for longer is NaN meanwhile.

    Raises MarkerError, UnitsError or SignalError if a marker is missing, the markers fit the mirror
    image of the reference better than the reference, a lip marker is never visible or lost for
    longer than `max_gap`, a frame other than at the ends lacks three face markers that are not
    collinear, positions are not in metres or cannot be by their size, or the frames are not
    uniformly spaced.
    """
    position = _checked(recording_position)
    time = np.asarray(position["time_marker"], dtype=float)
    rate = sampling_rate(time)
    values = np.asarray(position, dtype=float).transpose(2, 0, 1)  # frame, marker, axis
    names = [str(name) for name in position["marker"].values]
    # A position requires all three coordinates.
    values = np.where(np.isfinite(values).all(axis=2, keepdims=True), values, np.nan)
    face = np.array([names.index(name) for name in FACE_MARKERS])
    points = values[:, face]
    present = np.isfinite(points[:, :, 0])
    fitted = _check_frames(points, present, time, rate)
    given = None if reference is None else _given_reference(reference)
    target = points[int(np.argmax(present.sum(axis=1)))]
    present = present & np.isfinite(target[:, 0])  # markers present in that frame
    fitted = _check_frames(points, present, time, rate)
    if given is not None or parameters.own_reference == "mean":
        target = _aligned_mean(points[fitted], present[fitted], target)
    if given is not None:
        target = _placed(target, given)
    rotation, origin, goal = _fit(points[fitted], present[fitted], target)
    moved = np.full_like(values, np.nan)
    moved[fitted] = np.einsum("tij,tmj->tmi", rotation, values[fitted] - origin[:, None])
    moved[fitted] += goal[:, None]
    about = target if given is None else given
    distance = np.linalg.norm(moved[:, face] - about, axis=2)[present]
    distance = distance[np.isfinite(distance)]
    bridged = _bridge(moved, names, time, rate, parameters.max_gap, lost == "refused")
    result = position.copy(data=moved.transpose(1, 2, 0))
    left_out = np.array(FACE_MARKERS)[~present.all(axis=0)]
    result.attrs |= {
        "units": "m",
        "head_reference": f"own, {parameters.own_reference}" if given is None else "given",
        "residual_rms": float(np.sqrt(np.mean(distance**2))),
        "residual_max": float(distance.max()),
        "bridged": bridged,
        "face_markers_left_out": " ".join(left_out),
    }
    return result


def _checked(position: xr.DataArray) -> xr.DataArray:
    """Check names, dims and unit, and return the declared order of dims."""
    if set(position.dims) != {"marker", "axis", "time_marker"}:
        raise MarkerError(
            f"positions have dims {tuple(position.dims)}, expected marker, axis, time_marker: "
            "rename or select dims"
        )
    units = position.attrs.get("units")
    if units != "m":
        raise UnitsError(
            f"positions have units {units!r}, expected 'm': convert the recording when it is read"
        )
    names = [str(name) for name in position["marker"].values]
    missing = [name for name in (*FACE_MARKERS, *LIP_MARKERS) if name not in names]
    if missing:
        raise MarkerError(
            f"missing marker{'s' if len(missing) > 1 else ''} {listed(missing)} (found "
            f"{listed(names) or 'none'}), expected six face and ten lip markers: rename the "
            "markers of the recording"
        )
    return position.sel(axis=list(AXES)).transpose("marker", "axis", "time_marker")


def _check_frames(points: np.ndarray, present: np.ndarray, time: np.ndarray, rate: float) -> slice:
    """Frames from the first to the last with three face markers that are not collinear.

    Raises MarkerError if there is none, or if a frame between them lacks these.
    """
    count = present.sum(axis=1)
    mean = np.where(present[:, :, None], points, 0.0).sum(axis=1) / np.maximum(count, 1)[:, None]
    centred = np.where(present[:, :, None], points - mean[:, None], 0.0)
    singular = np.linalg.svd(centred, compute_uv=False)
    # Fewer than two points (all singular values zero) also fail this comparison.
    poor = (count < 3) | ~(singular[:, 1] > COLLINEAR * singular[:, 0])
    good = np.flatnonzero(~poor)
    span = slice(int(good[0]), int(good[-1]) + 1) if good.size else slice(0, poor.size)
    poor = poor[span]
    if not poor.any():
        return span
    first = int(np.argmax(poor))
    length = int(np.argmin(poor[first:])) or poor.size - first
    start = span.start + first
    lost = [n for n, seen in zip(FACE_MARKERS, present[start], strict=True) if not seen]
    state = (
        f"only {count[start]} face markers are present"
        if count[start] < 3
        else f"the {count[start]} face markers present lie on one line"
    )
    raise MarkerError(
        f"{state} at t = {time[start]:.6g} s for {length / rate:.4g} s ({length} frames; "
        f"lost: {', '.join(lost) or 'none'}), expected at least three that are not "
        "collinear: label the markers at this time, or exclude the trial"
    )


def _aligned_mean(points: np.ndarray, present: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Mean of all frames after a fit of each to a first target."""
    rotation, origin, goal = _fit(points, present, target)
    aligned = np.einsum("tij,tmj->tmi", rotation, points - origin[:, None]) + goal[:, None]
    seen = np.maximum(np.sum(present, axis=0), 1)[:, None]
    mean = np.where(present[:, :, None], aligned, 0.0).sum(axis=0) / seen
    return np.where(np.any(present, axis=0)[:, None], mean, np.nan)


def _placed(own: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """Rotate and translate a configuration onto a reference of another shape.

    Raises UnitsError if the sizes differ more than those of two heads, and MarkerError if the mirror
    image of the configuration fits better. Markers in one plane fit equally well, so that their
    mirror image cannot be detected.
    """
    known = np.isfinite(own[:, 0])[None]
    _check_size(own[known[0]], reference[known[0]])

    def fitted(points: np.ndarray) -> tuple[np.ndarray, float]:
        rotation, origin, goal = _fit(points[None], known, reference)
        moved = (points - origin[0]) @ rotation[0].T + goal[0]
        return moved, float(np.linalg.norm((moved - reference)[known[0]]))

    (placed, given), (_, mirrored) = fitted(own), fitted(own * [-1.0, 1.0, 1.0])
    if mirrored < MIRRORED_AXES_RATIO * given:
        raise MarkerError(
            f"face markers are {given / np.sqrt(known.sum()) * 1e3:.3g} mm (rms) from the reference "
            f"and their mirror image {mirrored / np.sqrt(known.sum()) * 1e3:.3g} mm, expected the "
            "reverse: left and right are exchanged in the names, or one axis has the wrong sign"
        )
    return placed


def _check_size(own: np.ndarray, reference: np.ndarray) -> None:
    """Refuse positions whose stated unit cannot be that of their values."""
    size, expected = (float(np.linalg.norm(np.std(x, axis=0))) for x in (own, reference))
    if not size <= LARGEST_RATIO * expected or not expected <= LARGEST_RATIO * size:
        raise UnitsError(
            f"the face markers are {size:.3g} m (rms) from their centre, those of the reference "
            f"{expected:.3g} m, expected at most a factor of {LARGEST_RATIO:g}: check the unit of the "
            "positions in the recording or its sidecar"
        )


def _given_reference(reference: xr.DataArray) -> np.ndarray:
    """Check a reference and return its positions in the order of FACE_MARKERS."""
    dim = "face_marker" if "face_marker" in reference.dims else "marker"
    names = [str(name) for name in reference[dim].values] if dim in reference.coords else []
    missing = [name for name in FACE_MARKERS if name not in names]
    if missing:
        raise MarkerError(
            f"reference lacks the face markers {', '.join(missing)} (found "
            f"{', '.join(names) or 'none'}), expected {', '.join(FACE_MARKERS)}: rename them"
        )
    if reference.attrs.get("units") != "m":
        raise UnitsError(
            f"reference has units {reference.attrs.get('units')!r}, expected 'm': convert it"
        )
    chosen = reference.sel({dim: list(FACE_MARKERS), "axis": list(AXES)}).transpose(dim, "axis")
    target = np.asarray(chosen, dtype=float)
    if not np.isfinite(target).all():
        raise MarkerError(
            "reference contains positions that are not finite, expected six points: specify all of them"
        )
    singular = np.linalg.svd(target - target.mean(axis=0), compute_uv=False)
    if not singular[1] > COLLINEAR * singular[0]:
        raise MarkerError(
            "face markers of the reference lie on one line, expected at least three that do not: "
            "check their positions"
        )
    return target


def _fit(
    points: np.ndarray, present: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations (frame, 3, 3) and centroids of the present points and their targets."""
    weight = present.astype(float)[:, :, None]
    count = weight.sum(axis=1)
    origin = (np.where(weight > 0, points, 0.0)).sum(axis=1) / count
    goal = np.where(weight > 0, target, 0.0).sum(axis=1) / count
    p = np.where(weight > 0, points - origin[:, None], 0.0)
    q = np.where(weight > 0, target - goal[:, None], 0.0)
    covariance = np.einsum("tmi,tmj->tij", q, p)
    u, _, vt = np.linalg.svd(covariance)
    # A reflection would fit planar markers equally; the sign excludes it.
    sign = np.ones((points.shape[0], 3))
    sign[:, 2] = np.sign(np.linalg.det(u @ vt))
    return (u * sign[:, None, :]) @ vt, origin, goal


def _bridge(
    moved: np.ndarray,
    names: list[str],
    time: np.ndarray,
    rate: float,
    max_gap: float,
    refused: bool,
) -> int:
    """Interpolate gaps of every marker in place, and count the interpolated frames."""
    bridged = 0
    for m, name in enumerate(names):
        lost = ~np.isfinite(moved[:, m, 0])
        if not lost.any():
            continue
        must = refused and name in LIP_MARKERS
        if must and lost.all():
            raise MarkerError(
                f"marker {name} is never visible, expected it in at least part of the trial: "
                "label it, or exclude the trial"
            )
        edges = np.flatnonzero(np.diff(np.concatenate([[0], lost.astype(int), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            length = (stop - start) / rate
            inside = start > 0 and stop < lost.size
            if inside and length <= max_gap * (1 + 1e-9):
                continue
            if must and inside:
                raise MarkerError(
                    f"marker {name} is lost for {length:.4g} s ({stop - start} frames) from "
                    f"t = {time[start]:.6g} s, expected gaps of at most {max_gap:g} s: "
                    "increase head_frame.max_gap if a gap of this length may be "
                    "interpolated, or exclude the trial"
                )
            lost[start:stop] = False  # gaps at the ends, and of face markers, are not interpolated
        if lost.any():
            seen = np.isfinite(moved[:, m, 0])
            curve = PchipInterpolator(time[seen], moved[seen, m], axis=0)
            moved[lost, m] = curve(time[lost])
            bridged += int(lost.sum())
    return bridged
