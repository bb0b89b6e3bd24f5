"""Time loop: labelled trajectory of a compiled scene for an activation."""

import time
from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import contextmanager

import numpy as np
import xarray as xr

from sim.activation import Activation, Driven
from sim.errors import SceneError, SimulationError
from sim.integrators import ConvergedEuler, Integrator, Workspace
from sim.integrators.contract import RunsSteps
from sim.outputs import intervals, joined, outputs_of
from sim.probes import Probe, SmallestJ
from sim.restart import solver_memory, with_solver_memory
from sim.snapping import snapped
from sim.state import Array, Control, State, StepReport
from sim.steps import FixedStep, Motion, StepControl, StepsThrough, Watch, united
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
        Rest by default. The final state of another simulation continues that simulation
        (`save_state`, `read_state`), bitwise identical to an uninterrupted one if steps, outputs
        and solver are the same.
    work : Workspace, optional
        Analysed solver for several simulations of one system; it does not influence the result.
    progress : callable, optional
        Called as ``progress(done, total)`` after every step.

    Returns
    -------
    trajectory : xarray.Dataset
        One variable per probe variable over ``time`` [s]. Attributes: solver, largest step, run
        time, and ``unstable_from_s`` and ``unstable_until_s`` [s] if a matrix was not positive
        definite or the motion snapped (`sim.snapping`) between these times; the further motion may
        depend on rounding.
    final : State

    Raises
    ------
    ControlError
        The activation leaves 0-1, is not finite or does not fit the muscles; steps, outputs and
        duration do not fit each other.
    SceneError
        The initial state is not finite.
    InvertedElement, NotConverged, SingularSystem
        A step failed and the step control could not help.
    """
    integrator = ConvergedEuler() if integrator is None else integrator
    steps = FixedStep() if steps is None else steps
    state = initial or system.rest_state()
    _require_finite(state)
    work = work or Workspace(system)
    carried, origin = solver_memory(state)
    work.restore(carried)
    every = steps.h if every is None else every
    longest = min(steps.h, every) if system.holds_at_ends else steps.h
    origin = state.t if origin is None else origin
    plan = intervals(state.t, duration, longest, every, origin)

    control, fused, known = Driven(system, activation), None, np.zeros((0, len(system.muscles)))
    motion = Motion(integrator, system, control, work)
    if (
        work.bodies is not None
        and isinstance(steps, StepsThrough)
        and isinstance(integrator, RunsSteps)
        and not plan[0].inside
    ):
        plan = joined(plan)
        ends = [interval.ends for interval in plan]
        fused = steps.through(motion, state, ends)
        known = activation.at_all(np.array([interval.until for interval in plan]))
    inside = ((activation.values >= 0.0) & (activation.values <= 1.0)).all(axis=1)
    system.control(activation.values[int(np.argmin(inside))])  # errors before the first step
    start = time.perf_counter()
    records = [_record(probes, system, state, control(state.t), None)]
    times = [state.t]
    reports: list[StepReport] = []
    unstable: list[float] = []
    # At rest, the state is not yet in equilibrium with the initial activation.
    astray = 0.0 if state.v.any() else float(activation.at(state.t).max(initial=0.0))

    def advance(state: State, until: float, watch: Watch | None) -> tuple[State, StepReport]:
        return steps.advance(motion, state, until, watch)

    def smallest_J(q: Array) -> float:
        return system.smallest_J(q)[0]

    for i, interval in enumerate(plan):
        bent, astray = astray, control.astray(state.t, interval.until) if interval.inside else 0.0
        with _told(unstable):
            # The initial velocities, too, result from the activation before the interval.
            if fused is not None:
                passed = [next(fused)]
            else:
                passed = outputs_of(advance, state, interval, smallest_J, max(bent, astray))
        before, state = state, passed[-1][0]
        here = control(state.t) if fused is None else Control(known[i], state.t)
        shifted = (report.indefinite + report.shifts for _, report in passed if report is not None)
        if sum(shifted) > 0 or snapped(system, before, state, here, work.bodies):
            unstable += [before.t, state.t]
        for at, report in passed:
            whole = None
            if report is not None:
                reports.append(report)
            if at is state and not interval.ends_output:
                continue
            if report is not None:
                whole, reports = united(reports, 0), []
            driven = here if at is state else control(at.t)
            records.append(_record(probes, system, at, driven, whole))
            times.append(at.t)
        if progress is not None:
            progress(i + 1, len(plan))
    attrs = {
        "integrator": type(integrator).__name__,
        "step_control": type(steps).__name__,
        "step_s": longest,
        "output_s": every,
        "linear_solver": work.linear.name,
        "run_time_s": time.perf_counter() - start,
        "n_unknowns": system.pattern.n,
    }
    if unstable:
        attrs |= {"unstable_from_s": unstable[0], "unstable_until_s": unstable[-1]}
    return _dataset(probes, times, records, attrs), with_solver_memory(state, work, origin)


@contextmanager
def _told(unstable: list[float]) -> Generator[None]:
    """Add an earlier loss of stability to an error message."""
    try:
        yield
    except SimulationError as error:
        if unstable:
            error.add_note(
                f"the equilibrium lost stability between {unstable[0]:.4g} and "
                f"{unstable[-1]:.4g} s, so that the occurrence and the time of this depend "
                "on rounding"
            )
        raise


def _require_finite(state: State) -> None:
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


def _record(
    probes: Sequence[Probe],
    system: System,
    state: State,
    control: Control,
    report: StepReport | None,
) -> list[Array | float]:
    return [value for p in probes for value in p.record(system, state, control, report)]


def _dataset(
    probes: Sequence[Probe],
    times: list[float],
    records: list[list[Array | float]],
    attrs: Mapping[str, object],
) -> xr.Dataset:
    variables = [v for p in probes for v in p.variables()]
    data: dict[str, xr.DataArray] = {}
    for i, variable in enumerate(variables):
        values = np.array([record[i] for record in records], dtype=np.float64)
        coords = {name: list(labels) for name, labels in (variable.coords or {}).items()}
        data[variable.name] = xr.DataArray(
            np.moveaxis(values, 0, -1),
            dims=(*variable.dims, "time"),
            coords=coords,
            attrs={"units": variable.units},
        )
    time_axis = xr.DataArray(np.array(times), dims="time", attrs={"units": "s"})
    return xr.Dataset(data, coords={"time": time_axis}, attrs=attrs)
