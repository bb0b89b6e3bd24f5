"""Doubts about an inversion: what its recording, or the face, contradicts."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from emgface.inverse.problem import Problem
from emgface.recordings.quality import swapped_sides
from sim.state import Array

LARGEST_MISFIT = 0.5
"""Misfit over motion of the targets above which the face does not follow the markers [1]."""
LAGGING = 0.1
"""Misfit of the motion minus that of the equilibria, over the motion of the targets, above which a face
moves too fast for equilibria [1]."""
RESTING = 0.1
"""Motion within the first `emgface.inverse.markers.REST` over that of the trial above which a trial does
not begin at rest [1]."""
NOISY = 0.5
"""Noise over motion of a coordinate of the markers above which a trial contains no motion [1]."""
RELATED, LAGS, LARGEST_MOTION_LAG = 0.5, (-0.15, 0.3), 1.0
"""Correlation of sEMG and motion below which they are not related [1], lags of the motion that are
expected, and the largest one that is compared [s]. In the twelve simulated trials of the documentation
the correlation is 0.74 to 0.90 at lags of -0.10 to 0.18 s."""
USUAL_DELAY = 0.04
"""Delay of the sEMG with which the lags above were measured [s]."""
LARGEST_QUIET_RATIO = 0.15
"""Smallest 25 % quantile, over the muscles, of the sEMG over its largest value, above which no muscle
was quiet [1]. In these trials it is 0, and above 0.2 of noise."""


def signs(
    problem: Problem, recording: xr.Dataset, measured: bool, delay: float = USUAL_DELAY
) -> dict[str, Any]:
    """Attributes of a result by which `doubts` judges the signals of its recording.

    ``noise_ratio`` is the noise of the markers over their motion. With sEMG (`measured`),
    ``emg_agreement`` is the largest correlation of the sum of what exceeds the median of every muscle
    with electrodes with the size of the motion, ``emg_lag`` [s] the time by which the motion is then
    later, ``emg_delay`` [s] the `delay` with which the sEMG was used, ``emg_floor`` the quantity of
    `LARGEST_QUIET_RATIO`, and ``exchanged_sides`` are the channels of `swapped_sides`.
    """
    moved = problem.moved
    attrs: dict[str, Any] = {"noise_ratio": problem.noise / moved if moved > 0.0 else np.inf}
    missing = set(str(problem.emg.attrs["missing"]).split())
    own = [str(m) for m in problem.emg["muscle"].values if str(m) not in missing]
    if not measured or not own:
        return attrs
    each = np.array([problem.delayed(m, 0.0) for m in own])
    total = np.maximum(each - np.median(each, axis=1, keepdims=True), 0.0).sum(axis=0)
    heard = each[each.max(axis=1) > 0.0]
    floor = np.quantile(heard, 0.25, axis=1) / heard.max(axis=1)
    way = (problem.target.position - problem.state.q[problem.target.nodes]) ** 2
    agreement, lag = agreement_of(total, np.sqrt(_mean(way)), problem.h)
    sides = swapped_sides(recording)
    names = sides.loc[sides["swapped"].astype(bool), ["left", "right"]].to_numpy().ravel()
    exchanged = " ".join(map(str, names))
    attrs |= {
        "emg_agreement": agreement,
        "emg_lag": lag,
        "emg_delay": delay,
        "emg_floor": float(floor.min(initial=1.0)),
    }
    return attrs | {"exchanged_sides": exchanged}


def agreement_of(emg: Array, motion: Array, h: float) -> tuple[float, float]:
    """Largest correlation of two signals with steps h [s], and the lag of the second at it [s].

    Lags leave at least half of the samples in common. NaN is not compared; without variation the
    correlation is 0.
    """
    most, best = min(int(LARGEST_MOTION_LAG / h), len(emg) // 2), (0.0, 0.0)
    for k in range(-most, most + 1):
        a = emg[: len(emg) - k] if k >= 0 else emg[-k:]
        b = motion[k:] if k >= 0 else motion[:k]
        seen = np.isfinite(a) & np.isfinite(b)
        a, b = a[seen], b[seen]
        if len(a) > 2 and min(np.ptp(a), np.ptp(b)) > 0.0:
            best = max(best, (float(np.corrcoef(a, b)[0, 1]), k * h))
    return best


def _mean(squares: Array) -> Array:
    """Mean (n,) over the visible markers and the axes, NaN if none is visible."""
    seen = np.isfinite(squares)
    n = seen.sum(axis=(1, 2))
    return np.where(n > 0, np.nansum(squares, axis=(1, 2)) / np.maximum(n, 1), np.nan)


def doubts(result: xr.Dataset) -> list[str]:
    """Sentences on what a result of `emgface.inverse.run.invert` contradicts, empty if nothing."""
    sentences: list[str] = []
    if not result.attrs.get("converged", 1):
        sentences.append(
            "the fit did not converge: its activations still change, or no step lowers the objective. "
            "Compare it with --form step, which has no iterations"
        )
    if not result.attrs["rest_ratio"] <= RESTING:
        sentences.append(
            f"the markers move in the first 0.1 s by {result.attrs['rest_ratio']:.0%} of the motion of "
            "the trial, but their displacements are counted from there: begin the trial at rest"
        )
    if not result.attrs["misfit_ratio"] <= LARGEST_MISFIT:
        sentences.append(
            f"the face does not follow the markers: the misfit exceeds {LARGEST_MISFIT:.0%} of "
            "their motion. Check names, axes and unit of the markers (`emgface check`) before "
            "using the result."
        )
    in_motion = result.attrs.get("motion_misfit_ratio", 0.0)
    if in_motion > result.attrs["misfit_ratio"] + LAGGING:
        sentences.append(
            f"a face that moves by these activations misses the markers by {in_motion:.0%} of their "
            f"motion, its equilibria by {result.attrs['misfit_ratio']:.0%}: the trial is too fast for "
            "--form quasi_static, use another form"
        )
    sentences += _of_signals(result.attrs)
    return sentences


def _of_signals(attrs: Mapping[str, Any]) -> list[str]:
    if attrs.get("noise_ratio", 0.0) > NOISY:
        return [
            f"the noise of the markers is {attrs['noise_ratio']:.0%} of their motion: activations do "
            "not follow from this trial, and its result is what was assumed before"
        ]
    sentences: list[str] = []
    agreement, lag = attrs.get("emg_agreement", 1.0), attrs.get("emg_lag", 0.0)
    if attrs.get("emg_floor", 0.0) > LARGEST_QUIET_RATIO:
        sentences.append(
            f"no muscle is quiet for a quarter of the trial (at least {attrs['emg_floor']:.0%} of its "
            "largest sEMG): the sEMG may be noise only, use --variant motion"
        )
    elif agreement < RELATED:
        sentences.append(
            f"the sEMG is not related to the motion (largest correlation {agreement:.2f}): check that "
            "both are of the same trial, or use --variant motion"
        )
    elif not LAGS[0] <= lag <= LAGS[1]:
        when = f"{abs(lag):.2f} s {'after' if lag > 0.0 else 'before'}"
        sentences.append(
            f"the motion is {when} the sEMG, expected 0 to 0.2 s after it: check the clocks of both, "
            "or use --variant motion"
        )
    elif not LAGS[0] <= lag - attrs.get("emg_delay", USUAL_DELAY) + USUAL_DELAY <= LAGS[1]:
        sentences.append(
            f"the motion is {lag:.2g} s after the sEMG, which was used {attrs['emg_delay']:.2g} s "
            "later: expected a delay at which both agree, usually 0.04 s: check it and its unit, s"
        )
    if attrs.get("exchanged_sides"):
        sentences.append(
            f"the channels {attrs['exchanged_sides']} follow the mouth corners of the other side: check "
            "whether left and right are exchanged in the sEMG or in the markers"
        )
    return sentences
