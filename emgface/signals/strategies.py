"""Strategies that select the activated muscles: act_all, act_3, act_rel, act_threshold.

Source: Eskes et al. 2017, Methods, Table 1; act_threshold follows a proposal of its Discussion.
"""

import numpy as np
import xarray as xr

from emgface.errors import ConfigurationError, SchemaError
from emgface.muscles import LETTERS, MODELLED, RELEVANT
from emgface.plugins import plugins, require_name
from emgface.schema.rules import one_line
from emgface.signals.parameters import STRATEGIES, StrategyParameters


def bilateral_mean(feature: xr.DataArray) -> xr.DataArray:
    """Mean of left and right muscle, (g_m + g_(m+10)) / 2 (Eskes et al. 2017, act_3, step 1).

    The result (muscle, time) has names without side, in the order of `emgface.muscles.MODELLED`.
    For a muscle with one side it is the feature of that side.
    """
    names = [str(name).rpartition("_")[0] for name in feature["muscle"].values]
    mean = feature.assign_coords(muscle=names).groupby("muscle").mean()
    return mean.sel(muscle=[name for name in MODELLED if name in names])


def bilateral_variance(feature: xr.DataArray) -> xr.DataArray:
    """Variance over time of the bilateral mean, V_m (muscle), divided by the number of samples.

    Source: Eskes et al. 2017, act_3, step 2.
    """
    return bilateral_mean(feature).var("time")


def needed_muscles(strategy: str, instruction: str | None) -> tuple[str, ...]:
    """Return the muscles, without side, required by a strategy: Table 1 for act_rel, all ten otherwise.

    Raises ConfigurationError if the strategy or the instruction is unknown.
    """
    require_name("strategy", strategy, STRATEGIES)
    if strategy != "act_rel":
        return MODELLED
    if instruction not in RELEVANT:
        raise ConfigurationError(
            f"instruction {instruction!r} has no row in the table of relevant muscles, "
            f"expected one of {LETTERS}: specify one of these, or use another strategy"
        )
    return tuple(name for name in MODELLED if name in RELEVANT[instruction])


def select_muscles(
    feature: xr.DataArray,
    strategy: str,
    instruction: str | None,
    parameters: StrategyParameters,
) -> tuple[str, ...]:
    """Select the muscles, without side, that a strategy activates on both sides.

    Of the muscles in `feature` (muscle, time), before normalisation, ``"act_all"`` selects all ten;
    ``"act_3"`` the n of largest variance of the bilateral mean, with ties in the order of
    `emgface.muscles.MODELLED`; ``"act_rel"`` those of Table 1 for the instruction;
    ``"act_threshold"`` those whose standard deviation of the bilateral mean exceeds
    `parameters.threshold` times the largest. The order is that of `MODELLED`, except for act_3:
    most active first. A strategy of another package is the function of its entry point
    (`emgface.plugins`).

    Raises ConfigurationError if strategy or instruction is unknown, or the function of another
    package does not select some of the muscles, and SchemaError if the montage contains none of the
    muscles that act_rel activates.
    """
    present = {str(name).rpartition("_")[0] for name in feature["muscle"].values}
    wanted = needed_muscles(strategy, instruction)
    names = tuple(name for name in wanted if name in present)
    if not names:
        raise SchemaError(
            f"{strategy} of instruction {instruction!r} activates {', '.join(wanted)}, of "
            "which the montage contains none (it contains "
            f"{', '.join(sorted(present)) or 'no muscle'}): use another strategy, or record "
            "these muscles"
        )
    if strategy not in STRATEGIES:
        return _selected_by_plugin(feature, strategy, instruction, parameters, names)
    if strategy == "act_3":
        variance = bilateral_variance(feature).values
        order = np.argsort(-variance, kind="stable")
        return tuple(names[k] for k in order[: parameters.n])
    if strategy == "act_threshold":
        deviation = np.sqrt(bilateral_variance(feature).values)
        active = deviation > parameters.threshold * deviation.max()
        return tuple(name for name, on in zip(names, active, strict=True) if on)
    return names


def _selected_by_plugin(
    feature: xr.DataArray,
    strategy: str,
    instruction: str | None,
    parameters: StrategyParameters,
    present: tuple[str, ...],
) -> tuple[str, ...]:
    """Muscles that the function of another package selects among those present."""
    plugin = plugins("strategy")[strategy]
    select = plugin.load()
    try:
        names = tuple(map(str, select(feature.copy(), instruction, parameters)))
    except Exception as error:
        raise ConfigurationError(
            f"the strategy '{strategy}' of {plugin.packages} failed ({one_line(error)}), expected "
            "names of muscles: report it to its authors, or use another strategy"
        ) from error
    if not names or len(set(names)) < len(names) or not set(names) <= set(present):
        raise ConfigurationError(
            f"the strategy '{strategy}' of {plugin.packages} selected {', '.join(names) or 'nothing'}, "
            f"expected some of {', '.join(present)}, each once: use another strategy"
        )
    return names
