"""Simulation of a trial with the derivatives of its targets by all coefficients of the activations."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.sparse import csr_array

from sim.errors import SceneError
from sim.integrators import LinearlyImplicitEuler, Workspace
from sim.integrators.contract import (
    require_fixed_contact,
    require_no_barrier,
    require_no_friction,
    require_upright,
)
from sim.integrators.linear_rows import LinearRows
from sim.inverse.active_forces import NEAR, ActiveForces
from sim.inverse.linear_targets import Linearised
from sim.inverse.response import SOLVED, generalised_normals
from sim.inverse.splines import DEGREE, Splines, ends_of_steps
from sim.inverse.targets import Target, Together
from sim.pattern import Sparsity
from sim.state import Array, Control, Line, State
from sim.step_matrices import damping_matrix
from sim.system import System
from sim.threads import one_blas_thread

DECAYED = 1e-5
"""Displacement per activation below which a column of the sensitivities is dropped [m]."""


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
    a row that opens or closes is a kink of the motion. Normals are constant within a step. Columns that
    have decayed to `decayed` [m] are dropped.

    Raises
    ------
    SceneError
        Steps have joints, a barrier, friction, constraints, memory, matrix-free products, rotating
        coordinates, or a damping matrix that depends on the activation.
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
            touched = LinearRows(system, state, equation, h, SOLVED, work).solve()
            normals = generalised_normals(system, touched.active, state.pose)
        solve = work.steps.many(equation.A) if touched is None or derivatives else np.asarray
        w = solve(equation.rhs[None])[0] if touched is None else touched.solution.x
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
    require_no_friction(system, "inverse tracking")
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
