"""Checks of the attributes of a dataset and of the requirements of a study."""

from collections.abc import Collection

import numpy as np
import xarray as xr

from emgface.errors import listed
from emgface.schema.declaration import AttributeDeclaration, ObjectDeclaration
from emgface.schema.rules import hint, nearest

Problem = tuple[bool, str]  #: problem: True if it concerns a unit, and the message


def attribute_problems(dataset: xr.Dataset, declared: ObjectDeclaration) -> list[Problem]:
    """Presence, type and value of the attributes of the dataset."""
    problems: list[Problem] = []
    for name, wanted in declared.attrs.items():
        if name not in dataset.attrs:
            if wanted.required:
                expected = f"one of {', '.join(wanted.values)}" if wanted.values else wanted.dtype
                text = f"The attribute {name!r} is missing; expected {expected} ({wanted.meaning})"
                problems.append((False, f"{text}: set it on the dataset."))
            continue
        wrong = _attribute(dataset.attrs[name], wanted)
        if wrong:
            problems.append((False, f"The attribute {name!r} is {wrong}."))
    return problems


def _attribute(value: object, wanted: AttributeDeclaration) -> str | None:
    """Return the problem of the value of an attribute."""
    types: dict[str, tuple[type, ...]] = {
        "string": (str,),
        "integer": (int, np.integer),
        "number": (int, float, np.integer, np.floating),
        "any": (str, int, float, np.integer, np.floating),
    }
    if not isinstance(value, types[wanted.dtype]) or isinstance(value, bool):
        kind = "text or number" if wanted.dtype == "any" else wanted.dtype
        return f"{value!r}; expected {kind} ({wanted.meaning})"
    if wanted.values and value not in wanted.values:
        options = ", ".join(wanted.values)
        return f"{value!r}{hint(str(value), wanted.values)}; expected one of {options}"
    if wanted.range and isinstance(value, (int, float, np.number)):
        low, high = wanted.range
        if (low is not None and value < low) or (high is not None and value > high):
            bounds = f"at least {low}" if high is None else f"{low} to {high}"
            return f"{value!r}; expected {bounds} ({wanted.meaning})"
    return None


def study_problems(
    dataset: xr.Dataset, declared: ObjectDeclaration, reported: str, partial: Collection[str] = ()
) -> list[Problem]:
    """Find the requirements of a study that the dataset lacks, except those in `reported`.

    Coordinates in `partial` may lack names.
    """
    demand = declared.study
    if demand is None:
        return []
    problems: list[Problem] = []
    for name in demand.required:
        if name in dataset.variables or name in dataset.attrs:
            continue
        if repr(name) not in reported and not (name in declared.any_of and "none of" in reported):
            text = f"The variable {name!r} is missing; a study requires {demand.meaning}."
            if name in declared.attrs:
                meaning = declared.attrs[name].meaning
                text = (
                    f"The attribute {name!r} is missing; a study requires it ({meaning}): set it on "
                    "the dataset, or in the mapping of its labels."
                )
            problems.append((False, text))
    for coord, names in demand.names.items():
        if coord not in dataset.coords or coord in partial:
            continue
        present = [str(v) for v in dataset.coords[coord].values]
        missing = [name for name in names if name not in present]
        if missing:
            unknown = [name for name in present if name not in names]
            guess = {m: nearest(m, unknown, cutoff=0.75) for m in missing}
            near = [f"{there!r} may be {want!r}" for want, there in guess.items() if there]
            advice = listed(near, 3) if near else "map the labels of the file to these names"
            text = (
                f"{coord} lacks {listed(missing, 20)}; a study requires {demand.meaning}: {advice}."
            )
            problems.append((False, text))
    return problems
