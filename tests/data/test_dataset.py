"""Selection of readers by suffix, search of folders, and invalid trials among valid ones."""

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import emgface.recordings.readers
from emgface.errors import ConfigurationError, DataError, SchemaError
from emgface.recordings.dataset import (
    find_recordings,
    read_recording,
    read_recordings,
    readers,
    write_recording,
)
from emgface.recordings.labels import note
from emgface.schema.netcdf import write_netcdf
from emgface.schema.validation import validate

Make = Callable[[str], xr.Dataset]


def test_a_recording_is_read_back_identical(trial: xr.Dataset, tmp_path: Path) -> None:
    back = read_recording(write_recording(trial, tmp_path / "trial.nc"), study=True)
    expected = validate(trial, "recording")
    changed = {"original_names": "{}", "dropped": "{}"}
    xr.testing.assert_identical(back, expected.assign_attrs(changed))
    again = read_recording(write_recording(back, tmp_path / "again.nc"))
    xr.testing.assert_identical(again, back)


def test_the_truth_of_a_simulated_recording_is_kept(trial: xr.Dataset, tmp_path: Path) -> None:
    truth = np.linspace(0, 1, 40).reshape(2, 20)
    trial = trial.assign_coords(
        muscle=["ZYG_L", "ZYG_R"], time_true=("time_true", np.arange(20) / 50, {"units": "s"})
    ).assign(true_activation=(("muscle", "time_true"), truth, {"units": "1"}))
    back = read_recording(write_recording(trial, tmp_path / "trial.nc"), study=True)
    np.testing.assert_array_equal(back["true_activation"], truth)
    trial["true_activation"].values[1, 3] = 1.5
    with pytest.raises(SchemaError, match="true_activation is 1.5 at muscle ZYG_R, time_true 0.06"):
        write_recording(trial, tmp_path / "trial.nc")


def test_a_recording_without_source_gets_name_and_digest(trial: xr.Dataset, tmp_path: Path) -> None:
    del trial.attrs["source"], trial.attrs["source_digest"]
    path = write_recording(trial, tmp_path / "trial.nc")
    back = read_recording(path)
    assert back.attrs["source"] == "trial.nc"
    assert back.attrs["source_digest"] == hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_general_recording_becomes_one_of_a_study(trial: xr.Dataset, tmp_path: Path) -> None:
    names = [str(c) for c in trial["channel"].values]
    general = trial.assign_coords(channel=[f"lead {c}" for c in names])
    path = write_recording(general, tmp_path / "trial.nc")
    mapping = {"channels": {f"lead {c}": c for c in names}}
    back = read_recording(path, mapping=mapping, study=True)
    np.testing.assert_array_equal(back["emg"], trial["emg"])
    assert note(back, "original_names")["OOS_L"] == "lead OOS_L"


def test_a_constant_channel_is_flagged_while_present(trial: xr.Dataset, tmp_path: Path) -> None:
    trial["emg"].values[4] = 2e-6
    trial["emg"].values[4, :7] = np.nan
    path = write_recording(trial, tmp_path / "trial.nc")
    back = read_recording(path)
    assert note(back, "flagged") == {"LLSAN_L": "constant at 2e-06 V"}
    path = write_recording(back, tmp_path / "flagged.nc")
    without = read_recording(path, mapping={"channels": {"OOS_L": "OOS_L"}})
    assert "flagged" not in without.attrs


def test_recordings_are_written_as_netcdf_only(trial: xr.Dataset, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="trial.c3d ends in '.c3d'; expected '.nc'"):
        write_recording(trial, tmp_path / "trial.c3d")


def test_absent_and_unknown_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="No file .*none.nc; expected a recording"):
        read_recording(tmp_path / "none.nc")
    (tmp_path / "trial.c4d").write_text("x")
    with pytest.raises(DataError, match=r"unknown suffix '.c4d' \(did you mean '.c3d'\?\)"):
        read_recording(tmp_path / "trial.c4d")
    (tmp_path / "trial.nc").write_text("x")
    with pytest.raises(ConfigurationError, match="Cannot read .*labels.toml"):
        read_recording(tmp_path / "trial.nc", mapping=tmp_path / "labels.toml")


def test_suffixes_are_read_whatever_their_case(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_recording(trial, tmp_path / "TRIAL.NC")
    assert read_recording(path).sizes["channel"] == 14


def test_a_folder_returns_its_recordings_and_failures(
    valid: Make, trial: xr.Dataset, tmp_path: Path
) -> None:
    good = write_recording(trial, tmp_path / "V01" / "A_1.nc")
    write_netcdf(valid("activation"), tmp_path / "V01" / "A_1_activation.nc", "activation")
    cut = tmp_path / "V02" / "A_1.nc"
    cut.parent.mkdir()
    cut.write_bytes(good.read_bytes()[:4000])
    (tmp_path / "notes.txt").write_text("not a recording")
    (tmp_path / ".A_1.nc.part").write_text("a write that was killed")
    assert find_recordings(tmp_path) == [good, cut]
    results = dict(read_recordings(tmp_path, study=True))
    assert isinstance(results[good], xr.Dataset)
    assert isinstance(results[cut], DataError) and "truncated" in str(results[cut])


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        DataError, match="No recording in .*; expected files ending in .asc, .bdf, .c3d, "
    ):
        find_recordings(tmp_path)
    with pytest.raises(DataError, match="No folder"):
        find_recordings(tmp_path / "none")


def test_a_new_format_is_a_new_file(
    trial: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    code = """
import numpy as np
from emgface.recordings.readers._build import Part, assemble_parts, emg_array
from emgface.recordings.timebase import of_rate
SUFFIXES = (".raw8",)
FORMAT = "one byte per sample"
def read(path, units):
    values = np.frombuffer(path.read_bytes(), "i1")[None].astype(float)
    part = emg_array(values, ["only"], of_rate(path.name, values.size, 1000.0), units.get("emg", "uV"))
    return assemble_parts([Part(part, {"emg": "uV"})])
"""
    (tmp_path / "more").mkdir()
    (tmp_path / "more" / "raw8.py").write_text(code)
    path = [*emgface.recordings.readers.__path__, str(tmp_path / "more")]
    monkeypatch.setattr(emgface.recordings.readers, "__path__", path)
    readers.cache_clear()
    try:
        (tmp_path / "trial.raw8").write_bytes(bytes([1, 2, 250]))
        recording = read_recording(tmp_path / "trial.raw8")
        np.testing.assert_array_equal(recording["emg"], [[1 / 1e6, 2 / 1e6, -6 / 1e6]])
        mapped = read_recording(tmp_path / "trial.raw8", mapping={"units": {"emg": "mV"}})
        np.testing.assert_array_equal(mapped["emg"], [[1e-3, 2e-3, -6e-3]])
    finally:
        readers.cache_clear()
        shutil.rmtree(tmp_path / "more")
