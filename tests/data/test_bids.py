"""EMG-BIDS and Motion-BIDS: rules of the standard, and files read back."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import emgface.files
from emgface.errors import DataError, SchemaError, SignalError, UnitsError
from emgface.recordings.bids import bids_problems, write_bids
from emgface.recordings.bids.names import entities, faults, file_name, trial_of
from emgface.recordings.bids.rules import EMG_KEYS, MOTION_KEYS
from emgface.recordings.bids.sidecars import ROWS, read_tsv
from emgface.recordings.bids.tables import complete_table
from emgface.recordings.dataset import find_recordings, read_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.labels import note

EMG = "sub-V01/emg/sub-V01_task-A_run-01_"
MOTION = "sub-V01/motion/sub-V01_task-A_tracksys-markers_run-01_"


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")


def test_a_trial_is_read_back(trial: xr.Dataset, tmp_path: Path) -> None:
    written = write_bids(trial, tmp_path)
    assert [p.relative_to(tmp_path).as_posix() for p in written] == [
        EMG + "emg.bdf", MOTION + "motion.tsv",
    ]  # fmt: skip
    assert find_recordings(tmp_path) == written[:1]
    back = read_recording(written[0], study=True)
    for name in ("position", "time_emg", "time_marker", "channel", "marker", "axis"):
        np.testing.assert_array_equal(back[name], trial[name])
    # 24 bits of the power of two of microvolts above the largest value of each channel.
    top = 2.0 ** np.ceil(np.log2(np.abs(trial["emg"].values * 1e6).max(axis=1)))
    error = np.abs(back["emg"].values - trial["emg"].values).max(axis=1) * 1e6
    assert (error <= 0.501 * top / (2**23 - 1)).all()
    for name in ("volunteer", "instruction", "repetition", "origin"):
        assert back.attrs[name] == trial.attrs[name]


def test_a_recording_read_from_bids_is_written_identically(
    trial: xr.Dataset, tmp_path: Path
) -> None:
    first = read_recording(write_bids(trial, tmp_path / "a")[0])
    path = write_bids(first, tmp_path / "b")[0]
    xr.testing.assert_identical(read_recording(path), first)
    for one in sorted(p for p in (tmp_path / "a").rglob("*") if p.is_file()):
        assert (tmp_path / "b" / one.relative_to(tmp_path / "a")).read_bytes() == one.read_bytes()


@pytest.mark.parametrize("rate", [1000.0, 2048.0, 1925.925925925926, 976.5625, 2148.148148148148])
@pytest.mark.parametrize("samples", [97, 4096])
def test_any_rate_and_length_is_kept(
    trial: xr.Dataset, tmp_path: Path, rate: float, samples: int
) -> None:
    time = ("time_emg", np.arange(samples) / rate, {"units": "s"})
    values = np.random.default_rng(0).normal(scale=1e-4, size=(14, samples))
    emg = trial.drop_vars(["emg", "time_emg"]).assign_coords(time_emg=time)
    emg["emg"] = (("channel", "time_emg"), values, {"units": "V"})
    back = read_recording(write_bids(emg, tmp_path)[0])
    assert back.sizes["time_emg"] == samples
    np.testing.assert_allclose(back["time_emg"], emg["time_emg"], rtol=1e-9, atol=1e-12)


def test_the_lag_of_the_markers_is_kept(trial: xr.Dataset, tmp_path: Path) -> None:
    time = trial["time_marker"]
    for lag in (0.0375, -0.25):
        late = trial.assign_coords(time_marker=("time_marker", time.values + lag, time.attrs))
        back = read_recording(write_bids(late, tmp_path)[0])
        np.testing.assert_allclose(back["time_marker"], late["time_marker"], rtol=0, atol=5e-7)


def test_either_part_may_be_absent(trial: xr.Dataset, tmp_path: Path) -> None:
    emg = trial.drop_vars(["position", "marker", "axis", "time_marker"])
    motion = trial.drop_vars(["emg", "channel", "time_emg"])
    assert "position" not in read_recording(write_bids(emg, tmp_path / "a")[0])
    (path,) = write_bids(motion, tmp_path / "b")
    assert find_recordings(tmp_path / "b") == [path]
    back = read_recording(path)
    np.testing.assert_array_equal(back["position"], trial["position"])
    assert (back.attrs["volunteer"], back.attrs["origin"]) == ("V01", "simulated")
    for folder in "ab":
        assert bids_problems(tmp_path / folder) == []


def test_a_dataset_grows_and_follows_the_rules(trial: xr.Dataset, tmp_path: Path) -> None:
    for volunteer, repetition in (("V02", 1), ("V01", 2), ("V01", 1), ("V01", 1)):
        one = trial.assign_attrs(volunteer=volunteer, repetition=repetition)
        write_bids(one, tmp_path, emg={"PowerLineFrequency": 50, "Manufacturer": "TMSi"})
    assert bids_problems(tmp_path) == []
    assert len(find_recordings(tmp_path)) == 3
    listed = (tmp_path / "participants.tsv").read_text().splitlines()
    assert listed == ["participant_id", "sub-V01", "sub-V02"]
    assert len((tmp_path / "sub-V01" / "sub-V01_scans.tsv").read_text().splitlines()) == 5
    description = json.loads((tmp_path / "dataset_description.json").read_text())
    assert description["Name"].endswith("(simulated)")
    sidecar = json.loads((tmp_path / (EMG + "emg.json")).read_text())
    assert sidecar["PowerLineFrequency"] == 50 and set(EMG_KEYS) <= set(sidecar)
    assert set(MOTION_KEYS) <= set(json.loads((tmp_path / (MOTION + "motion.json")).read_text()))
    first = (tmp_path / (EMG + "channels.tsv")).read_text().splitlines()[:2]
    assert first == [
        "name\ttype\tunits\ttarget_muscle",
        "OOS_L\tEMG\tuV\torbicularis oris superior",
    ]
    back = read_recording(tmp_path / (EMG + "emg.bdf"))
    assert back.attrs["device"] == "TMSi"


def test_columns_of_participants_are_kept(trial: xr.Dataset, tmp_path: Path) -> None:
    write_bids(trial, tmp_path)
    (tmp_path / "participants.tsv").write_text("participant_id\tage\nsub-V01\t27\n")
    write_bids(trial.assign_attrs(volunteer="V02"), tmp_path)
    assert (tmp_path / "participants.tsv").read_text() == (
        "participant_id\tage\nsub-V01\t27\nsub-V02\tn/a\n"
    )


BREAKS = [
    (EMG + "emg.json", '"EMGReference"', '"Reference"', "lacks the key 'EMGReference'"),
    (EMG + "emg.json", '"SamplingFrequency": 2048.0', '"SamplingFrequency": "2k"', "above 0"),
    (EMG + "emg.json", '"SoftwareFilters": "n/a"', '"SoftwareFilters": "none"', "an object or"),
    (EMG + "emg.json", "Description", "Text", "'EMGPlacementSchemeDescription', needed for"),
    (EMG + "channels.tsv", "name\ttype", "type\tname", "begins with the columns type, name"),
    (EMG + "channels.tsv", "\tEMG\t", "\temg\t", "has the type 'emg'"),
    (EMG + "channels.tsv", "OOI_L", "OOS_L", "lists the channel 'OOS_L' more than once"),
    (MOTION + "channels.tsv", "nasion_x\tx", "nasion_x\tX", "has the component 'X'"),
    (MOTION + "motion.json", '"TrackingSystemName"', '"System"', "'TrackingSystemName'"),
    ("dataset_description.json", '"BIDSVersion"', '"Version"', "lacks the key 'BIDSVersion'"),
    ("participants.tsv", "sub-V01", "sub-V09", "does not list sub-V01"),
    ("sub-V01/sub-V01_scans.tsv", "emg.bdf", "emg.edf", "which does not exist"),
]


@pytest.mark.parametrize(("file", "old", "new", "text"), BREAKS)
def test_each_violated_rule_is_reported(
    trial: xr.Dataset, tmp_path: Path, file: str, old: str, new: str, text: str
) -> None:
    write_bids(trial, tmp_path)
    assert bids_problems(tmp_path) == []
    edit(tmp_path / file, old, new)
    assert any(text in problem for problem in bids_problems(tmp_path))


def test_names_places_and_headers_are_examined(trial: xr.Dataset, tmp_path: Path) -> None:
    write_bids(trial, tmp_path)
    motion = tmp_path / (MOTION + "motion.tsv")
    motion.write_text("a\tb\n" + motion.read_text())
    (tmp_path / (EMG + "emg.bdf")).rename(tmp_path / "sub-V01" / "run-01_sub-V01_emg.bdf")
    found = " ".join(bids_problems(tmp_path))
    for text in (
        "begins with a row of names", "has 2 columns and", "lacks the entity 'task'",
        "is in sub-V01, not in sub-V01/emg", "has the entities run, sub; expected sub, ses",
    ):  # fmt: skip
        assert text in found


@pytest.mark.parametrize(
    ("file", "old", "new", "text"),
    [
        (
            EMG + "channels.tsv",
            "OOS_L\tEMG\tuV\torbicularis oris superior\n",
            "",
            "contains 14 chann",
        ),
        (EMG + "channels.tsv", "name\t", "label\t", "expected 'name' among them"),
        (EMG + "emg.json", "{", "[", "cannot be read as JSON"),
        (MOTION + "channels.tsv", "tracked_point", "point", "lacks the column 'tracked_point'"),
        (MOTION + "motion.json", '"SamplingFrequency": 100.0', '"SamplingFrequency": 0', "above 0"),
        (MOTION + "channels.tsv", "nasion_x\tx\tPOS\tnasion\tm\n", "", "has 48 columns and"),
        (MOTION + "motion.tsv", "n/a", "missing", "cannot be read as numbers"),
    ],
)
def test_tables_that_do_not_match_are_refused(
    trial: xr.Dataset, tmp_path: Path, file: str, old: str, new: str, text: str
) -> None:
    path = write_bids(trial, tmp_path)[0]
    edit(tmp_path / file, old, new)
    with pytest.raises(DataError, match=text):
        read_recording(path)


def test_file_and_table_name_the_same_unit(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_bids(trial, tmp_path)[0]
    edit(tmp_path / (EMG + "channels.tsv"), "\tuV\t", "\tmV\t")
    with pytest.raises(UnitsError, match="'OOS_L' is in 'uV', and in 'mV' in its channels.tsv"):
        read_recording(path)
    read_recording(path, mapping={"units": {"emg": "uV"}})


def test_other_types_and_incomplete_points_are_left_out(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_bids(trial, tmp_path)[0]
    edit(tmp_path / (EMG + "channels.tsv"), "MEN_R\tEMG", "MEN_R\tTRIG")
    edit(tmp_path / (MOTION + "channels.tsv"), "nasion_x\tx\tPOS", "nasion_x\tx\tVEL")
    back = read_recording(path)
    assert back.sizes["channel"] == 13 and back.sizes["marker"] == 15
    dropped = note(back, "dropped")
    assert dropped["MEN_R"] == "of type TRIG, not EMG"
    assert dropped["nasion_x"] == "of type VEL, component x"
    assert dropped["nasion_y"] == "not one column for each axis"


def test_a_motion_file_cut_within_a_row_is_refused(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_bids(trial, tmp_path)[0]
    motion = tmp_path / (MOTION + "motion.tsv")
    text = motion.read_text()
    motion.write_text(text[: text.rindex("\t")])
    with pytest.raises(DataError, match="motion.tsv ends within a row"):
        read_recording(path)
    motion.write_text(text[: text.rstrip("\n").rindex("\n")])
    held = note(read_recording(path), "dropped")[motion.name]
    assert held == "contains 0.24 s of the 0.25 s that it declares"


def test_recordings_that_bids_cannot_represent_are_refused(
    trial: xr.Dataset, tmp_path: Path
) -> None:
    gap = trial.copy(deep=True)
    gap["emg"].values[3, 5] = np.nan
    with pytest.raises(SignalError, match="channel ZYG_L has a gap"):
        write_bids(gap, tmp_path)
    with pytest.raises(DataError, match="'V 1' cannot be the label of 'sub'"):
        write_bids(trial.assign_attrs(volunteer="V 1"), tmp_path)
    del trial.attrs["repetition"]
    with pytest.raises(DataError, match="specifies no repetition"):
        write_bids(trial, tmp_path)
    with pytest.raises(SchemaError):
        write_bids(trial.assign_attrs(origin="?"), tmp_path)


def test_names_are_composed_in_the_order_of_the_specification() -> None:
    name = file_name({"run": "02", "tracksys": "m", "task": "A", "sub": "V1"}, "motion.tsv")
    assert name == "sub-V1_task-A_tracksys-m_run-02_motion.tsv"
    assert trial_of(Path(name)) == {"volunteer": "V1", "instruction": "A", "repetition": 2}
    assert entities(Path("notes_of_today.txt")) == {}


def test_the_published_examples(shared: Path) -> None:
    root = shared / "recordings" / "bids-emg-examples"
    if not root.is_dir():
        pytest.skip("the BIDS examples are not there")
    face, many = root / "emg_CustomBipolarFace", root / "emg_Multimodal"
    path = face / "sub-01" / "emg" / "sub-01_task-talking_emg.edf"
    with pytest.raises(UnitsError, match="channel 'EMG1' is in 'uV', and in 'V' in its channels"):
        read_recording(path)
    trial = read_recording(path, mapping={"units": {"emg": "uV"}})
    assert dict(trial.sizes) == {"channel": 6, "time_emg": 2000}
    assert (trial.attrs["volunteer"], trial.attrs["instruction"]) == ("01", "talking")
    deviation = trial["emg"].std("time_emg").values
    assert (0.05e-6 < deviation).all() and (deviation < 0.1e-6).all()  # 0.07 uV beside the file
    with pytest.raises(DataError, match="number of signals is '0  E'; expected an integer"):
        read_recording(many / "sub-01" / "emg" / "sub-01_task-pullstand_emg.edf")
    motion = many / "sub-01" / "motion" / "sub-01_task-pullstand_tracksys-mocap_motion.tsv"
    positions = read_recording(motion)
    assert dict(positions.sizes) == {"marker": 2, "axis": 3, "time_marker": 256}
    first = positions["position"].sel(marker="sacrum").values[:, 0]
    np.testing.assert_array_equal(first, np.array([89.1437, 114.9735, 112.8298]) / 1e3)
    assert "contains 1 s of the 620.453 s" in note(positions, "dropped")[motion.name]
    # Both lack a column that a later version of the specification requires.
    for folder in (face, many):
        assert bids_problems(folder) == [
            "sub-01_electrodes.tsv lacks the column 'coordinate_system'"
        ]


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
    with pytest.raises(DataError, match=f"{Path(file).name[-8:]}|{Path(file).name[-11:]}") as told:
        read_recording(emg)
    assert text.strip('"').split("e")[0] in str(told.value).replace("True", "true")


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


@pytest.mark.parametrize("ending", ROWS)
def test_rows_and_columns_of_a_table_have_different_names(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"sub-V01_{ending}"
    path.write_text(f"name\t{ROWS[ending]}\n".replace("name\tname", "name\ttype") + "a\tA\na2\tB\n")
    assert len(read_tsv(path)) == 2
    path.write_text(f"{ROWS[ending]}\tx\na\t1\nb\t2\na\t3\n")
    with pytest.raises(DataError, match=r"two rows 'a' \(1 and 3\)"):
        read_tsv(path)
    path.write_text(f"{ROWS[ending]}\tunits\tunits\na\tV\tmV\n")
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


@pytest.mark.parametrize("ending", ROWS)
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
def test_start_times_that_cannot_be_compared_are_told(
    trial: xr.Dataset, tmp_path: Path, first: str, second: str, lag: float, code: str
) -> None:
    """A time with a zone made the reader fail, and one that is no date was a lag of zero."""
    (emg, motion) = write_bids(trial, tmp_path)
    (table,) = tmp_path.rglob("*_scans.tsv")
    rows = [f"emg/{emg.name}\t{first}", f"motion/{motion.name}\t{second}"]
    table.write_text("\n".join(["filename\tacq_time", *rows]) + "\n")
    found = read_recording(emg)
    apart = float(found["time_marker"][0] - found["time_emg"][0])
    assert apart == pytest.approx(lag, abs=1e-6)
    told = [f for f in findings_in(found) if f.code.endswith("_lag")]
    assert [f.code for f in told] == ([code] if code else [])
    for one in told:
        assert repr(first) in one.clause and repr(second) in one.clause and one.kind == "marker"
