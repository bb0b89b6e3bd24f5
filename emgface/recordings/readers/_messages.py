"""Messages between processes: plain values as JSON, arrays as bytes, and errors of known types.

A message consists of the lengths of its parts, a JSON text, and the bytes of its arrays. JSON
represents a list as itself and everything else that is no number, text, truth value or None as a list
with one of the `_MARKS` at its beginning. Nothing in a message names a class or module except the
request of the parent process, whose function must be that of an imported module.
"""

import builtins
import json
import math
import struct
from collections.abc import Callable
from functools import reduce
from importlib import import_module
from pathlib import Path
from typing import IO, Any, Final

import numpy as np

from emgface.errors import DataError, SignalError
from emgface.recordings.readers._parsers import AbsentVariable, NotAnArray

_LENGTHS: Final = struct.Struct("<QQ")
_MOST: Final = 1 << 40  #: bytes of a message; a larger length is damaged
_KINDS: Final = "biufcSU"  #: kinds of arrays whose bytes are sent
_LIST, _TUPLE, _DICT, _ARRAY, _TEXTS, _PATH, _FLOAT, _COMPLEX, _BYTES = _MARKS = "ludatpfcb"
_OWN: Final = {kind.__name__: kind for kind in (DataError, SignalError, AbsentVariable, NotAnArray)}


class _Body:
    """Bytes of the arrays of a message, in parts."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.size = 0

    def add(self, values: Any) -> tuple[int, int]:
        """Append an array; return position and number of its bytes."""
        part, start = np.ascontiguousarray(values).tobytes(), self.size
        self.parts.append(part)
        self.size += len(part)
        return start, len(part)


class DamagedMessage(Exception):
    """A message is not of the form of this module."""


def send(stream: IO[bytes] | None, message: object) -> None:
    """Write a message; TypeError if it contains something other than plain values and arrays."""
    assert stream is not None  # opened as a pipe
    body = _Body()
    text = json.dumps(_packed(message, body)).encode()
    stream.write(_LENGTHS.pack(len(text), body.size) + text)
    for part in body.parts:
        stream.write(part)
    stream.flush()


def receive(stream: IO[bytes] | None) -> Any:
    """Read a message; EOFError if the stream ends within it, DamagedMessage if it is invalid."""
    assert stream is not None
    text_size, body_size = _LENGTHS.unpack(_exactly(stream, _LENGTHS.size))
    if max(text_size, body_size) > _MOST:
        raise DamagedMessage("a message of impossible size")
    text, body = _exactly(stream, text_size), _exactly(stream, body_size)
    try:
        return _unpacked(json.loads(text), memoryview(body))
    except (ValueError, TypeError, KeyError, IndexError, RecursionError) as error:
        raise DamagedMessage("a message that cannot be read") from error


def name_of(function: Callable[..., Any]) -> str:
    """Name of a function of a module, such as ``package.module:function``."""
    return f"{function.__module__}:{function.__qualname__}"


def function_of(name: str) -> Callable[..., Any]:
    """Return the function with this name."""
    module, _, path = name.partition(":")
    return reduce(getattr, path.split("."), import_module(module))


def packed_error(error: Exception) -> list[Any]:
    """Type and arguments of an error as a message."""
    known = next(kind for kind in type(error).__mro__ if _known(kind.__name__) is kind)
    if known is type(error):
        arguments: list[Any] = list(error.args)
        try:
            _packed(arguments, _Body())
        except TypeError:
            arguments = [str(error)]
        return [known.__name__, arguments]
    if known is Exception:
        return ["RuntimeError", [f"{type(error).__name__}: {error}"]]
    return [known.__name__, [str(error)]]


def error_of(message: Any) -> Exception:
    """Error from `packed_error`; of an unknown type, a RuntimeError."""
    if not (isinstance(message, list) and len(message) == 2 and isinstance(message[1], list)):
        return DataError("the parser failed without a message")
    name, arguments = str(message[0]), message[1]
    kind = _known(name)
    if kind is not None:
        try:
            return kind(*arguments)
        except TypeError:  # such as UnicodeDecodeError, with other arguments
            pass
    return RuntimeError(f"{name}: {arguments}")


def _known(name: str) -> type[Exception] | None:
    """Class of errors with this name, of `_OWN` or of Python."""
    kind = _OWN.get(name) or getattr(builtins, name, None)
    return kind if isinstance(kind, type) and issubclass(kind, Exception) else None


def _exactly(stream: IO[bytes], size: int) -> bytes:
    data = stream.read(size)
    if len(data) < size:
        raise EOFError
    return data


def _packed(value: Any, body: _Body) -> Any:
    if value is None or isinstance(value, bool | str) or type(value) is int:
        return value
    if isinstance(value, float) and not isinstance(value, np.generic):
        return value if math.isfinite(value) else [_FLOAT, repr(value)]
    if isinstance(value, list | tuple):
        mark = _LIST if isinstance(value, list) else _TUPLE
        return [mark, *(_packed(each, body) for each in value)]
    if isinstance(value, dict):
        return [_DICT, *([_packed(k, body), _packed(v, body)] for k, v in value.items())]
    if isinstance(value, bytes):
        return [_BYTES, value.hex()]
    if isinstance(value, complex) and not isinstance(value, np.generic):
        return [_COMPLEX, repr(value.real), repr(value.imag)]
    if isinstance(value, Path):
        return [_PATH, str(value)]
    if isinstance(value, np.ndarray | np.generic):
        array: Any = np.asarray(value)
        if array.dtype.kind in _KINDS and array.dtype.names is None:
            return [_ARRAY, array.dtype.str, list(array.shape), *body.add(array)]
        if array.dtype == object:
            return [_TEXTS, list(array.shape), [_packed(each, body) for each in array.ravel()]]
    raise TypeError(f"{type(value).__name__} cannot be sent, expected plain values and arrays")


def _unpacked(value: Any, body: memoryview) -> Any:
    if not isinstance(value, list):
        return value
    mark, *rest = value
    if mark in (_LIST, _TUPLE):
        values = [_unpacked(each, body) for each in rest]
        return values if mark == _LIST else tuple(values)
    if mark == _DICT:
        return {_unpacked(k, body): _unpacked(v, body) for k, v in rest}
    if mark == _ARRAY:
        kind, shape, start, size = rest
        dtype = np.dtype(kind)
        if dtype.kind not in _KINDS or start < 0 or size < 0 or start + size > len(body):
            raise ValueError("an array outside the message")
        array = np.frombuffer(body[start : start + size], dtype).reshape(shape)
        return array.copy() if shape else array[()]
    if mark == _TEXTS:
        shape, values = rest
        made = np.empty(len(values), dtype=object)
        made[:] = [_unpacked(each, body) for each in values]
        return made.reshape(shape)
    if mark == _PATH:
        return Path(rest[0])
    if mark == _BYTES:
        return bytes.fromhex(rest[0])
    if mark == _COMPLEX:
        return complex(float(rest[0]), float(rest[1]))
    if mark == _FLOAT:
        return float(rest[0])
    raise ValueError(f"the mark {mark!r}, expected one of {_MARKS}")
