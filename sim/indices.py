"""Indices of nodes, elements and others: numbers or a mask, checked at one place."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim.errors import SceneError
from sim.pattern import Index

Refused = type[Exception]


def indices(
    place: str, what: str, given: ArrayLike, n: int | None, *, error: Refused = SceneError
) -> Index:
    """Indices (k,) from whole numbers in 0..n - 1, or from a mask (n,) of those that are meant.

    `place` and `what` name the part and what it counts in messages. Without n the range of the numbers
    is not checked; a mask then raises, because its length cannot be checked.

    Raises the given error for other shapes and types, numbers that are not whole, negative or too large,
    and masks of another length.
    """
    values = np.asarray(given)
    if values.dtype == bool and n is not None:
        if values.shape != (n,):
            raise error(
                f"{place}: the mask of {what}s has shape {values.shape}, expected ({n},), one per {what}"
            )
        return np.flatnonzero(values)
    if values.ndim != 1:
        raise error(
            f"{place}: the {what}s have shape {values.shape}, expected a list of numbers (k,) or a mask"
        )
    return _whole(place, what, values, n, error)


def node_indices(place: str, given: ArrayLike, n: int, n_points: int) -> Index:
    """As `indices` for n nodes, of which the last n_points are points outside the mesh.

    A mask may also be one of the other nodes, those of the mesh.
    """
    values = np.asarray(given)
    if n_points and values.dtype == bool and values.shape == (n - n_points,):
        return np.flatnonzero(values)
    return indices(place, "node", given, n)


def index_rows(
    place: str,
    what: str,
    given: ArrayLike,
    n: int | None,
    width: int | None,
    *,
    error: Refused = SceneError,
) -> Index:
    """Rows (m, width) of indices, such as the nodes of elements; a mask is refused.

    With the width None the shape is free. Raises as `indices`.
    """
    values = np.asarray(given)
    if width is not None and values.size == 0:
        values = values.reshape(-1, width)
    if width is not None and (values.ndim != 2 or values.shape[1] != width):
        raise error(
            f"{place}: the {what}s have shape {values.shape}, expected (m, {width}), {width} in a row"
        )
    return _whole(place, what, values, n, error)


def index(
    place: str, what: str, given: object, n: int | None, *, error: Refused = SceneError
) -> int:
    """One index in 0..n - 1; raises as `indices`."""
    value = np.asarray(given)
    if value.ndim:
        raise error(f"{place}: the {what} has shape {value.shape}, expected one number")
    return int(_whole(place, what, value.reshape(1), n, error)[0])


def kept_until_known(
    place: str, what: str, given: ArrayLike
) -> NDArray[np.int64] | NDArray[np.bool_]:
    """Numbers (k,) checked without their range, or a mask, which `indices` checks when n is known."""
    values = np.asarray(given)
    if values.dtype == bool and values.ndim == 1:
        return values
    return indices(place, what, given, None)


def whole_numbers(place: str, what: str, given: ArrayLike, *, error: Refused = SceneError) -> Index:
    """Whole numbers of any shape and sign, such as codes; raises as `indices` for other values."""
    return _whole(place, what, np.asarray(given), None, error, least=None)


def count_of(given: ArrayLike) -> int:
    """Number of indices that numbers or a mask mean."""
    values = np.asarray(given)
    return int(np.count_nonzero(values)) if values.dtype == bool else len(values)


def _whole(
    place: str,
    owner: str,
    given: NDArray[np.generic],
    n: int | None,
    error: Refused,
    least: int | None = 0,
) -> Index:
    """Checked numbers as int64."""
    if given.dtype.kind not in "iuf":
        if given.size == 0 and given.dtype.kind != "b":
            return np.empty(given.shape, dtype=np.int64)
        what = (
            "true and false values" if given.dtype.kind == "b" else f"values of type {given.dtype}"
        )
        raise error(f"{place}: the {owner}s are {what}, expected whole numbers")
    if given.dtype.kind == "f":
        values = given.astype(np.float64)
        good = np.isfinite(values) & (values == np.round(values)) & (np.abs(values) < 2.0**53)
        if not good.all():
            at = tuple(int(i) for i in np.argwhere(~good)[0])
            raise error(
                f"{place}: {owner} {float(values[at])!r} at place {_shown(at)} is no whole number, "
                "expected indices from 0 or a mask"
            )
    whole = given.astype(np.int64)
    # unsigned numbers above the largest int64 become negative
    low = np.iinfo(np.int64).min if least is None else least
    outside: NDArray[np.bool_] = whole < low
    if n is not None:
        outside = outside | (whole >= n)
    if outside.any():
        at = tuple(int(i) for i in np.argwhere(outside)[0])
        allowed = "a number from 0" if n is None else f"0..{n - 1}"
        raise error(
            f"{place} refers to {owner} {given[at]}, expected {allowed} (at place {_shown(at)})"
        )
    return whole


def _shown(at: tuple[int, ...]) -> str:
    return str(at[0]) if len(at) == 1 else str(at)
