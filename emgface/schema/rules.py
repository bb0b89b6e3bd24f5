"""Rules for arrays, each of which returns a sentence if it is violated."""

import difflib
import hashlib
import json
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Final

import numpy as np
import xarray as xr

from emgface.errors import listed
from emgface.schema.declaration import ArrayDeclaration

Rule = Callable[[xr.DataArray], str | None]
"""Rule: returns None, or a sentence on what was found, expected and what to try."""

SLACK = 1e-9  #: fraction of a range by which rounding may exceed it

_KINDS = {"float64": "f", "number": "iuf", "string": "UTO"}
_WANTED = {"float64": "64-bit floats", "number": "numbers", "string": "strings"}


def nearest(name: str, valid: Iterable[str], cutoff: float = 0.6) -> str | None:
    """Return the valid name most similar to `name`, or None."""
    valid = [str(v) for v in valid]
    folded = {v.lower(): v for v in valid}
    matches = difflib.get_close_matches(name.lower(), list(folded), n=1, cutoff=cutoff)
    return folded[matches[0]] if matches else None


def one_line(error: Exception) -> str:
    """Return the type and the message of an error of a library, on one line."""
    return f"{type(error).__name__}: {' '.join(str(error).split())}".rstrip(": ")


def hint(name: str, valid: Iterable[str]) -> str:
    """Return the end of a sentence with the nearest valid name, if any."""
    near = nearest(name, valid)
    return f" (did you mean {near!r}?)" if near else ""


def _where(array: xr.DataArray, mask: np.ndarray) -> str:
    """Describe the first position where `mask` is True, by coordinate if there is one."""
    if array.ndim == 0:
        return ""
    first = np.unravel_index(int(np.argmax(mask)), mask.shape)
    parts = []
    for dim, i in zip(array.dims, first, strict=True):
        label = array.coords[dim].values[i] if dim in array.coords else i
        shown = f"{label:.6g}" if isinstance(label, float) else str(label)
        parts.append(f"{dim} {shown}")
    return " at " + ", ".join(parts)


def type_rule(declared: ArrayDeclaration) -> Rule:
    """Values have the declared kind; integers may have any sufficient width."""

    def rule(array: xr.DataArray) -> str | None:
        dtype = array.dtype
        kind = "T" if dtype.kind == "T" else dtype.kind
        if declared.dtype.startswith("int"):
            if kind not in "iu":
                return f"contains {dtype}; expected integers: convert with .astype('int32')"
            limits = np.iinfo(declared.dtype)
            if array.size and (array.max() > limits.max or array.min() < limits.min):
                return f"contains integers beyond {declared.dtype}: renumber from 0"
            return None
        fits = kind in _KINDS[declared.dtype]
        if fits and declared.dtype == "float64" and dtype.itemsize != 8:
            fits = False
        if fits and kind == "O":
            fits = all(isinstance(v, str) for v in array.values.ravel())
        if fits:
            return None
        to = "str" if declared.dtype == "string" else "float64"
        return f"contains {dtype}; expected {_WANTED[declared.dtype]}: convert with .astype({to!r})"

    return rule


def finite_rule(declared: ArrayDeclaration) -> Rule:
    """No infinity, and no NaN unless declared nullable."""

    def rule(array: xr.DataArray) -> str | None:
        if array.dtype.kind != "f":
            return None
        bad = np.isinf(array.values) if declared.nullable else ~np.isfinite(array.values)
        if not bad.any():
            return None
        what = "infinite" if declared.nullable else "not finite"
        return (
            f"has {int(bad.sum())} of {bad.size} values {what}, the first{_where(array, bad)}; "
            f"expected {'numbers or NaN' if declared.nullable else 'numbers only'}: "
            "repair the source or leave the trial out"
        )

    return rule


def range_rule(declared: ArrayDeclaration) -> Rule:
    """Values are in the declared range, up to rounding."""
    low, high = declared.range or (None, None)
    lower = -np.inf if low is None else low
    upper = np.inf if high is None else high
    slack = SLACK * (upper - lower) if np.isfinite(upper - lower) else 0.0

    def rule(array: xr.DataArray) -> str | None:
        values = array.values
        if array.dtype.kind not in "iuf" or not values.size:
            return None
        # Comparisons with NaN are false; `finite_rule` decides on NaN.
        bad = (values < lower - slack) | (values > upper + slack)
        if not bad.any():
            return None
        unit = "" if declared.units in (None, "1") else f" {declared.units}"
        worst = values.ravel()[int(np.argmax(bad))]
        expected = (
            f"{low:g} to {high:g}"
            if low is not None and high is not None
            else (f"at least {low:g}" if low is not None else f"at most {high:g}")
        )
        advice = f": check whether the values really are in{unit}" if unit else ""
        return f"is {worst:.6g}{unit}{_where(array, bad)}; expected {expected}{unit}{advice}"

    return rule


def names_rule(declared: ArrayDeclaration) -> Rule:
    """Strings are among the declared names, or exactly those if declared complete."""
    names = declared.names or ()

    def rule(array: xr.DataArray) -> str | None:
        values = [str(v) for v in array.values.ravel()]
        unknown = [v for v in values if v not in names]
        if unknown:
            return f"contains {unknown[0]!r}{hint(unknown[0], names)}; expected {listed(names)}"
        if declared.complete and tuple(values) != tuple(names):
            return f"is {listed(values)}; expected {listed(names)} in this order: use .sel(...)"
        return None

    return rule


def pattern_rule(declared: ArrayDeclaration) -> Rule:
    """Every string matches the declared regular expression in full."""
    pattern = re.compile(declared.pattern or "")

    def rule(array: xr.DataArray) -> str | None:
        for value in np.unique(array.values.astype(str)):
            if not pattern.fullmatch(str(value)):
                return f"contains {str(value)!r}; expected {declared.pattern}"
        return None

    return rule


def unique_rule(array: xr.DataArray) -> str | None:
    """No value occurs twice."""
    values, counts = np.unique(array.values.astype(str), return_counts=True)
    if (counts <= 1).all():
        return None
    return f"contains {str(values[counts > 1][0])!r} more than once; expected each once: rename one"


def increasing_rule(array: xr.DataArray) -> str | None:
    """Every value is larger than the preceding one."""
    step = np.diff(array.values)
    if step.size == 0 or (step > 0).all():
        return None
    at = int(np.argmin(step > 0))
    before, after = array.values[at : at + 2]
    return (
        f"goes from {before:.6g} to {after:.6g} at sample {at + 1}; expected increasing values: "
        "sort the samples or repair the clock"
    )


def length_rule(declared: ArrayDeclaration) -> Rule:
    """Vectors along the declared dim have length one."""

    def rule(array: xr.DataArray) -> str | None:
        if declared.unit_length not in array.dims:
            return None
        axis = array.dims.index(declared.unit_length)
        length = np.sqrt(np.sum(array.values**2, axis=axis))
        bad = np.abs(length - 1.0) > 1e-6
        if not bad.any():
            return None
        first = int(np.argmax(bad))
        return f"has length {length.ravel()[first]:.6g} at row {first}; expected 1: normalise it"

    return rule


def index_rule(declared: ArrayDeclaration, size: int) -> Rule:
    """Values are positions below `size`, or the declared fill."""

    def rule(array: xr.DataArray) -> str | None:
        values = array.values
        if array.dtype.kind not in "iu":
            return None
        bad = ((values < 0) | (values >= size)) & (values != declared.fill)
        if not bad.any():
            return None
        return (
            f"points to {declared.index_into} {int(values.ravel()[int(np.argmax(bad))])}"
            f"{_where(array, bad)}; expected 0 to {size - 1}: positions count from 0, "
            "they are not identifiers"
        )

    return rule


INDEX_ORDER: Final = "index_order"
"""Attribute of an index: digest of the names along its dim, in the order that its numbers mean."""


def order_of(names: xr.DataArray) -> str:
    """Digest of names in their order."""
    text = json.dumps([str(name) for name in names.values])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def order_rule(names: xr.DataArray) -> Rule:
    """The names along the dim of an index are those, and in the order, that its numbers mean.

    Selecting along that dim reorders the names but not the numbers.
    """

    def rule(array: xr.DataArray) -> str | None:
        if array.attrs.get(INDEX_ORDER, order_of(names)) == order_of(names):
            return None
        return (
            f"is an index into {names.dims[0]!r}, whose names or order have changed since; expected "
            "those with which it was made, because its numbers would mean others: pass the object as "
            f"it was read, and select from results; after a change of both, delete {INDEX_ORDER!r}"
        )

    return rule


def rules_of(declared: ArrayDeclaration) -> Iterator[tuple[str, Rule]]:
    """Yield the rules that require only the array, the most basic first."""
    if declared.dtype != "string":
        yield "finite", finite_rule(declared)
    if declared.range:
        yield "range", range_rule(declared)
    if declared.names is not None:
        yield "names", names_rule(declared)
    if declared.pattern is not None:
        yield "pattern", pattern_rule(declared)
    if declared.unique:
        yield "unique", unique_rule
    if declared.increasing:
        yield "increasing", increasing_rule
    if declared.unit_length is not None:
        yield "length", length_rule(declared)
