"""Digest of the recipe of a scene: its content, independent of the process and of the order of terms."""

import dataclasses
import functools
import hashlib
import types
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np

from sim.scene import Scene

DEEPEST_NESTING = 40  #: nesting beyond which a part counts by its type alone


def digest_of(scene: Scene) -> bytes:
    """Digest (16 bytes) of a scene; the order of its terms, members and constraints does not matter.

    Functions, such as prescribed motions, count by their code and by the values that they enclose.
    """
    parts = {f.name: getattr(scene, f.name) for f in dataclasses.fields(scene)}
    for name in ("terms", "reductions", "constraints"):
        parts[name] = sorted(digest(part) for part in parts[name])
    return digest(parts)


def names_of(parts: Sequence[object]) -> list[str]:
    """Names such as ``Solid[0]`` of some parts: labels, or types, numbered in the order of digests."""
    labels = [getattr(part, "label", type(part).__name__) for part in parts]
    own = [
        (label, digest(part), i) for i, (label, part) in enumerate(zip(labels, parts, strict=True))
    ]
    place, count = dict[int, str](), dict[str, int]()
    for kind, _, i in sorted(own):
        place[i] = f"{kind}[{count.get(kind, 0)}]"
        count[kind] = count.get(kind, 0) + 1
    return [place[i] for i in range(len(parts))]


def digest(value: object) -> bytes:
    """Digest (16 bytes) of numbers, texts, arrays, containers, functions and other objects."""
    hasher = hashlib.blake2b(digest_size=16)
    _add(hasher, value, 0)
    return hasher.digest()


def _add(to: Any, value: Any, depth: int) -> None:
    """Add a value to a hash, with its kind and size, so that neighbours cannot be confused."""
    if value is None or isinstance(value, str | bytes):
        data = repr(value).encode()
        to.update(b"t%d:" % len(data) + data)
    elif isinstance(value, bool | int | float | np.number | np.bool_):
        number = float(cast("float", value))
        to.update(b"n" + number.hex().encode() + b";")
    elif isinstance(value, np.ndarray):
        _add_array(to, cast("np.ndarray[Any, Any]", value))
    elif depth > DEEPEST_NESTING:
        to.update(b"d" + type(value).__qualname__.encode())
    elif isinstance(value, Mapping):
        rows = cast("Mapping[Any, Any]", value)
        to.update(b"m%d:" % len(rows))
        for key in sorted(rows, key=repr):
            _add(to, key, depth + 1)
            _add(to, rows[key], depth + 1)
    elif isinstance(value, list | tuple | set | frozenset):
        rows = cast("Sequence[Any]", value)
        if rows and all(isinstance(row, int | float | np.number) for row in rows):
            _add_array(to, np.asarray([*rows], dtype=np.float64))  # as the array of these numbers
            return
        ordered = rows if isinstance(value, list | tuple) else sorted(rows, key=repr)
        to.update(b"s%d:" % len(rows))
        for row in ordered:
            _add(to, row, depth + 1)
    elif isinstance(value, types.CodeType):
        _add(to, (value.co_code, value.co_names), depth + 1)
        _add(to, value.co_consts, depth + 1)
    elif isinstance(value, functools.partial):
        _add(to, (value.func, value.args, value.keywords), depth + 1)
    elif isinstance(value, types.MethodType):
        _add(to, (value.__func__, value.__self__), depth + 1)
    elif isinstance(value, types.FunctionType):
        enclosed = [cell.cell_contents for cell in value.__closure__ or ()]
        about = value.__module__, value.__qualname__, value.__code__
        _add(to, (*about, value.__defaults__, value.__kwdefaults__, enclosed), depth + 1)
    else:
        _add_object(to, value, depth)


def _add_array(to: Any, array: "np.ndarray[Any, Any]") -> None:
    to.update(b"a" + repr(array.shape).encode())
    if array.dtype.kind not in "buif":
        to.update(repr(array.tolist()).encode())
        return
    kind = b"b" if array.dtype.kind == "b" else b"n"
    to.update(kind + np.ascontiguousarray(array, dtype=np.float64).tobytes())


def _add_object(to: Any, value: Any, depth: int) -> None:
    """Add the type of an object, and its fields or public attributes."""
    kind: type = value if isinstance(value, type) else type(value)
    to.update(b"o" + f"{kind.__module__}.{kind.__qualname__}".encode())
    if isinstance(value, type | types.ModuleType | types.BuiltinFunctionType):
        return
    if dataclasses.is_dataclass(value):
        own = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
    else:
        own = {k: v for k, v in getattr(value, "__dict__", {}).items() if not k.startswith("_")}
    _add(to, own, depth + 1)
