"""Response of steps and equilibria to the activations, with frozen rows of joints and contact."""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, Protocol

import numpy as np

from sim.contact.rows import ContactRows
from sim.contact.step import ContactStep
from sim.dense import least, solve_under_rows
from sim.errors import SceneError
from sim.integrators.contract import require_fixed_contact, require_no_friction
from sim.integrators.linear_rows import LinearRows
from sim.integrators.step_solver import LinearStep
from sim.integrators.workspace import Workspace
from sim.inverse.active_forces import NEAR, ActiveForces, require_affine
from sim.joints.compiled import JOINT_MATRIX, REDUNDANT, CompiledJoints
from sim.state import Array, Control, ControlAt, Line, Pose, State, StepReport
from sim.system import System, stiffness_matrix

Form = Literal["exact", "affine"]
"""Derivative of the step itself, or with the matrix of the step held constant."""

CONTACTS = "the matrix of active contacts"

SOLVED = 1e-10  #: error of the positions of a step that an iterative solution may leave [m]


class LinearlyImplicit(Protocol):
    """An integrator with one linear equation per step."""

    theta: ClassVar[float]
    """Implicit part of the step."""

    def equation(self, system: System, state: State, line: Line, work: Workspace) -> LinearStep:
        """Matrix and right-hand side of a step."""
        ...

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by one step."""
        ...


@dataclass(frozen=True)
class Response:
    """End of a step as a function of the activation, w(a) = w + H (a - activation)."""

    activation: Array  #: (n_muscles,) at which the step is linearised
    w: Array  #: (n,) independent velocities at the end of the step for this activation
    H: Array  #: (n, n_muscles) derivatives of the velocities
    #: start of the step
    pose: Pose
    w0: Array
    #: length of the step [s], and weight of the end velocity in the motion
    h: float
    moves: float
    rows: int  #: number of frozen rows
    force: Array = field(default_factory=lambda: np.zeros(0))  #: (m,) forces of rows of joints
    #: (m, n_muscles) their derivatives, if they were asked for
    force_slope: Array = field(default_factory=lambda: np.zeros((0, 0)))
    #: (n_pairings,) sums of the normal forces of contact [N], and (n_pairings, n_muscles) derivatives
    contact_forces: Array = field(default_factory=lambda: np.zeros(0))
    contact_slope: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def velocity(self, activation: Array) -> Array:
        """End velocities (n,) for an activation."""
        return self.w + self.H @ (activation - self.activation)

    def end(self, system: System, w: Array) -> Pose:
        """Pose at the end of the step with end velocities w."""
        way = self.h * ((1.0 - self.moves) * self.w0 + self.moves * w)
        return system.kinematics.advance(self.pose, way, self.pose.t + self.h)


def step_response(
    system: System,
    integrator: LinearlyImplicit,
    state: State,
    activation: Array,
    h: float,
    work: Workspace,
    forces: ActiveForces,
    form: Form = "exact",
    row_forces: bool = False,
) -> Response:
    """Response of one step from a state to the activation, by one factor and n_muscles solutions.

    With the equation A(a) w = b(a) of a step, A dw/da_i = db/da_i - dA/da_i w. In the form "affine"
    the matrix is held constant, dw/da_i = h A^-1 F_i with the forces F_i of the muscles. Rows of
    joints and of active contacts hold: their forces are eliminated by the Schur complement, and their
    directions and the set of active rows are those of this step. A contact at rest without force closes
    for the muscles that press it. Hard volumes hold by multipliers.

    Parameters
    ----------
    system, integrator, state, h, work
        As of the step.
    activation : (n_muscles,) at the end of the step, at which it is linearised.
    forces : ActiveForces
        Of the system.
    form : "exact" or "affine"
    row_forces : bool
        Also return the derivatives of the forces of rows of joints; they are not unique if rows are
        redundant, and those of the least squares are returned.

    Raises
    ------
    SceneError
        The scene has friction, or its form "affine" does not exist.
    InvertedElement, NotConverged, SingularSystem
        As of the step.
    """
    require_fixed_contact(system, "inverse tracking", "leave one of the two out")
    require_no_friction(system, "inverse tracking")
    if form == "affine":
        require_affine(system, forces)
    whole = system.during(state, h)
    kinematics, control = system.kinematics, Control(activation, state.t + h)
    line = Line(activation, np.zeros_like(activation), state.t, h)
    equation = integrator.equation(whole, state, line, work)
    w0 = kinematics.velocities(state)
    pose = kinematics.at(state.pose, state.t + h)

    def loads(w: Array) -> Array:
        if form == "affine":
            return h * forces.columns(pose, control)
        if forces.damping_varies:
            return _differences(integrator, whole, state, line, equation, w, work, forces)
        theta = integrator.theta
        along = w + (1.0 - theta) / theta * w0
        fastest = float(np.abs(kinematics.displacements(along, pose)).max(initial=0.0))
        if fastest == 0.0:
            return h * forces.columns(pose, control)
        near = NEAR / fastest
        ahead, behind = (
            forces.columns(kinematics.advance(pose, way * along, pose.t), control)
            for way in (near, -near)
        )
        half, slope = 0.5 * (ahead + behind), (ahead - behind) / (2.0 * near)
        return h * half + (theta * h) ** 2 * slope

    if system.rows is not None or system.contact is not None:
        under = LinearRows(whole, state, equation, h, SOLVED, work).solve()
        w, f = under.solution.x, under.reaction
        given = loads(w)
        under_rows = [under.solve_under_rows(load) for load in given]
        H, slope = np.array([x for x, _ in under_rows]).T, np.zeros((0, 0))
        if row_forces and system.rows is not None and f is not None:
            left = np.array([equation.A.times(x) for x in H.T]) - given
            slope = _force_slope(system.rows, pose, f, left[:, system.rows.columns].T / h)
        count = len(under.active) + (0 if f is None else len(f))
        contact_forces, contact_slope = np.zeros(0), np.zeros((0, 0))
        if system.contact is not None:
            pairings, every = under.near.pairing, np.arange(len(system.contact.names))
            contact_forces = system.contact.normal_forces(under.memory)
            rises = np.array([rise for _, rise in under_rows], dtype=np.float64)
            contact_slope = np.asarray((every[:, None] == pairings) @ rises.T / h, dtype=np.float64)
        about = count, np.zeros(0) if f is None else f, slope, contact_forces, contact_slope
        return Response(activation, w, H, state.pose, w0, h, equation.moves, *about)
    if system.constraints is not None:
        saddle, still = work.constraints.saddle, np.zeros(system.constraints.n)
        drift = system.constraints.drift(pose, pose.t)
        saddle.factorise(equation.A.values, system.constraints.evaluate(pose)[1])
        w, _ = saddle.solve(equation.rhs, -drift)
        columns = np.array([saddle.solve(load, still)[0] for load in loads(w)]).T
        return Response(activation, w, columns, state.pose, w0, h, equation.moves, len(still))
    solve = work.steps.many(equation.A)
    w = solve(equation.rhs[None])[0]  # it determines the loads
    return Response(activation, w, solve(loads(w)).T, state.pose, w0, h, equation.moves, 0)


def equilibrium_response(
    system: System, state: State, control: Control, work: Workspace, forces: ActiveForces
) -> Array:
    """Derivatives (n, n_muscles) of the coordinates of an equilibrium, K^-1 F [m].

    Active contacts of the state hold, as in `step_response`. Raises SingularSystem if the stiffness
    cannot be factorised, and SceneError for hard volumes and friction.
    """
    if system.constraints is not None:
        raise SceneError("the response of an equilibrium under hard volumes is not implemented")
    require_fixed_contact(system, "inverse tracking", "leave one of the two out")
    require_no_friction(system, "inverse tracking")
    whole = system.during(state, math.inf)
    pose = state.pose
    here, K = whole.tangent(pose.q, control)
    A = stiffness_matrix(whole, pose, K, here.f)
    F = forces.columns(pose, control)
    if system.contact is None:
        return work.steps.many(A)(F).T
    step = ContactStep(system.contact, state, state.t + 1.0, equilibrium=True)
    near = step.at(pose.q)
    pushing = np.isin(near.contact_vertex, system.contact.pushing(state))
    N = generalised_normals(system, near.take(np.flatnonzero(pushing)), pose)
    X = work.steps.many(A)(np.concatenate([F, N]))
    return under_normals(X[: len(F)], X[len(F) :], N, 0.0).T


def _force_slope(rows: CompiledJoints, pose: Pose, f: Array, left: Array) -> Array:
    """Derivatives (m, n_muscles) of the forces of rows, with G'df = left (k, n_muscles)."""
    out = np.zeros((len(f), left.shape[1]))
    on = ~rows.unilateral | (f > 0.0)
    G = rows.evaluate(pose).G[on]
    out[on] = least(G.T, left, JOINT_MATRIX, REDUNDANT)
    return out


def _differences(
    integrator: LinearlyImplicit,
    system: System,
    state: State,
    line: Line,
    equation: LinearStep,
    w: Array,
    work: Workspace,
    forces: ActiveForces,
) -> Array:
    """Loads (n_muscles, n) by differences of the whole equation, at least one assembly a muscle."""
    start = equation.rhs - equation.A.times(w)
    rows = np.zeros((len(line.mean), len(w)))
    for i in range(len(line.mean)):
        for value, weight in forces.differences(float(line.mean[i])):
            other = line.mean.copy()
            other[i] = value
            changed = integrator.equation(system, state, replace(line, mean=other), work)
            rows[i] += weight * (changed.rhs - changed.A.times(w) - start)
    return rows


def generalised_normals(system: System, rows: ContactRows, pose: Pose) -> Array:
    """Generalised directions (k, n) of contact rows."""
    out = np.zeros((len(rows), system.pattern.n))
    for j in range(len(rows)):
        one = rows.take(np.array([j]))
        f = one.spread(one.normal, len(pose.q))
        out[j] = system.kinematics.generalised_force(f, pose)
    return out


def under_normals(X: Array, Y: Array, N: Array, rate: Array | float) -> Array:
    """Solutions X (k, n) with forces along normals N (m, n), so that N X' = rate; Y = A^-1 N'."""
    return solve_under_rows(X, N, N @ Y.T, lambda f: f @ Y, CONTACTS, wanted=rate, cutoff=1e-12)[0]
