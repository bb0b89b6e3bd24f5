"""Scores of a study against their baselines, with intervals over volunteers."""

from typing import Final

import numpy as np
import xarray as xr

from analysis.arguments import count, generator
from analysis.baselines import LEAST_ROOM, complete, has_baselines
from analysis.cube import TRIAL_DIMS
from analysis.errors import StatisticsError
from analysis.statistics.bootstrap import replicates, tails
from analysis.statistics.finding import check_level
from analysis.statistics.paired import Array, sound_cube
from analysis.statistics.scope import LEAST_VOLUNTEERS
from analysis.tables import origin_of
from analysis.typed import status_of

CORRELATIONS: Final = (
    "rho", "template_rho", "template_limit", "repeat_rho", "ceiling", "others_rho", "shuffled_rho",
    "wrong_rho", "wrong_rho_max",
)  # fmt: skip
"""Correlations that are compared."""

GAINS: Final = {
    "gain_template": "rho minus that of the template of all persons",
    "gain_others": "rho minus that with the EMG of the other volunteers",
    "gain_shuffled": "rho minus that with the EMG of other repetitions",
    "gain_wrong": "rho minus that of the other instructions",
    "gain_room": "1 minus rho of the person's other repetitions: largest gain by the own EMG",
    "within": "correlation of deviations from the person's mean",
    "skill": "(rho - template) / (ceiling - template), with a template of all persons",
    "skill_others": "skill of the motion driven by the EMG of the other volunteers",
}


def against_baselines(
    cube: xr.Dataset, *, level: float = 0.95, draws: int = 2000, seed: int = 0
) -> xr.Dataset:
    """Means of rho and of its baselines per strategy, gains and skill with intervals.

    `cube` has the variables of `analysis.baselines.VARIABLES`, without further axes. `level` is
    that of the intervals; `draws` and `seed` are bootstrap samples and the seed of their draws.

    The result has the dims strategy, bound: means over the trials of a strategy of each of
    `CORRELATIONS` [1]; of each of `GAINS` [1] the estimate and, as ``<name>_interval``, its bounds:
    markers are averaged first, volunteers and repetitions drawn as in
    `analysis.statistics.bootstrap`, quantiles expanded. Gain and skill refer to the template of
    infinitely many volunteers (`analysis.baselines.template_limit`), because any prediction that is
    free of the noise of the finite template exceeds it, also without EMG. ``skill`` is the mean of
    rho - template over the mean of ceiling - template, not the mean of the trials' skills, which
    trials with similar template and ceiling would dominate. ``skill_others`` is that of a
    prediction without the EMG of the person. ``volunteers`` and ``trials`` for which rho minus
    template is defined, ``template_volunteers`` (median), ``instructions``. Templates of different
    volunteers share members, so that volunteers are not wholly independent.

    Raises StatisticsError if the cube contains no baselines, has further axes, or an option is
    outside its range.
    """
    check_level(level)
    cube = sound_cube(cube, "rho")
    count("the number of bootstrap samples", draws, least=1)
    generator(seed)  # errors before the first step
    if not has_baselines(cube):
        raise StatisticsError(
            "the cube contains no baselines: it was written by an older version, run the study again"
        )
    cube, dims = complete(cube), (*TRIAL_DIMS, "marker")
    extra = set(cube["rho"].dims) - set(dims)
    if extra:
        raise StatisticsError(f"the cube has further axes ({', '.join(map(str, extra))})")
    ok = status_of(cube) == "ok"
    values = {
        name: cube[name].broadcast_like(cube["rho"]).transpose(*dims).where(ok)
        for name in CORRELATIONS
    }
    strategies = [str(label) for label in cube["strategy"].values]
    result = xr.Dataset(coords={"strategy": strategies, "bound": ["lower", "upper"]})
    for name in CORRELATIONS:
        shared = np.isfinite(values["rho"]) & np.isfinite(values[name])
        mean = values[name].where(shared).mean("marker").mean([*TRIAL_DIMS[:3]])
        result[name] = ("strategy", mean.values, {"units": "1"})
    rho = values["rho"]
    room = values["ceiling"] - values["template_limit"]
    parts = {
        "gain_template": rho - values["template_limit"],
        "gain_others": rho - values["others_rho"],
        "gain_shuffled": rho - values["shuffled_rho"],
        "gain_room": (1.0 - values["repeat_rho"]).where(np.isfinite(rho)),
        "gain_wrong": rho - values["wrong_rho"],
        "within": cube["within_rho"].expand_dims("repetition"),
        "skill": (rho - values["template_limit"]).where(np.isfinite(room)),
        "skill_others": (values["others_rho"] - values["template_limit"]).where(np.isfinite(room)),
    }
    rooms = {
        "skill": room.where(np.isfinite(rho)),
        "skill_others": room.where(np.isfinite(values["others_rho"])),
    }
    for name, top in parts.items():
        bottom = rooms.get(name)
        estimates = [
            ratio_interval(
                _cells(top, k), None if bottom is None else _cells(bottom, k), level, draws, seed
            )
            for k in range(len(strategies))
        ]
        attrs = {"units": "1", "long_name": GAINS[name]}
        result[name] = ("strategy", np.array([one[0] for one in estimates]), attrs)
        bounds = np.array([one[1:] for one in estimates]).reshape(-1, 2)
        result[f"{name}_interval"] = (("strategy", "bound"), bounds, attrs)
    scored = (
        parts["gain_template"].transpose("strategy", *TRIAL_DIMS[:3], "marker").notnull().values
    )
    result["trials"] = ("strategy", scored.any(axis=4).sum(axis=(1, 2, 3)))
    result["volunteers"] = ("strategy", scored.any(axis=(2, 3, 4)).sum(axis=1))
    others = cube["template_volunteers"].values
    others = others[np.isfinite(others)]
    result["template_volunteers"] = float(np.median(others)) if len(others) else 0.0
    result["instructions"] = cube.sizes["instruction"]
    return result.assign_attrs(origin=origin_of(cube), level=level, draws=draws, seed=seed)


def _cells(data: xr.DataArray, strategy: int) -> Array:
    """Means over markers, shape (volunteers, instructions, repetitions, 1)."""
    means = data.isel(strategy=strategy).mean("marker", skipna=True)
    return means.transpose("volunteer", "instruction", "repetition").values[..., None]


def ratio_interval(
    top: Array, bottom: Array | None, level: float, draws: int, seed: int
) -> tuple[float, float, float]:
    """Mean of cells, or the ratio of two means over the same cells, with its interval.

    Cells have the shape (volunteers, instructions, repetitions, 1), NaN where there is no score.
    """
    nothing = (np.nan, np.nan, np.nan)
    kept = np.isfinite(top).any(axis=(1, 2, 3))
    top = top[kept]
    if not len(top):
        return nothing
    estimate = float(np.nanmean(top))
    if bottom is not None:
        bottom = bottom[kept]
        room = float(np.nanmean(bottom))
        if room < LEAST_ROOM:
            return nothing
        estimate /= room
    if len(top) < LEAST_VOLUNTEERS:
        return estimate, np.nan, np.nan
    drawn = replicates(top, "mean", draws, seed)
    if bottom is not None:
        # With the same seed and shape, the same volunteers and repetitions are drawn.
        drawn_room = replicates(bottom, "mean", draws, seed)
        drawn = np.where(drawn_room > 0, drawn / drawn_room, np.sign(drawn) * np.inf)
    drawn = drawn[~np.isnan(drawn)]
    lower, upper = (
        float(np.quantile(drawn, tail, method="inverted_cdf"))
        for tail in tails(len(top), level, "expanded")
    )
    return estimate, lower, upper
