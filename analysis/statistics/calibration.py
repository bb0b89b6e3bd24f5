"""What the tests are worth for a number of volunteers: their size and coverage, measured."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.errors import StatisticsError
from analysis.statistics.bootstrap import hierarchical_bootstrap
from analysis.statistics.equivalence import equivalence
from analysis.statistics.mixed_model import mixed_model
from analysis.statistics.ranks import friedman, wilcoxon
from analysis.statistics.sign_flip import sign_flip
from analysis.trajectory import names

STRATEGIES: Final = ("act_all", "act_3", "act_rel")


def simulated_scores(
    seed: int,
    *,
    volunteers: int = 6,
    instructions: int = 2,
    repetitions: int = 2,
    markers: int = 3,
    strategies: Sequence[str] = STRATEGIES,
    effects: Sequence[float] = (0.0, 0.0, 0.0),
    centre: float = 0.6,
    sd_volunteer: float = 0.3,
    sd_instruction: float = 0.3,
    sd_marker: float = 0.2,
    sd_interaction: float = 0.2,
    sd_error: float = 0.4,
) -> xr.Dataset:
    """Draw a cube of scores whose truth is known.

    artanh(rho) = centre + effect(strategy) + volunteer + instruction + marker
                  + volunteer x strategy + error

    Parameters
    ----------
    seed : int
        Of the draws.
    volunteers, instructions, repetitions, markers : int
        Sizes of the cube.
    strategies : sequence of str
        Labels.
    effects : sequence of float
        One per strategy, in Fisher's z.
    centre : float
        Mean of Fisher's z where all else is zero.
    sd_volunteer, sd_instruction, sd_marker, sd_interaction, sd_error : float
        Standard deviations of the normal terms, in Fisher's z.

    Returns
    -------
    xarray.Dataset
        As of `analysis.cube.build_cube` with ``rho``, ``amplitude_ratio`` and ``rmse`` [m], the
        latter two functions of rho, and ``status`` "ok" throughout; ``origin`` is "simulated".

    Raises
    ------
    StatisticsError
        Not one effect per strategy.
    """
    if len(effects) != len(strategies):
        raise StatisticsError(f"{len(effects)} effects for {len(strategies)} strategies")
    rng = np.random.default_rng(seed)
    dims = ("volunteer", "instruction", "repetition", "strategy", "marker")
    shape = (volunteers, instructions, repetitions, len(strategies), markers)

    def term(deviation: float, *over: str) -> np.ndarray:
        size = [n if dim in over else 1 for dim, n in zip(dims, shape, strict=True)]
        return deviation * rng.standard_normal(size)

    z = centre + np.asarray(effects, dtype=np.float64)[:, None]
    z = z + term(sd_volunteer, "volunteer") + term(sd_instruction, "instruction")
    z = z + term(sd_marker, "marker") + term(sd_interaction, "volunteer", "strategy")
    rho = np.tanh(z + term(sd_error, *dims))
    return xr.Dataset(
        {
            "rho": (dims, rho, {"units": "1"}),
            "amplitude_ratio": (dims, np.exp(rho - 1.0), {"units": "1"}),
            "rmse": (dims, 1e-3 * (1.0 - rho), {"units": "m"}),
            "status": (dims[:-1], np.full(shape[:-1], "ok", dtype="U24")),
        },
        coords={
            "volunteer": [f"v{index + 1}" for index in range(volunteers)],
            "instruction": [f"i{index + 1}" for index in range(instructions)],
            "repetition": list(range(1, repetitions + 1)),
            "strategy": list(strategies),
            "marker": [f"marker_{index + 1}" for index in range(markers)],
        },
        attrs={"origin": "simulated"},
    )


Outcome = dict[str, tuple[float, float]]
"""Per method: p of a true null hypothesis, and 1 where the interval holds the truth."""


def _sign_flip(cube: xr.Dataset, seed: int) -> Outcome:
    found = sign_flip(cube)
    return {
        "sign flip": (float(found["p"][0]), _holds(found, 0.0)),
        "sign flip, joint": (float(found["p_joint"].min()), np.nan),
    }


def _wilcoxon(cube: xr.Dataset, seed: int) -> Outcome:
    found = wilcoxon(cube)
    return {
        "Wilcoxon": (float(found["p"][0]), _holds(found, 0.0)),
        "Wilcoxon, Holm": (float(found["p_holm"].min()), np.nan),
    }


def _friedman(cube: xr.Dataset, seed: int) -> Outcome:
    found = friedman(cube)
    return {
        "Friedman": (float(found["p"][0]), np.nan),
        "Friedman, chi-square limit": (float(found["p_chi2"][0]), np.nan),
    }


def _mixed_model(cube: xr.Dataset, seed: int) -> Outcome:
    found = mixed_model(cube)
    wald = abs(float(found["estimate"][0])) <= 1.959964 * float(found["standard_error"][0])
    return {
        "mixed model, t": (float(found["p"][0]), _holds(found, 0.0)),
        "mixed model, Wald": (float(found["p_wald"][0]), float(wald)),
    }


def _bootstrap(cube: xr.Dataset, seed: int) -> Outcome:
    draw = partial(hierarchical_bootstrap, draws=500, seed=seed)
    pair = [(str(cube["strategy"].values[1]), str(cube["strategy"].values[0]))]
    return {
        "bootstrap, expanded": (np.nan, _holds(draw(cube, contrasts=pair), 0.0)),
        "bootstrap, percentile": (
            np.nan,
            _holds(draw(cube, contrasts=pair, interval="percentile"), 0.0),
        ),
    }


def _equivalence(cube: xr.Dataset, seed: int) -> Outcome:
    # The test has its largest size where the true difference equals the margin.
    margin = 0.3
    second = cube["strategy"].values[1]
    moved = np.tanh(np.arctanh(cube["rho"]) + margin * (cube["strategy"] == second))
    found = equivalence(cube.assign(rho=moved.assign_attrs(units="1")), margin=margin)
    return {"equivalence": (float(found["p"][0]), _holds(found, margin))}


METHODS: Final[dict[str, Callable[[xr.Dataset, int], Outcome]]] = {
    "sign_flip": _sign_flip,
    "wilcoxon": _wilcoxon,
    "friedman": _friedman,
    "mixed_model": _mixed_model,
    "bootstrap": _bootstrap,
    "equivalence": _equivalence,
}


def calibration(
    *,
    methods: Sequence[str] = tuple(METHODS),
    alpha: float = 0.05,
    simulations: int = 200,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
    **model: Any,
) -> xr.Dataset:
    """Measure how often each test rejects a true null hypothesis, and each interval holds.

    Parameters
    ----------
    methods : sequence of str
        Keys of `METHODS`.
    alpha : float
        Nominal size [1].
    simulations : int
        Cubes drawn; the Monte Carlo error of a size of 0.05 is 0.22 / sqrt(simulations).
    seed : int
        Cubes are drawn with the seeds seed, seed + 1, and so on.
    progress : callable, optional
        Called with the cubes done and their number.
    **model
        Sizes and standard deviations of `simulated_scores`; its effects stay zero.

    Returns
    -------
    xarray.Dataset
        Dim test: ``size`` [1], share of p <= alpha (over all contrasts for joint and Holm, one
        contrast otherwise); ``coverage`` [1] of the interval, nominal 0.95 (equivalence 0.90; the
        exact ones choose the next level they can reach); each with its Monte Carlo error,
        ``size_error`` and ``coverage_error``; NaN where a method has no p or no interval.

    Raises
    ------
    StatisticsError
        Unknown method or no simulation.

    Notes
    -----
    Six volunteers, the defaults of `simulated_scores`, 1000 cubes (seed 1000), Monte Carlo error
    0.006 to 0.009. Size at 0.05: sign flip and Wilcoxon 0.036 (exactly 2/64), sign flip jointly
    0.029, Wilcoxon after Holm 0, Friedman 0.034 (chi-square limit 0.048), mixed model 0.050 with
    t and 0.070 with Wald, equivalence 0.047. Coverage: sign flip and Wilcoxon 0.964 (exactly
    62/64), mixed model 0.950 (Wald 0.930), bootstrap 0.959 expanded and 0.906 plain, equivalence
    0.906 of 0.90.
    """
    wrong = [name for name in methods if name not in METHODS]
    if wrong or simulations < 1:
        raise StatisticsError(
            f"cannot measure {names(wrong) or 'without simulations'}, expected "
            f"{names([*METHODS], 9)}"
        )
    outcomes: list[Outcome] = []
    for index in range(simulations):
        cube = simulated_scores(seed + index, **model)
        found: Outcome = {}
        for name in methods:
            found |= METHODS[name](cube, seed + index)
        outcomes.append(found)
        if progress is not None:
            progress(index + 1, simulations)
    labels = list(outcomes[0])
    p = np.array([[outcome[label][0] for label in labels] for outcome in outcomes])
    held = np.array([[outcome[label][1] for label in labels] for outcome in outcomes])
    size = np.where(np.isnan(p[0]), np.nan, (p <= alpha * (1 + 1e-9)).mean(axis=0))
    coverage = held.mean(axis=0)
    one = {"units": "1"}
    result = xr.Dataset(coords={"test": labels})
    for name, share in (("size", size), ("coverage", coverage)):
        result[name] = ("test", share, one)
        result[f"{name}_error"] = ("test", np.sqrt(share * (1 - share) / simulations), one)
    result.attrs = {"alpha": alpha, "simulations": simulations, "seed": seed, **model}
    return result


def _holds(found: xr.Dataset, truth: float) -> float:
    lower, upper = found["interval"].values[0]
    return float(lower <= truth <= upper)
