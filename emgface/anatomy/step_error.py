"""Estimated error of the time steps of a motion, from its repetition with other steps.

Motions of jaw, tongue and head are repeated; those of a face have an estimate in every step
(`emgface.face.numerical_error`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr

import sim
from emgface.face.parts import Floats
from emgface.schema.rules import one_line
from sim.integrators import Integrator
from sim.integrators.contract import TimeIntegrator
from sim.probes import Probe, Variable
from sim.state import Control, Outputs, State, StepReport

MOST_STEP_HALVINGS = 6
"""Largest number of times that steps are halved to reach a desired error."""
REPETITION_FAILED = "repetition_failed"  #: attribute of a motion
FITTING = 1e-6
"""Relative difference from a whole ratio of two times that is rounding."""


@dataclass(frozen=True)
class Jumps:
    """Largest ``jump`` of a step since the output before [m], as of `sim.state.StepReport`."""

    def variables(self) -> tuple[Variable, ...]:
        """Describe the variable."""
        return (Variable("jump", "m"),)

    def record(
        self, system: sim.System, state: State, control: Control, report: StepReport | None
    ) -> tuple[float]:
        """Copy it from the report; 0 at the start and with integrators that do not estimate it."""
        return (0.0 if report is None else float(np.nan_to_num(report.jump)),)

    def record_all(self, system: sim.System, outputs: Outputs, activation: Floats) -> tuple[Floats]:
        """Copy them from the reports."""
        return (np.nan_to_num([report.jump for report in outputs.reports]),)


Run = Callable[[float, bool], xr.Dataset]
"""Motion with steps of at most so many seconds, or, with False, its points alone."""


def order_of_steps(integrator: Integrator) -> int:
    """Order of a method, 1 if it declares none."""
    return integrator.order if isinstance(integrator, TimeIntegrator) else 1


@dataclass(frozen=True)
class Repeated:
    """A motion and its repetition with longer or shorter steps, by a method of order p.

    If the longer steps are r times the shorter ones, the series of the error in the step gives
    1/(r^p - 1) of the distance between both motions as the error of the one with shorter steps, and
    r^p/(r^p - 1) as that of the other. The attribute ``step_s`` of each is the step that was taken.
    """

    motion: xr.Dataset
    other: xr.Dataset
    order: int

    @property
    def shorter(self) -> bool:
        """True if the repetition has the shorter steps."""
        return self.other.attrs["step_s"] < self.motion.attrs["step_s"]

    def error(self, markers: Sequence[str] | None = None) -> Floats:
        """Estimated error (time,) of some points, by default all, until every instant [m].

        Where an impact or a burst within a step decides the further motion, both motions may err
        alike: a velocity that changes by dv (``jump``) at an unknown instant of a step displaces a
        point by up to h dv, which is added where a method computes it (that of bodies alone).
        """
        x, y = (
            one["position"].sel(marker=slice(None) if markers is None else list(markers))
            .transpose("time", "marker", "axis").values
            for one in (self.motion, self.other)
        )  # fmt: skip
        apart = np.sqrt(((x - y) ** 2).sum(axis=2)).max(axis=1)
        short, long = sorted(float(one.attrs["step_s"]) for one in (self.motion, self.other))
        grown = (long / short) ** self.order
        share = (grown if self.shorter else 1.0) / (grown - 1.0)
        error = share * np.maximum.accumulate(apart)
        if "jump" in self.motion:
            error = error + np.maximum.accumulate(self.motion["jump"].values)
        return np.asarray(error, dtype=np.float64)


def repeated_motion(
    run: Run, step: float, output: float, order: int, *, shorter: bool = False, whole: bool = False
) -> Repeated:
    """Motion with steps and times between outputs [s], and its repetition.

    The repetition has steps twice as long, for half of the run time; with `shorter`, or if these do
    not divide the time between outputs, or fail, it has shorter ones. Outputs shorten the steps of
    constraints, so that the steps that were taken are compared, not those requested. With `whole` a
    repetition with shorter steps has all variables.
    """
    motion = run(step, True)
    taken = float(motion.attrs["step_s"])
    if not shorter and _whole(0.5 * output / taken):
        try:
            return Repeated(motion, run(2.0 * taken, False), order)
        except sim.SimulationError:
            pass
    return Repeated(motion, run(_next_shorter(taken, output), whole), order)


def with_step_error(
    run: Run,
    step: float,
    output: float,
    order: int,
    tolerance: float | None,
    *,
    shorter: bool = False,
) -> xr.Dataset:
    """Motion with ``numerical_error`` (time) [m], also an attribute with its largest value.

    Steps are shortened until the error is at most a tolerance [m], at most `MOST_STEP_HALVINGS` times;
    without a tolerance they are those given. Other arguments as of `repeated_motion`. If a repetition
    fails, the attribute ``repetition_failed`` is the reason; without any, the error is not known.
    """
    whole, failed, moved, halved = tolerance is not None, dict[str, str](), list[xr.Dataset](), 0

    def kept(h: float, whole: bool) -> xr.Dataset:
        moved.append(run(h, whole))
        return moved[-1]

    try:
        pair = repeated_motion(kept, step, output, order, shorter=shorter, whole=whole)
    except sim.SimulationError as reason:
        if not moved or shorter:
            raise
        return moved[0].assign_attrs({REPETITION_FAILED: one_line(reason)})
    error = pair.error()
    while tolerance is not None and error[-1] > tolerance and halved < MOST_STEP_HALVINGS:
        halved += 1
        best = pair.other if pair.shorter else pair.motion
        try:
            finer = run(_next_shorter(float(best.attrs["step_s"]), output), True)
        except sim.SimulationError as reason:
            failed = {REPETITION_FAILED: one_line(reason)}
            break
        pair = Repeated(best, finer, order) if pair.shorter else Repeated(finer, best, order)
        error = pair.error()
    motion = pair.motion.assign(numerical_error=("time", error, {"units": "m"}))
    return motion.assign_attrs({"numerical_error": float(error[-1]), **failed})


def motion_of(
    system: sim.System,
    drive: sim.Activation,
    probes: Sequence[Probe],
    *,
    duration: float,
    step: float,
    output: float,
    integrator: Integrator,
    check: bool,
    tolerance: float | None,
    progress: Callable[[int, int], None] | None,
) -> xr.Dataset:
    """Motion of a scene with steps that are halved where they fail, with its error if it is checked.

    The first of the `probes` records the points whose error is estimated; a repetition records no
    others. `progress` is called in every repetition.
    """

    def run(h: float, whole: bool) -> xr.Dataset:
        return sim.simulate(
            system,
            drive,
            duration=duration,
            steps=sim.HalvingStep(h),
            every=output,
            integrator=integrator,
            probes=probes if whole else probes[:1],
            progress=progress,
        )[0]

    if not check and tolerance is None:
        return run(step, True)
    return with_step_error(run, step, output, order_of_steps(integrator), tolerance)


def _whole(ratio: float) -> bool:
    """True for a whole number above 0, but for rounding."""
    return ratio > 0.5 and abs(ratio - round(ratio)) < FITTING * ratio


def _next_shorter(step: float, output: float) -> float:
    """Half of a step [s]; of one that spans an odd number of outputs, the largest part that fits."""
    spans = round(step / output)
    parts = 2 if spans < 3 else next(k for k in range(2, spans + 1) if spans % k == 0)
    return step / parts
