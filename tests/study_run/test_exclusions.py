"""Excluded trials: they are not computed, and the cube contains the reason."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from analysis.tables import descriptive_table
from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.recordings.dataset import read_recording, write_recording
from emgface.recordings.exclusions import Exclusion, exclusions_text, read_exclusions
from emgface.schema.netcdf import read_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import load_study, study_template
from emgface.study.run import run_study
from tests.study_run.test_cli import one_sentence, run

WHY = 'the electrode "ZYG_L" fell off, 3 µV left; \\ tab\tand\x7f'


def test_an_excluded_trial_is_not_computed_and_keeps_its_reason(laboratory, tmp_path) -> None:
    out = tmp_path / "study"
    values = {
        "strategies": ["act_rel", "act_all"],
        "recordings": {"folder": str(laboratory / "recordings"), "instructions": ["B"]},
        "face": {"path": str(laboratory / "face.nc")},
        "exclude": [
            {"volunteer": "S01", "instruction": "B", "reason": WHY},
            {"volunteer": "S09", "reason": "never came"},
        ],
    }
    result = run_study(configure(StudyConfiguration, values), out)
    assert result.events == []  # nothing of it was computed
    cube = read_netcdf(result.path, "cube")
    assert (cube["status"] == "excluded").all() and (cube["reason"] == WHY).all()
    assert np.isnan(cube["rho"]).all()
    table = descriptive_table(cube)
    counted = dict(zip([column.name for column in table.columns], table.rows[0], strict=True))
    assert (counted["excluded"], counted["failed"], counted["missing"], counted["n"]) == (
        1, 0, 0, 0,
    )  # fmt: skip


def test_exclusions_are_written_and_read_back(tmp_path: Path) -> None:
    given = (
        Exclusion(volunteer="Müller", instruction="E", repetition=2, reason=WHY),
        Exclusion(instruction="C", reason="too strong"),
    )
    path = tmp_path / "exclusions.toml"
    path.write_text(exclusions_text(given), encoding="utf-8")
    assert read_exclusions(path) == given
    (tmp_path / "study.toml").write_text(
        '[recordings]\nexclusions = "exclusions.toml"\n'
        '[[exclude]]\nrepetition = 3\nreason = "laughed"\n'
    )
    study = load_study(tmp_path / "study.toml")
    assert study.exclude == (Exclusion(repetition=3, reason="laughed"), *given)
    assert configure(StudyConfiguration, tomllib.loads(study_template(study))).exclude == (
        study.exclude
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('[[exclude]]\nvolunteer = "V1"\n', "volunteer V1 has no reason"),
        ('[[exclude]]\nreason = "x"\n', "specifies no volunteer.*every trial"),
        ('[[exclude]]\ninstruction = "Z"\nreason = "x"\n', "'Z' is unknown"),
        ('[[exclude]]\nvolunter = "V1"\nreason = "x"\n', "volunter"),
        ("[[exclude", "not valid TOML"),
    ],
)
def test_a_wrong_exclusion_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "e.toml").write_text(text)
    with pytest.raises(ConfigurationError, match=said):
        read_exclusions(tmp_path / "e.toml")
    with pytest.raises(ConfigurationError, match="No file .*check the path"):
        read_exclusions(tmp_path / "absent.toml")


def test_the_check_writes_the_exclusions_of_what_cannot_be_used(laboratory, tmp_path) -> None:
    folder = tmp_path / "recordings"
    for path in (laboratory / "recordings").glob("*.nc"):
        recording = read_recording(path)
        if recording.attrs["instruction"] == "E":
            recording["emg"].loc["ZYG_L"] = 0.0
        write_recording(recording, folder / path.name)
    out = tmp_path / "exclusions.toml"
    result = run("check", folder, "--study", "--exclude", out)
    assert result.exit_code == 2 and "1 of 2 recordings" in result.stderr
    exclusions = read_exclusions(out)
    assert [(e.volunteer, e.instruction, e.repetition) for e in exclusions] == [("S01", "E", 1)]
    assert "channel ZYG_L: constant" in exclusions[0].reason
    one_sentence(run("check", folder, "--exclude", out), "DataError", "exists")
