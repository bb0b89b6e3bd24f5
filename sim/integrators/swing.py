"""Energy that a step with one linear solution takes from tissue that turns."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.state import Array, Line, Pose, State, Swing
from sim.system import System
from sim.vectors import dot

OF_KINETIC: Final = 0.02
OF_DAMPED: Final = 0.1
"""Loss of energy in a step, of all kinds, relative to its kinetic and damped energy, that is examined.

If no step exceeds the second, neither does their sum reach the share that is warned of.
"""


@dataclass(frozen=True)
class Turned:
    """A step that may have turned tissue: h [s], share `theta` of the new velocity, and its ends."""

    state: State
    end: Pose
    w1: Array  #: velocities at the end
    theta: float
    line: Line
    damping: Callable[[Array], Array]  #: force (n,) for velocities
    solve: Callable[[Array], Array]  #: with the matrix of the step, under the rows and constraints
    reaction: Array | None  #: (m,) forces of the rows of joints [N], [N m]


def swing_of(system: System, step: Turned, f0: Array, f1: Array, pushed: Array) -> Swing:
    """Energies of a step with forces f0 and f1 (n_points, 3) [N] at its ends, `pushed` of contact.

    A rotation by an angle within a step stretches tissue by half its square, because displacements
    are linear in the velocities. In the next step the stress of this stretch acts in directions at the
    start of the step, and so resists the rotation like a string; the residual forces at the end of the
    step do not show it, since the tissue has turned by then. One more iteration with the same matrix
    releases the stretch; the forces there leave the momentum u that the step has lost, and w'u is the
    energy that a second iteration would give back. It is computed only for a step that lost more than
    `OF_KINETIC` and `OF_DAMPED` of both energies.

    Bodies have their momentum at both ends. Forces of joints are those of the solution; rigid ones and
    those of constant volumes do no work on velocities that satisfy them, and the iteration satisfies
    them, too. A limit that is hit takes momentum, but no energy of the velocities after it.
    """
    h, theta, kinematics = step.line.h, step.theta, system.kinematics
    w0, w1 = kinematics.velocities(step.state), step.w1
    start = step.state.pose
    if kinematics.matrix_varies:
        u = kinematics.inertial(w1, step.end) - kinematics.inertial(w0, start)
        momentum = kinematics.momentum(u, step.end)
    else:
        momentum = kinematics.apply_mass(w1 - w0, step.end)
    kinetic = 0.5 * dot(w1, kinematics.apply_mass(w1, step.end))
    before = 0.5 * dot(w0, kinematics.apply_mass(w0, start))
    mean = (1.0 - theta) * w0 + theta * w1
    damped = h * dot(mean, step.damping(mean))
    joints = _of_joints(system, step)
    F0, F1 = (
        kinematics.generalised_force(f + pushed, pose) + joints
        for f, pose in ((f0, start), (f1, step.end))
    )
    work = 0.5 * h * dot(mean, F0 + F1)
    lost = before + work - damped - kinetic
    if not lost > OF_KINETIC * kinetic + OF_DAMPED * max(damped, 0.0):
        return Swing(kinetic, damped)

    def missing(F: Array, change: Array) -> Array:
        ends = (1.0 - theta) * (F0 - step.damping(w0)) + theta * (F - step.damping(w1 + change))
        return h * ends - momentum - kinematics.apply_mass(change, step.end)

    change = step.solve(missing(F1, np.zeros_like(w1)))
    released = kinematics.advance(step.end, theta * h * change, step.end.t)
    f2 = system.force(released.q, step.line.at(1.0)).f + pushed
    F2 = kinematics.generalised_force(f2, released) + joints
    u = missing(F2, change)
    given_back = min(max(dot(w1, u), 0.0), lost)
    if given_back == 0.0:
        return Swing(kinetic, damped)
    node = int(np.linalg.norm(kinematics.displacements(u, step.end), axis=1).argmax())
    return Swing(kinetic, damped, given_back, node)


def _of_joints(system: System, step: Turned) -> Array:
    """Generalised forces (n,) of the rows of joints, those of the solution."""
    force = np.zeros_like(step.w1)
    if system.rows is not None and step.reaction is not None:
        at = system.rows.evaluate(system.kinematics.at(step.state.pose, step.end.t))
        force[system.rows.columns] = at.G.T @ step.reaction
    return force
