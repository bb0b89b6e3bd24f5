"""Record of the environment of a result: packages, numerical libraries, machine and code."""

import os
import platform
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import numpy as np

from emgface import __version__
from emgface.errors import ExecutionError
from emgface.run.digest import canonical_json, code_version

RECORDED_PACKAGES: Final = (
    "numpy", "scipy", "numba", "llvmlite", "xarray", "netCDF4", "pandas", "statsmodels",
    "pypardiso", "mkl",
)  # fmt: skip
"""Packages whose versions may change a result, in addition to this package."""
SETTINGS: Final = (
    "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_CBWR", "MKL_THREADING_LAYER",
)  # fmt: skip
"""Environment variables that may change a result; the threads of element loops do not."""
CODE: Final = ("analysis", "emgface", "sim")


@cache
def computing_environment() -> str:
    """Describe the environment of this process as a JSON object.

    It contains ``emgface``, ``python``, ``packages`` (versions), ``blas`` (of numpy), ``platform``,
    ``processor``, ``cores``, ``settings`` (environment variables of numerical libraries) and
    ``code``, the digest of the source of the three packages. Without date, name and path, equal
    environments have equal texts.
    """
    packages: dict[str, str] = {}
    for name in RECORDED_PACKAGES:
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            continue
    return canonical_json(
        {
            "emgface": __version__,
            "python": f"{platform.python_implementation()} {platform.python_version()}",
            "packages": packages,
            "blas": _blas(),
            "platform": f"{platform.system()} {platform.release()} {platform.machine()}",
            "processor": _processor(),
            "cores": os.cpu_count() or 0,
            "settings": {name: os.environ[name] for name in SETTINGS if name in os.environ},
            "code": code_version(CODE),
        }
    )


def require_code(code: str) -> None:
    """Raise ExecutionError if the source of this process has another digest than `code`."""
    if code_version(CODE) != code:
        raise ExecutionError(
            "a worker has other source code of emgface than the study, expected the same: install "
            "the same version for the workers and start them again"
        )


def _blas() -> str:
    """Linear algebra library of numpy."""
    built: Any = np.show_config(mode="dicts")
    library = (built or {}).get("Build Dependencies", {}).get("blas", {})
    return f"{library.get('name', 'unknown')} {library.get('version', '')}".strip()


def _processor() -> str:
    """Name of the processor, if the system states it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown"


def now() -> str:
    """UTC date and time to the second, ISO 8601."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
