"""Detection of a loss of stability by concave energy along the motion."""

from collections.abc import Callable

import numpy as np

from sim.dense import dot, norm
from sim.integrators.bodies_alone import BodiesAlone
from sim.kinematics import Kinematics
from sim.pattern import Flags
from sim.state import Array, Control, Pose, State
from sim.system import System

STILL_MOTION = 1e-7  #: displacement below which the test is not applied [m]
ROUNDING = 1e-6  #: relative rounding error of the product of displacement and change of force


def concave(
    kinematics: Kinematics,
    before: Pose,
    f0: Callable[[], Array],
    after: Pose,
    f1: Callable[[], Array],
) -> bool:
    """Test if d . (f0 - f1) < 0 with the displacement d between two poses.

    `f0` and `f1`, which are not called for very small displacements, return the forces (n_points, 3)
    of all terms at the poses under one control [N].
    """
    d = kinematics.between(before, after)
    if not np.abs(d).max(initial=0.0) > STILL_MOTION:
        return False
    change = kinematics.generalised_force(f0(), before)
    change = change - kinematics.generalised_force(f1(), after)
    return dot(d, change) < -ROUNDING * norm(d) * norm(change)


def snapped(
    system: System, before: State, after: State, control: Control, bodies: BodiesAlone | None = None
) -> bool:
    """Test if the energy for one control is concave between two states.

    d . (f(q0) - f(q1)) < 0 with d = q1 - q0 and the forces f of all terms: the mean stiffness along
    d is negative. Small differences then increase, as in the buckling of a column, and rounding
    determines the further motion. The matrix of a time step may still be positive definite because
    of inertia and damping. The test succeeds once the unstable motion dominates the displacement.

    Both forces are for one control; `bodies` evaluates those of a scene of rigid bodies in less time.
    """
    if bodies is not None:
        frames, activation = np.stack([before.frames, after.frames]), control.activation[None]
        return bool(snapped_bodies(bodies, frames, activation)[0])

    def force(state: State) -> Callable[[], Array]:
        return lambda: system.force(state.q, control).f

    poses = before.pose, force(before), after.pose, force(after)
    return concave(system.kinematics, *poses)


def snapped_bodies(bodies: BodiesAlone, frames: Array, activation: Array) -> Flags:
    """Test (n,) of every motion between successive frames (n + 1, ...) of bodies, as `snapped`.

    The forces at both ends of a motion are those under its activation, one of (n, n_muscles).
    """
    d, change = bodies.changes(frames, activation)
    size = np.linalg.norm(d, axis=1) * np.linalg.norm(change, axis=1)
    concave = (d * change).sum(axis=1) < -ROUNDING * size
    return concave & (np.abs(d).max(axis=1) > STILL_MOTION)
