"""Choices varied by a study as dims of its cube, and their effects."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from analysis.axes import NOT_IN_DESIGN, combine_cubes, further_axes, reference_cube
from analysis.errors import CubeError
from analysis.sensitivity import choices_table, sensitivity
from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.report.results import open_results
from emgface.report.write import render_report
from emgface.schema.netcdf import read_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import load_study, study_template, variants
from emgface.study.run import run_study
from tests.study_run.conftest import MECHANICS

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

AMBIGUITIES = """
[[axis]]
parameters = ["signals.mapping.mapping_stage"]
levels = ["signal", "feature", "activation"]
[[axis]]
parameters = ["signals.normalisation.reach"]
levels = ["trial", "session"]
[[axis]]
name = "wamp_threshold"
parameters = ["signals.feature.threshold"]
levels = [10e-6, 5e-6]
[[axis]]
parameters = ["signals.filter.phase"]
levels = ["zero", "causal"]
[[axis]]
parameters = ["simulation.sigma_max"]
levels = [100e3, 60e3]
[[axis]]
parameters = ["simulation.fibre_law", "simulation.P1"]
levels = [["blemker", 0.05], ["generic", 500.0]]
[[axis]]
parameters = ["simulation.bulk_potential"]
levels = ["logarithmic", "quadratic"]
[[axis]]
name = "marker_ring"
parameters = ["face.path"]
levels = ["ring_0.nc", "ring_1.nc"]
"""


def loaded(folder: Path, text: str) -> StudyConfiguration:
    path = folder / "study.toml"
    path.write_text(text)
    return load_study(path)


def test_all_named_ambiguities_fit_in_one_study(tmp_path: Path) -> None:
    study = loaded(tmp_path, AMBIGUITIES)
    made = variants(study)
    assert len(made) == 1 + 2 + 7
    assert made[0].labels == (
        "signal", "trial", 10e-6, "zero", 100e3, "blemker", "logarithmic", "ring_0",
    )  # fmt: skip
    assert made[0].study.face.path == tmp_path / "ring_0.nc"
    generic = next(v for v in made if "generic" in v.labels)
    assert generic.study.simulation.fibre_law == "generic"
    assert generic.study.simulation.P1 == 500.0
    assert generic.study.signals == made[0].study.signals
    every = variants(study.model_copy(update={"axis_design": "factorial"}))
    assert len(every) == 3 * 2**7 and len({v.labels for v in every}) == len(every)


def test_the_template_writes_axes_back(tmp_path: Path) -> None:
    study = loaded(tmp_path, AMBIGUITIES)
    assert loaded(tmp_path, study_template(study)).axis == study.axis


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("parameters = ['simulation.sigma_max']\nlevels = [1e5]", "1 parameters and 1 levels"),
        ("parameters = ['recordings.folder']\nlevels = ['a', 'b']", "expected a parameter of"),
        ("parameters = ['simulation.sigma_mix']\nlevels = [1, 2]", "did you mean 'sigma_max'"),
        ("parameters = ['simulation.sigma_max']\nlevels = [1e5, -1]", "sigma_max = -1.0: "),
        ("parameters = ['simulation.sigma_max']\nlevels = [1e5, 1e5]", "a level twice"),
        ("parameters = ['simulation.sigma_max']\nlevels = [1e5, [1, 2]]", "a level of 2 values"),
        ("name = 'marker'\nparameters = ['simulation.step']\nlevels = [1, 2]", "not used in the cube"),
    ],
)  # fmt: skip
def test_axes_that_cannot_be_varied(tmp_path: Path, text: str, complaint: str) -> None:
    with pytest.raises(ConfigurationError, match=complaint):
        loaded(tmp_path, f"[[axis]]\n{text}")


@pytest.fixture(scope="module")
def varied(laboratory: Path, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("varied")
    study = configure(
        StudyConfiguration,
        {
            "strategies": ["act_rel"],
            "recordings": {"folder": str(laboratory / "recordings"), "instructions": ["B"]},
            "face": {"path": str(laboratory / "face.nc")},
            "signals": {"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}},
            "simulation": MECHANICS,
            "axis": [
                {"parameters": ["simulation.sigma_max"], "levels": [100e3, 60e3]},
                {"parameters": ["score.form"], "levels": ["consistent", "as_printed"]},
            ],
        },
    )
    run_study(study, folder)
    return folder


def test_cube_has_the_axes_as_dims(varied: Path) -> None:
    cube = read_netcdf(varied / "cube.nc", "cube")
    assert further_axes(cube) == ["simulation_sigma_max", "form"]
    at = {"volunteer": "S01", "instruction": "B", "repetition": 1, "strategy": "act_rel"}
    trial = cube.sel(at)
    assert trial["status"].values.tolist() == [["ok", "ok"], ["ok", "missing"]]
    assert str(trial["reason"].values[1, 1]) == NOT_IN_DESIGN
    # The printed form is smaller by the factor (n - 1)/n, with n samples of the trial.
    ratio = trial["rho"].sel(simulation_sigma_max=100e3, form="as_printed") / trial["rho"].sel(
        simulation_sigma_max=100e3, form="consistent"
    )
    samples = 1 / (1 - ratio.values)
    np.testing.assert_allclose(samples, np.round(samples[0]), rtol=1e-6)
    weaker = trial["amplitude_ratio"].sel(form="consistent")
    assert float(weaker.sel(simulation_sigma_max=60e3).median()) < float(
        weaker.sel(simulation_sigma_max=100e3).median()
    )
    base = reference_cube(cube)
    assert base["rho"].dims == ("volunteer", "instruction", "repetition", "strategy", "marker")


def test_report_shows_what_choices_change(varied: Path) -> None:
    text = render_report(open_results(varied), faces=False)
    assert 'id="figure-choices"' in text and "as_printed" in text
    assert "There is one strategy, act_rel; there is no comparison." in text


def test_resuming_reuses_what_choices_share(varied: Path, laboratory: Path) -> None:
    motions = list((varied / "store" / "motion").glob("*.nc"))
    assert len(motions) == 2  # the form of the score needs no simulation of its own


def test_table_of_choices() -> None:
    from analysis.statistics.simulated import simulated_scores

    base = simulated_scores(3)
    moved = base.assign(rho=np.tanh(np.arctanh(base["rho"]) + 0.3).assign_attrs(units="1"))
    cube = combine_cubes({("zero",): base, ("causal",): moved}, {"phase": ["zero", "causal"]})
    table = choices_table(sensitivity(cube))
    assert [row[:3] for row in table.rows] == [
        ("phase", "causal", str(strategy)) for strategy in base["strategy"].values
    ]
    assert [row[3] for row in table.rows] == pytest.approx([0.3] * 3)
    assert "Fisher's z" in table.title and "these 2 instructions" in table.note
    xr.testing.assert_identical(reference_cube(cube)["rho"], base["rho"])


def test_cubes_with_invalid_axes_are_refused() -> None:
    from analysis.statistics.simulated import simulated_scores

    base = simulated_scores(3)
    with pytest.raises(CubeError, match="add the axes marker"):
        combine_cubes({("a",): base}, {"marker": ["a", "b"]})
    with pytest.raises(CubeError, match="add the axes rho"):
        combine_cubes({("a",): base}, {"rho": ["a", "b"]})
    with pytest.raises(CubeError, match="no cube of the reference a"):
        combine_cubes({("b",): base}, {"phase": ["a", "b"]})
    with pytest.raises(CubeError, match="other trials or markers"):
        combine_cubes({("a",): base, ("b",): base.isel(marker=[0])}, {"phase": ["a", "b"]})
    with pytest.raises(CubeError, match="labelled c"):
        combine_cubes({("a",): base, ("c",): base}, {"phase": ["a", "b"]})


def test_accuracy_may_be_varied(tmp_path: Path) -> None:
    study = loaded(
        tmp_path,
        "[[axis]]\nparameters = ['simulation.accuracy']\nlevels = ['draft', 'reference']",
    )
    steps = [variant.study.simulation.step for variant in variants(study)]
    assert steps[0] > steps[1]
