"""Time loop: labelled trajectory of a compiled scene for an activation."""

import math
import time
import warnings
from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
import xarray as xr

from sim.activation import Activation, Driven
from sim.checks import number, whole
from sim.errors import ControlError, SceneError, SlowStepsWarning
from sim.integrators import ConvergedEuler, Integrator, Workspace
from sim.integrators.contract import RunsSteps
from sim.linear.pardiso import NOTE
from sim.linear.pardiso import solver_threads as threads_of
from sim.outputs import Interval, intervals, outputs_of, steps_to_outputs
from sim.probes import Probe, ReadsErrors, SmallestJ
from sim.record import Log
from sim.restart import require_own, with_scene
from sim.snapping import snapped, snapped_bodies
from sim.state import Array, Control, State, StepReport, united
from sim.steps import FixedStep, Motion, StepControl, StepsThrough, Watch
from sim.system import System
from sim.threads import one_blas_thread

Progress = Callable[[int, int], None]


@one_blas_thread
def simulate(
    system: System,
    activation: Activation,
    *,
    duration: float,
    integrator: Integrator | None = None,
    steps: StepControl | None = None,
    every: float | None = None,
    probes: Sequence[Probe] = (SmallestJ(),),
    initial: State | None = None,
    work: Workspace | None = None,
    progress: Progress | None = None,
    checkpoint: int | None = None,
    at_checkpoint: Callable[[State], None] | None = None,
    solver_threads: int = 1,
) -> tuple[xr.Dataset, State]:
    """Simulate and record.

    Parameters
    ----------
    system : System
    activation : Activation
        One column per muscle in the order of `System.muscles`.
    duration : float
        Simulated time [s], a whole number of outputs.
    integrator : Integrator, optional
        `ConvergedEuler` by default.
    steps : StepControl, optional
        `FixedStep` of 10 ms by default.
    every : float, optional
        Time between outputs [s], ``steps.h`` by default; a whole multiple or a whole fraction of
        it. Positions inside a step are interpolated (`sim.outputs.outputs_of`); counts and
        residuals are recorded at the first output at or after the end of their step. With contact
        or constraints, which are satisfied only at the ends of steps, steps end at every output.
    probes : sequence of Probe
    initial : State, optional
        Rest by default, or the final state of another simulation (`save_state`, `read_state`).
    work : Workspace, optional
        Analysed solver for several simulations of one system; it does not influence the result.
    progress : callable, optional
        Called as ``progress(done, total)`` after every step.
    checkpoint : int, optional
        Number of outputs between checkpoints, none by default. At a checkpoint the solver forgets
        earlier steps, and instants are counted anew. A simulation that starts from the state at a
        checkpoint is therefore bitwise identical to one without interruption.
    at_checkpoint : callable, optional
        Called with the state at every checkpoint, for `save_state` or as `initial` of a branch.
    solver_threads : int
        Threads of PARDISO. With more than one, a large scene takes less time on idle cores, and the
        last digits differ between processes, which the attribute ``note`` of the trajectory states.

    Returns
    -------
    trajectory : xarray.Dataset
        One variable per probe variable over ``time`` [s]. Attributes: solver and its threads, largest
        step, run time, and ``unstable_from_s`` and ``unstable_until_s`` [s] if a matrix was not positive
        definite or the motion snapped (`sim.snapping`) between these times; the further motion may
        depend on rounding; ``swing_lost`` and its time [s] and node if steps with one linear solution
        took more than a tenth of the energy of turning tissue (`LostSwingWarning`).
    final : State

    Raises
    ------
    ControlError
        The activation leaves 0-1, is not finite or does not fit the muscles; steps, outputs,
        checkpoints and duration do not fit each other.
    SceneError
        The initial state is not finite or belongs to another scene; the linear solver has no threads.
    InvertedElement, NotConverged, SingularSystem
        A step failed and the step control could not help.
    """
    _require_arguments(system, activation, duration, every, probes, checkpoint, solver_threads)
    integrator = ConvergedEuler() if integrator is None else integrator
    steps = FixedStep() if steps is None else steps
    state = initial or system.rest_state()
    require_own(state, system)
    _require_finite(state)
    work = work or Workspace(system)
    every = steps.h if every is None else every
    longest = min(steps.h, every) if system.holds_at_ends else steps.h
    parts = _parts(duration, every, checkpoint)
    control, log = Driven(system, activation), Log(system, probes)
    motion = Motion(integrator, system, control, work)
    through = steps if isinstance(steps, StepsThrough) else None
    runs = isinstance(integrator, RunsSteps)
    if runs and system.not_fused:
        warnings.warn(
            f"steps of this scene of bodies are not fused and take about 100 times as long: "
            f"{system.not_fused}",
            SlowStepsWarning,
            stacklevel=3,
        )
    fused = runs and integrator.fuses(work)
    if not fused or longest > 1.5 * every:
        through = None  # or outputs are inside steps
    intervals(state.t, duration, longest, every)  # errors before the first step
    inside = ((activation.values >= 0.0) & (activation.values <= 1.0)).all(axis=1)
    system.control(activation.values[int(np.argmin(inside))])  # errors before the first step
    began = time.perf_counter()
    log.add(state, control(state.t), None)
    estimating = work.estimating(any(isinstance(part, ReadsErrors) for part in (steps, *probes)))
    parts_done = _ProgressOfParts(progress)
    with threads_of(solver_threads, work.linear.name), estimating:
        for number, part in enumerate(parts):
            if number and at_checkpoint is not None:
                at_checkpoint(with_scene(state, system))
            work.forget()
            times = state.t, part, longest, every
            if through is not None:
                groups = steps_to_outputs(*times)
                parts_done.begin(len(groups), len(parts))
                state = _together(motion, through, state, groups, activation, log, parts_done)
            else:
                plan = intervals(*times)
                parts_done.begin(len(plan), len(parts))
                state = _one_by_one(motion, control, steps, state, plan, log, parts_done)
    attrs = {
        "integrator": type(integrator).__name__,
        "step_control": type(steps).__name__,
        "step_s": longest,
        "output_s": every,
        "linear_solver": work.linear.name,
        "solver_threads": solver_threads,
        "run_time_s": time.perf_counter() - began,
        "n_unknowns": system.pattern.n,
    }
    if solver_threads > 1:
        attrs["note"] = NOTE.format(solver_threads)
    if log.unstable:
        attrs |= {"unstable_from_s": log.unstable[0], "unstable_until_s": log.unstable[-1]}
    if (lost := log.lost_swing()) is not None:
        attrs |= {
            "swing_lost": lost.share,
            "swing_lost_at_s": lost.time,
            "swing_lost_node": lost.node,
        }
        warnings.warn(lost, stacklevel=3)
    return log.dataset(attrs), with_scene(state, system)


def _require_arguments(
    system: object,
    activation: object,
    duration: object,
    every: object,
    probes: object,
    checkpoint: object,
    solver_threads: object,
) -> None:
    """Refuse arguments of another type, which Python would accept or report without a name."""
    for name, given, kind in (
        ("system", system, System),
        ("activation", activation, Activation),
        ("probes", probes, Sequence),
    ):
        if not isinstance(given, kind) or isinstance(given, str):
            raise SceneError(
                f"simulate: {name} is a {type(given).__name__}, expected a {kind.__name__}"
            )
    for probe in cast("Sequence[object]", probes):
        if isinstance(probe, type) or not hasattr(probe, "record"):
            raise SceneError(f"simulate: {ascii(probe)[:60]} among the probes, expected a probe")
    for name, seconds in (("duration", duration), ("every", every)):
        if name == "every" and seconds is None:
            continue
        if not 0.0 <= number("simulate", name, seconds, error=ControlError) < math.inf:
            raise ControlError(f"{name} = {seconds!r} s, expected a finite number of seconds >= 0")
    if checkpoint is not None:
        whole("simulate", "checkpoint", checkpoint, least=1, error=ControlError)
    whole("simulate", "solver_threads", solver_threads, least=1)


def _parts(duration: float, every: float, checkpoint: int | None) -> list[float]:
    """Durations [s] between the start, the checkpoints and the end."""
    if checkpoint is None:
        return [duration]
    outputs = round(duration / every)
    whole, rest = divmod(outputs, checkpoint)
    return [checkpoint * every] * whole + ([rest * every] if rest else [])


class _ProgressOfParts:
    """Progress over the parts between checkpoints."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self._before, self._total, self._own = progress, 0, 0, 0

    def begin(self, own: int, parts: int) -> None:
        """Begin a part of some steps; the first has the most."""
        self._before += self._own
        self._total, self._own = max(self._total, own * parts), own

    def __call__(self, done: int) -> None:
        if self.progress is not None:
            self.progress(self._before + done, self._total)


def _together(
    motion: Motion,
    steps: StepsThrough,
    state: State,
    groups: Sequence[Sequence[float]],
    activation: Activation,
    log: Log,
    parts_done: _ProgressOfParts,
) -> State:
    """Record a simulation after each group of steps, several at once; the last state."""
    bodies, outputs, done = motion.work.bodies, None, 0
    t, frames = np.array([state.t]), state.frames[None]
    passed = steps.through(motion, state, groups)
    while done < len(groups):
        with log.noting_lost_stability():
            outputs = next(passed)
        driven = activation.at_all(outputs.t)
        t, frames = np.concatenate([t, outputs.t]), np.concatenate([frames, outputs.frames])
        lost = np.array([r.indefinite + r.shifts > 0 or bool(r.concave) for r in outputs.reports])
        if bodies is not None:
            lost |= snapped_bodies(bodies, frames, driven)
        log.unstable += [float(x) for k in np.flatnonzero(lost) for x in t[k : k + 2]]
        log.add_all(outputs, driven)
        before, done, t, frames = done, done + len(outputs.t), t[-1:], frames[-1:]
        for k in range(before if parts_done.progress else done, done):
            parts_done(k + 1)
    return state if outputs is None else outputs.state(-1)


def _one_by_one(
    motion: Motion,
    control: Driven,
    steps: StepControl,
    state: State,
    plan: Sequence[Interval],
    log: Log,
    parts_done: _ProgressOfParts,
) -> State:
    """Record the outputs of a plan; the last state."""
    system, reports = motion.system, list[StepReport]()
    # At rest, the state is not yet in equilibrium with the initial activation.
    astray = 0.0 if state.v.any() else float(control(state.t).activation.max(initial=0.0))

    def advance(state: State, until: float, watch: Watch | None) -> tuple[State, StepReport]:
        return steps.advance(motion, state, until, watch)

    def smallest_J(q: Array) -> float:
        return system.smallest_J(q)[0]

    for i, interval in enumerate(plan):
        bent, astray = astray, control.astray(state.t, interval.until) if interval.inside else 0.0
        with log.noting_lost_stability():
            # The initial velocities, too, result from the activation before the interval.
            passed = outputs_of(advance, state, interval, smallest_J, max(bent, astray))
        before, state = state, passed[-1][0]
        here = control(state.t)
        if _lost_stability(motion, before, state, here, passed):
            log.unstable += [before.t, state.t]
        for at, report in passed:
            whole = None
            if report is not None and report.swing is not None:
                log.swings.append((state.t, report.swing))
            if report is not None:
                reports.append(report)
            if at is state and not interval.ends_output:
                continue
            if report is not None:
                whole, reports = united(reports, 0), []
            log.add(at, here if at is state else control(at.t), whole)
        parts_done(i + 1)
    return state


def _lost_stability(
    motion: Motion,
    before: State,
    after: State,
    control: Control,
    passed: Sequence[tuple[State, StepReport | None]],
) -> bool:
    """Test if a matrix was not positive definite or the motion snapped, by its reports if any."""
    reports = [report for _, report in passed if report is not None]
    if any(report.indefinite + report.shifts > 0 for report in reports):
        return True
    concave = [report.concave for report in reports]
    if concave and None not in concave:
        return any(concave)
    return snapped(motion.system, before, after, control, motion.work.bodies)


def _require_finite(state: State) -> None:
    if not np.isfinite(state.t):
        raise SceneError(
            f"the time of the initial state is {state.t} s, expected a finite number: state it"
        )
    blocks = {"position": state.q, "velocity": state.v}
    blocks |= {"frame": state.frames, "twist": state.twists}
    for name, values in blocks.items():
        finite = np.isfinite(values).all(axis=1)
        if not finite.all():
            node, kind = int(np.argmin(finite)), "body" if name in ("frame", "twist") else "node"
            raise SceneError(
                f"{name} of {kind} {node} in the initial state is not finite ({values[node].tolist()}), "
                "expected numbers: repair it, or start from rest"
            )
