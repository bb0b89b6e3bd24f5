"""Simulation of a trial with the derivatives of its targets by all coefficients of the activations."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from sim.errors import SceneError
from sim.integrators import LinearlyImplicitEuler, Workspace
from sim.integrators.contract import (
    require_fixed_contact,
    require_no_friction,
)
from sim.integrators.linear_rows import LinearRows
from sim.inverse.active_forces import NEAR, ActiveForces
from sim.inverse.linear_targets import Linearised
from sim.inverse.response import SOLVED, generalised_normals, under_normals
from sim.inverse.splines import DEGREE, Splines, ends_of_steps
from sim.inverse.targets import Target, Together
from sim.pattern import Sparsity
from sim.state import Array, Control, Line, State, require_upright
from sim.system import System, damping_matrix
from sim.threads import one_blas_thread

DECAYED = 3e-5
"""Displacement per activation below which a part of the sensitivities is dropped [m]."""


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
    a row that opens or closes is a kink of the motion. Normals are constant within a step. Columns of
    splines that are over, which no longer have own loads, are combinations of few (`_Past`), without
    parts below `decayed` [m].

    Raises
    ------
    SceneError
        Steps have joints, friction, constraints, memory, matrix-free products, rotating
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
    alive, begun, past = np.zeros(0, dtype=np.int64), 0, _Past.none(system.pattern.n)
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
        solve = (
            work.steps.many(equation.A, derivatives)
            if touched is None or derivatives
            else np.asarray
        )
        w = solve(equation.rhs[None])[0] if touched is None else touched.solution.x
        if derivatives:
            while begun < splines.n and splines.knots[begun] < t1:
                alive = np.append(alive, begun * n + np.arange(n))
                x = np.concatenate([x, np.zeros((2, n, x.shape[2]))], axis=1)
                begun += 1
            control = Control(a, state.t + h)
            load = _loads(system, forces, state, w, control, h)
            K = full.matrix(_later_stiffness(system, state, w, control, h))
            both = np.concatenate([x, past.x], axis=1)
            rhs = (M @ both[1].T - h * (K @ both[0].T)).T
            rhs[: len(alive)] += basis[k][alive // n, None] * load[alive % n]
            X, Y = np.split(solve(np.concatenate([rhs, normals])), [len(rhs)])
            rate = -(both[0] @ normals.T) / h
            both[1] = under_normals(X, Y, normals, rate)
            both[0] += h * both[1]
            x, past = both[:, : len(alive)], replace(past, x=both[:, len(alive) :])
        if touched is None:
            pose = kinematics.advance(state.pose, h * w, state.t + h)
        else:
            pose, memory = touched.pose, touched.memory
        least, element = system.smallest_J(pose.q)
        require_upright(element, least, state.t + h)
        state = kinematics.state(pose, w, memory)
        rows.append(target.wanted(state.t) - target.value(state.q))
        if derivatives:
            seen, out = target.slope(state.q) @ R, np.zeros((len(rows[-1]), total))
            out[:, alive] = seen @ x[0].T
            out[:, past.columns] = (seen @ past.x[0].T) @ past.shares
            columns.append(out)
            over = splines.knots[alive // n + DEGREE + 1] <= t1
            if over.any():
                past = past.joined(
                    x[:, over], alive[over], float(splines.knots[1] - splines.knots[0]), decayed
                )
                alive, x = alive[~over], x[:, ~over]
    J = np.array(columns) if derivatives else np.zeros((len(rows), len(rows[0]), 0))
    return Linearised(coefficients, np.array(rows), J, state)


@dataclass(frozen=True)
class _Past:
    """Sensitivities to the coefficients of splines that are over, as combinations of few.

    Their equations are linear without own loads, so that the combinations stay the same.
    """

    x: Array  #: (2, r, n) derivatives of q and w
    shares: Array  #: (r, n_columns)
    columns: NDArray[np.int64]  #: (n_columns,) coefficients

    @classmethod
    def none(cls, n: int) -> "_Past":
        return cls(np.zeros((2, 0, n)), np.zeros((0, 0)), np.zeros(0, dtype=np.int64))

    def joined(self, x: Array, columns: NDArray[np.int64], unit: float, decayed: float) -> "_Past":
        """With further columns, by a singular value decomposition without values below `decayed` [m].

        Velocities count with the time `unit` [s].
        """
        both = np.concatenate([self.x, x], axis=1)
        shares = np.zeros((both.shape[1], self.shares.shape[1] + x.shape[1]))
        shares[: len(self.shares), : self.shares.shape[1]] = self.shares
        shares[len(self.shares) :, self.shares.shape[1] :] = np.eye(x.shape[1])
        size, ways = np.linalg.eigh(both[0] @ both[0].T + unit**2 * (both[1] @ both[1].T))
        ways = ways[:, size > max(decayed**2, 1e-14 * float(size.max(initial=0.0)))]
        return _Past(
            np.einsum("ij,kil->kjl", ways, both, optimize=True), ways.T @ shares,
            np.concatenate([self.columns, columns]),
        )  # fmt: skip


def _require_smooth(system: System, forces: ActiveForces, state: State, h: float) -> None:
    require_fixed_contact(system, "inverse tracking", "leave one of the two out")
    require_no_friction(system, "inverse tracking")
    parts = {
        "joints": system.rows is not None,
        "constraints": system.constraints is not None,
        "history-dependent tissue": system.during(state, h) is not system,
        "nodal pressure": system.has_products,
        "bodies": system.kinematics.matrix_varies,
        "damping that varies": forces.damping_varies or _damping_moves(system, state),
    }
    unsupported = [name for name, there in parts.items() if there]
    if unsupported:
        raise SceneError(
            f"derivatives over a trajectory do not exist for {' and '.join(unsupported)}: leave these "
            "out, or track step by step"
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
