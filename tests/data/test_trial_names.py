"""A folder of foreign files is studied without a loop: names by a pattern, tables per file."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.recordings.dataset import read_recording, read_recordings, write_recording
from emgface.recordings.findings import findings_in
from emgface.recordings.labels import apply_labels, read_label_map
from emgface.recordings.trial_names import trial_in_name
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.file import load_study
from emgface.study.intake import take_in
from emgface.study.table import place_of
from tests.data.conftest import recording
from tests.data.test_c3d import make_c3d

PATTERN = "{volunteer}_{instruction}_{repetition}.c3d"


@pytest.mark.parametrize(
    ("pattern", "path", "stated"),
    [
        (PATTERN, "x/V1_A_3.c3d", ("V1", "A", 3)),
        (PATTERN, "V1_A_03.C3D", ("V1", "A", 3)),
        (PATTERN, "with_underscore_A_3.c3d", ("with_underscore", "A", 3)),
        (PATTERN, "V1_A.c3d", None),
        (PATTERN, "V1_A_x.c3d", None),
        ("{volunteer}/{instruction}{repetition}.c3d", "data/V 1/A12.c3d", ("V 1", "A", 12)),
        ("/study/{volunteer}/trial {repetition} ({instruction}).c3d", "q/V1/trial 2 (B).c3d",
         ("V1", "B", 2)),
        ("{volunteer}.{instruction}.{repetition}.c3d", "V1xAx3.c3d", None),
        ("{volunteer}_{instruction}_{repetition}", "x/V1_A_3.c3d", ("V1", "A", 3)),
        ("{volunteer}.{instruction}.{repetition}", "P.1.A.3.poly5", ("P.1", "A", 3)),
        ("{volunteer}-{instruction}{repetition}", "P01-smile2.c3d", ("P01", "smile", 2)),
        ("{volunteer}_{repetition}.{instruction}", "V1_3.c3d", None),
    ],
)  # fmt: skip
def test_a_pattern_states_the_trial(pattern, path, stated) -> None:
    names = ("volunteer", "instruction", "repetition")
    wanted = {} if stated is None else dict(zip(names, stated, strict=True))
    assert trial_in_name(pattern, Path(path)) == wanted


@pytest.mark.parametrize(
    "pattern", ["{person}_{volunteer}.c3d", "{volunteer}_{volunteer}", "{volunteer"]
)
def test_a_wrong_pattern_is_refused(pattern: str, tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f'names = "{pattern}"\n')
    with pytest.raises(ConfigurationError, match="expected each of"):
        read_label_map(path)


def folder_of(tmp_path: Path) -> Path:
    folder = tmp_path / "data"
    folder.mkdir()
    make_c3d(folder / "V1_A_1.c3d")
    shutil.copy(folder / "V1_A_1.c3d", folder / "V1_B_2.C3D")
    return folder


def test_a_folder_of_c3d_is_named_by_a_pattern(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    for mapping in (PATTERN, Path(PATTERN), {"names": PATTERN}):
        recordings = [each for _, each in read_recordings(folder, mapping=mapping)]
        assert [(r.attrs["volunteer"], r.attrs["instruction"], r.attrs["repetition"])
                for r in recordings] == [("V1", "A", 1), ("V1", "B", 2)]  # fmt: skip


def test_one_mapping_has_tables_per_file(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    labels = [str(c) for c in read_recording(folder / "V1_A_1.c3d")["channel"].values]
    (tmp_path / "m.toml").write_text(
        f'names = "{PATTERN}"\ninstruction = "C"\n[channels]\n"{labels[0]}" = "ZYG_L"\n'
        f'[files."V1_B_2.C3D"]\nvolunteer = "V9"\n[files."V1_B_2.C3D".channels]\n'
        f'"{labels[0]}" = "ZYG_R"\n'
    )
    first, second = (
        read_recording(path, mapping=tmp_path / "m.toml") for path in sorted(folder.iterdir())
    )
    assert list(first["channel"].values) == ["ZYG_L"] and first.attrs["volunteer"] == "V1"
    assert list(second["channel"].values) == ["ZYG_R"] and second.attrs["volunteer"] == "V9"
    # A common entry counts more than the name of a file, and an entry of the file more than both.
    assert first.attrs["instruction"] == "C" and second.attrs["repetition"] == 2


def test_words_for_instructions_are_translated(tmp_path: Path) -> None:
    """Of the names of files, of the files themselves, and of the mapping; without a contradiction."""
    make_c3d(tmp_path / "P01-smile2.c3d")
    words: dict = {"instructions": {"smile": "B", "purse": "A"}}
    named = words | {"names": "{volunteer}-{instruction}{repetition}"}
    read = read_recording(tmp_path / "P01-smile2.c3d", mapping=named)
    assert place_of(read, "") == ("P01", "B", 2)
    other = read_recording(tmp_path / "P01-smile2.c3d", mapping=named | {"instruction": "purse"})
    assert other.attrs["instruction"] == "A"
    stated = recording().assign_attrs(instruction="smile")
    labelled = apply_labels(stated, read_label_map(words))
    assert labelled.attrs["instruction"] == "B"
    assert "named_otherwise" not in {one.code for one in findings_in(labelled)}
    with pytest.raises(ConfigurationError, match="'smile' is instruction 'G'"):
        read_label_map({"instructions": {"smile": "G"}})


def test_a_study_takes_the_pattern(tmp_path: Path) -> None:
    """Also with a pattern in the study file, relative to its folder."""
    folder = tmp_path / "data"
    folder.mkdir()
    for name in ("V1_A_1", "V1_A_2"):
        whole = recording().drop_attrs(deep=False).assign_attrs(origin="measured")
        whole.to_netcdf(folder / f"{name}.nc")
    pattern = PATTERN.replace(".c3d", ".nc")
    (tmp_path / "study.toml").write_text(f'[recordings]\nfolder = "data"\nmapping = "{pattern}"\n')
    study = load_study(tmp_path / "study.toml")
    assert isinstance(study.recordings, RecordingsConfiguration)
    intake = take_in(study.recordings)
    assert sorted(one.place for one in intake.recordings) == [("V1", "A", 1), ("V1", "A", 2)]


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ("{volunteer}_{instruction}_{repetition}.nc", ["volunteer", "instruction", "repetition"]),
        ({"names": "{volunteer}_{instruction}_3.nc"}, ["volunteer", "instruction"]),
        ({"repetition": 4}, ["repetition"]),
        ({"files": {"V9_C_3.nc": {"volunteer": "V2"}}}, ["volunteer"]),
        ({"volunteer": "V1", "instruction": "A", "repetition": 2}, []),
        (None, []),
    ],
)
def test_a_name_or_mapping_that_contradicts_the_recording_is_a_finding(tmp_path, mapping, message):
    values = np.random.default_rng(0).normal(0.0, 1e-5, (1, 4000))
    coords = {"channel": ["ZYG_L"], "time_emg": ("time_emg", np.arange(4000) / 2e3, {"units": "s"})}
    emg = xr.DataArray(values, coords, ("channel", "time_emg"), "emg", {"units": "V"})
    trial = {"volunteer": "V1", "instruction": "A", "repetition": 2, "origin": "simulated"}
    path = write_recording(xr.Dataset({"emg": emg}, attrs=trial), tmp_path / "V9_C_3.nc")
    findings = findings_in(read_recording(path, mapping=mapping))
    assert [f.values["what"] for f in findings if f.code == "named_otherwise"] == message
