"""Estimated errors of a step: of its solution, of the missed activation, and of lost swing."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from sim.dense import dot
from sim.linear.contract import Matrix
from sim.state import Array, Control, ControlAt, Line, Pose, State, Swing
from sim.system import System

NEGLIGIBLE: Final = 3e-4
"""First moment of an activation, relative to full activation over a step, that needs no estimate.

With a step of a fifth of the time constant of the damping it moves tissue by 1e-5 of its displacement
under full activation.
"""

UNRESOLVED: Final = 2.0
"""Factor on the passing error, whose limits are those of modes much slower and faster than a step.

The response of modes between them within a step is not resolved (``python -m benchmarks error_coverage
--hard`` measures the coverage).
"""


def relaxed(
    system: System,
    position: Array,
    momentum: Array,
    D: Matrix,
    s: float,
    solve: Callable[[Array], Array],
    pose: Pose,
) -> Array:
    """Estimate (e_q, e_v) filtered by one implicit stage, which removes stiff components.

    An estimate from the velocity v0 at the start of the step is valid while v0 follows the load.
    After a jump of the load, tissue assumes its new velocity within a fraction of a millisecond,
    and the estimate decreases only in proportion to the step; it would require steps as short as
    that fraction, although an L-stable method is exact there. One solution with the matrix A of the
    stage,

        A e = M e_q + s D e_q + s M e_v,    A = M + s D + s^2 K,

    is (1 - s J)^-1 (e_q, e_v) with J the Jacobian of the motion: it replaces v0 by the velocity
    that corresponds to the forces at the start, and does not change the slow part of the error.

    The arguments are e_q as `position` (n,) [m], M e_v as `momentum` (n,) [N s], the implicit part s of
    the step [s] and an exact or approximate solution with A; the result is of the points (n_points, 3)
    [m].

    The filter is that of Hosea and Shampine 1996, Analysis and implementation of TR-BDF2, Appl. Numer.
    Math. 20, section 4, for second-order equations.
    """
    e, kinematics = position, system.kinematics
    relaxed = solve(kinematics.apply_mass(e, pose) + s * D.times(e) + s * momentum)
    return kinematics.displacements(relaxed, pose)


def of_input(
    system: System,
    control: ControlAt,
    line: Line,
    s: float,
    solve: Callable[[Array], Array],
    pose: Pose,
) -> Array | None:
    """Errors (2, n_points, 3) [m] at the end of a step by the activation that its line misses.

    The line has the mean of the activation a over the step, but not its first moment where it had to
    be limited to 0-1 (a switch, a spike). With the force F of unit activation and mu = int (1 - c)(a -
    line) dc, the impulse h F acts too early or too late by h mu. Tissue with the damping D = tau K is
    displaced by such an impulse by h F/D, which decays with tau, so that its error at the end of the
    step is (h/tau) h F mu/D and decays likewise (lasting). Before the velocity has decayed, the error
    is that of a mass, h^2 F mu/M (passing); while both are about as fast as the step, what the
    line misses within the step displaces the mass, too, by about h^2 F nu/M or h F nu/D, with nu = int
    |P| dc, P'' = a - line. The inertial share of a displacement y is z with the matrix A of a stage:

        A y = s h F mu,                             lasting h/(tau + s) y
        A y' = s h F (|mu| + |nu|),  A z = M y',    passing 2 (y' + (h/s) z)

    The result has both, the lasting one first. Arguments as of `relaxed`. None if nothing is missed
    (`NEGLIGIBLE`).
    """
    first, second = control.misfit(line)
    if not np.abs(np.concatenate([first, second])).max(initial=0.0) > NEGLIGIBLE:
        return None
    kinematics = system.kinematics

    def displacement(missed: Array) -> Array:
        # active forces are linear in the activation, and two positive activations are within 0-1
        early, late = (Control(np.maximum(sign * missed, 0.0), pose.t) for sign in (1.0, -1.0))
        F = system.force(pose.q, early).f - system.force(pose.q, late).f
        return solve(s * line.h * kinematics.generalised_force(F, pose))

    y = displacement(first)
    further = np.where(first < 0.0, -second, second)
    both = y + displacement(further)
    z = solve(kinematics.apply_mass(both, pose))
    tau = 0.0 if system.damping_law is None else system.damping_law.beta
    parts = (line.h / (tau + s) * y, UNRESOLVED * (both + line.h / s * z))
    return np.array([kinematics.displacements(part, pose) for part in parts])


OF_KINETIC: Final = 0.02
OF_DAMPED: Final = 0.1
"""Loss of energy in a step, of all kinds, relative to its kinetic and damped energy, that is examined.

If no step exceeds the second, neither does their sum reach the share that is warned of.
"""


@dataclass(frozen=True)
class TurnedStep:
    """A step that may have turned tissue: h [s], share `theta` of the new velocity, and its ends."""

    state: State
    end: Pose
    w1: Array  #: velocities at the end
    theta: float
    line: Line
    damping: Callable[[Array], Array]  #: force (n,) for velocities
    solve: Callable[[Array], Array]  #: with the matrix of the step, under the rows and constraints
    reaction: Array | None  #: (m,) forces of the rows of joints [N], [N m]


def swing_of(system: System, step: TurnedStep, f0: Array, f1: Array, pushed: Array) -> Swing:
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


def _of_joints(system: System, step: TurnedStep) -> Array:
    """Generalised forces (n,) of the rows of joints, those of the solution."""
    force = np.zeros_like(step.w1)
    if system.rows is not None and step.reaction is not None:
        at = system.rows.evaluate(system.kinematics.at(step.state.pose, step.end.t))
        force[system.rows.columns] = at.G.T @ step.reaction
    return force
