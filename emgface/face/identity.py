"""Face to which a result belongs: its name and digest, as attributes of every result of a face.

Motions, equilibria, calibrations and activations by inversion state them. What is used with another face
is a finding of `emgface.recordings.belonging`, or refused where it could not be used at all. A treated
face or jaw contains its plans, each with the digest of the model to which it was applied.
"""

import json
from collections.abc import Mapping
from typing import Any, Final

import xarray as xr

from emgface.errors import DataError, FaceError
from emgface.run.digest import dataset_digest

FACE_ATTRIBUTE, DIGEST = "face", "face_digest"  #: attributes of a result
SHOWN_DIGITS: Final = 8  #: digits of a digest in a message
TREATMENT, PARENT = "treatment", "parent"  #: attributes of a treated model
TREATED: Final = "simulated treatment"  #: in the name of a treated face, and of its results
APPLIED_TO: Final = "applied_to"  #: digest, in an entry of `TREATMENT`, of the model before it

Entry = dict[str, Any]


def is_treated(result: Mapping[str, Any]) -> bool:
    """Return True if attributes are those of a treated model, or of a result of a treated face."""
    return TREATMENT in result or TREATED in str(result.get(FACE_ATTRIBUTE, ""))


def belongs(result: xr.Dataset, face: xr.Dataset) -> xr.Dataset:
    """Store name and digest of the face from which a result was computed, and return the result."""
    result.attrs |= {FACE_ATTRIBUTE: str(face.attrs.get("name", "")), DIGEST: dataset_digest(face)}
    return result


def require_face(result: Mapping[str, Any], face: xr.Dataset, what: str) -> None:
    """FaceError if a result states the digest of another face, with which it cannot be used."""
    digest = str(result.get(DIGEST, ""))
    if digest and digest != (here := dataset_digest(face)):
        raise FaceError(
            f"the {what} belongs to the face {str(result.get(FACE_ATTRIBUTE, ''))!r} with digest "
            f"{digest[:SHOWN_DIGITS]}, found the face {str(face.attrs.get('name', ''))!r} with digest "
            f"{here[:SHOWN_DIGITS]}: pass the {what} of this face, or omit it"
        )


def treatments(model: xr.Dataset) -> list[Entry]:
    """Treatments of a face or jaw in their order, each with ``plan``, ``steps`` and ``applied_to``.

    Empty if the model was not treated. Raises DataError if its attribute is not a list of these.
    """
    entries: Any = None
    try:
        entries = json.loads(model.attrs.get(TREATMENT, "[]"))
        valid = isinstance(entries, list) and all(
            isinstance(entry.get("plan"), dict)
            and isinstance(entry.get("steps"), list)
            and all(
                isinstance(step, dict) and {"step", "kind"} <= set(step) for step in entry["steps"]
            )
            and isinstance(entry.get(APPLIED_TO), str)
            for entry in entries
        )
    except (AttributeError, TypeError, ValueError, RecursionError):
        valid = False
    if not valid:
        raise DataError(
            f"the attribute {TREATMENT!r} of {str(model.attrs.get('name', ''))!r} is not a list of "
            "plans with reports of their steps, as 'emgface treat' writes it: treat the model again"
        )
    return entries


def told_treatment(entry: Entry) -> str:
    """Words of a treatment: its plan, and the model to which it was applied."""
    name, before = str(entry["plan"].get("name", "")), entry[APPLIED_TO][:SHOWN_DIGITS]
    return f"the plan {name!r}, applied to the model with digest {before}"


def with_treatment(before: xr.Dataset, after: xr.Dataset, entry: Entry) -> xr.Dataset:
    """Store a treatment in the model after it, with the digest of that before, and return the model."""
    here = dataset_digest(before)
    every = [*treatments(before), {**entry, APPLIED_TO: here}]
    after.attrs |= {
        TREATMENT: json.dumps(every, allow_nan=False),
        PARENT: before.attrs.get(PARENT) or here,
    }
    return after


def treatments_between(before: xr.Dataset, after: xr.Dataset) -> list[Entry]:
    """Treatments that lead from one model to another; empty if both are the same model.

    The digest of `before` is that of a model to which a plan was applied on the way to `after`. Raises
    DataError if it is not: outcomes of two persons, or of two resolutions, are no change by a treatment.
    """
    here = dataset_digest(before)
    every = treatments(after)
    applied = [entry[APPLIED_TO] for entry in every]
    if here in applied:
        return every[applied.index(here) :]
    there = dataset_digest(after)
    if here == there:
        return []
    names = [repr(str(m.attrs.get("name", ""))) for m in (before, after)]
    swapped = there in [entry[APPLIED_TO] for entry in treatments(before)]
    raise DataError(
        f"{names[1]} ({there[:SHOWN_DIGITS]}) is not a treatment of {names[0]} "
        f"({here[:SHOWN_DIGITS]}), expected a model that 'emgface treat' has written from it"
        + (": it is the model before that treatment, exchange both" if swapped else "")
    )
