"""Modules that an import must not load, checked in a new process."""

import json
import os
import subprocess
import sys

import pytest

PLOTTING_AND_CLI = {"matplotlib", "pyvista", "vtk", "rich", "typer", "click", "jinja2"}
DATA = {
    "ezc3d", "meshio", "pydantic", "h5netcdf", "netCDF4", "h5py", "edfio", "dask",
    "statsmodels", "scikit_learn", "sklearn",
}  # fmt: skip


def brought_by(what: str) -> set[str]:
    code = f"import {what}, json, sys; print(json.dumps([m.split('.')[0] for m in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_mechanics_import_no_plotting_command_line_or_data_library():
    found = brought_by("sim")
    assert {"sim", "numba", "numpy", "scipy", "xarray"} <= found
    assert not found & (PLOTTING_AND_CLI | DATA | {"emgface", "analysis"})


def test_a_face_is_simulated_without_plotting_and_command_line():
    together = "emgface.face.motion, emgface.face.template, emgface.face.file"
    assert not brought_by(together) & PLOTTING_AND_CLI


def test_analysis_imports_neither_mechanics_nor_plotting():
    assert not brought_by("analysis") & (PLOTTING_AND_CLI | {"sim", "numba", "emgface"})


def test_threads_wait_passively_unless_configured_otherwise():
    code = "import os, {what}; print(os.environ['OPENBLAS_THREAD_TIMEOUT'], os.environ['KMP_BLOCKTIME'])"
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(("KMP", "OPENBLAS"))}
    for what in ("emgface", "sim.waiting"):
        command = [sys.executable, "-c", code.format(what=what)]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=True,
            env=inherited | {"KMP_BLOCKTIME": "7"},
        )
        assert done.stdout.split() == ["4", "7"]


@pytest.mark.parametrize("given", [["demo", "--help"], ["demo", "--seedd", "3"], ["demoo"]])
def test_help_and_typing_errors_do_not_import_the_mechanics(given):
    code = (
        "import json, sys\nfrom emgface.cli import main\n"
        f"sys.argv = ['emgface', *{given!r}]\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "print('\\n' + json.dumps([m.split('.')[0] for m in sys.modules]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = set(json.loads(done.stdout.splitlines()[-1]))
    assert not found & {"sim", "analysis", "numpy", "numba", "xarray", "pandas", "matplotlib"}
