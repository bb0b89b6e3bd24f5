"""Damaged files: a typed error or a valid recording, in bounded time."""

import gzip
import shutil
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
import xarray as xr
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from benchmarks.mutants import mutant
from emgface.errors import EmgfaceError
from emgface.recordings.bids import write_bids
from emgface.recordings.dataset import read_recording, write_recording
from emgface.schema.validation import validate
from tests.data.conftest import recording
from tests.data.test_brainvision import make as make_brainvision
from tests.data.test_c3d import make_c3d
from tests.data.test_edf import packed
from tests.data.test_poly5 import make_poly5, signals
from tests.data.test_trc import content
from tests.data.test_xdf import emg_stream, mocap_stream
from tests.data.test_xdf import make as make_xdf

LONGEST = 5.0
"""Seconds of computing after which a read counts as hanging; a sound one takes milliseconds."""


def netcdf(folder: Path) -> tuple[Path, Path]:
    path = write_recording(recording().isel(time_emg=slice(0, 64)), folder / "a.nc")
    return path, path


def c3d(folder: Path) -> tuple[Path, Path]:
    make_c3d(folder / "a.c3d")
    return folder / "a.c3d", folder / "a.c3d"


def poly5(folder: Path) -> tuple[Path, Path]:
    path = make_poly5(folder / "a.poly5", signals())
    return path, path


def edf(folder: Path) -> tuple[Path, Path]:
    counts = np.random.default_rng(4).integers(-32768, 32767, size=(2, 3, 50))
    (folder / "a.edf").write_bytes(packed(counts))
    return folder / "a.edf", folder / "a.edf"


def trc(folder: Path) -> tuple[Path, Path]:
    (folder / "a.trc").write_text(content())
    return folder / "a.trc", folder / "a.trc"


def bids(folder: Path, ending: str) -> tuple[Path, Path]:
    path, motion = write_bids(recording(), folder)
    files = {"bdf": path, "motion": motion, "json": path.with_suffix(".json")}
    files["channels"] = next(path.parent.glob("*channels.tsv"))
    return path, files[ending]


def csv(folder: Path, ending: str) -> tuple[Path, Path]:
    rng = np.random.default_rng(1)
    rows = "\n".join(",".join(f"{v:.4f}" for v in row) for row in rng.normal(size=(30, 2)))
    (folder / "a.csv").write_text(f"E1,E2\n{rows}\n")
    path = folder / "a.toml"
    path.write_text('schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 100.0\nunit = "mV"\n')
    return path, folder / f"a.{ending}"


def matlab(folder: Path, version: int) -> tuple[Path, Path]:
    values = np.random.default_rng(1).normal(size=(60, 3))
    if version == 5:
        scipy.io.savemat(folder / "a.mat", {"rec": {"emg": values}})
    else:
        with h5py.File(folder / "a.mat", "w") as opened:
            opened.create_dataset("rec/emg", data=values.T, chunks=(3, 20), compression=4)
    path = folder / "a.toml"
    name = "rec.emg" if version == 5 else "rec/emg"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "a.mat"\nvariable = "{name}"\nrate = 100\n'
        f'unit = "mV"\ndims = ["{"time" if version == 5 else "channel"}", '
        f'"{"channel" if version == 5 else "time"}"]\n'
    )
    return path, folder / "a.mat"


def nested(folder: Path, packed: bool) -> tuple[Path, Path]:
    """Small nested MATLAB structures and cells, so that most damage affects a tag."""
    rng = np.random.default_rng(1)
    inner = {"t": np.arange(4.0), "cells": np.array([1.0, "b", {"c": 2}], dtype=object)}
    content = {"rec": {"emg": rng.normal(size=(6, 3)), "inner": inner}}
    scipy.io.savemat(folder / "a.mat", content, do_compression=packed)
    path = folder / "a.toml"
    path.write_text(
        'schema = "recording"\n[emg]\nfile = "a.mat"\nvariable = "rec.emg"\nrate = 100\n'
        'unit = "mV"\n'
    )
    return path, folder / "a.mat"


def brainvision(folder: Path, ending: str) -> tuple[Path, Path]:
    return make_brainvision(folder), folder / f"a.{ending}"


def xdf(folder: Path) -> tuple[Path, Path]:
    path = make_xdf(folder, emg_stream(), mocap_stream())
    return path, path


def hdf5(folder: Path) -> tuple[Path, Path]:
    counts = np.random.default_rng(2).integers(0, 65535, size=(400, 1)).astype(np.uint16)
    with h5py.File(folder / "a.h5", "w") as opened:
        opened.create_dataset("00:07/raw/channel_3", data=counts)
    path = folder / "a.toml"
    path.write_text(
        'schema = "recording"\n[emg]\nfile = "a.h5"\nvariable = "00:07/raw/channel_3"\n'
        'rate = 1000\nunit = "mV"\nstep = 4.6e-5\nzero = 32768\n'
    )
    return path, folder / "a.h5"


def packed_csv(folder: Path) -> tuple[Path, Path]:
    path, plain = csv(folder, "csv")
    (folder / "a.csv.gz").write_bytes(gzip.compress(plain.read_bytes(), mtime=0))
    path.write_text(path.read_text().replace("a.csv", "a.csv.gz"))
    return path, folder / "a.csv.gz"


def motion_alone(folder: Path) -> tuple[Path, Path]:
    path, motion = write_bids(recording(), folder)
    for file in path.parent.glob("*"):
        file.unlink()
    return motion, motion.with_name(motion.name.replace("motion.tsv", "channels.tsv"))


FORMATS: dict[str, Callable[[Path], tuple[Path, Path]]] = {
    "netcdf": netcdf,
    "c3d": c3d,
    "poly5": poly5,
    "edf": edf,
    "trc": trc,
    "bids bdf": lambda folder: bids(folder, "bdf"),
    "bids motion": lambda folder: bids(folder, "motion"),
    "bids json": lambda folder: bids(folder, "json"),
    "bids channels": lambda folder: bids(folder, "channels"),
    "csv": lambda folder: csv(folder, "csv"),
    "toml": lambda folder: csv(folder, "toml"),
    "mat 5": lambda folder: matlab(folder, 5),
    "mat 5 nested": lambda folder: nested(folder, False),
    "mat 5 packed": lambda folder: nested(folder, True),
    "brainvision header": lambda folder: brainvision(folder, "vhdr"),
    "brainvision markers": lambda folder: brainvision(folder, "vmrk"),
    "brainvision samples": lambda folder: brainvision(folder, "eeg"),
    "xdf": xdf,
    "mat 7.3": lambda folder: matlab(folder, 7),
    "hdf5": lambda folder: hdf5(folder),
    "csv gz": lambda folder: packed_csv(folder),
    "motion alone": lambda folder: motion_alone(folder),
}


def attempt(path: Path) -> str:
    """Read a file; return ok or the name of the error; fail on an untyped error."""
    began = time.process_time()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            opened = read_recording(path)
        assert isinstance(opened, xr.Dataset)
        validate(opened, "recording")
        outcome = "ok"
    except EmgfaceError as error:
        assert str(error) and "\n" not in str(error)
        outcome = type(error).__name__ + (
            " after a crash" if "parser crashed" in str(error) else ""
        )
    assert time.process_time() - began < LONGEST
    return outcome


# The HDF5 library of netCDF runs in this process, which would end with its crash.
@pytest.mark.parametrize("name", FORMATS)
def test_damage_gives_a_typed_error(name: str, tmp_path: Path) -> None:
    count = 40
    path, target = FORMATS[name](tmp_path)
    assert attempt(path) == "ok"
    whole = target.read_bytes()
    outcomes: dict[str, int] = {}
    for k in range(count):
        target.write_bytes(mutant(whole, f"{name} {k}")[2])
        outcome = attempt(path)
        outcomes[outcome] = outcomes.get(outcome, 0) + 1
    # Flipped samples are valid ones; truncations and damaged headers are not.
    assert outcomes.get("ok", 0) < 0.7 * count, outcomes
    target.write_bytes(b"")
    assert attempt(path) != "ok"


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    data=st.binary(max_size=400),
    name=st.sampled_from([".edf", ".bdf", ".poly5", ".trc", ".nc", ".c3d", ".toml"]),
)
def test_any_bytes_give_a_typed_error(data: bytes, name: str, tmp_path_factory) -> None:
    folder = tmp_path_factory.mktemp("bytes")
    (folder / f"a{name}").write_bytes(data)
    assert attempt(folder / f"a{name}") != "ok"
    shutil.rmtree(folder)
