"""Completeness of the cube: scored, failed and missing trials."""

import itertools

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from synthetic_cubes import MARKERS, Inverted, cube, results, scores

from analysis.cube import MARKER_DIMS, TRIAL_DIMS, build_cube
from analysis.descriptives import descriptives
from analysis.errors import CubeError
from analysis.listing import counts, trials
from analysis.trial import Trial


def test_every_combination_has_a_status() -> None:
    scored = cube()
    assert scored["status"].dims == TRIAL_DIMS
    assert scored["rho"].dims == MARKER_DIMS
    assert scored["status"].size == 24
    given_in = {(t.volunteer, t.instruction, t.repetition, t.strategy): t for t in results()}
    labels = (scored[dim].values.tolist() for dim in TRIAL_DIMS)
    for label in itertools.product(*labels):
        cell = scored.sel(dict(zip(TRIAL_DIMS, label, strict=True)))
        trial = given_in.get(label)
        if trial is None:
            assert str(cell["status"].values) == "missing"
            assert str(cell["reason"].values) == "no result was passed"
        elif trial.scores is None:
            assert str(cell["status"].values) == "failed:Inverted"
            assert str(cell["reason"].values).startswith("element ")
            assert float(cell["sigma_max"]) == 240e3
        else:
            assert str(cell["status"].values) == "ok"
            for name in ("rho", "amplitude_ratio", "rmse"):
                np.testing.assert_array_equal(cell[name], trial.scores[name])
            assert float(cell["shift"]) == float(trial.scores["shift"])
            assert (float(cell["steps"]), float(cell["run_time"])) == (160, trial.run_time)
            continue
        assert np.isnan(cell["rho"]).all()


def test_undefined_marker_keeps_its_reason() -> None:
    cell = cube().sel(volunteer="v1", instruction="A", repetition=1, strategy="act_all")
    assert list(cell["marker_reason"].values) == ["", "the simulated marker does not move", ""]
    assert str(cell["status"].values) == "ok"


def test_expected_labels_without_result_are_missing() -> None:
    scored = build_cube(
        [Trial("v1", "A", 1, "act_3", scores(0))],
        volunteers=["v1", "v2", "v3"],
        instructions=list("ABCDEF"),
        repetitions=[1, 2, 3, 4],
        strategies=["act_all", "act_3", "act_rel"],
    )
    assert scored["status"].size == 216
    assert int((scored["status"] == "missing").sum()) == 215
    assert [int(c.iloc[0]) for _, c in counts(scored, by=()).items()] == [216, 1, 0, 0, 215, 3, 0]


def test_all_failed_is_still_a_cube() -> None:
    error = Inverted("element 7 inverted")
    scored = build_cube(
        [Trial.failed("v1", "A", 1, "act_3", error)], markers=MARKERS, origin="measured"
    )
    assert scored.attrs["origin"] == "measured"
    assert np.isnan(scored["rho"]).all()
    table = descriptives(scored)
    assert int(table["n_failed"].sum()) == 3
    assert np.isnan(table["median"]).all()


def test_trials_lists_all_with_status() -> None:
    scored = cube()
    table = trials(scored)
    assert len(table) == 24
    assert table["status"].value_counts().to_dict() == {
        "ok": 19,
        "failed:Inverted": 3,
        "missing": 2,
    }
    for row in table.itertuples():
        cell = scored.sel({dim: getattr(row, dim) for dim in TRIAL_DIMS})
        assert str(cell["status"].values) == row.status
        if row.n_defined:
            assert row.median_rho == np.nanmedian(cell["rho"])
    assert table["n_undefined"].sum() == 1


def test_counts_add_up() -> None:
    by_strategy = counts(cube())
    assert by_strategy.loc["act_all"].to_dict() == {
        "trials": 8, "ok": 5, "failed": 3, "excluded": 0, "missing": 0, "correlations": 14,
        "undefined": 1,
    }  # fmt: skip
    assert by_strategy.loc["act_rel", "missing"] == 1
    parts = by_strategy[["ok", "failed", "excluded", "missing"]].sum(axis=1)
    assert (parts == by_strategy["trials"]).all()
    pd.testing.assert_series_equal(
        counts(cube(), by=()).iloc[0], by_strategy.sum(), check_names=False, check_index=True
    )


def test_counts_by_marker_is_refused() -> None:
    with pytest.raises(CubeError, match="by marker"):
        counts(cube(), by=("marker",))


def test_order_of_results_does_not_matter() -> None:
    made, rng = results(), np.random.default_rng(0)
    labels = {
        "volunteers": ["v1", "v2"],
        "instructions": ["A", "B"],
        "strategies": ["act_all", "act_3", "act_rel"],
    }
    ordered = build_cube(made, **labels)
    for order in (range(len(made))[::-1], *(rng.permutation(len(made)) for _ in range(4))):
        shuffled = build_cube([made[i] for i in order], **labels)
        xr.testing.assert_identical(shuffled, ordered)


def test_markers_are_matched_by_name() -> None:
    first, second = scores(1), scores(2).isel(marker=[2, 0, 1])
    scored = build_cube([Trial("v1", "A", 1, "s", first), Trial("v1", "A", 2, "s", second)])
    cell = scored["rho"].sel(repetition=2, marker="corner_left").item()
    assert cell == float(second["rho"].sel(marker="corner_left"))


def test_cube_survives_netcdf(tmp_path) -> None:
    scored = cube()
    scored.to_netcdf(tmp_path / "cube.nc")
    with xr.open_dataset(tmp_path / "cube.nc") as again:
        xr.testing.assert_equal(again.load(), scored)


def test_cube_meets_the_schema(root) -> None:
    """Names, dims and units as data_schema/cube.json declares them."""
    import json

    declared = json.loads((root / "data_schema" / "cube.json").read_text())
    scored = cube()
    of_the_study = {"recording", "recording_digest"}  # attributes of studies only
    assert of_the_study < set(declared["variables"])
    for name, variable in declared["variables"].items():
        if name in of_the_study or (name not in scored and variable.get("required") is False):
            continue
        assert list(scored[name].dims) == variable["dims"], name
        assert scored[name].attrs.get("units") == variable["units"], name


def second(**options) -> list[Trial]:
    """A trial, and another one of the same study with other scores."""
    return [Trial("v1", "A", 1, "s", scores(1)), Trial("v1", "A", 2, "s", scores(2, **options))]


def without_origin() -> xr.Dataset:
    scored = scores(1)
    del scored.attrs["origin"]
    return scored


def only(scored: xr.Dataset) -> list[Trial]:
    return [Trial("v1", "A", 1, "s", scored)]


@pytest.mark.parametrize(
    ("trials", "labels", "words"),
    [
        (2 * results()[:1], {}, "v1/A/1/act_all is passed twice"),
        (results(), {"volunteers": ["v1"]}, "has volunteer 'v2', expected one of v1"),
        (second(markers=(*MARKERS[:2], "nose")), {}, "other markers than the cube .*nose"),
        (second(origin="measured"), {}, "cannot share a cube"),
        (
            only(without_origin()),
            {},
            "is unknown, expected 'measured' or 'simulated'",
        ),
        (second(form="as_printed"), {}, "form = 'as_printed', another one with 'consistent'"),
        ([], {}, "there is no volunteer"),
        (only(scores(1).drop_vars("rmse")), {}, "lack rmse"),
    ],
)
def test_results_that_form_no_cube_are_refused(trials, labels, words) -> None:
    with pytest.raises(CubeError, match=words):
        build_cube(trials, **labels)


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ({"status": "fine"}, "status 'fine', expected 'ok'"),
        ({"status": "failed:"}, "status 'failed:'"),
        ({}, "'ok' but no scores"),
        ({"status": "missing", "scores": scores(1)}, "'missing' but scores"),
        ({"status": "excluded", "scores": scores(1)}, "'excluded' but scores"),
    ],
)
def test_status_and_scores_must_agree(kind: dict, words: str) -> None:
    with pytest.raises(CubeError, match=words):
        Trial("v1", "A", 1, "s", **kind)


def test_the_cube_says_where_full_order_replaced_a_reduced_face() -> None:
    given_in = [
        Trial("V1", "A", k, "act_all", scores(k), reduced=value)
        for k, value in enumerate((1.0, 0.0, np.nan), 1)
    ]
    reduced = build_cube(given_in)["reduced"].values.ravel()
    np.testing.assert_array_equal(reduced, [1.0, 0.0, np.nan])


def test_a_trial_whose_error_exceeds_a_tenth_of_its_motion_is_flagged() -> None:
    errors = {("V1", 1): (0.2e-3, 3e-3), ("V1", 2): (0.4e-3, 3e-3), ("V2", 1): (np.nan, 3e-3)}
    given_in = [
        Trial(
            volunteer,
            "A",
            repetition,
            "act_all",
            scores(repetition),
            numerical_error=error,
            motion=motion,
        )
        for (volunteer, repetition), (error, motion) in errors.items()
    ]
    scored = build_cube(given_in)
    for (volunteer, repetition), raised in {("V1", 1): 0.0, ("V1", 2): 1.0}.items():
        cell = scored.sel(volunteer=volunteer, repetition=repetition)
        assert cell["inaccurate"].item() == raised
        assert cell["motion"].item() == 3e-3
    assert np.isnan(scored["inaccurate"].sel(volunteer="V2", repetition=1).item())
    listed = trials(scored)
    flagged = listed[listed["flags"] == "inaccurate"]
    assert flagged[["volunteer", "repetition"]].values.tolist() == [["V1", 2]]
