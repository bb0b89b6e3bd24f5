"""Error of a motion with contact that the error estimates of its steps cannot contain.

Where two edges meet, a difference of micrometres decides on which side one passes the other, and two
nearby motions part. Every step is accurate, so that its estimate remains small. The error is
therefore estimated by repeating the motion with other time steps, or assumed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from sim import Contacts, SimulationError, System
from sim.probes import Variable
from sim.state import Control, State, StepReport

ASSUMED: Final = 5e-4
"""Largest error of a marker that is assumed from the first contact if a motion is not repeated [m].

It is the largest distance between two motions of one trial with contact in different steps, of several
settings and trials driven by EMG; that of the default settings from small steps is smaller
(docs/accuracy.md).
"""

ASSUMED_SHARE: Final = 0.03
"""Assumed error relative to the largest displacement of a marker since the first contact.

Of 20 switches, spikes, chirps and square waves, the largest share that the error requires in addition to
the estimates of the steps is 0.024; the trials driven by EMG in docs/accuracy.md require up to 0.022 of
their whole motion. The number was tested on other drives than these 20. Surfaces that just meet have
not yet moved past each other.
"""

MARGIN: Final = 2.0
"""Error relative to the largest distance from the repetition so far.

Either motion may have passed an edge on the wrong side, and one repetition does not find every event.
"""

SHORTER: Final = 0.5  #: largest step of the repetition, relative to the shorter of step and output
LOOSER: Final = 5.0
"""Error tolerance of the repetition, relative to that of the motion, which makes all steps differ."""

ITERATED: Final = 5e-5
"""Largest tolerance of the iteration [m] to which the repetition increases it, tenfold at most."""
FORCE, TOUCHING = "force_of_contact", "steps_with_contact"


@dataclass(frozen=True)
class ContactForce:
    """Sum of the normal forces of all contacts [N], and number of steps with contact.

    The steps are those since the last output: surfaces may touch and part again between two outputs.
    Errors as of `sim.Contacts`.
    """

    def variables(self) -> tuple[Variable, ...]:
        """Variables `FORCE` and `TOUCHING`."""
        return (Variable(FORCE, "N"), Variable(TOUCHING, "1"))

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float, float]:
        """Measure the force of the state, and copy the number from the report."""
        force = float(np.sum(Contacts().record(system, state, control, report)[2]))
        return force, 0.0 if report is None else float(report.touching)


def in_other_steps(parameters: SimulationParameters) -> SimulationParameters:
    """Parameters of the repetition of a motion: shorter steps, and larger tolerances."""
    tolerance, iterated = parameters.error_tolerance, parameters.iteration_tolerance
    changed = {
        "step": SHORTER * min(parameters.step, parameters.output),
        "error_tolerance": None if tolerance is None else LOOSER * tolerance,
        "iteration_tolerance": max(iterated, min(10.0 * iterated, ITERATED)),
    }
    return parameters.model_copy(update=changed)


def event_error(
    motion: xr.Dataset, again: Callable[[], xr.Dataset] | None
) -> tuple[xr.DataArray, dict[str, float | str]]:
    """Error (time,) [m] of the largest marker by events of contact, 0 before the first contact.

    `motion` contains ``position(marker, axis, time)`` [m] and, if surfaces may touch, the variables of
    `ContactForce`. `again` repeats it with other time steps; the error is `MARGIN` times the largest
    distance of a marker between both motions so far, and its run time is added to ``run_time_s`` of
    the motion. If it is None or fails, the error is `ASSUMED_SHARE` of the largest displacement of a
    marker since the first contact, and at most `ASSUMED`. The second result contains the attributes of a
    motion with contact.
    """
    none = xr.zeros_like(motion["time"])
    force, steps = (motion.get(name, none).values for name in (FORCE, TOUCHING))
    touching = np.maximum.accumulate((force > 0.0) | (steps > 0.0))
    values, attrs = _assumed(motion["position"], touching), dict[str, float | str]()
    if touching.any():
        attrs["event_error_measured"] = 0
    if again is not None and touching.any():
        try:
            other = again()
        except SimulationError as error:
            attrs["repetition_failed"] = f"{type(error).__name__}: {error}"
        else:
            apart = other["position"].assign_coords(time=motion["time"]) - motion["position"]
            distance = ((apart**2).sum("axis").max("marker") ** 0.5).values
            values = MARGIN * np.maximum.accumulate(distance)
            motion.attrs["run_time_s"] += other.attrs["run_time_s"]
            attrs["event_error_measured"] = 1
    if attrs:
        attrs["event_error"] = float(values.max())
    found = xr.DataArray(values, dims="time", coords={"time": motion["time"]})
    return found.assign_attrs(units="m"), attrs


def _assumed(position: xr.DataArray, touching: np.ndarray) -> np.ndarray:
    """Error (time,) [m] that is assumed from the first contact; positions (marker, axis, time) [m]."""
    if not touching.any():
        return np.zeros(len(touching))
    first = max(int(np.argmax(touching)) - 1, 0)  # surfaces may have met since the output before
    moved = position - position.isel(time=first)
    distance = ((moved**2).sum("axis").max("marker") ** 0.5).values
    so_far = np.maximum.accumulate(np.where(touching, distance, 0.0))
    return np.minimum(ASSUMED, ASSUMED_SHARE * so_far)


def contact_statement(*, repeated: bool) -> str:
    """Sentence on the part of contact in the estimated error, for the methods of a manuscript."""
    if repeated:
        return (
            "Every motion with contact was repeated with other time steps, and twice the largest "
            "distance "
            "of a marker between both was added to its estimated error"
        )
    return (
        f"From the first contact, the estimated error includes {100 * ASSUMED_SHARE:g} % of the "
        f"displacement since then, at most {1e3 * ASSUMED:g} mm, for events "
        "that error control cannot resolve, such as a lip that passes the edge of a tooth on one "
        "side or the other: the largest distance of a marker between two motions of one trial "
        "with different time steps, measured in other trials, not in these"
    )


def contact_share(motion: xr.Dataset) -> str:
    """Phrase on the part of contact in the estimated error of a motion, empty without contact."""
    error = 1e3 * float(motion.attrs.get("event_error", 0.0))
    if error == 0.0:
        return ""
    if not motion.attrs["event_error_measured"]:
        advice = "; --check-contact measures it for this motion"
        return (
            f"of which {error:.2g} mm is assumed for contact, from the distance between motions in "
            f"different steps (docs/accuracy.md){'' if 'repetition_failed' in motion.attrs else advice}"
        )
    return (
        f"of which {error:.2g} mm is twice the distance from the repetition with other time steps"
    )
