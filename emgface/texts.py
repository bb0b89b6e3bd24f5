"""Text of files that users supply, whatever encoding they were saved in, and TOML files.

Editors and spreadsheets save text as UTF-8, with or without a byte order mark, as UTF-16, or in a
code page. All text files of users are opened here, so that each of these is read everywhere.
"""

import codecs
import csv
import gzip
import io
import json
import math
import re
import tomllib
import zlib
from pathlib import Path
from typing import Any, Final

from emgface.errors import ConfigurationError, DataError

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),  # before UTF-16, whose mark it begins with
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte order marks and the codecs that remove them."""
EXPANDED, TEXT_EXPANSION = 32 << 20, 32
"""Largest size of a compressed text [byte], and addition per byte of the file.

Tables of signals are compressed to a third to a tenth; only repetition exceeds the limit.
"""
LONGEST_TOML: Final = 8 << 20  #: largest TOML file [byte]; a study file has 30 kB
DEEPEST_TABLES: Final = 32  #: most tables or arrays that contain one another


def marked_encoding(start: bytes) -> str | None:
    """Return the encoding stated by a byte order mark, or shown by the zeros of UTF-16.

    Examples
    --------
    >>> marked_encoding("t,EMG".encode("utf-16-le")), marked_encoding(b"t,EMG")
    ('utf-16-le', None)
    """
    encoding = next((name for mark, name in _MARKS if start.startswith(mark)), None)
    if encoding is not None:
        return encoding
    # UTF-16 of western text without a mark has a zero in every second byte.
    head = start[: 2 * (min(len(start), 4096) // 2)]
    even, odd = head[::2].count(0), head[1::2].count(0)
    if min(even, odd) == 0 and max(even, odd) > 0.4 * len(head) / 2:
        return "utf-16-le" if odd else "utf-16-be"
    return None


def decoded(data: bytes, encoding: str = "utf-8", *, fallback: str | None = None) -> str:
    """Decode the bytes of a text file, without a byte order mark.

    A byte order mark, or the zeros of UTF-16, take precedence over `encoding`. If the bytes do not
    have this encoding, `fallback` is used. Raises UnicodeDecodeError if that is None.
    """
    codec = marked_encoding(data) or encoding
    try:
        return data.decode(codec)
    except UnicodeDecodeError:
        if fallback is None:
            raise
        return data.decode(fallback, "replace")


def read_bytes(path: Path, most: int | None = None) -> bytes:
    """Read a file, decompressed if its suffix is ``.gz``; `most` bytes of it if specified.

    Raises DataError if a compressed file expands beyond `EXPANDED` and `TEXT_EXPANSION`, is truncated or
    damaged, and OSError if it cannot be read.
    """
    if path.suffix.lower() != ".gz":
        with path.open("rb") as stream:
            return stream.read() if most is None else stream.read(most)
    limit = EXPANDED + TEXT_EXPANSION * path.stat().st_size
    try:
        with gzip.open(path) as stream:
            data = stream.read(limit + 1 if most is None else most)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise DataError(
            f"{path.name} cannot be decompressed ({error}); expected a complete gzip file: it is "
            "truncated or damaged, copy it again."
        ) from error
    if len(data) > limit:
        raise DataError(
            f"{path.name} has {path.stat().st_size} bytes and expands to more than {limit}; expected "
            f"at most {TEXT_EXPANSION} bytes per compressed byte: decompress it if it is yours."
        )
    return data


def read_text(path: Path, encoding: str = "utf-8", *, fallback: str | None = None) -> str:
    """Read a text file as `decoded`, decompressed if its suffix is ``.gz``.

    Raises OSError, UnicodeDecodeError, and DataError as `read_bytes`.
    """
    return decoded(read_bytes(path), encoding, fallback=fallback)


def open_text(path: Path, encoding: str = "utf-8") -> io.StringIO:
    """Return a stream of the text of `read_text`, with the line ends of the file."""
    return io.StringIO(read_text(path, encoding), newline="")


def labelled(stream: io.StringIO, delimiter: str = ",") -> io.StringIO:
    """Return the stream of a table, at its begin; ValueError if two columns have the same label.

    pandas would rename the second one. Lines that are empty or begin with ``#`` precede the labels.
    """
    head = next((x for x in stream if x.strip() and not x.lstrip().startswith("#")), "")
    stream.seek(0)
    try:
        labels = [label.strip() for label in next(csv.reader([head], delimiter=delimiter), [])]
    except csv.Error as error:  # a label of more than 128 KiB
        raise ValueError(str(error)) from error
    twice = next((label for label in labels if label and labels.count(label) > 1), None)
    if twice is not None:
        raise ValueError(f"two columns are called {twice!r}, expected different names")
    return stream


def json_in(text: str) -> Any:
    """Return the value of a text in JSON, such as the header or sidecar of a file.

    Raises ValueError if it is not JSON, if a number is not finite (JSON has no NaN, and 1e999 is
    infinite), or if a name occurs twice in an object, and RecursionError if it is too deep.
    """
    return json.loads(
        text, parse_constant=finite, parse_float=finite, object_pairs_hook=_named_once
    )


def finite(text: str) -> float:
    """Return the number of a text; ValueError if it is not finite."""
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text} is no finite number")
    return number


def _named_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice!r} occurs twice")
    return table


def value_of_toml(text: str) -> Any:
    """Value of a text as in a TOML file, where names may lack their quotation marks.

    Examples
    --------
    >>> value_of_toml("1e-3"), value_of_toml("none"), value_of_toml("['lips']")
    (0.001, 'none', ['lips'])
    """
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError):
        return text


def read_toml(path: Path) -> dict[str, Any]:
    """Return the tables of a TOML file.

    Raises ConfigurationError if the file is absent, is not TOML, larger than `LONGEST_TOML` or
    deeper than `DEEPEST_TABLES`.
    """
    try:
        size = path.stat().st_size
        text = read_text(path) if size <= LONGEST_TOML else ""
    except OSError as error:
        raise ConfigurationError(
            f"Cannot read {path}: {error.strerror}; expected a TOML file: check its path."
        ) from error
    except UnicodeDecodeError as error:
        raise _not_toml(path.name, error) from error
    if size > LONGEST_TOML:
        raise ConfigurationError(
            f"{path.name} has {size / 2**20:.0f} MiB; expected a TOML file of at most "
            f"{LONGEST_TOML >> 20} MiB: it is another file."
        )
    return toml_in(text, path.name)


def toml_in(text: str, name: str) -> dict[str, Any]:
    """Return the tables of a text in TOML; `name` is used in messages.

    Raises ConfigurationError if it is not TOML or deeper than `DEEPEST_TABLES`.
    """
    try:
        content = tomllib.loads(text)
    # ValueError includes TOMLDecodeError and integers of thousands of digits.
    except (ValueError, RecursionError) as error:
        raise _not_toml(name, error, text) from error
    return _shallow(content, name)


def module_toml(module: str) -> dict[str, Any]:
    """Return the data of a module of the package, from the TOML file with its name.

    Such files are part of the source: `emgface.run.digest.code_version` follows them.
    """
    return tomllib.loads(Path(module).with_suffix(".toml").read_text(encoding="utf-8"))


def module_rows(module: str) -> list[dict[str, str]]:
    """Return the rows of the table of a module of the package, from the CSV file with its name."""
    text = Path(module).with_suffix(".csv").read_text(encoding="utf-8")
    return list(csv.DictReader(io.StringIO(text)))


def _line_of(error: Exception) -> int:
    """Number of the line in which an error of a TOML file is, from 1; 0 if it is not stated."""
    match = re.search(r"at line (\d+)", str(error))
    return int(match[1]) if match else 0


def _not_toml(name: str, error: Exception, text: str = "") -> ConfigurationError:
    description = " ".join(str(error).split())[:200]
    line = (
        text.splitlines()[at - 1] if 0 < (at := _line_of(error)) <= len(text.splitlines()) else ""
    )
    comma = re.search(r"=\s*([-+]?\d+),(\d+)\s*(#|$)", line)
    advice = f"write {comma[1]}.{comma[2]}, with a point" if comma else "repair it"
    return ConfigurationError(
        f"{name} is not valid TOML ({type(error).__name__}: {description}); expected lines such as "
        f"name = 'value' in UTF-8: {advice}."
    )


def _shallow(content: dict[str, Any], name: str) -> dict[str, Any]:
    """Refuse nesting that later code, which is recursive, would not survive."""
    left: list[tuple[Any, int]] = [(content, 1)]
    while left:
        value, depth = left.pop()
        if not isinstance(value, (dict, list)):
            continue
        if depth > DEEPEST_TABLES:
            raise ConfigurationError(
                f"{name} nests tables and arrays more than {DEEPEST_TABLES} deep; expected the entries "
                "of the documentation: repair it."
            )
        inner = value.values() if isinstance(value, dict) else value
        left += [(item, depth + 1) for item in inner]
    return content
