"""Calibration of an error estimate by split conformal prediction."""

import math

import numpy as np

from sim.errors import SceneError
from sim.state import Array


def coverage_factor(errors: Array, estimates: Array, floor: float, coverage: float) -> float:
    """Factor c such that a new trial has error <= c (estimate + floor) at all its times.

    The inequality holds with at least the given probability if the new trial and those of the
    calibration are exchangeable: c is the ceil((n + 1) coverage)-th smallest of the n largest ratios
    of the trials.

    Parameters
    ----------
    errors, estimates : (n, times) true and estimated errors [m]; NaN after the end of a trial.
    floor : float
        Smallest estimate [m].
    coverage : float
        Nominal probability, between 0 and 1.

    Raises
    ------
    SceneError
        There are too few trials: n must be at least coverage/(1 - coverage).

    Notes
    -----
    Lei et al., Journal of the American Statistical Association 113, 2018, with the largest ratio of a
    trial as its score.
    """
    n = len(errors)
    rank = math.ceil((n + 1) * coverage - 1e-9)
    if rank > n:
        raise SceneError(
            f"{n} trials cannot calibrate a coverage of {100 * coverage:g} %, expected at least "
            f"{least_trials(coverage)}"
        )
    scores = np.nanmax(errors / (estimates + floor), axis=1)
    return float(np.sort(scores)[rank - 1])


def least_trials(coverage: float) -> int:
    """Smallest number of trials that calibrate a coverage: n >= coverage/(1 - coverage)."""
    return math.ceil(coverage / (1.0 - coverage) - 1e-9)
