"""Loss of stability during a motion, and its sensitivity to rounding."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import xarray as xr

from sim import SimulationError, State, System

ROUNDING_PERTURBATION: Final = 1e-14  #: perturbation of the start that represents rounding [m]

NOTICED: Final = 1e-5
"""Change of a marker above which a warning is given [m]: the tolerance of the iteration, a tenth
of the error requested by a study."""


def rounding_sensitivity(
    system: System, start: State, motion: xr.Dataset, again: Callable[[State], xr.Dataset]
) -> float:
    """Largest change of a marker position [m] for a start perturbed by rounding.

    `motion` is ``position(marker, axis, time)`` [m] from `start`, and `again` simulates it from
    another start. The result is infinite if the motion from the perturbed start fails.
    """
    q = start.q.copy()
    signs = np.random.default_rng(0).choice([-1.0, 1.0], size=len(system.free))
    q.reshape(-1)[system.free] += ROUNDING_PERTURBATION * signs
    try:
        other = again(replace(start, q=q))
    except SimulationError:
        return float("inf")
    apart = other["position"] - motion["position"]
    return float((apart**2).sum("axis").max() ** 0.5)


def stability_warning(motion: xr.Dataset) -> str:
    """Warning for a motion that depends on rounding or steps, or whose sigma_max was lowered.

    The trajectory has the attributes ``unstable_from_s``, ``unstable_until_s`` [s] and
    ``rounding_sensitivity`` [m] if its equilibrium lost stability, and ``lowered_after`` if that of
    a run with a larger sigma_max did (`emgface.face.sigma_max`), and ``repetition_failed`` if its
    repetition did (`emgface.face.event_error`). The text is empty otherwise.
    """
    lowered = str(motion.attrs.get("lowered_after", ""))
    lowered = f"sigma_max was lowered after {lowered}" if lowered else ""
    if failed := motion.attrs.get("repetition_failed"):
        failed = (
            f"the repetition with other time steps failed ({failed}), so the difference between the "
            "two motions is unknown"
        )
        lowered = f"{lowered}; {failed}" if lowered else failed
    changes = float(motion.attrs.get("rounding_sensitivity", 0.0))
    if changes < NOTICED:
        return lowered
    level = f"at the level of {1e3 * changes:.2g} mm"
    if not np.isfinite(changes):
        level = "and fails from a start displaced by 1e-14 m"
    own = (
        f"the equilibrium lost stability between {motion.attrs['unstable_from_s']:.4g} and "
        f"{motion.attrs['unstable_until_s']:.4g} s; the motion there depends on rounding {level}: "
        "choose a smaller step, a lower sigma_max or an iterating solver"
    )
    return f"{own}; {lowered}" if lowered else own
