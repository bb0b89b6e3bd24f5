"""Digests of parameters, datasets, files and source text, which identify results."""

import hashlib
import importlib.util
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from emgface.errors import StoreError

if TYPE_CHECKING:  # importing xarray takes longer than an unchanged report
    import xarray as xr

DIGEST_LENGTH: Final = 32  #: number of hexadecimal digits of a digest: 128 bits
SOURCE_SUFFIXES: Final = (".py", ".toml", ".csv")  #: suffixes of modules, and of their data files
DERIVED: Final = frozenset({"index_order"})
"""Attributes that follow from the values, without which a digest equals that of earlier files."""


def canonical_json(value: Any) -> str:
    """Canonical text of a value: sorted keys, no blanks.

    Raises StoreError if the value contains something that JSON cannot express, such as NaN or an
    array.
    """
    try:
        return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise StoreError(
            f"parameters of a stage cannot be written as JSON ({error}): expected finite numbers, "
            "text, true or false, lists and tables of these"
        ) from error


def text_digest(text: str) -> str:
    """SHA-256 of a text, the first 128 bits as hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()[:DIGEST_LENGTH]


def file_digest(path: Path) -> str:
    """SHA-256 of a file, all 64 hexadecimal digits."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def dataset_digest(dataset: "xr.Dataset") -> str:
    """Digest of the content of a dataset: names, dims, values and attributes, in a fixed order.

    Files with equal content have equal digests, although their bytes may differ.
    """
    digest = hashlib.sha256()
    for name in sorted(dataset.variables, key=str):
        variable = dataset.variables[name]
        values = np.ascontiguousarray(variable.values)
        if values.dtype.kind in "OUS":
            data = "\0".join(map(str, values.ravel().tolist())).encode()
            kind = "text"
        else:
            data, kind = values.tobytes(), values.dtype.str
        head = [str(name), list(map(str, variable.dims)), list(values.shape), kind]
        digest.update(canonical_json(head).encode())
        digest.update(data)
        digest.update(canonical_json(_plain(variable.attrs)).encode())
    digest.update(canonical_json(_plain(dataset.attrs)).encode())
    return digest.hexdigest()[:DIGEST_LENGTH]


def _plain(attrs: Mapping[Any, Any]) -> dict[str, Any]:
    return {
        str(key): value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        for key, value in attrs.items()
        if key not in DERIVED
    }


@cache
def code_version(modules: tuple[str, ...]) -> str:
    """Digest of the source text of modules and of their data files, for a package of all its modules.

    Raises StoreError if a name is not an importable module with source.
    """
    digest = hashlib.sha256()
    for module in sorted(modules):
        spec = importlib.util.find_spec(module)
        if spec is None or spec.origin is None:
            raise StoreError(f"no source found for {module!r}, expected an importable module")
        origin = Path(spec.origin)
        whole = origin.stem == "__init__"
        siblings = (origin.with_suffix(suffix) for suffix in SOURCE_SUFFIXES)
        every = (file for file in origin.parent.rglob("*") if file.suffix in SOURCE_SUFFIXES)
        for file in sorted(every) if whole else filter(Path.is_file, siblings):
            digest.update(f"{module}:{file.relative_to(origin.parent).as_posix()}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()[:DIGEST_LENGTH]
