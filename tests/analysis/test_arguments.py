"""Odd arguments of tests and alignments: seeds, counts, levels, switches, and values of a cube."""

import dataclasses
import importlib
import inspect
import pkgutil

import numpy as np
import pytest
import xarray as xr
from synthetic_cubes import cube
from synthetic_trajectories import trajectory

import analysis.statistics
from analysis.align import align
from analysis.arguments import count, generator, number, yes_or_no
from analysis.errors import AlignmentError, AnalysisError, StatisticsError
from analysis.matching import Options
from analysis.statistics.paired import Comparison, compare
from analysis.statistics.summary import study_statistics

NO_NUMBER = [True, "1", None, 1j, [1.0], float("nan")]
NO_SEED = [-1, 2.5, *NO_NUMBER]
#: first parameters of the functions that users call; others receive checked options
FIRST = {"data", "cube", "effect", "differences", "seed"}
#: functions that draw only for more than 12 volunteers
EXACT = {"sign_flip"}


def functions(parameter: str):
    """Public functions of the tests with a parameter."""
    for module in pkgutil.iter_modules(analysis.statistics.__path__):
        statistics = importlib.import_module(f"analysis.statistics.{module.name}")
        for name, value in vars(statistics).items():
            if not (inspect.isfunction(value) and value.__module__ == statistics.__name__):
                continue
            names = list(inspect.signature(value).parameters)
            if parameter in names and names[0] in FIRST and not name.startswith("_"):
                yield pytest.param(value, id=name)


def called(function, **options):
    """Result of a function for its data, with options."""
    given = {
        "cube": cube, "data": lambda: compare(cube()), "effect": lambda: 0.3, "margin": lambda: 0.3,
        "standard_deviation": lambda: 0.2, "seed": lambda: 0, "n": lambda: 20,
        "values": lambda: np.arange(20.0), "statistic": lambda: "median", "draws": lambda: 100,
        "differences": lambda: np.random.default_rng(0).normal(size=(4, 2, 2, 1)),
        "means": lambda: [np.arange(20.0)],
    }  # fmt: skip
    parameters = inspect.signature(function).parameters.values()
    needed = {p.name: given[p.name]() for p in parameters if p.default is p.empty}
    return function(**{**needed, **options})


@pytest.mark.parametrize("function", functions("seed"))
def test_seeds_are_whole_numbers_from_zero(function):
    if function.__name__ in EXACT:
        pytest.skip("no draws for so few volunteers")
    for seed in NO_SEED:
        with pytest.raises(StatisticsError, match="the seed is"):
            called(function, seed=seed)


@pytest.mark.parametrize("function", functions("level"))
def test_levels_are_real_numbers(function):
    for level in [*NO_NUMBER, 0.0, 1.0]:
        with pytest.raises(StatisticsError, match="the level is"):
            called(function, level=level)


@pytest.mark.parametrize("dim", ["volunteer", "instruction", "repetition", "marker", "strategy"])
def test_labels_that_occur_twice_are_refused(dim):
    made = cube()
    twice = xr.concat([made, made.isel({dim: [0]})], dim, coords="minimal", compat="override")
    for test in (compare, study_statistics):
        with pytest.raises(StatisticsError, match=f"contains the {dim} .* more than once"):
            test(twice)


@pytest.mark.parametrize("value", [np.inf, -np.inf])
@pytest.mark.parametrize("variable", ["rho", "rmse", "amplitude_ratio"])
def test_an_infinite_value_of_a_scored_trial_is_refused(variable, value):
    made = cube().copy(deep=True)
    scored = np.argwhere((made["status"] == "ok").broadcast_like(made[variable]).values)[0]
    made[variable] = made[variable].transpose(*(made["status"].broadcast_like(made[variable])).dims)
    made[variable].values[tuple(scored)] = value
    scale = "z" if variable == "rho" else "raw"
    with pytest.raises(StatisticsError, match=f"{variable} is infinite in 1 scored"):
        compare(made, variable=variable, scale=scale)
    unscored = made.assign(status=xr.full_like(made["status"], "missing"))
    assert isinstance(compare(unscored, variable=variable, scale=scale), Comparison)


@pytest.mark.parametrize("name", [f.name for f in dataclasses.fields(Options)])
def test_options_of_alignments_have_their_type(name):
    wrong = {"scaling": ["x", None, 1], "sign": ["x", None, 1]}.get(name)
    if name in ("centred", "subsample"):
        wrong = ["no", 1, 0, None, "True"]
    if name == "scale_range":
        wrong = [1.0, (0.5,), (True, 2.0), ("0.5", 2.0), (0.5, 2.0, 3.0), "ab"]
    for value in wrong or [v for v in NO_NUMBER if v is not None]:
        with pytest.raises(AlignmentError, match=name):
            align(trajectory(), trajectory(), **{name: value})


def test_numbers_of_numpy_are_numbers():
    assert number("x", np.float32(0.5)) == 0.5 and count("n", np.int64(3), least=3) == 3
    assert yes_or_no("b", np.True_) is True
    a, b = generator(np.uint8(7)).random(3), np.random.default_rng(7).random(3)
    np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "public", ["descriptives", "trials", "study_statistics", "descriptive_table", "trial_table"]
)
def test_a_cube_without_status_is_refused(public: str) -> None:
    """The variable that tells which trials were scored is missing: a sentence, not a KeyError."""
    with pytest.raises(AnalysisError, match="no variable 'status'"):
        getattr(analysis, public)(cube().drop_vars("status"))
