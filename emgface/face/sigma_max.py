"""Policy of sigma_max for trials that cannot be simulated with it.

The published rule is to start at 300 kPa and to lower it by 10 % each time an element inverts. The
solver raises an error and does not change its input; the rule is applied here.
"""

from collections.abc import Callable
from typing import Final

import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from sim.errors import InvertedElement, NotConverged

AVOIDED_BY_WEAKER: Final = (InvertedElement, NotConverged)  #: failures that weaker muscles avoid


def lowered(parameters: SimulationParameters) -> SimulationParameters | None:
    """Parameters with the next smaller sigma_max of the policy; None if it is below the minimum."""
    policy = parameters.sigma_max_policy
    lower = parameters.sigma_max * policy.factor
    return None if lower < policy.minimum else parameters.model_copy(update={"sigma_max": lower})


def lower_sigma_max(
    simulate: Callable[[SimulationParameters], xr.Dataset],
    parameters: SimulationParameters,
    *,
    report: Callable[[str], None] | None = None,
) -> xr.Dataset:
    """Simulate, lowering sigma_max each time an element inverts or a step does not converge.

    Weaker muscles avoid mechanical failures. A missed accuracy (`ToleranceMissed`) is not such a
    failure and is raised at once, because the motion would differ without being more accurate.

    `simulate` returns a trajectory for parameters with the current sigma_max; `sigma_max_policy` of
    `parameters` contains factor and minimum; `report` receives one sentence per reduction. The
    trajectory has the attribute ``attempts``, the number of values tried, and ``lowered_after``,
    one sentence for each failure that followed a loss of stability. The last InvertedElement or
    NotConverged is raised if the next value would be below the minimum; any other SimulationError
    is raised at once.
    """
    attempts, noted = 1, list[str]()
    present = parameters
    while True:
        sigma_max = present.sigma_max
        try:
            trajectory = simulate(present)
        except AVOIDED_BY_WEAKER as error:
            failure = f"{type(error).__name__} at sigma_max = {sigma_max / 1e3:.4g} kPa"
            if notes := getattr(error, "__notes__", []):
                failure += f" ({'; '.join(notes)})"
                noted.append(failure)
            lower = lowered(present)
            if lower is None:
                error.add_note(
                    f"sigma_max was lowered {attempts - 1} times from "
                    f"{parameters.sigma_max / 1e3:.4g} to {sigma_max / 1e3:.4g} kPa"
                )
                raise
            if report is not None:
                report(f"{failure}, trying {lower.sigma_max / 1e3:.4g} kPa")
            present, attempts = lower, attempts + 1
        else:
            trajectory.attrs["attempts"] = attempts
            if noted:
                trajectory.attrs["lowered_after"] = "; ".join(noted)
            return trajectory
