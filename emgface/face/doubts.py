"""Doubts about a simulated motion, in sentences: stability, reduction, and error of the time steps."""

import xarray as xr

from emgface.face.event_error import contact_share
from emgface.face.stability import NOTICED, stability_warning


def doubts_of(trajectory: xr.Dataset) -> list[str]:
    """Return what a user of a motion must know, beginning with a small letter and without full stop.

    An error below 0.01 mm is none, whatever its share of a motion that is itself smaller.
    """
    a = trajectory.attrs
    sentences = [stability_warning(trajectory)]
    if doubt := a.get("reduction_doubt"):
        ran = "is not trusted" if a["reduced"] else "was repeated at full order"
        sentences.append(f"the reduced motion {ran}, since {doubt}")
    error = float(a.get("numerical_error", 0.0))
    if a.get("inaccurate", 0) and error > NOTICED:
        advice = "" if contact_share(trajectory) else ": specify an accuracy such as '0.1 mm'"
        sentences.append(
            f"the estimated error of the time steps is {1e3 * error:.2g} mm, more than "
            f"a tenth of the motion{advice}"
        )
    return [text for text in sentences if text]
