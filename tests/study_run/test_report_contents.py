"""Words and tables of the report of a cube, without the page of a study."""

from pathlib import Path
from typing import get_args

import numpy as np
import xarray as xr

from analysis.cube import build_cube
from analysis.statistics.simulated import simulated_scores
from analysis.tables import origin_of, report_tables
from analysis.trial import Trial
from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.recordings.finding_codes import CODES
from emgface.report import contents
from emgface.report.methods import methods
from emgface.report.results import Results, open_results, representative
from emgface.report.simulated import simulated_limits
from emgface.report.write import render_report
from emgface.schema.netcdf import write_netcdf
from emgface.study.configuration import StudyConfiguration
from tests.study_run.test_report import text_of


def scores(**options) -> xr.Dataset:
    """Scores with all variables of a cube."""
    cube = simulated_scores(5, **options)
    for name, units in (("run_time", "s"), ("steps", "1"), ("sigma_max", "Pa")):
        cube[name] = xr.ones_like(cube["rho"].isel(marker=0, drop=True)).assign_attrs(units=units)
    cube["reason"] = xr.full_like(cube["status"], "")
    return cube


def test_a_planted_difference_is_found_and_no_other_is_claimed() -> None:
    moved = contents.inference(scores(effects=(0.0, 0.9, 0.9), sd_interaction=0.05))
    assert any("rho is higher with the first" in one for one in moved.conclusions)
    still = contents.inference(scores())
    assert not any("is higher" in one or "is lower" in one for one in still.conclusions)
    *contrasts, last = still.conclusions
    assert len(contrasts) == 3 and all("a difference may exist" in one for one in contrasts)
    assert last.startswith("No statement is made about instructions in general: 2 instructions")


def test_a_doubtful_feature_is_reported_with_the_advice_of_its_finding() -> None:
    """No threshold helps a muscle that is not active, and the report must not promise one."""
    for code in ("narrow_count", "weak_burst"):
        cube = scores()
        reasons = np.full(cube["status"].shape, "", dtype=object)
        reasons.flat[0] = f"check: {code.replace('_', ' ')} (ZYG_L, OOM_L)"
        cube["reason"] = cube["status"].dims, reasons
        cube["status"][:] = "ok"
        (sentence,) = contents.features(cube)
        assert "1 of " in sentence and "first of all ZYG_L, named in 1" in sentence
        for advice in ("would serve", "no threshold serves"):
            assert (advice in sentence) == (advice in CODES[code].clause)


def alone(cube: xr.Dataset, folder: Path) -> str:
    """Words of the report of a cube without configuration."""
    write_netcdf(cube, folder / "cube.nc", "cube")
    return text_of(render_report(open_results(folder)))


def test_empty_cube(tmp_path: Path) -> None:
    text = alone(scores().isel(volunteer=[]), tmp_path)
    assert "This study contains no trial; there is nothing to report." in text
    assert "no test is performed" in text and "No simulation was scored" in text


def test_all_trials_failed(tmp_path: Path) -> None:
    trials = [
        Trial("v1", "A", r, s, status="failed:InvertedElement", reason="element 7 is inverted")
        for r in (1, 2)
        for s in ("act_all", "act_3")
    ]
    cube = build_cube(trials, markers=["corner_left"], origin="simulated")
    text = alone(cube, tmp_path)
    assert "No trial could be scored: of 4 trials, 4 failed, 0 were excluded" in text
    assert "failed:InvertedElement 4 v1 A 1 act_all, v1 A 1 act_3" in text
    assert "element 7 is inverted" in text and "Moving face" not in text


def test_one_strategy_and_one_volunteer(tmp_path: Path) -> None:
    cube = scores(volunteers=2).isel(strategy=[0])
    assert "There is one strategy, act_all; there is no comparison." in contents.verdict(cube)
    assert contents.inference(cube).table is None
    two = contents.verdict(scores(volunteers=2))
    assert "There are 2 volunteers; intervals require 5 or more and are not given." in two
    one = scores(volunteers=1)
    assert any("There is one volunteer" in sentence for sentence in contents.verdict(one))
    assert contents.inference(one).conclusions == [
        "There is one volunteer; the tests require several volunteers, and no test is performed."
    ]


def test_simulated_worlds_are_named_with_their_limits(tmp_path: Path, without_figures) -> None:
    matched = scores().assign_attrs(world="matched world")
    matched = matched.assign_coords(strategy=["act_all", "act_3", "act_rel"])
    text = alone(matched, tmp_path)
    assert "simulated recordings, matched world" in text
    assert "the true selection of muscles by construction" in text
    assert "Scores and tests in this report do not apply to people" in text
    other = simulated_limits(matched.assign_attrs(world="world mismatched in delay"))
    assert any("world mismatched in delay" in sentence for sentence in other)
    assert any("an advantage that it may not have in people" in sentence for sentence in other)
    two = matched.isel(strategy=[0, 1])
    assert not any("act_rel" in sentence for sentence in simulated_limits(two))
    unlabelled = simulated_limits(scores())
    assert any("do not state how the volunteers differ" in sentence for sentence in unlabelled)
    assert simulated_limits(matched.assign_attrs(origin="measured")) == []
    titles = [table.title for table in report_tables(matched).values()]
    assert titles and all("simulated recordings, matched world" in title for title in titles)
    assert origin_of(scores()) == "simulated"


def test_rho_identical_everywhere(tmp_path: Path, without_figures) -> None:
    cube = scores()
    cube["rho"][:] = 0.5
    text = alone(cube, tmp_path)
    assert "rho is 0.5 everywhere: all 216 values are identical" in text
    assert "is higher" not in text and "is lower" not in text


def test_representative_trial_is_in_the_middle() -> None:
    cube = scores(volunteers=3, instructions=1, repetitions=1)
    for volunteer, value in (("v1", 0.1), ("v2", 0.9), ("v3", 0.5)):
        cube["rho"].loc[{"volunteer": volunteer}] = value
    assert representative(cube) == {"i1": ("v3", "i1", 1)}
    cube["status"].loc[{"volunteer": "v3", "strategy": "act_3"}] = "failed:SignalError"
    assert representative(cube)["i1"][0] in {"v1", "v2"}


def test_an_error_without_estimate_is_reported_as_such() -> None:
    cube = scores(volunteers=2)
    table = contents.cost(Results(Path(), cube))
    assert table is not None and {row[-1] for row in table.rows} == {"not estimated"}
    cube["numerical_error"] = (0.25e-3 * xr.ones_like(cube["run_time"])).assign_attrs(units="m")
    table = contents.cost(Results(Path(), cube))
    assert table is not None and {row[-1] for row in table.rows} == {"0.25"}


def test_exclusions_name_markers_without_rho() -> None:
    cube = scores(volunteers=2, instructions=1, repetitions=1)
    cube["rho"][0, 0, 0, 0, 1] = np.nan
    cube["marker_reason"] = xr.full_like(cube["rho"], 0.0).astype("U40")
    cube["marker_reason"][:] = ""
    cube["marker_reason"][0, 0, 0, 0, 1] = "the measured marker does not move"
    table = contents.exclusions(Results(Path(), cube))
    assert table.rows == (
        (
            "partly scored",
            1,
            "v1 i1 1 act_all",
            "1 of 3 markers have no rho: the measured marker does not move",
        ),
    )


def chosen(**simulation) -> str:
    study = configure(StudyConfiguration, {"simulation": simulation})
    return methods(study, scores().assign_attrs(face="slab", face_origin="generated"))


def test_methods_state_every_choice_of_the_mechanics() -> None:
    fields = SimulationParameters.model_fields
    texts: dict[str, set[str]] = {}
    for name in ("solver", "incompressibility", "fibre_law", "muscle_form", "damping_tangent"):
        options = get_args(fields[name].annotation)
        extra: dict[str, object] = {"contact": {"method": "none"}}
        extra |= {"bulk_potential": "quadratic"} if name == "incompressibility" else {}
        texts[name] = {chosen(**{name: option}, **extra) for option in options}
        assert len(texts[name]) == len(options), name
    controlled = chosen(solver="converged", error_tolerance=1e-4)
    assert "chosen by error control with a tolerance of 0.1 mm" in controlled
    assert "lips and cheeks with the teeth, where the face has them" in chosen(), "the default"
    assert "support of 5 N/m" in chosen(support=5.0)
    rubbing = {"contact": {"between": ["lips"], "friction": 0.2}}
    lips = "contact of the lips with each other (node-to-face constraints{}, friction 0.2)"
    renewed = ", with the normals and closest points at the end of a step"
    assert lips.format(renewed) in chosen(**rubbing)
    assert lips.format("") in chosen(**rubbing, solver="linearly_implicit", error_tolerance=None)
    assert "contact" not in chosen(contact={"method": "none"})
    assert "the estimated error includes the displacement by the change of the normals" in chosen()
    of_one = chosen(solver="linearly_implicit", error_tolerance=None)
    assert "the estimated error includes 3 % of the displacement" in of_one
    assert "contact was repeated with other time steps" in chosen(check_contact=True)


def test_methods_state_every_choice_of_the_signals() -> None:
    for table, name in (
        ("feature", "kind"),
        ("mapping", "mapping_stage"),
        ("normalisation", "reach"),
    ):
        model = getattr(StudyConfiguration().signals, table)
        options = get_args(type(model).model_fields[name].annotation)
        texts = {
            methods(configure(StudyConfiguration, {"signals": {table: {name: option}}}), scores())
            for option in options
        }
        assert len(texts) == len(options), name


def test_the_report_says_how_often_full_order_replaced_a_reduced_face() -> None:
    labels = {"volunteer": ["V1", "V2", "V3"], "instruction": ["A"], "repetition": [1]}
    dims, shape = (*labels, "strategy"), (3, 1, 1, 1)
    status = np.array(["ok", "ok", "failed:InvertedElement"]).reshape(shape)
    used = np.array([1.0, 0.0, 0.0]).reshape(shape)
    data = {"status": (dims, status), "reduced": (dims, used)}
    cube = xr.Dataset(data, coords={**labels, "strategy": ["act_all"]})
    (sentence,) = contents.reduction(cube)
    assert sentence.startswith("A reduced face was simulated in 2 scored trials. In 1 of them,")
    assert not contents.reduction(cube.assign(reduced=(dims, np.full(shape, np.nan))))


def test_the_error_of_the_time_steps_is_stated_with_the_motion() -> None:
    labels = {"volunteer": ["V1", "V2", "V3"], "instruction": ["A"], "repetition": [1]}
    dims = (*labels, "strategy")
    shape = (3, 1, 1, 1)

    def over(*values: object) -> tuple[tuple[str, ...], np.ndarray]:
        return dims, np.array(values).reshape(shape)

    cube = xr.Dataset(
        {
            "status": over("ok", "ok", "failed:InvertedElement"),
            "numerical_error": over(0.1e-3, 2e-3, 9e-3),
            "motion": over(4e-3, 6e-3, 1e-3),
            "inaccurate": over(0.0, 1.0, 1.0),
        },
        coords={**labels, "strategy": ["act_all"]},
    )
    (sentence,) = contents.accuracy(cube)
    assert "a median of 1.1 mm and a maximum of 2 mm; the median motion is 5 mm" in sentence
    assert "a tenth of the motion in 1 trial, flagged as inaccurate" in sentence
    assert (
        "not estimated in any"
        in contents.accuracy(cube.assign(numerical_error=over(*[np.nan] * 3)))[0]
    )
    assert contents.accuracy(cube.drop_vars("motion")) == []


def test_muscles_without_information_are_named_with_a_threshold_to_try() -> None:
    """One channel is far below the threshold of the Willison amplitude, in one trial of two."""
    from types import SimpleNamespace

    from emgface.muscles import CHANNELS
    from emgface.report.figures import mute_muscles

    def recording(k, quiet):
        emg = 1e-4 * np.random.default_rng(k).normal(size=(len(CHANNELS), 4000))
        emg[list(CHANNELS).index("ZYG_L")] *= 1e-3 if quiet else 1.0
        data = xr.Dataset(
            {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
            {"channel": list(CHANNELS), "time_emg": ("time_emg", np.arange(4000) / 2000.0)},
        )
        return SimpleNamespace(error=None, excluded=[], dataset=data, place=("V1", "A", k))

    intake = SimpleNamespace(recordings=[recording(1, quiet=False), recording(2, quiet=True)])
    (sentence,) = mute_muscles(SimpleNamespace(study=StudyConfiguration(), intake=intake))
    assert sentence.startswith(
        "ZYG_L contains no information in trial V1 A 2: its Willison amplitude"
    )
    assert "is zero in every window at a threshold of 1e-05 V: try a threshold near" in sentence
