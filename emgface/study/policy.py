"""Policy of sigma_max for trials that cannot be simulated with it.

The published rule is to start at 300 kPa and to lower by 10 % each time an element inverts. The
solver does not tune its own inputs: it raises, and the rule is applied here.
"""

from collections.abc import Callable

import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from sim.errors import InvertedElement, NotConverged


def lower_sigma_max(
    simulate: Callable[[SimulationParameters], xr.Dataset],
    parameters: SimulationParameters,
    *,
    report: Callable[[str], None] | None = None,
) -> xr.Dataset:
    """Simulate, lowering sigma_max each time an element inverts or a step does not converge.

    Weaker muscles avoid mechanical failures. An accuracy that is missed (`ToleranceMissed`) is not
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
    Dataset
        The trajectory that succeeded, with the attribute ``attempts``, the number of values tried, and,
        where failures came after a loss of stability, ``lowered_after``, one sentence for each.

    Raises
    ------
    InvertedElement, NotConverged
        The last failure, when the next value would be below the minimum; its message says how
        many values were tried.
    SimulationError
        Any other failure, at once.
    """
    policy = parameters.sigma_max_policy
    attempts, noted = 1, list[str]()
    sigma_max = parameters.sigma_max
    while True:
        try:
            trajectory = simulate(parameters.model_copy(update={"sigma_max": sigma_max}))
        except (InvertedElement, NotConverged) as error:
            failure = f"{type(error).__name__} at sigma_max = {sigma_max / 1e3:.4g} kPa"
            if notes := getattr(error, "__notes__", []):
                failure += f" ({'; '.join(notes)})"
                noted.append(failure)
            lower = sigma_max * policy.factor
            if lower < policy.minimum:
                error.add_note(
                    f"sigma_max was lowered {attempts - 1} times from "
                    f"{parameters.sigma_max / 1e3:.4g} to {sigma_max / 1e3:.4g} kPa"
                )
                raise
            if report is not None:
                report(f"{failure}, trying {lower / 1e3:.4g} kPa")
            sigma_max, attempts = lower, attempts + 1
        else:
            trajectory.attrs["attempts"] = attempts
            if noted:
                trajectory.attrs["lowered_after"] = "; ".join(noted)
            return trajectory
