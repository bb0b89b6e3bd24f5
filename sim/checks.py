"""Checks of the numbers that are arguments of the parts of a scene and of a simulation."""

import math
from collections.abc import Callable
from dataclasses import fields
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from sim.errors import SceneError
from sim.pattern import Array

T = TypeVar("T")
Refused = type[Exception]


def number(place: str, name: str, value: object, *, error: Refused = SceneError) -> float:
    """Real number from an argument; infinite numbers are allowed.

    True and False are refused, which Python would take for 1 and 0, as are texts, complex numbers,
    arrays and NaN. Raises the given error.
    """
    value_as_array = _array(value)
    if (
        value_as_array.ndim == 0
        and value_as_array.dtype.kind in "iuf"
        and not np.isnan(value_as_array)
    ):
        return float(value_as_array)
    raise error(f"{place}: {name} = {_shown(value)}, expected a real number")


def whole(
    place: str, name: str, value: object, *, least: int = 0, error: Refused = SceneError
) -> int:
    """Whole number of at least `least`; raises as `number`."""
    checked = number(place, name, value, error=error)
    if math.isfinite(checked) and checked == round(checked) and checked >= least:
        return int(checked)
    raise error(f"{place}: {name} = {_shown(value)}, expected a whole number of at least {least}")


def require(
    part: object,
    name: str,
    value: float,
    *,
    least: float = -math.inf,
    above: float = -math.inf,
    below: float = math.inf,
) -> None:
    """Raise SceneError unless a number is finite, at least `least`, above `above` and below `below`."""
    number(type(part).__name__, name, value)
    if math.isfinite(value) and value >= least and above < value < below:
        return
    bounds = ((">=", least), (">", above), ("<", below))
    wanted = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if math.isfinite(bound))
    raise SceneError(
        f"{type(part).__name__}: {name} = {value!r}, expected a finite number {wanted}".rstrip()
    )


def real_numbers(part: type[T]) -> type[T]:
    """Check the numbers of a dataclass, in the order of its fields, before its own checks.

    Applied below ``@dataclass``. Fields of type float and int must be real and whole numbers, and
    arrays and tuples of float consist of real numbers; None is allowed where the type has it. Raises
    SceneError.
    """
    own: Callable[[Any], None] | None = getattr(part, "__post_init__", None)

    def __post_init__(self: Any) -> None:
        for f in fields(self):
            _check(type(self).__name__, f.name, getattr(self, f.name), types_of(f.type))
        if own is not None:
            own(self)

    setattr(part, "__post_init__", __post_init__)  # noqa: B010
    return part


def types_of(hint: object) -> tuple[object, ...]:
    """Members of a union, or the type itself."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def many(hint: object) -> bool:
    """Test if a type consists of several real numbers: an array or a tuple of float."""
    return hint == Array or (get_origin(hint) is tuple and get_args(hint)[:1] == (float,))


def _check(place: str, name: str, value: object, types: tuple[object, ...]) -> None:
    """Check a value by the members of its type; other types than numbers are not checked."""
    several = any(map(many, types))
    single = float in types or int in types
    if not (several or single) or (value is None and type(None) in types):
        return
    if single and _array(value).ndim == 0:
        if float in types:
            number(place, name, value)
        else:
            whole(place, name, value)
    elif several:
        if _array(value).dtype.kind not in "iuf":
            raise SceneError(f"{place}: {name} = {_shown(value)}, expected real numbers")
    else:
        raise SceneError(f"{place}: {name} = {_shown(value)}, expected one number")


def _array(value: object) -> NDArray[Any]:
    """Return an array of a value; of its text for lists of different lengths, which are none."""
    try:
        return np.asarray(value)
    except (ValueError, TypeError):
        return np.asarray(str(value))


def _shown(value: object) -> str:
    """Return a short text of a value."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
