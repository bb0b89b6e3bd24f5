"""Inverse tracking: the activations of every step that move a scene along targets."""

import time
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from sim.errors import SceneError
from sim.integrators import LinearlyImplicitEuler, Workspace
from sim.inverse.active_forces import ActiveForces
from sim.inverse.force_targets import ForceTarget
from sim.inverse.objective import MeasuredActivation, Objective, Weights
from sim.inverse.quadratic import minimise_in_box
from sim.inverse.response import LinearlyImplicit, Response, step_response
from sim.inverse.targets import Target, Together
from sim.scene import Index
from sim.state import Array, Control, State, require_upright
from sim.system import System
from sim.threads import one_blas_thread

EULER = LinearlyImplicitEuler()


@one_blas_thread
def track(
    system: System,
    targets: Sequence[Target],
    *,
    duration: float,
    h: float = 0.01,
    weights: Weights | None = None,
    measured: MeasuredActivation | None = None,
    integrator: LinearlyImplicit = EULER,
    initial: State | None = None,
    before: Array | None = None,
    work: Workspace | None = None,
    forces: Sequence[ForceTarget] = (),
    progress: Callable[[int, int], None] | None = None,
) -> tuple[xr.Dataset, State]:
    """Activations of every step by which a system follows its targets.

    Parameters
    ----------
    system : System
    targets : sequence of Target
    duration, h : float
        Simulated time and step [s].
    weights : Weights, optional
    measured : MeasuredActivation, optional
        Activation from sEMG; without it the motion alone determines the muscles.
    integrator : LinearlyImplicit
    initial : State, optional
        Rest by default.
    before : (n_muscles,) activation before the first step, 0 by default.
    work : Workspace, optional
    forces : sequence of RowForceTarget or ContactForceTarget
        Wanted forces, such as those of a bite or of lips that touch; their residuals are those at the
        end of the step, without the chase time.
    progress : callable, optional
        Called as ``progress(done, total)``.

    Returns
    -------
    result : xarray.Dataset
        ``activation (muscle, time)``, ``tracked`` and ``wanted (quantity, time)`` in units of the
        sizes of the targets, and over time: ``misfit``, the root mean square of their measured
        differences; ``violation`` of the optimality conditions; ``rows``, the number of frozen rows; and
        ``saturated``, the number of activations at an upper bound.
    final : State

    Raises
    ------
    SceneError
        There are no targets or no muscles, the chase time is shorter than the step, or as
        `step_response`.
    InvertedElement, NotConverged, SingularSystem
        A step failed.

    Notes
    -----
    One step looks one step ahead: the result is not the optimum over the trajectory. Sources:
    Stavness, Lloyd and Fels 2012, J Biomech 45:2841-2848, and the modelling guide of ArtiSynth,
    Inverse simulation (objective and chase rule); Pizzolato et al. 2015, J Biomech 48:3929-3936 (the
    family of sEMG terms).
    """
    weights = weights or Weights()
    target, n = Together(tuple(targets)), len(system.muscles)
    force_targets = tuple((one.indices(system), one) for one in forces)
    if not (targets or forces) or not n:
        raise SceneError(f"{len(targets)} targets and {n} muscles, expected at least one of each")
    chase = h if weights.chase is None else weights.chase
    if chase < h * (1.0 - 1e-9):
        raise SceneError(
            f"chase = {chase:g} s is shorter than the step of {h:g} s, expected at least that"
        )
    state = initial or system.rest_state()
    work = work or Workspace(system)
    active = ActiveForces(system)
    total = round(duration / h)
    a = np.zeros(n) if before is None else before
    records: list[tuple[Array, Array, Array, float, float, float, float]] = []
    times = list[float]()
    started = time.perf_counter()
    for k in range(total):
        t1, last, rounds = state.t + h, a, 0
        objective = Objective.at(t1, last, weights, measured)
        while True:
            around = np.zeros(n) if weights.form == "affine" and not rounds else a
            response = step_response(
                system,
                integrator,
                state,
                around,
                h,
                work,
                active,
                weights.form,
                bool(force_targets),
            )
            along, r = _residuals(system, response, target, force_targets, state, chase, weights)
            Q, c = objective.quadratic(along, r, response.activation)
            minimum = minimise_in_box(Q, c, objective.low, objective.high, last)
            moved = float(np.abs(minimum.x - a).max())
            a, rounds = minimum.x, rounds + 1
            if rounds >= weights.rounds or moved < 1e-9:
                break
        state = _advanced(system, integrator, state, response, a, h, work, weights)
        reached, wanted = target.value(state.q), target.wanted(t1)
        for rows, one in force_targets:
            reached = np.concatenate([reached, one.reached(system, state, rows) / one.size])
            wanted = np.concatenate([wanted, one.wanted(t1) / one.size])
        saturated = float((minimum.at_high & (objective.high > objective.low)).sum())
        about = misfit(reached, wanted), minimum.violation, response.rows, saturated
        records.append((a, reached, wanted, *about))
        times.append(t1)
        if progress is not None:
            progress(k + 1, total)
    names, seconds = ("misfit", "violation", "rows", "saturated"), time.perf_counter() - started
    return tracked_dataset(system, np.array(times), records, names, seconds), state


def _residuals(
    system: System,
    response: Response,
    target: Together,
    force_targets: Sequence[tuple[Index, ForceTarget]],
    state: State,
    chase: float,
    weights: Weights,
) -> tuple[Array, Array]:
    """Derivatives of the quantities by the activations, and residuals, at the linearisation."""
    h, t0, t1 = response.h, state.t, state.t + response.h
    kinematics, pose = system.kinematics, response.pose
    end = response.end(system, response.w)
    slope = target.slope(end.q)
    points = kinematics.matrix(pose) @ response.H
    x0, to, at = target.value(state.q), target.wanted(t1), target.wanted(t0)
    rate = (to - at) / h
    if weights.aim == "position":
        moved, x = response.moves * h * (slope @ points), target.value(end.q)
        r = x0 + h * (rate + (at - x0) / chase) - x
        lost = np.isnan(at) & ~np.isnan(to)  # a marker that reappears has no velocity
        r = (chase / h) * np.where(lost, x0 + h / chase * (to - x0) - x, r)
        moved = (chase / h) * moved
    else:
        # v* = x_t' + (x_t - x)/T at the end of the step
        reached = kinematics.state(end, response.w, {}).v.reshape(-1)
        moved = chase * (slope @ points)
        r = chase * (rate + (to - x0) / chase - slope @ reached)
    for rows, one in force_targets:
        force, slope = one.response(response, rows)
        r = np.concatenate([r, (one.wanted(t1) - force) / one.size])
        moved = np.concatenate([moved, slope / one.size])
    return moved, r


def _advanced(
    system: System,
    integrator: LinearlyImplicit,
    state: State,
    response: Response,
    a: Array,
    h: float,
    work: Workspace,
    weights: Weights,
) -> State:
    """State at the end of a step: the linearised one, or that of the integrator."""
    again = weights.rounds > 1 or weights.form == "affine"
    conditions = system.rows, system.contact, system.constraints
    again = again or any(one is not None for one in conditions)
    if again:
        return integrator.step(system, state, Control(a, state.t + h), h, work)[0]
    w = response.velocity(a)
    pose = response.end(system, w)
    least, element = system.smallest_J(pose.q)
    require_upright(element, least, state.t + h)
    return system.kinematics.state(pose, w, system.during(state, h).remember(pose.q))


def misfit(reached: Array, wanted: Array) -> float:
    """Root mean square of the measured differences; NaN if nothing is measured."""
    gap = (reached - wanted)[np.isfinite(wanted)]
    return float(np.sqrt(np.mean(gap**2))) if len(gap) else np.nan


def tracked_dataset(
    system: System,
    times: Array,
    records: Sequence[tuple[Array, Array, Array, *tuple[float, ...]]],
    names: tuple[str, ...],
    seconds: float,
) -> xr.Dataset:
    """Activations, reached and wanted values, and named numbers, of the records at times (n,) [s]."""
    a, reached, wanted, *rest = (np.array(part).T for part in zip(*records, strict=True))
    data = {
        name: ("time", values, {"units": "1"}) for name, values in zip(names, rest, strict=True)
    }
    return xr.Dataset(
        {
            "activation": (("muscle", "time"), a, {"units": "1"}),
            "tracked": (("quantity", "time"), reached, {"units": "1"}),
            "wanted": (("quantity", "time"), wanted, {"units": "1"}),
            **data,
        },
        coords={"muscle": list(system.muscles), "time": ("time", times, {"units": "s"})},
        attrs={"run_time_s": seconds},
    )
