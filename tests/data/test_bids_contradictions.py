"""BIDS datasets whose names, sidecars or tables contradict each other: refused, or reported."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pandas as pd
import pytest
import xarray as xr

import emgface.files
from emgface.errors import DataError
from emgface.recordings.bids import bids_problems, write_bids
from emgface.recordings.bids.names import faults
from emgface.recordings.bids.sidecars import IDENTIFYING_COLUMNS, read_tsv
from emgface.recordings.bids.tables import complete_table
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import findings_in
from tests.data.test_bids import EMG, MOTION, edit

NAMES = {
    "another volunteer": (
        "sub-V02_task-A_run-01_",
        "contains sub-V02, but is in the folder sub-V01",
    ),
    "a run with letters": ("sub-V01_task-A_run-1a_", "contains run-1a; expected a number"),
    "two runs": ("sub-V01_task-A_run-01_run-02_", "contains run-01 and run-02; expected"),
    "two tasks": ("sub-V01_task-A_task-B_run-01_", "contains task-A and task-B; expected"),
    "two volunteers": ("sub-V01_sub-V01_task-A_run-01_", "contains sub-V01 and sub-V01; expected"),
    "two sessions": ("sub-V01_ses-1_ses-2_task-A_run-01_", "contains ses-1 and ses-2; expected"),
    "no hyphen": ("sub-V01_taskA_run-01_", "contains 'taskA', which is no entity"),
    "no label": ("sub-V01_task-A_run-_", "contains 'run-', which is no entity"),
    "digits of another script": ("sub-V01_task-A_run-\u0661_", "contains run-\u0661; expected"),
}


@pytest.mark.parametrize("part", ["emg", "motion"])
@pytest.mark.parametrize("case", NAMES)
def test_names_that_do_not_identify_the_trial_are_refused(
    trial: xr.Dataset, tmp_path: Path, case: str, part: str
) -> None:
    one = trial.drop_vars(
        ["position", "marker", "axis", "time_marker"]
        if part == "emg"
        else ["emg", "channel", "time_emg"]
    )
    (path,) = write_bids(one, tmp_path)
    name, expected = NAMES[case]
    name = name if part == "emg" else name.replace("_run", "_tracksys-markers_run", 1)
    for own in list(path.parent.iterdir()):
        beginning = path.name.rpartition("_")[0] + "_"
        if own.name.startswith(beginning):
            own.rename(own.with_name(own.name.replace(beginning, name)))
    with pytest.raises(DataError, match=re.escape(expected)):
        read_recording(path.with_name(f"{name}{path.name.rpartition('_')[2]}"))


def test_a_session_that_differs_from_its_folder_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "sub-V01" / "ses-1" / "emg" / "sub-V01_ses-2_task-A_emg.bdf"
    assert faults(path) == ["contains ses-2, but is in the folder ses-1"]
    assert faults(path.with_name("sub-V01_ses-1_task-A_emg.bdf")) == []
    assert faults(path.with_name("sub-V01_task-A_emg.bdf")) == []
    assert faults(tmp_path / "my_export-2_emg.bdf") == []


def test_markers_with_two_runs_in_their_name_are_not_used(
    trial: xr.Dataset, tmp_path: Path
) -> None:
    emg = write_bids(trial, tmp_path)[0]
    markers = tmp_path / (MOTION + "motion.tsv")
    markers.rename(markers.with_name(markers.name.replace("run-01", "run-02_run-01")))
    with pytest.raises(DataError, match="contains run-02 and run-01"):
        read_recording(emg)


def test_run_0_is_a_finding(trial: xr.Dataset, tmp_path: Path) -> None:
    emg = write_bids(trial, tmp_path)[0]
    for own in [*emg.parent.iterdir(), *(tmp_path / "sub-V01" / "motion").iterdir()]:
        own.rename(own.with_name(own.name.replace("run-01", "run-0")))
    back = read_recording(emg.with_name(emg.name.replace("run-01", "run-0")))
    assert "repetition" not in back.attrs
    assert [f.values for f in findings_in(back) if f.code == "no_repetition"] == [{"label": "0"}]


@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", '"NaN"', "-5", "true"])
@pytest.mark.parametrize(
    ("file", "key"),
    [
        (EMG + "emg.json", "SamplingFrequency"),
        (EMG + "emg.json", "RecordingDuration"),
        (MOTION + "motion.json", "SamplingFrequency"),
        (MOTION + "motion.json", "RecordingDuration"),
    ],
)
def test_numbers_of_sidecars_are_finite(
    trial: xr.Dataset, tmp_path: Path, file: str, key: str, text: str
) -> None:
    emg = write_bids(trial, tmp_path)[0]
    set_json(tmp_path / file, key, text)
    with pytest.raises(
        DataError, match=f"{Path(file).name[-8:]}|{Path(file).name[-11:]}"
    ) as raised:
        read_recording(emg)
    assert text.strip('"').split("e")[0] in str(raised.value).replace("True", "true")


@pytest.mark.parametrize("key", ["PowerLineFrequency", "Gain", "Anything"])
@pytest.mark.parametrize("text", ["NaN", "Infinity", "1e999", '[1, {"a": NaN}]'])
def test_no_number_of_a_sidecar_is_other_than_finite(
    trial: xr.Dataset, tmp_path: Path, key: str, text: str
) -> None:
    emg = write_bids(trial, tmp_path)[0]
    set_json(tmp_path / (EMG + "emg.json"), key, text)
    with pytest.raises(DataError, match="is no finite number"):
        read_recording(emg)


def set_json(path: Path, key: str, text: str) -> None:
    content = json.loads(path.read_text("utf-8")) | {key: "@"}
    path.write_text(json.dumps(content).replace('"@"', text), encoding="utf-8")


def test_a_key_that_occurs_twice_is_refused(trial: xr.Dataset, tmp_path: Path) -> None:
    emg = write_bids(trial, tmp_path)[0]
    edit(tmp_path / (EMG + "emg.json"), "{", '{"SamplingFrequency": 1,')
    with pytest.raises(DataError, match="the key 'SamplingFrequency' occurs twice"):
        read_recording(emg)


def test_rates_of_the_table_are_numbers(trial: xr.Dataset, tmp_path: Path) -> None:
    emg = write_bids(trial, tmp_path)[0]
    table = tmp_path / (EMG + "channels.tsv")
    rows = pd.read_csv(table, sep="\t", dtype=str, keep_default_na=False)
    for cell, refused in (("n/a", False), ("1000", False), ("nan", True), ("fast", True)):
        rows.assign(sampling_frequency=cell).to_csv(table, sep="\t", index=False)
        if refused:
            with pytest.raises(DataError, match=f"sampling_frequency '{cell}'"):
                read_recording(emg)
        else:
            read_recording(emg)


@pytest.mark.parametrize("ending", IDENTIFYING_COLUMNS)
def test_rows_and_columns_of_a_table_have_different_names(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"sub-V01_{ending}"
    path.write_text(
        f"name\t{IDENTIFYING_COLUMNS[ending]}\n".replace("name\tname", "name\ttype")
        + "a\tA\na2\tB\n"
    )
    assert len(read_tsv(path)) == 2
    path.write_text(f"{IDENTIFYING_COLUMNS[ending]}\tx\na\t1\nb\t2\na\t3\n")
    with pytest.raises(DataError, match=r"two rows 'a' \(1 and 3\)"):
        read_tsv(path)
    path.write_text(f"{IDENTIFYING_COLUMNS[ending]}\tunits\tunits\na\tV\tmV\n")
    with pytest.raises(DataError, match=r"two columns 'units' \(2 and 3\)"):
        read_tsv(path)


def test_an_electrode_is_stated_once_in_every_system_of_coordinates(tmp_path: Path) -> None:
    path = tmp_path / "sub-V01_electrodes.tsv"
    path.write_text("name\tcoordinate_system\nE1\tface\nE1\tgrid\n")
    assert len(read_tsv(path)) == 2
    path.write_text("name\tcoordinate_system\nE1\tface\nE1\tface\n")
    with pytest.raises(DataError, match="two rows 'E1 in face'"):
        read_tsv(path)


def test_a_channel_that_is_listed_twice_is_refused(trial: xr.Dataset, tmp_path: Path) -> None:
    emg = write_bids(trial, tmp_path)[0]
    table = tmp_path / (EMG + "channels.tsv")
    lines = table.read_text("utf-8").splitlines()
    first = lines[1].split("\t")[0]
    lines[2] = "\t".join([first, *lines[2].split("\t")[1:]])
    table.write_text("\n".join([*lines, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=f"two rows '{first}'"):
        read_recording(emg)


@pytest.mark.parametrize("ending", IDENTIFYING_COLUMNS)
def test_the_check_of_a_dataset_names_what_is_listed_twice(
    trial: xr.Dataset, tmp_path: Path, ending: str
) -> None:
    write_bids(trial, tmp_path)
    assert bids_problems(tmp_path) == []
    table = tmp_path / (ending if ending == "participants.tsv" else EMG + ending)
    table.parent.mkdir(exist_ok=True, parents=True)
    columns = {"electrodes.tsv": "name\tx\ty\tcoordinate_system", "scans.tsv": "filename\tacq_time"}
    if not table.exists():
        table.write_text(f"{columns[ending]}\n")
    row = table.read_text("utf-8").splitlines()[-1]
    name = row.split("\t")[0]
    table.write_text(table.read_text("utf-8") + f"{row}\n{row}\n", encoding="utf-8")
    assert any(
        problem.startswith(table.name)
        and name in problem.partition("lists ")[2]
        and problem.endswith("more than once")
        for problem in bids_problems(tmp_path)
    )


def test_an_interrupted_trial_is_absent_and_not_one_without_its_lag(
    trial: xr.Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the table of scans, markers half a second late would be read as simultaneous."""
    time = trial["time_marker"]
    given = trial.assign_coords(time_marker=("time_marker", time.values + 0.5, time.attrs))
    whole = write_bids(given, tmp_path / "whole")
    lag = float(read_recording(whole[0])["time_marker"][0])
    assert lag == pytest.approx(float(time[0]) + 0.5, abs=1e-6)
    count = len([p for p in (tmp_path / "whole").rglob("*") if p.is_file()])
    real = emgface.files.os.fsync
    for most in range(count):
        root, calls = tmp_path / f"cut{most}", []

        def full(handle: int, calls: list[int] = calls, most: int = most) -> None:
            calls.append(handle)
            if len(calls) > most:
                raise OSError(28, "No space left on device")
            real(handle)

        monkeypatch.setattr(emgface.files.os, "fsync", full)
        with pytest.raises(DataError, match="disk is full"):
            write_bids(given, root)
        monkeypatch.setattr(emgface.files.os, "fsync", real)
        assert not list(root.rglob("*_emg.bdf"))
        for path in root.rglob("*_motion.tsv"):
            assert list(root.rglob("*_scans.tsv")) and list(root.rglob("*_motion.json")), path
        again = write_bids(given, root)
        assert float(read_recording(again[0])["time_marker"][0]) == lag


def test_two_processes_complete_one_table(tmp_path: Path) -> None:
    """Rows of the other process would be lost with the lags that they state."""
    path = tmp_path / "d" / "scans.tsv"
    with ThreadPoolExecutor(8) as pool:
        for k in range(40):
            pool.submit(complete_table, path, ("filename", "acq_time"), [(f"{k}", "n/a")])
    assert len(read_tsv(path)) == 40


@pytest.mark.parametrize(
    ("first", "second", "lag", "code"),
    [
        ("2024-12-31T23:59:59.900000", "2025-01-01T00:00:00.150000", 0.25, ""),
        ("2024-06-01T01:00:00+02:00", "2024-05-31T23:00:00.250000+00:00", 0.25, ""),
        ("2024-06-01T01:00:00", "2024-06-01T01:00:00", 0.0, ""),
        ("2024-06-01T01:00:00", "2024-06-01T01:00:01", 1.0, "coarse_lag"),
        ("2024-06-01T01:00:00.5Z", "2024-06-01T01:00:00.75", 0.0, "no_lag"),
        ("01.06.2024 10:00", "2024-06-01T01:00:00.75", 0.0, "no_lag"),
        ("2024-06-01T01:00:00.5", "n/a", 0.0, "no_lag"),
        ("n/a", "n/a", 0.0, ""),
    ],
)
def test_start_times_that_cannot_be_compared_are_reported(
    trial: xr.Dataset, tmp_path: Path, first: str, second: str, lag: float, code: str
) -> None:
    """A time with a zone made the reader fail, and one that is no date was a lag of zero."""
    (emg, motion) = write_bids(trial, tmp_path)
    (table,) = tmp_path.rglob("*_scans.tsv")
    rows = [f"emg/{emg.name}\t{first}", f"motion/{motion.name}\t{second}"]
    table.write_text("\n".join(["filename\tacq_time", *rows]) + "\n")
    recording = read_recording(emg)
    apart = float(recording["time_marker"][0] - recording["time_emg"][0])
    assert apart == pytest.approx(lag, abs=1e-6)
    messages = [f for f in findings_in(recording) if f.code.endswith("_lag")]
    assert [f.code for f in messages] == ([code] if code else [])
    for one in messages:
        assert repr(first) in one.clause and repr(second) in one.clause and one.kind == "marker"
