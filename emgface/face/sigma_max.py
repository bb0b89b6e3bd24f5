"""Policy of sigma_max for trials that cannot be simulated with it.

The published rule is to start at 300 kPa and to lower it by 10 % each time an element inverts. The
solver raises an error and does not change its input; the rule is applied here.
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

    Weaker muscles avoid mechanical failures. A missed accuracy (`ToleranceMissed`) is not such a
    failure and is raised at once, because the motion would differ without being more accurate.

    `simulate` returns a trajectory for parameters with the current sigma_max; `sigma_max_policy` of
    `parameters` contains factor and minimum; `report` receives one sentence per reduction. The
    trajectory has the attribute ``attempts``, the number of values tried, and ``lowered_after``,
    one sentence for each failure that followed a loss of stability. The last InvertedElement or
    NotConverged is raised if the next value would be below the minimum; any other SimulationError
    is raised at once.
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
