"""The study file: accepted contents, and messages of errors."""

import inspect
import re
import tomllib
from pathlib import Path
from typing import get_args

import pytest
import xarray as xr
from pydantic import BaseModel, ValidationError

from analysis.align import align
from analysis.scores import score
from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.face.template import template_face
from emgface.run.digest import dataset_digest
from emgface.study.configuration import AlignmentParameters, ScoreParameters, StudyConfiguration
from emgface.study.file import load_study, study_face, study_template


def written(folder: Path, text: str) -> Path:
    path = folder / "study.toml"
    path.write_text(text)
    return path


def test_an_empty_file_is_the_published_study(tmp_path: Path) -> None:
    study = load_study(written(tmp_path, ""))
    assert study.strategies == ("act_all", "act_3", "act_rel")
    assert study.simulation.sigma_max == 300e3
    assert study.simulation.sigma_max_policy.factor == 0.9
    assert (study.simulation.C10, study.simulation.C20, study.simulation.kappa) == (
        2500.0, 1175.0, 25e3,
    )  # fmt: skip
    assert study.signals.resampling.steps == 160
    assert study.score.form == "consistent"


def test_a_study_file_of_another_version_is_refused_by_name(tmp_path: Path) -> None:
    assert load_study(written(tmp_path, "schema_version = 1\n")).schema_version == 1
    with pytest.raises(ConfigurationError, match="version 3 of its format, expected version 1"):
        load_study(written(tmp_path, "schema_version = 3\n"))


def test_the_template_holds_every_parameter_and_reads_back_as_the_defaults() -> None:
    text = study_template()
    assert configure(StudyConfiguration, tomllib.loads(text)) == StudyConfiguration()

    def names(model: type[BaseModel]) -> set[str]:
        parameters = set()
        for name, field in model.model_fields.items():
            kinds = (field.annotation, *get_args(field.annotation))
            models = [k for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)]
            parameters |= names(models[0]) if models else {name}
        return parameters

    for name in names(StudyConfiguration):
        assert f"\n{name} =" in text or f"\n# {name} =" in text, name
    assert max(map(len, text.splitlines())) <= 100


def test_the_template_writes_the_values_of_a_study() -> None:
    study = configure(
        StudyConfiguration,
        {"strategies": ["act_rel"], "simulation": {"sigma_max": 123e3, "gravity": False},
         "recordings": {"repetitions": [1, 3]}},
    )  # fmt: skip
    assert configure(StudyConfiguration, tomllib.loads(study_template(study))) == study


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[simulation]\nsigma_mx = 1e5\n", "'simulation.sigma_mx', did you mean 'sigma_max'"),
        ("[alignmnt]\n", "'alignmnt', did you mean 'alignment'"),
        ("[signals.filter]\nhgh = 400.0\n", "'signals.filter.hgh', did you mean 'high'"),
        ("strategies = ['act_5']\n", "strategies.0: unknown strategy 'act_5'.*act_all.*act_rel"),
        ("[simulation]\nstep = -0.01\n", "'simulation.step' = -0.01.*greater than 0"),
        ("[simulation]\nstep = nan\n", "simulation.step.*finite"),
        ("[simulation]\nsolver = 'newton'\n", "'newton'.*converged.*linearly_implicit"),
        ("[simulation]\nsigma_max = 1e3\n", "sigma_max = 1000 Pa is below"),
        ("[simulation]\nincompressibility = 'nodal'\n", "bulk_potential = 'quadratic'"),
        ("[alignment]\nscale_range = [1.1, 1.2]\n", "does not span 1"),
        (
            "[recordings]\ninstructions = ['A', 'G']\n",
            "instruction G is unknown.*A .purse lips., B ",
        ),
        (
            "[face]\npath = 'a.nc'\n[face.template]\n",
            "both path and template are specified, expected one",
        ),
        ("[face.template]\npreset = 'elf'\n", "face.template.preset.*'elf'.*older_woman"),
        ("[face.template]\nresolution = 'huge'\n", "face.template.resolution.*'huge'.*coarse"),
        ("[face.template]\nresolution = 12\n", "face.template.resolution.*400 to 200000"),
        ("strategies = ['act_3', 'act_3']\n", "each only once"),
        ("name = 'a'\nseed 3\n", "not valid TOML.*line 2"),
    ],
)
def test_errors_are_reported_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError, match=said) as caught:
        load_study(written(tmp_path, text))
    assert "study.toml" in str(caught.value) and "\n" not in str(caught.value)


def test_a_missing_file_names_the_command_that_writes_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="emgface study template"):
        load_study(tmp_path / "study.toml")


def test_paths_are_relative_to_the_file_and_not_to_the_shell(tmp_path: Path, monkeypatch) -> None:
    path = written(tmp_path, "[recordings]\nfolder = 'data'\n[face]\npath = 'face.nc'\n")
    monkeypatch.chdir("/")
    study = load_study(path)
    assert study.recordings.folder == tmp_path / "data"
    assert study.face.path == tmp_path / "face.nc"


def test_a_source_of_the_face_is_chosen_by_removing_the_comment_signs() -> None:
    text = study_template()
    start = text.index("# [face.template]")
    end = text.index("\n\n\n", start)
    rows = text[start:end].splitlines()
    chosen = [row.removeprefix("# ") if re.match(r"# (\[|\w+ = )", row) else row for row in rows]
    study = configure(
        StudyConfiguration, tomllib.loads(text[:start] + "\n".join(chosen) + text[end:])
    )
    given = {name for name, value in study.face if value is not None}
    assert given == {"template"}


def test_a_study_simulates_the_template_it_names(medium: xr.Dataset) -> None:
    given = {"face": {"template": {"resolution": "coarse", "preset": "woman", "seed": 4}}}
    face = study_face(configure(StudyConfiguration, given).face)
    same = template_face(resolution="coarse", preset="woman", seed=4)
    assert dataset_digest(face) == dataset_digest(same)
    means = study_face(configure(StudyConfiguration, {}).face)
    assert dataset_digest(means) == dataset_digest(medium)


def test_a_study_cannot_be_changed_after_it_was_read() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        StudyConfiguration().seed = 3


def test_true_activations_are_a_strategy() -> None:
    assert StudyConfiguration(activation_source="true").strategy_names == ("true",)


def defaults(function) -> dict[str, object]:
    return {
        name: given.default
        for name, given in inspect.signature(function).parameters.items()
        if given.kind is inspect.Parameter.KEYWORD_ONLY
    }


def test_the_study_offers_every_option_of_alignment_and_score_with_its_default() -> None:
    options = defaults(align)
    for shared in ("smallest_motion", "smallest_snr"):  # choices of the study, made under score
        options.pop(shared)
    assert AlignmentParameters().arguments() == options
    assert ScoreParameters().model_dump() == defaults(score)
    assert AlignmentParameters(cutoff=0.0).arguments()["cutoff"] is None
