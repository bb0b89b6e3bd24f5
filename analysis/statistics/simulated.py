"""Cubes of scores drawn from a model whose effects are known."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
import xarray as xr

from analysis.arguments import generator
from analysis.errors import StatisticsError

SIMULATED_STRATEGIES: Final = ("act_all", "act_3", "act_rel")


def simulated_scores(
    seed: int,
    *,
    volunteers: int = 6,
    instructions: int = 2,
    repetitions: int = 2,
    markers: int = 3,
    strategies: Sequence[str] = SIMULATED_STRATEGIES,
    effects: Sequence[float] = (0.0, 0.0, 0.0),
    centre: float = 0.6,
    sd_volunteer: float = 0.3,
    sd_instruction: float = 0.3,
    sd_marker: float = 0.2,
    sd_interaction: float = 0.2,
    sd_instruction_strategy: float = 0.0,
    sd_trial: float = 0.0,
    sd_error: float = 0.4,
    spread: Sequence[float] = (1.0, 1.0, 1.0),
    freedom: float = math.inf,
    missing: float = 0.0,
    these: bool = False,
) -> xr.Dataset:
    """Draw a cube of scores with known effects.

    artanh(rho) = centre + effect(strategy) + volunteer + instruction + marker
                  + volunteer x strategy + instruction x strategy
                  + volunteer x instruction x strategy + error

    Parameters
    ----------
    seed : int
        Of the draws.
    volunteers, instructions, repetitions, markers, strategies
        Sizes of the cube, and labels of the strategies.
    effects, centre
        Effect of each strategy, and mean without effects, in Fisher's z.
    sd_volunteer, sd_instruction, sd_marker, sd_interaction, sd_error : float
        Standard deviations of the random terms, in Fisher's z; sd_interaction is that of
        volunteer x strategy.
    sd_instruction_strategy, sd_trial : float
        Of instruction x strategy, and of volunteer x instruction x strategy, which is common to all
        markers and repetitions.
    spread : sequence of float
        Factor per strategy on the terms of the volunteers and of the error that involve it.
    freedom : float
        Degrees of freedom, above 2, of the t distribution of every term; normal if infinite.
    missing : float
        Fraction of trials lost at random [1].
    these : bool
        If true, instruction x strategy sums to zero over the instructions drawn, so that the
        effects are those over these instructions.

    Returns
    -------
    xarray.Dataset
        As of `build_cube` with ``rho``, ``amplitude_ratio`` and ``rmse`` [m], the latter two
        functions of rho, and ``status``; ``origin`` is "simulated".
    """
    if len(effects) != len(strategies) or len(spread) != len(strategies):
        raise StatisticsError(
            f"{len(effects)} effects and {len(spread)} spreads for {len(strategies)} strategies"
        )
    if not freedom > 2:
        raise StatisticsError(f"the t distribution has {freedom} degrees of freedom, expected > 2")
    rng = generator(seed)
    dims = ("volunteer", "instruction", "repetition", "strategy", "marker")
    shape = (volunteers, instructions, repetitions, len(strategies), markers)
    factor = np.asarray(spread, dtype=np.float64)[:, None]

    def term(deviation: float, *over: str) -> np.ndarray:
        size = [n if dim in over else 1 for dim, n in zip(dims, shape, strict=True)]
        if math.isinf(freedom):
            return deviation * rng.standard_normal(size)
        return deviation * math.sqrt(1.0 - 2.0 / freedom) * rng.standard_t(freedom, size)

    z = centre + np.asarray(effects, dtype=np.float64)[:, None]
    z = z + term(sd_volunteer, "volunteer") + term(sd_instruction, "instruction")
    z = z + term(sd_marker, "marker") + factor * term(sd_interaction, "volunteer", "strategy")
    z = z + factor * term(sd_error, *dims)
    slope = term(sd_instruction_strategy, "instruction", "strategy")
    z = z + slope - (slope.mean(axis=1, keepdims=True) if these else 0.0)
    z = z + factor * term(sd_trial, "volunteer", "instruction", "strategy")
    lost = rng.random(shape[:-1]) < missing
    rho = np.where(lost[..., None], np.nan, np.tanh(z))
    return xr.Dataset(
        {
            "rho": (dims, rho, {"units": "1"}),
            "amplitude_ratio": (dims, np.exp(rho - 1.0), {"units": "1"}),
            "rmse": (dims, 1e-3 * (1.0 - rho), {"units": "m"}),
            "status": (dims[:-1], np.where(lost, "missing", "ok").astype("U24")),
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
