"""Recordings are identified by workers, and known again unless their files changed."""

import os
import pickle
import shutil
import warnings
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import xarray as xr

from emgface.errors import DataError, ExecutionError, FeatureWarning
from emgface.recordings.dataset import find_recordings, write_recording
from emgface.run.journal import Journal
from emgface.run.runner import InProcess
from emgface.run.state import read_state
from emgface.study import intake as intake_module
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.intake import Intake, take_in
from tests.data.conftest import recording


class Elsewhere(InProcess):
    """Workers whose jobs and results are pickled."""

    def __init__(self) -> None:
        self.jobs = 0

    def submit(self, function: Any, *arguments: Any) -> Future[Any]:
        self.jobs += 1
        future = super().submit(function, *pickle.loads(pickle.dumps(arguments)))
        if future.exception() is None:
            copied: Future[Any] = Future()
            copied.set_result(pickle.loads(pickle.dumps(future.result())))
            return copied
        return future


@pytest.fixture
def folder(tmp_path: Path, monkeypatch) -> Path:
    """Three recordings, one of them without a marker, and a file of another kind."""
    monkeypatch.setattr(intake_module, "SETTLED_AGE", -1.0)
    for repetition in (1, 2):
        write_recording(
            recording().assign_attrs(repetition=repetition), tmp_path / "in" / f"r{repetition}.nc"
        )
    write_recording(
        recording().drop_sel(marker="nasion").assign_attrs(repetition=3), tmp_path / "in" / "r3.nc"
    )
    xr.Dataset(attrs={"schema": "scores"}).to_netcdf(tmp_path / "in" / "other.nc")
    (tmp_path / "in" / "damaged.nc").write_bytes(b"\x89HDF\r\n\x1a\n damaged")
    return tmp_path


def taken(folder: Path, **options: Any) -> Intake:
    return take_in(RecordingsConfiguration(folder=folder / "in"), study=folder / "out", **options)


def noted(folder: Path) -> Intake:
    """Take in the recordings and write the journal, as a run does."""
    intake = taken(folder)
    journal = Journal(folder / "out", {"study": "s", "trials": 2, "workers": 1, "store": "store"})
    for line in intake.read:
        journal.write("recording", **line)
    journal.end("finished", [])
    return intake


def test_known_recordings_are_not_read_again(folder: Path) -> None:
    first = noted(folder)
    assert [r.place for r in first.recordings] == [("V01", "A", k) for k in (1, 2, 3)]
    assert len(first.read) == 2 and list(first.unreadable) == [folder / "in" / "damaged.nc"]
    again = taken(folder)
    assert again.read == []
    assert again.recordings[:2] == first.recordings[:2]
    assert "nasion" in str(again.recordings[2].error)
    assert read_state(folder / "out").total == 2  # the lines of recordings are no trials


@pytest.mark.parametrize("restored", [False, True], ids=["changed", "size and time as before"])
def test_a_changed_recording_is_read_again(folder: Path, restored: bool) -> None:
    noted(folder)
    path, before = folder / "in" / "r2.nc", taken(folder).recordings
    status = path.stat()
    changed = recording().assign_attrs(repetition=2)
    changed["emg"][3, 5] += 1e-6
    write_recording(changed, path)
    if restored:  # an entry of a file system also has the time of its own last change
        os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))
    after = taken(folder)
    assert [line["place"][2] for line in after.read] == [2]
    assert after.recordings[0] == before[0] and after.recordings[1].digest != before[1].digest
    with pytest.raises(DataError, match="has changed since the study began"):
        _ = replace(before[1], path=path).dataset


def test_recent_files_and_other_readers_are_read_again(folder: Path, monkeypatch) -> None:
    noted(folder)
    monkeypatch.setattr(intake_module, "code_version", lambda modules: "another version")
    monkeypatch.setattr("emgface.run.provenance.code_version", lambda modules: "another version")
    assert len(taken(folder).read) == 2
    monkeypatch.setattr(intake_module, "SETTLED_AGE", 60.0)
    assert taken(folder).read == []  # too recent to be known again by their times


def test_workers_identify_recordings_as_this_process(folder: Path, monkeypatch) -> None:
    here = taken(folder)
    monkeypatch.setattr(intake_module, "PER_JOB", 2)
    workers = Elsewhere()
    there = taken(folder, workers=workers)
    assert workers.jobs == 3
    assert there.recordings[:2] == here.recordings[:2] and there.read == here.read
    assert str(there.recordings[2].error) == str(here.recordings[2].error)
    assert [*map(str, there.unreadable.values())] == [*map(str, here.unreadable.values())]
    with pytest.raises(KeyboardInterrupt):
        taken(folder, stopping=lambda: True)


def test_workers_without_the_folder_or_the_code_are_refused(folder: Path, monkeypatch) -> None:
    read = intake_module.identified

    def gone(paths: list[Path]) -> Any:
        shutil.rmtree(folder / "in")
        return read(paths)

    monkeypatch.setattr("emgface.run.provenance.code_version", lambda modules: "another version")
    with pytest.raises(ExecutionError, match="other source code"):
        taken(folder)
    monkeypatch.undo()
    monkeypatch.setattr(intake_module, "identified", gone)
    with pytest.raises(ExecutionError, match=r"does not find .*damaged.nc"):
        taken(folder)


def test_a_folder_that_cannot_be_read_is_an_error(folder: Path, monkeypatch) -> None:
    (folder / "in" / "closed").mkdir()
    scan = os.scandir

    def refuse(path: Any) -> Any:
        if Path(path).name == "closed":
            raise PermissionError(13, "Permission denied", str(path))
        return scan(path)

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(DataError, match=r"closed cannot be read \(Permission denied\)"):
        find_recordings(folder / "in")


def test_usable_recordings_by_volunteer(folder: Path) -> None:
    intake = taken(folder)
    assert {v: [r.place[2] for r in recordings] for v, recordings in intake.usable.items()} == {
        "V01": [1, 2]
    }
    assert intake.usable["V01"][1].dataset.attrs["repetition"] == 2


@pytest.mark.parametrize(
    ("codes", "refused"),
    [(("V1", "v1"), True), (("1", "01"), True), (("V 1", "V1"), True), (("V10", "V1"), False),
     (("V１", "V1"), True), (("S01", "S02"), False), (("V0", "V00"), True), (("0", "1"), False),
     (("S100", "S10"), False), (("101", "11"), False), (("P1003", "P103"), False),
     (("A1B02", "A1B2"), True)],
)  # fmt: skip
def test_one_person_has_one_spelling(codes: tuple[str, str], refused: bool) -> None:
    """Two spellings of one person would be two independent volunteers of the statistics."""
    places = [(code, "A", 1) for code in codes]
    if not refused:
        intake_module.require_one_spelling(places)
        return
    with pytest.raises(DataError, match="different persons"):
        intake_module.require_one_spelling(places)


def test_a_study_refuses_two_spellings_and_names_both_files_of_one_trial(tmp_path: Path) -> None:
    for k, code in enumerate(("V1", "v1")):
        write_recording(recording().assign_attrs(volunteer=code), tmp_path / f"{k}.nc")
    with pytest.raises(DataError, match="'V1' and 'v1'"):
        take_in(RecordingsConfiguration(folder=tmp_path), workers=1)
    (tmp_path / "copy").mkdir()
    (tmp_path / "1.nc").rename(tmp_path / "copy" / "0.nc")
    write_recording(recording().assign_attrs(volunteer="V1"), tmp_path / "copy" / "0.nc")
    with pytest.raises(DataError, match=r"copy/0.nc and 0.nc|0.nc and copy/0.nc"):
        take_in(RecordingsConfiguration(folder=tmp_path), workers=1)


def test_copies_of_a_recording_are_reported(tmp_path: Path) -> None:
    """Three copies under three names were three independent volunteers of the statistics."""
    one = recording()
    other = one.assign(emg=(1.0 + 1e-9) * one["emg"]).assign(
        emg=lambda own: own["emg"].assign_attrs(units="V")
    )
    for k, given in enumerate((one, one, other)):
        write_recording(given.assign_attrs(volunteer=f"V{k}"), tmp_path / f"{k}.nc")
    with pytest.warns(FeatureWarning, match=r"0.nc \(V0 A 1\), 1.nc \(V1 A 1\) contain the same"):
        intake = take_in(RecordingsConfiguration(folder=tmp_path), workers=1)
    assert len(intake.recordings) == 3  # a warning, and no recording is left out
    (tmp_path / "1.nc").unlink()
    with warnings.catch_warnings():
        warnings.simplefilter("error", FeatureWarning)
        take_in(RecordingsConfiguration(folder=tmp_path), workers=1)
