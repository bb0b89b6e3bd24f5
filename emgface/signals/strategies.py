"""Which muscles of the model are activated: act_all, act_3, act_rel, act_threshold.

Source: Eskes et al. 2017, Methods, Table 1; act_threshold follows a proposal of its Discussion.
"""

import difflib
from typing import get_args

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError
from emgface.muscles import INSTRUCTIONS, MODELLED, RELEVANT
from emgface.signals.parameters import StrategyName, StrategyParameters

STRATEGIES: tuple[StrategyName, ...] = get_args(StrategyName)
"""Names of all strategies."""


def bilateral_mean(feature: xr.DataArray) -> xr.DataArray:
    """Mean of left and right muscle, (g_m + g_(m+10)) / 2.

    Parameters
    ----------
    feature : DataArray, dims (muscle, time)
        Feature of the twenty muscles.

    Returns
    -------
    DataArray, dims (muscle, time)
        Mean of both sides of the ten muscles, without side in their names.

    Notes
    -----
    Source: Eskes et al. 2017, act_3, step 1.
    """
    left = feature.sel(muscle=[f"{name}_L" for name in MODELLED])
    right = feature.sel(muscle=[f"{name}_R" for name in MODELLED])
    mean = 0.5 * (left.values + right.values)
    return left.copy(data=mean).assign_coords(muscle=list(MODELLED))


def bilateral_variance(feature: xr.DataArray) -> xr.DataArray:
    """Variance over time of the bilateral mean, V_m.

    Parameters
    ----------
    feature : DataArray, dims (muscle, time)
        Feature of the twenty muscles.

    Returns
    -------
    DataArray, dims (muscle)
        Variance, in the squared unit of the feature, divided by the number of samples.

    Notes
    -----
    Source: Eskes et al. 2017, act_3, step 2.
    """
    return bilateral_mean(feature).var("time")


def select_muscles(
    feature: xr.DataArray,
    strategy: str,
    instruction: str | None,
    parameters: StrategyParameters,
) -> tuple[str, ...]:
    """Select the muscles that a strategy activates, on both sides.

    Parameters
    ----------
    feature : DataArray, dims (muscle, time)
        Feature of the twenty muscles before normalisation (act_3 and act_threshold).
    strategy : str
        ``"act_all"``: all ten; ``"act_3"``: the n of largest variance of the bilateral mean,
        ties in the order of `emgface.muscles.MODELLED`; ``"act_rel"``: Table 1;
        ``"act_threshold"``: all whose standard deviation of the bilateral mean exceeds
        `parameters.threshold` times the largest.
    instruction : str or None
        A to F, needed by act_rel.
    parameters : StrategyParameters
        n and threshold.

    Returns
    -------
    tuple of str
        Muscle names without side, in the order of `emgface.muscles.MODELLED`, except for act_3:
        most active first.

    Raises
    ------
    ConfigurationError
        If the strategy or the instruction is unknown.
    """
    if strategy == "act_all":
        return MODELLED
    if strategy == "act_rel":
        if instruction not in RELEVANT:
            raise ConfigurationError(
                f"instruction {instruction!r} has no row in the table of relevant muscles, "
                f"expected one of {', '.join(INSTRUCTIONS)}: name it, or use another strategy"
            )
        return tuple(name for name in MODELLED if name in RELEVANT[instruction])
    if strategy == "act_3":
        variance = bilateral_variance(feature).values
        order = np.argsort(-variance, kind="stable")
        return tuple(MODELLED[k] for k in order[: parameters.n])
    if strategy == "act_threshold":
        deviation = np.sqrt(bilateral_variance(feature).values)
        active = deviation > parameters.threshold * deviation.max()
        return tuple(name for name, on in zip(MODELLED, active, strict=True) if on)
    near = difflib.get_close_matches(strategy, STRATEGIES, n=1, cutoff=0.4)
    raise ConfigurationError(
        f"unknown strategy '{strategy}', "
        + (f"did you mean '{near[0]}'?" if near else f"expected one of {', '.join(STRATEGIES)}")
    )
