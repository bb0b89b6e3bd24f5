"""Modules that an import must not load, checked in a new process."""

import json
import os
import subprocess
import sys
from functools import cache

import pytest

PLOTTING_AND_CLI = {"matplotlib", "pyvista", "vtk", "rich", "typer", "click", "jinja2"}
DATA = {
    "ezc3d", "meshio", "pydantic", "h5netcdf", "netCDF4", "h5py", "edfio", "dask",
    "statsmodels", "scikit_learn", "sklearn",
}  # fmt: skip
FACE = "emgface.face.motion, emgface.face.template, emgface.face.file"


@cache
def brought_by(what: str) -> tuple[set[str], list[str]]:
    """Modules in a new process after an import, and two settings of waiting threads."""
    code = (
        f"import {what}, json, os, sys; print(json.dumps([[m.split('.')[0] for m in sys.modules], "
        "[os.environ.get(k) for k in ('OPENBLAS_THREAD_TIMEOUT', 'KMP_BLOCKTIME')]]))"
    )
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("KMP", "OPENBLAS"))}
    environment = inherited | {"KMP_BLOCKTIME": "7"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment
    )
    modules, waiting = json.loads(done.stdout)
    return set(modules), waiting


def test_mechanics_import_no_plotting_command_line_or_data_library():
    found, _ = brought_by("sim")
    assert {"sim", "numba", "numpy", "scipy", "xarray"} <= found
    assert not found & (PLOTTING_AND_CLI | DATA | {"emgface", "analysis", "ipctk"})


def test_a_face_is_simulated_without_plotting_and_command_line():
    assert not brought_by(FACE)[0] & PLOTTING_AND_CLI


def test_analysis_imports_neither_mechanics_nor_plotting():
    assert not brought_by("analysis.figures")[0] & (PLOTTING_AND_CLI | {"sim", "numba", "emgface"})


@pytest.mark.parametrize("what", ["sim", FACE])
def test_threads_wait_passively_unless_configured_otherwise(what):
    assert brought_by(what)[1] == ["4", "7"]


@pytest.mark.parametrize("given", [["demo", "--help"], ["demo", "--seedd", "3"], ["demoo"]])
def test_help_and_typing_errors_do_not_import_the_mechanics(given):
    code = (
        "import json, runpy, sys\n"
        f"sys.argv = ['emgface', *{given!r}]\n"
        "try:\n    runpy.run_module('emgface', run_name='__main__')\nexcept SystemExit:\n    pass\n"
        "print('\\n' + json.dumps([m.split('.')[0] for m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = set(json.loads(done.stdout.splitlines()[-1]))
    assert not found & {"sim", "analysis", "numpy", "numba", "xarray", "pandas", "matplotlib"}
