"""What happens to sigma_max when a trial cannot be simulated with it.

The published rule is to start at 300 kPa and to lower by 10 % each time an element inverts. The
solver does not tune its own inputs: it raises, and the rule is applied here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from sim.errors import InvertedElement, NotConverged


@dataclass(frozen=True)
class Attempt:
    """A value of sigma_max [Pa] that failed, and how."""

    sigma_max: float
    error: str


@dataclass(frozen=True)
class Lowered:
    """A simulation that succeeded, the sigma_max [Pa] it used and the attempts before it."""

    trajectory: xr.Dataset
    sigma_max: float
    attempts: tuple[Attempt, ...]


def lower_sigma_max(
    simulate: Callable[[SimulationParameters], xr.Dataset],
    parameters: SimulationParameters,
    *,
    report: Callable[[str], None] | None = None,
) -> Lowered:
    """Simulate, lowering sigma_max each time an element inverts or a step does not converge.

    Weaker muscles cure what fails mechanically. An accuracy that is missed (`ToleranceMissed`) is not
    such a failure and is raised at once: the motion would be another, not a better one.

    Parameters
    ----------
    simulate : callable
        Takes the parameters with the sigma_max to use, returns a trajectory.
    parameters : SimulationParameters
        sigma_max is where it starts; `sigma_max_policy` holds factor and minimum.
    report : callable, optional
        Receives one sentence per lowering.

    Returns
    -------
    Lowered

    Raises
    ------
    InvertedElement, NotConverged
        The last failure, when the next value would be below the minimum; its message says how
        many values were tried.
    SimulationError
        Any other failure, at once.
    """
    policy = parameters.sigma_max_policy
    attempts: list[Attempt] = []
    sigma_max = parameters.sigma_max
    while True:
        try:
            trajectory = simulate(parameters.model_copy(update={"sigma_max": sigma_max}))
        except (InvertedElement, NotConverged) as error:
            attempts.append(Attempt(sigma_max, type(error).__name__))
            lower = sigma_max * policy.factor
            if lower < policy.minimum:
                error.add_note(
                    f"sigma_max was lowered {len(attempts) - 1} times from "
                    f"{parameters.sigma_max / 1e3:.4g} to {sigma_max / 1e3:.4g} kPa"
                )
                raise
            if report is not None:
                report(
                    f"{type(error).__name__} at sigma_max = {sigma_max / 1e3:.4g} kPa, "
                    f"trying {lower / 1e3:.4g} kPa"
                )
            sigma_max = lower
        else:
            return Lowered(trajectory, sigma_max, tuple(attempts))
