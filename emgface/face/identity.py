"""Face to which a result belongs: its name and digest, as attributes of every result of a face.

Motions, equilibria, calibrations and activations by inversion state them. What is used with another face
is a finding of `emgface.recordings.belonging`, or refused where it could not be used at all.
"""

from collections.abc import Mapping
from typing import Any, Final

import xarray as xr

from emgface.errors import FaceError
from emgface.run.digest import dataset_digest

NAME, DIGEST = "face", "face_digest"  #: attributes of a result
SHOWN: Final = 8  #: digits of a digest in a message


def belongs(result: xr.Dataset, face: xr.Dataset) -> xr.Dataset:
    """Store name and digest of the face from which a result was computed, and return the result."""
    result.attrs |= {NAME: str(face.attrs.get("name", "")), DIGEST: dataset_digest(face)}
    return result


def require_face(result: Mapping[str, Any], face: xr.Dataset, what: str) -> None:
    """FaceError if a result states the digest of another face, with which it cannot be used."""
    digest = str(result.get(DIGEST, ""))
    if digest and digest != (here := dataset_digest(face)):
        raise FaceError(
            f"the {what} belongs to the face {str(result.get(NAME, ''))!r} with digest "
            f"{digest[:SHOWN]}, found the face {str(face.attrs.get('name', ''))!r} with digest "
            f"{here[:SHOWN]}: pass the {what} of this face, or omit it"
        )
