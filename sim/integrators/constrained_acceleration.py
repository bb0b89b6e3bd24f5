"""Accelerations under the rows of joints by their Schur complement, and the forces of rows."""

import numpy as np

from sim.dense import solved
from sim.joints.compiled import JOINT_MATRIX, CompiledJoints
from sim.joints.contract import REACTIONS
from sim.pattern import Flags
from sim.state import Array, Control, State
from sim.system import System, damping_matrix

TIME_DIFFERENCE = (
    1e-5  #: time between the poses of the finite difference of the directions of rows [s]
)


def free_acceleration(system: System, state: State, control: Control) -> Array:
    """Accelerations (n,) without rows, M^-1 (R'f - D w - b) with the inertial forces b."""
    kinematics = system.kinematics
    f = kinematics.generalised_force(system.force(state.q, control).f, state.pose)
    if system.is_damped:
        D = damping_matrix(system, state.pose, state.v, control)
        f = f - D.force(kinematics.velocities(state))
    return kinematics.solve_mass(f - kinematics.inertial_force(state), state.pose)


def constrained_acceleration(
    system: System, rows: CompiledJoints, a: Array, state: State, pressing: Flags | None = None
) -> tuple[Array, Array]:
    """Accelerations (n,) under rigid rows, G dw/dt + dG/dt w + ddrift/dt = 0, and their forces (m,).

    `pressing` (m,) are further rows that stay closed.
    """
    kinematics, pose, columns = system.kinematics, state.pose, rows.columns
    w = kinematics.velocities(state)

    def rate(after: float) -> Array:
        now = rows.evaluate(kinematics.advance(pose, after * w, pose.t + after))
        return now.G @ w[columns] + now.drift

    on = rows.rigid if pressing is None else rows.rigid | pressing
    G, X = rows.evaluate(pose).G, rows.inverse_mass(pose)
    turning = (rate(TIME_DIFFERENCE) - rate(-TIME_DIFFERENCE)) / (2.0 * TIME_DIFFERENCE)
    f, active = np.zeros(len(G)), G[on]
    f[on] = solved(
        active @ X[columns] @ active.T, -(active @ a[columns] + turning[on]), JOINT_MATRIX
    )
    return a + X @ (G.T @ f), f


def forces_at(system: System, state: State, control: Control) -> Array:
    """Forces (m,) of rows at a state: yielding ones by their law, rigid ones by the acceleration.

    Inequalities that pressed in the step before are held as rigid rows, unless this would pull: their
    forces in that step may be those of an impact, which are over.
    """
    rows = system.rows
    assert rows is not None  # callers ask for it by them
    now, w = rows.evaluate(state.pose), system.kinematics.velocities(state)
    f, soft = np.zeros(len(now.c)), rows.compliance > 0.0
    pressed = np.zeros(len(f), dtype=bool)
    if REACTIONS in state.memory:
        pressed = rows.unilateral & (state.memory[REACTIONS] > 0.0)
    rate = now.G @ w[rows.columns] + now.drift
    f[soft] = -((now.c + rows.damping_time * rate)[soft] / rows.compliance[soft])
    a, push = free_acceleration(system, state, control), np.zeros(len(w))
    push[rows.columns] = now.G.T @ f
    a = a + system.kinematics.solve_mass(push, state.pose)
    while (rows.rigid | pressed).any():
        pressing = constrained_acceleration(system, rows, a, state, pressed)[1]
        pulling = pressed & (pressing < 0.0)
        if not pulling.any():
            return np.where(rows.rigid | pressed, pressing, f)
        pressed &= ~pulling
    return f


def forces_of_rows(system: System, state: State, control: Control) -> Array:
    """Forces (m,) of rows: those of the step that led to a state, otherwise of the motion at it.

    Without such a step they are NaN if a row is compliant or an inequality.
    """
    rows = system.rows
    assert rows is not None  # callers check that the scene has joints
    if REACTIONS in state.memory:
        return state.memory[REACTIONS]
    if not rows.rigid.all():
        return np.full(len(rows.names), np.nan)
    return constrained_acceleration(system, rows, free_acceleration(system, state, control), state)[
        1
    ]
