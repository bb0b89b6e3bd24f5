"""Score of the lower incisor in a trial that moves a head, in addition to those of the lips."""

import numpy as np
import xarray as xr

from analysis.cube import PER_MARKER
from analysis.errors import AnalysisError
from emgface.anatomy.jaw.recorded import INCISOR, score_motion
from emgface.errors import EmgfaceError
from emgface.recordings.head import in_head_frame
from emgface.signals.parameters import HeadFrameParameters


def incisor_pair(
    recording: xr.Dataset, motion: xr.Dataset, face: xr.Dataset, frame: HeadFrameParameters
) -> tuple[xr.Dataset, xr.Dataset] | None:
    """Recorded incisor in the frame of the head, and the simulated one; None without both.

    The markers of `face` determine the frame, `motion` is the trajectory of a head with ``incisor``
    (axis, time) [m]. Raises MarkerError as `emgface.recordings.head.in_head_frame`.
    """
    if "incisor" not in motion or INCISOR not in recording["marker"].values:
        return None
    place = in_head_frame(recording["position"], frame, face["face_marker_position"])
    path = motion["incisor"].transpose("axis", "time").expand_dims(marker=[INCISOR])
    attrs = {name: motion.attrs[name] for name in ("recorded_start", "origin")}
    attrs["numerical_error"] = motion.attrs["incisor_error"]
    body = {"body": np.array([], dtype="U1")}  # the skull rests
    simulated = xr.Dataset({"position": path}, coords=body, attrs=attrs)
    given = xr.Dataset({"position": place.sel(marker=[INCISOR])}, attrs=recording.attrs)
    return given, simulated


def with_incisor(
    scores: xr.Dataset,
    recording: xr.Dataset,
    motion: xr.Dataset,
    face: xr.Dataset,
    frame: HeadFrameParameters,
) -> xr.Dataset:
    """Add ``incisor_rho``, ``incisor_amplitude_ratio`` [1] and ``incisor_rmse`` [m] to scores.

    Recording and motion are compared as `emgface score` does. Where they cannot be, or rho is
    undefined, the attribute ``incisor_reason`` states why, and the scores of the lips remain.
    """
    try:
        pair = incisor_pair(recording, motion, face, frame)
        if pair is None:
            return scores
        score = score_motion(*pair).sel(marker=INCISOR)
    except (EmgfaceError, AnalysisError) as error:
        return scores.assign_attrs(incisor_reason=f"the incisor is not scored: {error}")
    own = {f"incisor_{name}": ((), float(score[name]), {"units": unit})
           for name, (unit, _) in PER_MARKER.items()}  # fmt: skip
    reason = str(score["reason"].item()) if "reason" in score else ""
    why = {"incisor_reason": f"rho of the incisor is undefined, {reason}"} if reason else {}
    return scores.assign(own).assign_attrs(why)
