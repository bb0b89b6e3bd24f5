"""Inverse tracking: the activations of every step that move a scene along targets."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import xarray as xr

from sim.activation import Activation
from sim.errors import ControlError, SceneError
from sim.integrators import LinearlyImplicitEuler, Workspace
from sim.integrators.contract import require_upright
from sim.inverse.quadratic import Minimum, minimise_in_box
from sim.inverse.response import ActiveForces, Form, LinearlyImplicit, Response, step_response
from sim.inverse.targets import Target, Together
from sim.state import Array, Control, State
from sim.system import System
from sim.threads import one_blas_thread

Aim = Literal["position", "velocity"]
EULER = LinearlyImplicitEuler()
REDONE = 3  #: largest number of linearisations of a step


@dataclass(frozen=True)
class Weights:
    """Terms of the objective of a step, all dimensionless, and the bounds of the activations.

    The objective is motion/2 |r|^2 + size/2 |a|^2 + change/2 |a - a_before|^2 + the sEMG term of
    `MeasuredActivation`, where r are the residuals over the sizes of their targets.
    """

    #: weights [1]
    motion: float = 1.0
    size: float = 1e-4
    change: float = 1e-4
    #: bounds of the activations, within 0-1
    low: float | Array = 0.0
    high: float | Array = 1.0
    jump: float = 1.0  #: largest change of an activation in one step
    #: time T in which a deviation is to vanish [s], at least the step; default: the step
    chase: float | None = None
    #: the end of the step should be at x + h (x_t' + (x_t - x)/T) with the mean velocity x_t' of the
    #: target, so that T = h reaches the target without overshoot; or have the velocity
    #: x_t' + (x_t - x)/T with x_t at the end of the step, the rule of the published controller,
    #: which moves x by h x_t' too far in each step if T = h
    aim: Aim = "position"
    #: divide the residuals by the Frobenius norm of their derivatives, as the published controller
    #: does. The meaning of the weights then changes from step to step
    normalise: bool = False
    #: derivatives of `step_response`, at the activation of the step before; or, as published, with the
    #: matrix of the step at activation 0
    form: Form = "exact"
    #: linearisations of each step, at most three. With one and the exact form, the linearised step is
    #: the step; otherwise, and with joints or contact, the step is computed again with its activation
    rounds: int = 1

    def __post_init__(self) -> None:
        low, high = np.asarray(self.low), np.asarray(self.high)
        if not (np.all(low >= 0.0) and np.all(high <= 1.0) and np.all(low <= high)):
            raise ControlError("bounds of the activations must satisfy 0 <= low <= high <= 1")
        values = (self.motion, self.size, self.change)
        if not (np.isfinite(values).all() and min(values) >= 0.0 and self.jump > 0.0):
            raise SceneError(
                f"weights {values} and jump {self.jump}: expected numbers >= 0, jump > 0"
            )
        if not 1 <= self.rounds <= REDONE:
            raise SceneError(f"rounds = {self.rounds}, expected 1 to {REDONE}")


@dataclass(frozen=True, eq=False)
class MeasuredActivation:
    """Activation estimated from sEMG, and the trust in each muscle."""

    activation: Activation  #: of all muscles; values of muscles without trust are ignored
    #: (n_muscles,) weight w_e/2 trust (a - a_emg)^2 of each muscle [1], 0 if it is not measured,
    #: infinite if its activation is prescribed
    trust: Array = field(default_factory=lambda: np.zeros(0))
    #: (n_muscles, n_muscles) share of every muscle (column) in every measured activation (row) by
    #: cross-talk; by default the identity
    mixing: Array | None = None

    def __post_init__(self) -> None:
        n = self.activation.values.shape[1]
        if self.mixing is not None and np.isinf(self.trust).any():
            raise ControlError(
                "a muscle is prescribed by an activation with cross-talk: leave the mixing matrix out, "
                "or use a finite trust"
            )
        if self.trust.shape != (n,) or not (self.trust >= 0.0).all():
            raise ControlError(
                f"trust of shape {self.trust.shape} for {n} muscles, expected one number >= 0 for each"
            )


@dataclass(frozen=True)
class _Problem:
    """Quadratic programme of one step, Q and c, with its bounds."""

    Q: Array
    c: Array
    low: Array
    high: Array


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
    if not targets or not n:
        raise SceneError(f"{len(targets)} targets and {n} muscles, expected at least one of each")
    chase = h if weights.chase is None else weights.chase
    if chase < h * (1.0 - 1e-9):
        raise SceneError(
            f"chase = {chase:g} s is shorter than the step of {h:g} s, expected at least that"
        )
    state = initial or system.rest_state()
    work = work or Workspace(system)
    forces = ActiveForces(system)
    total = round(duration / h)
    a = np.zeros(n) if before is None else before
    records: list[tuple[Array, Array, Array, float, float, float, float]] = []
    times = list[float]()
    started = time.perf_counter()
    for k in range(total):
        t1, last, rounds = state.t + h, a, 0
        while True:
            around = np.zeros(n) if weights.form == "affine" and not rounds else a
            response = step_response(
                system, integrator, state, around, h, work, forces, weights.form
            )
            problem = _problem(system, response, target, state, last, chase, weights, measured)
            found = minimise_in_box(problem.Q, problem.c, problem.low, problem.high, last)
            moved = float(np.abs(found.x - a).max())
            a, rounds = found.x, rounds + 1
            if rounds >= weights.rounds or moved < 1e-9:
                break
        state = _advanced(system, integrator, state, response, a, h, work, weights)
        reached, wanted = target.value(state.q), target.wanted(t1)
        gap = (reached - wanted)[np.isfinite(wanted)]
        misfit = float(np.sqrt(np.mean(gap**2))) if len(gap) else np.nan
        saturated = float((found.at_high & (problem.high > problem.low)).sum())
        records.append((a, reached, wanted, misfit, found.violation, response.rows, saturated))
        times.append(t1)
        if progress is not None:
            progress(k + 1, total)
    return _dataset(system, times, records, time.perf_counter() - started), state


def _problem(
    system: System,
    response: Response,
    target: Together,
    state: State,
    last: Array,
    chase: float,
    weights: Weights,
    measured: MeasuredActivation | None,
) -> _Problem:
    """Objective of one step in terms of the activation."""
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
    seen = np.isfinite(r)
    along, r = moved[seen], r[seen]
    norm = float(np.linalg.norm(along)) if weights.normalise else 1.0
    along, r = along / max(norm, 1e-300), r / max(norm, 1e-300)
    n = len(last)
    ones = np.ones(n)
    soft, given, fixed = 0.0 * ones, 0.0 * ones, np.zeros(n, dtype=bool)
    mixing = np.eye(n)
    if measured is not None:
        given = np.nan_to_num(np.clip(measured.activation.at(t1), 0.0, 1.0))
        fixed = np.isinf(measured.trust)
        soft = np.where(fixed, 0.0, measured.trust)
        mixing = mixing if measured.mixing is None else measured.mixing
    quadratic = weights.motion * along.T @ along + mixing.T @ (soft[:, None] * mixing)
    quadratic = quadratic + (weights.size + weights.change) * np.eye(n)
    linear = weights.motion * along.T @ (r + along @ response.activation)
    linear = linear + weights.change * last + mixing.T @ (soft * given)
    low = np.maximum(np.broadcast_to(weights.low, n), last - weights.jump)
    high = np.minimum(np.broadcast_to(weights.high, n), last + weights.jump)
    low, high = np.where(fixed, given, low), np.where(fixed, given, high)
    return _Problem(quadratic, linear, low, np.maximum(low, high))


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


def _dataset(
    system: System,
    times: list[float],
    records: list[tuple[Array, Array, Array, float, float, float, float]],
    seconds: float,
) -> xr.Dataset:
    a, reached, wanted, *rest = (np.array(part).T for part in zip(*records, strict=True))
    names = ("misfit", "violation", "rows", "saturated")
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
        coords={"muscle": list(system.muscles), "time": ("time", np.array(times), {"units": "s"})},
        attrs={"run_time_s": seconds},
    )


__all__ = ["MeasuredActivation", "Minimum", "Weights", "track"]
