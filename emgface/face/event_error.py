"""Error of a motion by contact, which the other error estimates of its steps do not contain.

A converged stage presses along the normals that surfaces have at its start, unless they are renewed.
Every step estimates the displacement by their change, before a renewal; these estimates are accumulated
here. Where two edges meet, a difference of
micrometres decides on which side one passes the other, and two nearby motions part: a factor on the
estimate allows for small events of this kind. A repetition of the motion with other time steps finds
more of them. The error of steps with one linear solution is assumed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.face.integration import INTEGRATORS
from emgface.face.numerical_error import Floats, accumulated
from emgface.face.simulation_parameters import SimulationParameters
from sim import Contacts, SimulationError, System
from sim.integrators.stage import Converged
from sim.pattern import Flags
from sim.probes import Variable
from sim.state import Control, State, StepReport

ESTIMATE_FACTOR: Final = 1.5
"""Factor on the accumulated estimates of the steps.

Without it, errors that events at edges enlarge exceed the estimate more often (docs/accuracy.md).
"""

ASSUMED: Final = 5e-4
"""Largest error of a marker that is assumed from the first contact if no step estimates it [m].

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

REPETITION_MARGIN: Final = 2.0
"""Error relative to the largest distance from the repetition so far.

Either motion may have passed an edge on the wrong side, and one repetition does not find every event.
"""

SHORTER: Final = 0.5  #: largest step of the repetition, relative to the shorter of step and output
LOOSER: Final = 5.0
"""Error tolerance of the repetition, relative to that of the motion, which makes all steps differ."""

ITERATED: Final = 5e-5
"""Largest tolerance of the iteration [m] to which the repetition increases it, tenfold at most."""
BY_ASSUMPTION, BY_REPETITION, BY_STEPS = 0, 1, 2  #: values of ``event_error_measured``
ERRORS: Final = ("contact_error", "contact_passing_error")  #: of `sim.StepErrors`
CONTACT_FORCE, TOUCHING = "force_of_contact", "steps_with_contact"


@dataclass(frozen=True)
class ContactForce:
    """Sum of the normal forces of all contacts [N], and number of steps with contact.

    The steps are those since the last output: surfaces may touch and part again between two outputs.
    Errors as of `sim.Contacts`.
    """

    def variables(self) -> tuple[Variable, ...]:
        """Variables `CONTACT_FORCE` and `TOUCHING`."""
        return (Variable(CONTACT_FORCE, "N"), Variable(TOUCHING, "1"))

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
    motion: xr.Dataset, again: Callable[[], xr.Dataset] | None, memory: float = 0.0
) -> tuple[xr.DataArray, dict[str, float | str]]:
    """Error (time,) [m] of the largest marker by contact, 0 before the first contact.

    `motion` contains ``position(marker, axis, time)`` [m] and, if surfaces may touch, the variables of
    `ContactForce` and the `ERRORS` (marker, axis, time) [m] of `sim.StepErrors`. `again` repeats it
    with other time steps; the error is `REPETITION_MARGIN` times the largest distance of a marker
    between both motions so far, and its run time is added to ``run_time_s`` of the motion. If it is
    None or fails, the error is `ESTIMATE_FACTOR` times the largest length so far of the errors of
    the steps, accumulated with a `memory` [s] as in `emgface.face.numerical_error`. If the
    integrator does not estimate them, it is `ASSUMED_SHARE` of the largest displacement of a marker
    since the first contact, and at most `ASSUMED`. The second result contains the attributes of a
    motion with contact.
    """
    none = xr.zeros_like(motion["time"])
    force, steps = (motion.get(name, none).values for name in (CONTACT_FORCE, TOUCHING))
    touching = touched(force, steps)
    attrs = dict[str, float | str]()
    if touching.any() and ERRORS[0] in motion and bool(motion[ERRORS[0]].notnull().all()):
        lasting, passing = (motion[name] for name in ERRORS)
        values, kind = ESTIMATE_FACTOR * estimated(lasting, passing, memory), BY_STEPS
    else:
        values, kind = assumed(motion["position"], touching), BY_ASSUMPTION
    if touching.any():
        attrs["event_error_measured"] = kind
    if again is not None and touching.any():
        try:
            other = again()
        except SimulationError as error:
            attrs["repetition_failed"] = f"{type(error).__name__}: {error}"
        else:
            apart = other["position"].assign_coords(time=motion["time"]) - motion["position"]
            distance = ((apart**2).sum("axis").max("marker") ** 0.5).values
            values = REPETITION_MARGIN * np.maximum.accumulate(distance)
            motion.attrs["run_time_s"] += other.attrs["run_time_s"]
            attrs["event_error_measured"] = BY_REPETITION
    if attrs:
        attrs["event_error"] = float(values.max())
    estimate = xr.DataArray(values, dims="time", coords={"time": motion["time"]})
    return estimate.assign_attrs(units="m"), attrs


def touched(force: Floats, steps: Floats) -> Flags:
    """Test if surfaces have touched so far (time,), from the two variables of `ContactForce`."""
    return np.maximum.accumulate((force > 0.0) | (steps > 0.0))


def estimated(lasting: xr.DataArray, passing: xr.DataArray, memory: float) -> Floats:
    """Error (time,) [m] of the largest marker so far from `ERRORS` (marker, axis, time) [m].

    The lasting ones are accumulated with a `memory` [s] (`emgface.face.numerical_error.accumulated`), to
    which the passing ones of the step are added.
    """
    order = "time", "marker", "axis"
    values = accumulated(lasting.transpose(*order).values, lasting["time"].values, memory)
    lengths = np.linalg.norm(values + passing.transpose(*order).values, axis=2).max(axis=1)
    return np.maximum.accumulate(lengths)


def assumed(position: xr.DataArray, touching: Flags) -> Floats:
    """Error (time,) [m] that is assumed from the first contact; positions (marker, axis, time) [m]."""
    if not touching.any():
        return np.zeros(len(touching))
    first = max(int(np.argmax(touching)) - 1, 0)  # surfaces may have met since the output before
    moved = position - position.isel(time=first)
    distance = ((moved**2).sum("axis").max("marker") ** 0.5).values
    so_far = np.maximum.accumulate(np.where(touching, distance, 0.0))
    return np.minimum(ASSUMED, ASSUMED_SHARE * so_far)


def contact_statement(solver: str, *, repeated: bool) -> str:
    """Sentence on the part of contact in the estimated error, for the methods of a manuscript."""
    if repeated:
        return (
            "Every motion with contact was repeated with other time steps, and twice the largest "
            "distance of a marker between both was added to its estimated error"
        )
    if isinstance(INTEGRATORS[solver], Converged):
        return (
            "From the first contact, the estimated error includes the displacement by the change of "
            "the normals and closest points of the contacts within each step, multiplied by "
            f"{ESTIMATE_FACTOR:g}, but not the distance between motions that pass an edge on "
            "different sides"
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
    if motion.attrs["event_error_measured"] == BY_REPETITION:
        return f"of which {error:.2g} mm is twice the distance from the repetition with other time steps"
    advice = "; --check-contact measures it for this motion"
    advice = "" if "repetition_failed" in motion.attrs else advice
    if motion.attrs["event_error_measured"] == BY_STEPS:
        return (
            f"of which {error:.2g} mm is for contact, from the change of its normals within each step "
            f"(docs/accuracy.md){advice}"
        )
    return (
        f"of which {error:.2g} mm is assumed for contact, from the distance between motions in "
        f"different steps (docs/accuracy.md){advice}"
    )
