"""Quasi-static inverse tracking: activations of equilibria, by Gauss-Newton iterations."""

import time as clock
from collections.abc import Callable, Sequence

import numpy as np
import xarray as xr

from sim.errors import InvertedElement, NotConverged, SceneError, SingularSystem
from sim.integrators import Static, Workspace
from sim.inverse.active_forces import ActiveForces
from sim.inverse.objective import MeasuredActivation, Objective, Weights
from sim.inverse.quadratic import minimise_in_box
from sim.inverse.response import equilibrium_response
from sim.inverse.targets import Target, Together
from sim.inverse.track import misfit, tracked_dataset
from sim.state import Array, Control, State
from sim.system import System
from sim.threads import one_blas_thread

MOST_ITERATIONS = 60  #: most Levenberg-Marquardt iterations of a time
GOOD, POOR = 0.75, 0.25
"""Ratios of the decrease and its prediction above and below which the damping changes, by four."""
LEAST = 1e-4  #: ratio below which a step is refused
FIRST_DAMPING = 1e-3  #: damping of the first iteration over the mean diagonal of Q


@one_blas_thread
def equilibria(
    system: System,
    targets: Sequence[Target],
    times: Array,
    *,
    weights: Weights | None = None,
    measured: MeasuredActivation | None = None,
    initial: State | None = None,
    before: Array | None = None,
    tolerance: float = 1e-4,
    static: Static | None = None,
    work: Workspace | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[xr.Dataset, State]:
    """Activations whose equilibria follow targets, without inertia and damping.

    At every time J(a) of `Objective` with the residuals r = (wanted - x(q(a))) / size is minimised in
    the bounds, where q(a) is the equilibrium; dr/da = -dx/dq K^-1 F (`equilibrium_response`). The
    iteration is that of Levenberg and Marquardt in the bounds: a step that does not lower J, or whose
    equilibrium is not found, is repeated with a larger damping.

    Parameters
    ----------
    times : (n,) ascending [s]
    weights : Weights, optional
        Chase time, aim, form and rounds, which belong to steps, have no effect.
    initial : State, optional
        Equilibrium before the first time, rest by default.
    before : (n_muscles,) activation of that equilibrium, 0 by default.
    tolerance : float
        Share of J below which both its decrease and the decrease predicted must be for convergence.
    static : Static, optional

    Returns
    -------
    result : xarray.Dataset
        As of `track`; without ``rows``, and with ``iterations`` (time). ``violation`` is the share of
        J by which the undamped quadratic model would still lower it.
    final : State

    Raises
    ------
    SceneError
        There are no targets or no muscles, or as `equilibrium_response`.
    NotConverged
        The iteration of a time did not converge.
    InvertedElement, SingularSystem
        The first equilibrium does not exist.

    Notes
    -----
    At rest and where muscles are slack, fibres are at the kink of their law, so that J has kinks as
    well; a criterion on the change of the activations would not be met there. Sources: Sifakis,
    Neverov and Fedkiw 2005, ACM Trans. Graph. 24:417-425 (quasi-static Gauss-Newton on a face); More
    1978, Lecture Notes in Mathematics 630:105-116 (damping and criterion).
    """
    target, n = Together(tuple(targets)), len(system.muscles)
    if not targets or not n:
        raise SceneError(f"{len(targets)} targets and {n} muscles, expected at least one of each")
    started, weights, static = clock.perf_counter(), weights or Weights(), static or Static()
    work, active = work or Workspace(system), ActiveForces(system)
    state, a = initial or system.rest_state(), np.zeros(n) if before is None else before
    equilibrium = _Equilibria(system, target, static, work, active, tolerance)
    records: list[tuple[Array, Array, Array, float, float, float, float]] = []
    for k, t in enumerate(times):
        objective = Objective.at(float(t), a, weights, measured)
        a, state, violation, iterations = equilibrium.minimum(objective, float(t), state)
        reached, wanted = target.value(state.q), target.wanted(float(t))
        full = float(((a >= objective.high) & (objective.high > objective.low)).sum())
        about = misfit(reached, wanted), violation, full, float(iterations)
        records.append((a, reached, wanted, *about))
        if progress is not None:
            progress(k + 1, len(times))
    names = ("misfit", "violation", "saturated", "iterations")
    seconds = clock.perf_counter() - started
    return tracked_dataset(system, np.asarray(times), records, names, seconds), state


class _Equilibria:
    """Equilibria of a scene as a function of the activations, and the minimum of an objective."""

    def __init__(
        self,
        system: System,
        target: Together,
        static: Static,
        work: Workspace,
        active: ActiveForces,
        tolerance: float,
    ) -> None:
        self._system, self._target, self._static = system, target, static
        self._work, self._active, self._tolerance = work, active, tolerance

    def minimum(
        self, objective: Objective, t: float, state: State
    ) -> tuple[Array, State, float, int]:
        """Activations, equilibrium, violation of the conditions, and iterations at a time [s]."""
        low, high = objective.low, objective.high
        a = objective.last.clip(low, high)
        state = self._at(a, t, state)
        r = self._residual(state, t)
        model = self._model(objective, state, r, a, t)
        damping = FIRST_DAMPING * float(np.diag(model[0]).mean())
        for iteration in range(1, MOST_ITERATIONS + 1):
            (Q, c), here = model, objective.value(r, a)
            g = Q @ a - c
            damped = Q + damping * np.eye(len(a))
            way = minimise_in_box(damped, c + damping * a, low, high, a).x - a
            predicted = -float(g @ way + 0.5 * way @ Q @ way)
            if predicted <= 0.0:
                return a, state, 0.0, iteration
            lower, there, new = -np.inf, state, r
            try:
                there = self._at(a + way, t, state)
                new = self._residual(there, t)
                lower = here - objective.value(new, a + way)
            except (InvertedElement, NotConverged, SingularSystem):
                pass  # the equilibrium is too far away: a larger damping takes a shorter way
            small = self._tolerance * here
            if predicted <= small and abs(lower) <= small:
                best = minimise_in_box(Q, c, low, high, a).x - a
                left = -float(g @ best + 0.5 * best @ Q @ best)
                return a, state, left / max(here, 1e-300), iteration
            if lower > LEAST * predicted:
                a, state, r = a + way, there, new
                model = self._model(objective, state, r, a, t)
            if lower > GOOD * predicted:
                damping *= 0.25
            elif lower < POOR * predicted:
                damping *= 4.0
        raise NotConverged(
            (), t, f"the activations still change after {MOST_ITERATIONS} iterations"
        )

    def _model(
        self, objective: Objective, state: State, r: Array, a: Array, t: float
    ) -> tuple[Array, Array]:
        """Quadratic model of the objective at an equilibrium."""
        J = equilibrium_response(self._system, state, Control(a, t), self._work, self._active)
        points = self._system.kinematics.matrix(state.pose) @ J
        return objective.quadratic(np.asarray(self._target.slope(state.q) @ points), r, a)

    def _at(self, a: Array, t: float, state: State) -> State:
        """Equilibrium at a time [s], from another one."""
        h = max(t - state.t, 0.0)
        return self._static.step(self._system, state, Control(a, t), h, self._work)[0]

    def _residual(self, state: State, t: float) -> Array:
        return self._target.wanted(t) - self._target.value(state.q)
