"""Modules that an import must not load, checked in a new process."""

import json
import os
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import xarray as xr

from emgface.recordings.dataset import write_recording

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
    assert not found & (PLOTTING_AND_CLI | DATA | {"emgface", "analysis"})


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


WITHOUT_MECHANICS = {
    "activate": ["activate", "trial.nc", "--out", "a.nc"],
    "check": ["check", "trial.nc"],
    "convert": ["convert", "trial.nc", "--out", "converted"],
    "cut": ["cut", "trial.nc", "--events", "events.tsv", "--out", "trials"],
    "map": ["map", "trial.nc"],
    "inventory": ["inventory", "."],
    "features": ["features", "trial.nc"],
}


@pytest.mark.parametrize("name", WITHOUT_MECHANICS)
def test_commands_on_recordings_load_no_mechanics(name, tmp_path):
    """They start in about two seconds of processor time; the mechanics would add one to three."""
    time = np.arange(8192) / 2048
    names = [f"{c}_{s}" for c in ("OOS", "OOI", "RIS", "ZYG", "LLSAN", "DAO", "MEN") for s in "LR"]
    size = 5e-6 + 1e-4 * np.exp(-(((time - 2.0) / 0.5) ** 2))
    emg = size * np.random.default_rng(0).standard_normal((len(names), len(time)))
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": names, "time_emg": ("time_emg", time, {"units": "s"})},
        {"volunteer": "S01", "instruction": "A", "repetition": 1, "origin": "simulated"},
    )
    write_recording(recording, tmp_path / "trial.nc")
    (tmp_path / "events.tsv").write_text("onset\tduration\ttrial_type\n0.5\t2.0\tA\n")
    code = (
        "import json, sys\nfrom emgface.cli import app\n"
        f"try:\n    app({WITHOUT_MECHANICS[name]!r})\nexcept SystemExit as end:\n    code = end.code\n"
        "print('\\n' + json.dumps([code, sorted({m.split('.')[0] for m in sys.modules})]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    ended, found = json.loads(done.stdout.splitlines()[-1])
    assert not ended, done.stderr
    assert "xarray" in found and not set(found) & {"sim", "numba", "matplotlib"}
