"""Columns that state of every sample whether it is good: values NaN, or a finding if it is unclear."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, Literal, NamedTuple

import numpy as np

from emgface.recordings.findings import Finding, Kind
from emgface.recordings.readers._build import Part
from emgface.recordings.readers._flags import with_bad_samples
from emgface.recordings.timebase import TimeBase

RowMeaning = Literal["good", "bad", "ignored"]
"""Meaning of 1 in a column of flags, or that it is not used."""

_GOOD: Final = frozenset("valid good ok okay usable accepted visible tracked reliable".split())
_BAD: Final = frozenset(
    "invalid bad artifact artifacts artefact artefacts reject rejected exclude excluded corrupt "
    "corrupted saturated clipped disconnected leadoff occluded unusable noisy".split()
)
_GRADED: Final = frozenset("quality confidence likelihood reliability".split())
_UNCLEAR: Final = frozenset("status mask flag flags".split()) | _GRADED
_NEUTRAL: Final = frozenset(
    "is are emg semg sample samples row rows data frame frames signal signals flag flags mask".split()
)
_TRUE: Final = frozenset("true yes y 1 1.0".split())
_FALSE: Final = frozenset("false no n 0 0.0".split())
_FEW: Final = 10  #: different values of a column of flags
_SHOWN: Final = 5  #: columns that a finding names


Names = Mapping[Kind, Mapping[str, str]]
"""Names of channels and markers by their labels in a file."""
_NAMES: ContextVar[tuple[Names, ...]] = ContextVar("names", default=())


@contextmanager
def named(names: Names) -> Iterator[None]:
    """Within it, a column of flags may also name a channel or marker as a sidecar or mapping does.

    The names of a sidecar are the labels of a mapping.
    """
    token = _NAMES.set((names, *_NAMES.get()))
    try:
        yield
    finally:
        _NAMES.reset(token)


def _given_name(label: str, dim: Kind) -> str:
    """Name of a label after all mappings that apply."""
    for names in _NAMES.get():
        label = names.get(dim, {}).get(label, label)
    return label


class _Flags(NamedTuple):
    meaning: RowMeaning | None
    names: list[str] | None  # channels or markers concerned, all of them if None
    graded: bool


def is_row_flag(label: str) -> bool:
    """Return True for the label of a column that may state which samples are good.

    Examples
    --------
    >>> is_row_flag("isValid"), is_row_flag("M1_likelihood"), is_row_flag("ZYG_L")
    (True, True, False)
    """
    return any(word in _GOOD | _BAD | _UNCLEAR for word in _words(label))


def with_row_flags(
    part: Part,
    dim: Kind,
    base: TimeBase,
    columns: Mapping[str, object],
    stated: Mapping[str, RowMeaning] | None = None,
    home: str = "",
) -> Part:
    """Replace samples that a column of the file calls bad by NaN.

    The `columns` of a file have as many values as stored samples; those of channels are no flags. The
    meaning follows from the label (``valid``, ``artifact``; with the name of a channel or marker, it
    alone is concerned) or from the words in the cells, unless it is `stated`. A column that may be one
    of flags, but is not certain, is a finding. `home` is the begin of labels that names their place.
    """
    if part.data is None:
        return part
    names = [str(name) for name in part.data[dim].values]
    unclear: list[str] = []
    for label, values in columns.items():
        cells = np.asarray(values)
        given = (stated or {}).get(label)
        if cells.shape != (base.stored,) or given == "ignored":
            continue
        if given is None and (label in names or not is_row_flag(label.removeprefix(home))):
            continue
        flags = _meaning(label.removeprefix(home), names, dim)
        bad = _bad(cells, given or flags.meaning)
        if bad is not None:
            by = f"the column {label!r}"
            part = with_bad_samples(part, dim, base, bad, by, flags.names)
        elif _varies(cells, flags.graded or (given or flags.meaning) is not None):
            unclear.append(label)
    return part._replace(findings=[*part.findings, *unused_flags(unclear, dim)])


def unused_flags(unclear: Sequence[str], dim: Kind) -> list[Finding]:
    """Finding on columns that may state which samples are good, if there are any."""
    more = f" and {len(unclear) - _SHOWN} more" if len(unclear) > _SHOWN else ""
    values = {"columns": ", ".join(map(repr, unclear[:_SHOWN])) + more}
    return [Finding("unused_flags", dim, "", values)] if unclear else []


def may_flag_rows(label: str, values: np.ndarray) -> bool:
    """Return True for a column that may mark samples, which no reader applies."""
    graded = any(word in _GRADED for word in _words(label))
    return is_row_flag(label) and _varies(values, graded)


def holds_row_flags(label: str, values: object) -> bool:
    """Return True for a column with the label and the values of flags, which is no signal."""
    cells = np.asarray(values)
    if not is_row_flag(label):
        return False
    if cells.dtype.kind in "biuf":
        numbers = cells.astype(float)
        few = np.unique(numbers[np.isfinite(numbers)]).size <= _FEW
        return few or any(word in _GRADED for word in _words(label))
    return set(_texts(cells).tolist()) <= _TRUE | _FALSE | _GOOD | _BAD | {""}


def _words(label: str) -> list[str]:
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    return re.findall(r"[^\W_]+", spaced.lower())


def _own_words(name: str) -> list[str]:
    return [word for word in _words(name) if word not in _NEUTRAL]


def _meaning(label: str, names: Sequence[str], dim: Kind) -> _Flags:
    """Meaning of a label, None if it is not certain, and the channels or markers that it names.

    Labels of the file take precedence over the names that a mapping gives them.
    """
    words = _words(label)
    graded = any(word in _GRADED for word in words)
    good, bad = (any(word in known for word in words) for known in (_GOOD, _BAD))
    rest = [w for w in words if w not in _GOOD | _BAD | _UNCLEAR | _NEUTRAL]
    concerned = None
    if rest:
        called = {name: _given_name(name, dim) for name in names}
        concerned = [n for n in names if _own_words(n) == rest] or [
            n for n, name in called.items() if _own_words(name) == rest
        ]
    if good == bad or (rest and not concerned):
        return _Flags(None, concerned or None, graded)
    return _Flags("good" if good else "bad", concerned, graded)


def _bad(cells: np.ndarray, meaning: RowMeaning | None) -> np.ndarray | None:
    """Mask of the bad samples; None if the values are not those of flags or the meaning is unclear.

    An empty cell neither calls a sample good nor bad.
    """
    if cells.dtype.kind in "biuf":
        numbers = cells.astype(float)
        finite = numbers[np.isfinite(numbers)]
        if meaning is None or not finite.size or not np.isin(finite, (0.0, 1.0)).all():
            return None
        return numbers != 1.0 if meaning == "good" else numbers == 1.0
    texts = _texts(cells)
    words = set(texts) - {""}
    if words and words <= _GOOD | _BAD:
        return np.isin(texts, list(_BAD)) if words & _BAD else texts == ""
    if meaning is None or not words or not words <= _TRUE | _FALSE:
        return None
    good = np.isin(texts, list(_TRUE))
    return ~good if meaning == "good" else good


def _texts(cells: Iterable[object]) -> np.ndarray:
    return np.array(["" if one != one else str(one).strip().lower() for one in cells])


def _varies(cells: np.ndarray, graded: bool) -> bool:
    """Return True for values that may mark samples: two values, or several of a `graded` column."""
    if cells.dtype.kind in "biuf":
        numbers = cells[np.isfinite(cells.astype(float))].astype(float)
        few = np.unique(numbers)
        return few.size > 1 and (graded or bool(np.isin(few, (0.0, 1.0)).all()))
    words = set(_texts(cells).tolist()) - {""}
    return len(words) > 1 and (graded or words <= _TRUE | _FALSE or bool(words & (_GOOD | _BAD)))
