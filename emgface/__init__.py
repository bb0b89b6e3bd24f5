"""sEMG-driven experiments with a finite-element face.

``import emgface as ef`` offers one function for every stage: `read` a recording or a result,
`check`, `activate` (sEMG to muscle activation), `build`, `face`, `fit`, `treat`, `reduce`, `simulate`,
`invert`, `sound`, `score`, `study`, `report` and `show`.
They take and return plain xarray, and import what they need when they are first called. Importing
this package also gives xarray objects the accessor ``semg`` (`emgface.signals.accessor`).
"""

import os as _os
from typing import TYPE_CHECKING, Any

from emgface._xarray import register_accessor

# Threads of linear algebra otherwise wait by spinning, which multiplies the processor time if other
# programs run. The libraries read this when they are loaded; settings of the user have priority.
for _name, _value in {
    "OMP_WAIT_POLICY": "PASSIVE",
    "KMP_BLOCKTIME": "0",
    "OPENBLAS_THREAD_TIMEOUT": "4",
}.items():
    _os.environ.setdefault(_name, _value)

if TYPE_CHECKING:
    from emgface.api import (
        activate,
        build,
        check,
        compare,
        describe,
        face,
        fit,
        invert,
        read,
        reduce,
        report,
        score,
        show,
        simulate,
        sound,
        study,
        treat,
    )

    __version__: str

__all__ = [
    "activate",
    "build",
    "check",
    "compare",
    "describe",
    "face",
    "fit",
    "invert",
    "read",
    "reduce",
    "report",
    "score",
    "show",
    "simulate",
    "sound",
    "study",
    "treat",
]

_CALLABLE_PACKAGES = ("face", "fit", "report", "study")
"""Functions that share their name with a subpackage, which can be called (`emgface._callable`)."""


def __getattr__(name: str) -> Any:
    """Import a public name at its first use (PEP 562)."""
    from importlib import import_module, metadata

    if name == "__version__":
        try:
            return metadata.version("emgface")
        except metadata.PackageNotFoundError:  # a source tree that was not installed
            return "0+unknown"
    if name in _CALLABLE_PACKAGES:
        return import_module(f"emgface.{name}")
    if name in __all__:
        return getattr(import_module("emgface.api"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """List the public names, for completion."""
    return [*__all__, "__version__"]


register_accessor()
