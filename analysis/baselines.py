"""Baselines of a correlation: template, other trials, repeat ceiling, and skill.

Besides the simulated motion of a trial, five motions are compared with the measured one: the mean
motion of other people at the same instruction (template), their mean simulated motion (EMG of
others), the simulated motion of the same person at another instruction (wrong instruction) or in
another repetition (shuffled EMG), and another repetition of the person (repeat). All are aligned
and scored like the simulated motion.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.align import align
from analysis.cube import TRIAL_DIMS
from analysis.errors import AnalysisError, CubeError
from analysis.noise import SMALLEST_SNR
from analysis.registration import hold_ends
from analysis.scores import MOTION_ROUNDING
from analysis.trajectory import SMALLEST_MOTION, names

Array = NDArray[np.float64]

PERSON: Final = ("volunteer", "instruction")
RECORDING_DIMS: Final = (*PERSON, "repetition")

BASELINE_VARIABLES: Final[dict[str, tuple[tuple[str, ...], str, str]]] = {
    "template_rho": ((*RECORDING_DIMS, "marker"), "1", "rho of the mean motion of the other volunteers"),
    "template_amplitude_ratio": (
        (*RECORDING_DIMS, "marker"), "1",
            "amplitude of the mean motion of the other volunteers divided by the measured one"),
    "template_volunteers": (PERSON, "1", "number of other volunteers in the template"),
    "repeat_rho": ((*RECORDING_DIMS, "marker"), "1", "mean rho of the person's other repetitions"),
    "ceiling": (
        (*RECORDING_DIMS, "marker"), "1", "rho of the person's mean over infinitely many repetitions"),
    "others_rho": (
        (*TRIAL_DIMS, "marker"), "1",
        "rho of the mean motion driven by the EMG of the other volunteers"),
    "wrong_rho": ((*TRIAL_DIMS, "marker"), "1", "mean rho of the person's other instructions"),
    "wrong_rho_max": ((*TRIAL_DIMS, "marker"), "1", "rho of the best of the other instructions"),
    "shuffled_rho": (
        (*TRIAL_DIMS, "marker"), "1", "mean rho of motions driven by the EMG of other repetitions"),
    "within_rho": (
        (*PERSON, "strategy", "marker"), "1", "correlation of deviations from the person's mean"),
    "onset_error": (TRIAL_DIMS, "s", "onset of the simulated minus that of the measured motion"),
    "peak_error": (TRIAL_DIMS, "s", "peak of the simulated minus that of the measured motion"),
    "template_onset_error": (
        RECORDING_DIMS, "s", "mean onset of the other volunteers minus the measured one"),
    "template_peak_error": (
        RECORDING_DIMS, "s", "mean peak of the other volunteers minus the measured one"),
    "asymmetry_measured": (RECORDING_DIMS, "1", "(left - right) / (left + right), measured motion"),
    "asymmetry_simulated": (TRIAL_DIMS, "1", "(left - right) / (left + right), simulated motion"),
    "template_asymmetry": (PERSON, "1", "(left - right) / (left + right), template"),
    "skill": (
        TRIAL_DIMS, "1", "(rho - template) / (ceiling - template), with a template of all persons"),
}  # fmt: skip
"""Dims, unit and meaning of the baselines in a cube."""

LEAST_ROOM: Final = 1e-3
"""Smallest difference of ceiling and baseline for which skill is defined [1].

Noise of 0.1 mm lowers the rho of a marker that moves by 3 mm (root mean square) by 1.7e-3.
"""


def unlimited_template(rho: Array | float, volunteers: float) -> Array:
    """Expected rho [1] of a template of infinitely many volunteers, from that of a finite one.

    A measured motion is the sum of a common part of variance c, which all persons share, and an
    individual part of variance i; the mean of K other persons has the variance c + i / K. With
    v = i / c its correlation with the motion of a further person is

        rho_K = 1 / sqrt((1 + v) (1 + v / K)),

    whose positive root v results in rho_inf = 1 / sqrt(1 + v); this is `ceiling_of` the likeness q =
    1 / (1 + v) with which `template_correlation` is rho_K. A finite template is noisy, so that
    any prediction without EMG but also without this noise exceeds it by rho_inf - rho_K. Values that
    are not positive have no common part and are returned unchanged, as are undefined ones.
    """
    r, k = np.asarray(rho, dtype=np.float64), float(volunteers)
    if not k > 0.0:
        return np.full(r.shape, np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        # v^2 / K + (1 + 1 / K) v + 1 - 1 / rho^2 = 0
        b, c = 1.0 + 1.0 / k, 1.0 - 1.0 / np.minimum(r, 1.0) ** 2
        v = 2.0 * -c / (b + np.sqrt(b * b - 4.0 * c / k))
        return np.where(r > 0.0, 1.0 / np.sqrt(1.0 + v), r)


def template_limit(rho: xr.DataArray, volunteers: xr.DataArray) -> xr.DataArray:
    """Rho [1] of a template of infinitely many volunteers, of every recorded trial and marker.

    The template of K others of person p scores rho_p = r_p / sqrt(1 + v / K), where r_p is the score
    of the template of all persons and v the mean of v_p = 1 / r_p^2 - 1 over persons. All scores are
    therefore multiplied by one factor, sqrt(1 + v / K), in which v solves `unlimited_template` for
    the mean of 1 / rho_p^2; rho_p is the mean over instructions, repetitions and markers. The result
    is linear in the score of a trial, so that noise of single scores does not bias its mean.

    Parameters
    ----------
    rho : xarray.DataArray
        ``template_rho`` with the dims (volunteer, instruction, repetition, marker) in any order.
    volunteers : xarray.DataArray
        ``template_volunteers``, numbers K; their median is used.
    """
    k = volunteers.values[~np.isnan(volunteers.values)]
    own = rho.mean([dim for dim in rho.dims if dim != "volunteer"], skipna=True).values
    own = np.maximum(own[np.isfinite(own)], LEAST_LIKENESS)
    if not len(k) or not len(own):
        return rho * np.nan
    mean = float(np.mean(own**-2.0)) ** -0.5
    return rho * float(unlimited_template(mean, float(np.median(k))) / mean)


def complete(cube: xr.Dataset) -> xr.Dataset:
    """Cube with ``template_limit``, and undefined values of baselines that older cubes lack."""
    added = {"template_limit": template_limit(cube["template_rho"], cube["template_volunteers"])}
    if "others_rho" not in cube:
        added["others_rho"] = cube["rho"] * np.nan
    return cube.assign(added)


LEAST_LIKENESS: Final = 0.2
"""Least score of the template of a person in the mean of `template_limit` [1].

A person whose motions resemble no other would otherwise determine the mean alone.
"""

NO_ROOM: Final = "ceiling not above the template"
SKILL_REASONS: Final = (
    "", "rho is undefined", "no other volunteer", "no other repetition", NO_ROOM,
)  # fmt: skip


def scored(
    measured: xr.Dataset | xr.DataArray,
    predicted: xr.Dataset | xr.DataArray,
    alignment: Mapping[str, Any] | None = None,
    form: str = "consistent",
) -> tuple[Array, Array]:
    """Align a measured with a predicted motion and correlate them, as for a simulated motion.

    Positions have the dims (marker, axis, time) [m], with the same markers. `alignment` contains
    options of `analysis.align.align`; `form` is that of `analysis.scores.correlation_3d`. Returns
    rho and amplitude_ratio [1], each of shape (markers,), as `analysis.scores.score`, in the order
    of the predicted markers; NaN if the motions cannot be aligned or a marker does not move.
    """
    options = dict(alignment or {})
    model = hold_ends(predicted)
    undefined = np.full(model.sizes["marker"], np.nan)
    try:
        aligned = align(measured, model, **options)
    except AnalysisError:
        return undefined, undefined.copy()
    v, noise = aligned["position"].values, aligned["noise"].values  # both as in the model
    covered = np.isfinite(v).all(axis=(0, 1))
    v, w = v[:, :, covered], model.values[:, :, covered]
    least = float(options.get("smallest_motion", SMALLEST_MOTION))
    v, size_v, moves_v = _centred(v, least)
    w, size_w, moves_w = _centred(w, least)
    n = v.shape[2]
    snr = float(options.get("smallest_snr", SMALLEST_SNR))
    moves_v &= ~(size_v**2 / n < (1.0 + snr) * noise**2)
    with np.errstate(invalid="ignore", divide="ignore"):
        rho = np.clip((v * w).sum(axis=(1, 2)) / (size_v * size_w), -1.0, 1.0)
        ratio = np.where(moves_w, size_w / size_v, 0.0)
    rho = rho * ((n - 1) / n if form == "as_printed" else 1.0)
    return np.where(moves_v & moves_w, rho, np.nan), np.where(moves_v, ratio, np.nan)


def _centred(values: Array, least: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Positions about their means, their sizes, and moving markers, as in `analysis.scores`."""
    centred = values - values.mean(axis=2, keepdims=True)
    size = np.sqrt((centred**2).sum(axis=(1, 2)))
    moved = size / np.sqrt(values.shape[2])
    return (
        centred,
        size,
        (moved > MOTION_ROUNDING * np.abs(values).max(axis=(1, 2))) & (moved >= least),
    )


def ceiling_of(repeat_rho: Array) -> Array:
    """Highest expected rho of a motion that is the same in every repetition.

    With v_r = mu + e_r, the motion common to all repetitions and the deviation of a repetition, two
    repetitions have the correlation q = |mu|^2 / (|mu|^2 + |e|^2), and a repetition and mu sqrt(q).

    Parameters
    ----------
    repeat_rho : ndarray
        q, mean correlation of a trial with the person's other repetitions [1].

    Returns
    -------
    ndarray
        sqrt(max(q, 0)) [1].

    Notes
    -----
    Source: Spearman 1904, American Journal of Psychology 15:72 (attenuation); as a ceiling for
    models Hsu, Borst and Theunissen 2004, Network 15:91. A motion driven by the signals of the
    trial itself may exceed it, because it may contain differences between trials.
    """
    return np.sqrt(np.maximum(repeat_rho, 0.0))


def template_correlation(likeness: float, others: int) -> float:
    """Correlation of a person with the mean of K others, q / sqrt(q + (1 - q) / K).

    Parameters
    ----------
    likeness : float
        q, correlation between the motions of two people [1], above 0.
    others : int
        K, people in the mean.

    Notes
    -----
    Source: Spearman 1910 and Brown 1910, British Journal of Psychology 3. The deviations of people
    from their common motion are assumed to be independent and equally large.
    """
    return likeness / float(np.sqrt(likeness + (1.0 - likeness) / others))


def skill_of(rho: Array, baseline: Array, ceiling: Array) -> Array:
    """Skill score, (rho - baseline) / (ceiling - baseline) [1], of arrays of correlations.

    0 is as good as the baseline, 1 as good as the ceiling; NaN if the two differ by less than
    `LEAST_ROOM`. The skill is linear in rho and not in Fisher's z, because 2 (1 - rho) is the mean
    squared distance of two motions of unit size, so that it is the fraction of the baseline's
    avoidable squared error that is avoided. Source: Murphy 1988, Monthly Weather Review 116:2417.
    """
    room = ceiling - baseline
    return (rho - baseline) / np.where(room >= LEAST_ROOM, room, np.nan)


def unexplained(rho: float) -> float:
    """Fraction of a movement unexplained by a motion with this rho, sqrt(1 - rho^2).

    The root-mean-square residual after the best scaling, over the size of the movement [1].
    """
    return float(np.sqrt(1.0 - rho**2))


def with_baselines(cube: xr.Dataset, baselines: Mapping[str, xr.DataArray]) -> xr.Dataset:
    """Add baselines, ceiling and skill to a cube.

    `baselines` contains the variables of `BASELINE_VARIABLES` except ``skill``; trials that they
    lack become NaN. The result has all of `BASELINE_VARIABLES`, and text ``skill_reason``
    (volunteer, instruction, repetition, strategy). ``skill`` is computed from the means over the
    markers at which rho, `template_limit` and ceiling are defined. Raises CubeError if a variable
    is unknown, or lacks a dim.
    """
    unknown = [name for name in baselines if name not in BASELINE_VARIABLES or name == "skill"]
    if unknown:
        raise CubeError(
            f"{names(unknown)} is not a baseline, expected some of {names([*BASELINE_VARIABLES], 20)}"
        )
    added: dict[str, xr.DataArray] = {}
    for name, (dims, units, meaning) in BASELINE_VARIABLES.items():
        shape = tuple(cube.sizes[dim] for dim in dims)
        data = xr.DataArray(np.full(shape, np.nan), dims=dims, coords={d: cube[d] for d in dims})
        if name in baselines:
            if set(baselines[name].dims) != set(dims):
                raise CubeError(f"{name} has dims {baselines[name].dims}, expected {dims}")
            data = baselines[name].transpose(*dims).reindex_like(data)
        added[name] = data.assign_attrs(units=units, long_name=meaning)
    limit = template_limit(added["template_rho"], added["template_volunteers"])
    skill, reason = _skill(cube["rho"], limit, added["ceiling"])
    added["skill"] = skill.assign_attrs(added["skill"].attrs)
    result = cube.assign(added)
    result["skill_reason"] = reason.assign_attrs(long_name="reason for which skill is undefined")
    return result


def has_baselines(cube: xr.Dataset) -> bool:
    """Return True if a cube contains a baseline of any trial."""
    return "template_rho" in cube and any(
        bool(np.isfinite(cube[name].values).any())
        for name in ("template_rho", "wrong_rho", "repeat_rho")
    )


def _skill(
    rho: xr.DataArray, template: xr.DataArray, ceiling: xr.DataArray
) -> tuple[xr.DataArray, xr.DataArray]:
    """Skill per trial and strategy, or the reason for its absence."""
    dims = (*TRIAL_DIMS, "marker")
    rho, template, ceiling = (
        each.broadcast_like(rho).transpose(*dims) for each in (rho, template, ceiling)
    )
    lacking = [~np.isfinite(each.values).any(axis=-1) for each in (rho, template, ceiling)]
    shared = np.isfinite(rho + template + ceiling)
    means = [each.where(shared).mean("marker").values for each in (rho, template, ceiling)]
    values = skill_of(*means)
    reason = np.full(values.shape, "", dtype="U32")
    reason[~np.isfinite(values)] = SKILL_REASONS[4]
    for missing, text in reversed(list(zip(lacking, SKILL_REASONS[1:4], strict=True))):
        reason[missing] = text
    coords = {dim: rho[dim] for dim in TRIAL_DIMS}
    return (
        xr.DataArray(values, dims=TRIAL_DIMS, coords=coords),
        xr.DataArray(reason, dims=TRIAL_DIMS, coords=coords),
    )


def mean_of(rhos: Sequence[Array], markers: int) -> Array:
    """Mean over the defined predictions for each marker; NaN if there is none."""
    stack = np.array(rhos, dtype=np.float64).reshape(-1, markers)
    count = np.isfinite(stack).sum(axis=0)
    return np.where(count > 0, np.nansum(stack, axis=0) / np.maximum(count, 1), np.nan)


def best_of(rhos: Sequence[Array], markers: int) -> Array:
    """Prediction with the largest mean over markers; NaN if none is defined."""
    known = [each for each in rhos if np.isfinite(each).any()]
    if not known:
        return np.full(markers, np.nan)
    return max(known, key=lambda each: float(np.nanmean(each)))
