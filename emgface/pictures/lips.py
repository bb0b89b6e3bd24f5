"""Sentences of pages on the distance of the lips, which a face without loads need not close."""

import numpy as np
import xarray as xr

from emgface.face.lip_shape import lip_opening

OPENING = "lip_opening"


def lips_at_rest(face: xr.Dataset) -> str:
    """Sentence on the opening between the lips of a face_model without loads; '' if it has no lips."""
    if f"{OPENING}_node" not in face:
        return ""
    opening = lip_opening(face, face["position"].values)
    return (
        f"Without loads, the margins of the lips are {1e3 * opening:.1f} mm apart in the midline."
    )


def lips_of_motion(motion: xr.Dataset) -> str:
    """Sentence on the opening between the lips over a trajectory; '' if it does not contain it.

    The opening is the height of the margin of the upper lip above that of the lower one; it is
    negative where one lip is in front of the other (`emgface.face.lip_shape.lip_opening`).
    """
    if OPENING not in motion or not np.isfinite(motion[OPENING].values).any():
        return ""
    opening = 1e3 * motion[OPENING].values
    least = int(np.nanargmin(opening))
    at = f"at {float(motion['time'].values[least]):.2f} s"
    start = f"The margins of the lips are {opening[0]:.1f} mm apart in the midline at the start"
    if opening[least] < -0.05:  # what is printed as 0.0 mm is a contact of the margins
        return (
            f"{start}; {at} one lip is in front of the other by {-opening[least]:.1f} mm in height."
        )
    return f"{start}, and {max(opening[least], 0.0):.1f} mm where they are closest ({at})."
