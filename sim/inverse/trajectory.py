"""Trajectory form of inverse tracking: spline activations over a whole trial by Gauss-Newton."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import BSpline
from scipy.sparse import csr_array

from sim.errors import SceneError, SimulationError
from sim.integrators import LinearlyImplicitEuler, Workspace
from sim.integrators.contact_linear import LinearContact
from sim.integrators.contract import require_fixed_contact, require_no_barrier, require_upright
from sim.inverse.quadratic import minimise_in_box
from sim.inverse.response import NEAR, ActiveForces, generalised_normals
from sim.inverse.targets import Target, Together
from sim.pattern import Sparsity
from sim.state import Array, Control, Line, State
from sim.step_matrices import damping_matrix
from sim.system import System
from sim.threads import one_blas_thread

DEGREE = 1
"""Degree of the splines: an activation that is zero is one coefficient at its bound, which has a
positive density; the sum of several positive coefficients would not."""
KEPT = 0.5
"""Ratio of a decrease and its prediction above which the next iteration has the same derivatives."""
HALVINGS = 5
"""Largest number of halvings of a Gauss-Newton step."""
DECAYED = 1e-5
"""Displacement per activation below which a column of the sensitivities is dropped [m]."""


@dataclass(frozen=True)
class Splines:
    """Linear B-splines on 0 to `duration`, with equal distances of about `spacing` [s].

    Coefficients within 0-1 result in activations within 0-1 (convex hull property).
    """

    duration: float
    spacing: float = 0.06

    @cached_property
    def knots(self) -> Array:
        """Knots [s], which extend beyond the ends."""
        parts = max(1, round(self.duration / self.spacing))
        return float(self.duration / parts) * np.arange(-DEGREE, parts + DEGREE + 1.0)

    @property
    def n(self) -> int:
        """Number of splines."""
        return len(self.knots) - DEGREE - 1

    def basis(self, t: Array) -> Array:
        """Values (len(t), n) of the splines at times within the duration."""
        inside = np.clip(t, 0.0, self.duration * (1.0 - 1e-12))
        found = BSpline.design_matrix(inside, self.knots, DEGREE).toarray()
        return np.asarray(found, dtype=np.float64)


def ends_of_steps(n: int, h: float) -> Array:
    """Times (n,) of the ends of steps of length h [s]."""
    return np.asarray(h * np.arange(1, n + 1), dtype=np.float64)


@dataclass(frozen=True)
class LinearTargets:
    """Linear function of the coefficients of the activations, for targets over a trial.

    Attributes
    ----------
    coefficients : (n_splines, n_muscles) of the linearisation.
    residual : (n_steps, m) wanted minus reached targets over their sizes; NaN where not measured.
    J : (n_steps, m, n_splines n_muscles) derivatives of the reached targets over their sizes; empty
        without derivatives.
    """

    coefficients: Array
    residual: Array
    J: Array

    @property
    def misfit(self) -> float:
        """Half of the sum of squared residuals."""
        return 0.5 * float(np.nansum(self.residual**2))

    def normal(self, precision: Array | float = 1.0) -> "Quadratic":
        """Normal equations of the residuals with precisions (m,) of the targets."""
        weight = np.sqrt(np.broadcast_to(precision, self.residual.shape))
        seen = np.isfinite(self.residual)
        r = np.where(seen, self.residual, 0.0) * weight
        J = (self.J * (weight * seen)[:, :, None]).reshape(-1, self.J.shape[2])
        Q = J.T @ J
        return Quadratic(Q, J.T @ r.ravel() + Q @ self.coefficients.ravel())


@dataclass(frozen=True)
class Linearised(LinearTargets):
    """Targets over a trial as a function of the coefficients, with the end of the trial.

    Attributes
    ----------
    final : State
    exact : bool
        False if J is that at the coefficients of an earlier iteration.
    """

    final: State
    exact: bool = True


@dataclass(frozen=True)
class Quadratic:
    """Function x'Qx/2 - c'x of all coefficients; sums of these are objectives."""

    Q: Array
    c: Array

    def __add__(self, other: "Quadratic") -> "Quadratic":
        """Sum of two functions."""
        return Quadratic(self.Q + other.Q, self.c + other.c)

    def value(self, x: Array) -> float:
        """Value at coefficients of any shape."""
        flat = x.ravel()
        return float(0.5 * flat @ self.Q @ flat - self.c @ flat)


def prior(
    splines: Splines,
    t: Array,
    size: float,
    mean: float,
    change: float,
    measured: Array,
    precision: Array,
    mixing: Array | None = None,
) -> Quadratic:
    """Negative logarithm of a density of the activations before the motion is known.

    The density is proportional to exp(-a/mean - (a/size)^2/2) for every spline, so that few muscles
    are active, times a random walk of changes and a normal density about the sEMG.

    Parameters
    ----------
    splines : Splines
    t : (n_steps,) [s].
    size, mean : float
        Constants of the density [1].
    change : float
        Standard deviation of the change of an activation over 1 s, of a random walk [1].
    measured : (n_steps, n_signals) activation from sEMG.
    precision : (n_signals,) inverse variance of its error over the number of steps within which the
        error is correlated; 0 for a signal that is not measured.
    mixing : (n_signals, n_muscles), optional
        Share of the activation of every muscle in every signal (cross-talk), by default the identity.
    """
    B = splines.basis(t)
    rise = np.diff(np.eye(splines.n), axis=0)
    step = splines.knots[1] - splines.knots[0]
    one = np.eye(splines.n) / size**2 + rise.T @ rise / (change**2 * step)
    X = np.eye(len(precision)) if mixing is None else mixing
    of_size = np.asarray(np.kron(one, np.eye(X.shape[1])), dtype=np.float64)
    Q = of_size + np.asarray(np.kron(B.T @ B, X.T @ (precision[:, None] * X)), dtype=np.float64)
    return Quadratic(Q, (B.T @ (measured * precision) @ X).ravel() - 1.0 / mean)


@one_blas_thread
def linearise(
    system: System,
    targets: Sequence[Target],
    splines: Splines,
    coefficients: Array,
    *,
    h: float = 0.01,
    initial: State | None = None,
    work: Workspace | None = None,
    derivatives: bool = True,
    decayed: float = DECAYED,
) -> Linearised:
    """Simulate a trial by linearly implicit Euler, with derivatives by all coefficients.

    With A w1 = M w0 + h f(q0, a), A = M + h D + h^2 K(q0, a), q1 = q0 + h w1, the derivatives satisfy

        A dw1 = M dw0 - h (K + h dK[w1]) dq0 + (h F - h^2 dK/da w1) da,     dq1 = dq0 + h dw1,

    where dK[w1] is the derivative of K along w1 and F are the forces of the muscles: the derivative of
    K along dq0, times w1, equals that along w1, times dq0, because K is the second derivative of an
    energy. One factor serves the step and all its derivatives, which are exact if the damping matrix is
    constant. Rows of active contacts stay closed, N (dq0 + h dw1) = 0, with the directions of the step;
    a row that opens or closes is a kink of the motion. Steps leave gaps up to the tolerance of the
    contact, which also vary: with 1 um the derivatives of a block differ by 0.7 % of the largest from
    those of its steps, with 1e-5 um by 2e-8. Normals are constant within a step. Columns that have
    decayed to `decayed` [m] are dropped.

    Raises
    ------
    SceneError
        Steps have joints, a barrier, constraints, memory, matrix-free products, rotating coordinates, or
        a damping matrix that depends on the activation.
    InvertedElement, SingularSystem
        A step failed.
    """
    target, work = Together(tuple(targets)), work or Workspace(system)
    state = initial or system.rest_state()
    forces = ActiveForces(system)
    _require_smooth(system, forces, state, h)
    n, kinematics = len(system.muscles), system.kinematics
    times = ends_of_steps(round(splines.duration / h), h)
    basis = splines.basis(times)
    total, R = splines.n * n, kinematics.matrix(state.pose)
    full = _Full(system.pattern)
    mass = np.zeros(len(system.pattern.indices))
    kinematics.add_mass(mass, state.pose)
    M = full.matrix(mass).copy()  # the pattern is shared
    M.eliminate_zeros()
    integrator = LinearlyImplicitEuler()
    x = np.zeros((2, 0, system.pattern.n))  # dq and dw of the columns alive
    alive, begun = np.zeros(0, dtype=np.int64), 0
    rows: list[Array] = []
    columns: list[Array] = []
    for k, t1 in enumerate(times):
        a = np.clip(basis[k] @ coefficients, 0.0, 1.0)
        line = Line(a, np.zeros(n), state.t, h)
        equation = integrator.equation(system, state, line, work)
        touched, normals = None, np.zeros((0, x.shape[2]))
        memory: Mapping[str, Array] = {}
        if system.contact is not None:
            touched = LinearContact(system, state, equation, h, work).solve()
            normals = generalised_normals(system, touched.active, state.pose)
        solve = work.steps.many(equation.A) if touched is None or derivatives else np.asarray
        w = solve(equation.rhs[None])[0] if touched is None else touched.w
        if derivatives:
            while begun < splines.n and splines.knots[begun] < t1:
                alive = np.append(alive, begun * n + np.arange(n))
                x = np.concatenate([x, np.zeros((2, n, x.shape[2]))], axis=1)
                begun += 1
            control = Control(a, state.t + h)
            load = _loads(system, forces, state, w, control, h)
            K = full.matrix(_later_stiffness(system, state, w, control, h))
            rhs = (M @ x[1].T - h * (K @ x[0].T)).T
            rhs += basis[k][alive // n, None] * load[alive % n]
            x[1] = _held(solve, rhs, normals, -(normals @ x[0].T) / h)
            x[0] += h * x[1]
        if touched is None:
            pose = kinematics.advance(state.pose, h * w, state.t + h)
        else:
            pose, memory = touched.pose, touched.memory
        least, element = system.smallest_J(pose.q)
        require_upright(element, least, state.t + h)
        state = kinematics.state(pose, w, memory)
        rows.append(target.wanted(state.t) - target.value(state.q))
        if derivatives:
            out = np.zeros((len(rows[-1]), total))
            out[:, alive] = (target.slope(state.q) @ R) @ x[0].T
            columns.append(out)
            over = splines.knots[alive // n + DEGREE + 1] <= t1
            gone = over & (np.abs(x[0]).max(axis=1, initial=0.0) < decayed)
            if gone.any():
                alive, x = alive[~gone], x[:, ~gone]
    J = np.array(columns) if derivatives else np.zeros((len(rows), len(rows[0]), 0))
    return Linearised(coefficients, np.array(rows), J, state)


def _held(solve: Callable[[Array], Array], rhs: Array, N: Array, rate: Array) -> Array:
    """Solutions X (k, n) of A X' = rhs' + N' f for forces f with which N X' = rate (m, k)."""
    if not len(N):
        return solve(rhs)
    both = solve(np.concatenate([rhs, N]))
    X, Y = both[: len(rhs)], both[len(rhs) :]
    f = np.linalg.lstsq(N @ Y.T, rate - N @ X.T, rcond=1e-12)[0]
    return np.asarray(X + f.T @ Y, dtype=np.float64)


def _require_smooth(system: System, forces: ActiveForces, state: State, h: float) -> None:
    require_no_barrier(system, "inverse tracking")
    require_fixed_contact(system, "inverse tracking", "leave one of the two out")
    parts = {
        "stops": bool(system.stops),
        "joints": system.rows is not None,
        "constraints": system.constraints is not None,
        "history-dependent tissue": system.during(state, h) is not system,
        "nodal pressure": system.has_products,
        "bodies": system.kinematics.matrix_varies,
        "damping that varies": forces.damping_varies or _damping_moves(system, state),
    }
    found = [name for name, there in parts.items() if there]
    if found:
        raise SceneError(
            f"derivatives over a trajectory do not exist for {' and '.join(found)}: leave these out, or "
            "track step by step"
        )


def _damping_moves(system: System, state: State) -> bool:
    """True if the damping matrix depends on the positions."""
    silent = Control(np.zeros(len(system.muscles)))
    moved = np.random.default_rng(0).standard_normal(system.pattern.n)
    other = system.kinematics.advance(state.pose, NEAR * moved, state.t)
    D = [damping_matrix(system, pose, state.v, silent) for pose in (state.pose, other)]
    return system.is_damped and not np.array_equal(D[0].values, D[1].values)


class _Full:
    """Both triangles of matrices on a pattern that stores the upper one."""

    def __init__(self, pattern: Sparsity) -> None:
        n = pattern.n
        row = np.repeat(np.arange(n), np.diff(pattern.indptr))
        col = np.asarray(pattern.indices, dtype=np.int64)
        off = np.flatnonzero(row != col)
        place = np.concatenate([np.arange(len(col)), off])
        r, c = np.concatenate([row, col[off]]), np.concatenate([col, row[off]])
        order = np.lexsort((c, r))
        self._place, self._indices, self._n = place[order], c[order].astype(np.int32), n
        self._indptr = np.searchsorted(r[order], np.arange(n + 1)).astype(np.int32)

    def matrix(self, values: Array) -> csr_array:
        shape = (self._n, self._n)
        return csr_array((values[self._place], self._indices, self._indptr), shape=shape)


def _near(system: System, state: State, w: Array) -> float:
    """Time in which the fastest point moves by `NEAR` [s]."""
    moved = np.abs(system.kinematics.displacements(w, state.pose)).max(initial=0.0)
    return NEAR / max(float(moved), 1e-9)


def _loads(
    system: System, forces: ActiveForces, state: State, w: Array, control: Control, h: float
) -> Array:
    """Derivatives (n_muscles, n) of the step's equation by the activation, h F - h^2 dK/da w."""
    near = _near(system, state, w)
    ahead, behind = (
        forces.columns(system.kinematics.advance(state.pose, s * w, state.t), control)
        for s in (near, -near)
    )
    return 0.5 * h * (ahead + behind) + h**2 / (2.0 * near) * (ahead - behind)


def _later_stiffness(system: System, state: State, w: Array, control: Control, h: float) -> Array:
    """Values of K + h dK[w] at the start of a step."""
    kinematics, near = system.kinematics, _near(system, state, w)
    values: list[Array] = []
    for s in (near, -near):
        pose = kinematics.advance(state.pose, s * w, state.t)
        here, K = system.tangent(pose.q, control)
        values.append(kinematics.generalised_matrix(K, here.f, pose).copy())
    ahead, behind = values
    return np.asarray(0.5 * (ahead + behind) + h / (2.0 * near) * (ahead - behind))


@dataclass(frozen=True)
class Fit:
    """Most probable activations of a trial.

    Attributes
    ----------
    linearised : Linearised
        At the coefficients found.
    objective : list of float
        Before and after every iteration.
    """

    linearised: Linearised
    objective: list[float]


def fit(
    system: System,
    targets: Sequence[Target],
    splines: Splines,
    start: Array | Linearised,
    before: Quadratic,
    *,
    precision: Array | float = 1.0,
    h: float = 0.01,
    initial: State | None = None,
    work: Workspace | None = None,
    iterations: int = 3,
    enough: float = 1e-3,
    after: Callable[[Linearised, int], None] | None = None,
) -> Fit:
    """Minimise half of the squared residuals plus a prior over the coefficients, within 0-1.

    Gauss-Newton: every iteration solves the linearised problem within the box and halves its change
    until the objective decreases. The derivatives of an iteration serve the next one as well if the
    decrease is at least `KEPT` times the predicted one. It ends with a relative decrease below `enough`
    in an iteration with its own derivatives.

    Parameters
    ----------
    start : (n_splines, n_muscles), or a linearisation
        Zero is a good start: the activations of single steps may be far from those over the trial.
    before : Quadratic
        The prior.
    precision : float or (m,)
        Inverse variances of the targets over their sizes.
    after : callable, optional
        Called as ``after(linearised, iterations done)`` after every iteration that computed its
        derivatives; all are done if the fit has converged.

    Raises
    ------
    SceneError, InvertedElement, SingularSystem
        As `linearise`, at the start.
    """
    work = work or Workspace(system)

    def at(c: Array, derivatives: bool = True) -> Linearised:
        return linearise(
            system, targets, splines, c, h=h, initial=initial, work=work, derivatives=derivatives
        )

    def value(one: Linearised) -> float:
        squares = np.where(np.isfinite(one.residual), one.residual, 0.0) ** 2 * precision
        return 0.5 * float(squares.sum()) + before.value(one.coefficients)

    here = start if isinstance(start, Linearised) else at(start)
    reached = [value(here)]
    for k in range(iterations):
        problem = here.normal(precision) + before
        flat = here.coefficients.ravel()
        wanted = minimise_in_box(problem.Q, problem.c, 0.0 * flat, 0.0 * flat + 1.0, flat).x
        predicted = problem.value(flat) - problem.value(wanted)
        share, found = 1.0, None
        for _ in range(HALVINGS):
            c = here.coefficients + share * (wanted - flat).reshape(here.coefficients.shape)
            try:
                found = at(c, derivatives=False)
            except SimulationError:
                found = None
            if found is not None and value(found) < reached[-1]:
                break
            share, found = 0.5 * share, None
        if found is None and here.exact:
            break
        if found is None:
            here = at(here.coefficients)
            continue
        reached.append(value(found))
        decrease = reached[-2] - reached[-1]
        little = decrease < enough * abs(reached[-2])
        converged = little and here.exact
        keep = converged or (not little and decrease > KEPT * predicted)
        here = replace(found, J=here.J, exact=False) if keep else at(found.coefficients)
        if after is not None and (converged or here.exact):
            after(here, iterations if converged else k + 1)
        if converged:
            break
    return Fit(here, reached)
