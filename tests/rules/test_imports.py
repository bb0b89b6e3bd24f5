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
    loaded, _ = brought_by("sim")
    assert {"sim", "numba", "numpy", "scipy", "xarray"} <= loaded
    assert not loaded & (PLOTTING_AND_CLI | DATA | {"emgface", "analysis"})


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
    loaded = set(json.loads(done.stdout.splitlines()[-1]))
    assert not loaded & {"sim", "analysis", "numpy", "numba", "xarray", "pandas", "matplotlib"}


WITHOUT_MECHANICS = {
    "activate": ["activate", "trial.nc", "--out", "a.nc"],
    "check": ["check", "trial.nc"],
    "convert": ["convert", "trial.nc", "--out", "converted"],
    "cut": ["cut", "trial.nc", "--events", "events.tsv", "--out", "trials"],
    "map": ["map", "trial.nc"],
    "inventory": ["inventory", "."],
    "features": ["features", "trial.nc"],
}


COMMANDS = """
import json, os, sys
import netCDF4, pandas, scipy.signal, xarray  # libraries that these commands share
from emgface.cli import app
for name, words in json.loads(sys.argv[1]).items():
    child = os.fork()
    if child == 0:
        code = None
        try:
            app(words)
        except SystemExit as end:
            code = end.code
        with open(f"{name}.json", "w") as file:
            json.dump([code, sorted({m.split(".")[0] for m in sys.modules})], file)
        os._exit(0)
    os.waitpid(child, 0)
"""
"""Program that executes commands, each in a process which loads only what it needs besides libraries."""


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """Folder of the commands, with the exit code and the modules of each."""
    if not hasattr(os, "fork"):
        pytest.skip("needs to fork a process")
    folder = tmp_path_factory.mktemp("commands")
    time = np.arange(8192) / 2048
    names = [f"{c}_{s}" for c in ("OOS", "OOI", "RIS", "ZYG", "LLSAN", "DAO", "MEN") for s in "LR"]
    size = 5e-6 + 1e-4 * np.exp(-(((time - 2.0) / 0.5) ** 2))
    emg = size * np.random.default_rng(0).standard_normal((len(names), len(time)))
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": names, "time_emg": ("time_emg", time, {"units": "s"})},
        {"volunteer": "S01", "instruction": "A", "repetition": 1, "origin": "simulated"},
    )
    write_recording(recording, folder / "trial.nc")
    (folder / "events.tsv").write_text("onset\tduration\ttrial_type\n0.5\t2.0\tA\n")
    command = [sys.executable, "-c", COMMANDS, json.dumps(WITHOUT_MECHANICS)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.parametrize("name", WITHOUT_MECHANICS)
def test_commands_on_recordings_load_no_mechanics(name, ended):
    """They start in about two seconds of processor time; the mechanics would add one to three."""
    code, loaded = json.loads((ended / f"{name}.json").read_text(encoding="utf-8"))
    assert not code
    assert "xarray" in loaded and not set(loaded) & {"sim", "numba", "matplotlib"}
