"""Detection of a loss of stability by concave energy along the motion."""

import numpy as np

from sim.integrators.bodies_alone import BodiesAlone
from sim.state import Control, State
from sim.system import System
from sim.vectors import dot, norm

STILL = 1e-7  #: displacement below which the test is not applied [m]
ROUNDING = 1e-6  #: relative rounding error of the product of displacement and change of force


def snapped(
    system: System,
    before: State,
    after: State,
    control: Control,
    bodies: BodiesAlone | None = None,
) -> bool:
    """Test if the energy for one control is concave between two states.

    d . (f(q0) - f(q1)) < 0 with d = q1 - q0 and the forces f of all terms: the mean stiffness along
    d is negative. Small differences then increase, as in the buckling of a column, and rounding
    determines the further motion. The matrix of a time step may still be positive definite because
    of inertia and damping. The test succeeds once the unstable motion dominates the displacement.

    Parameters
    ----------
    before, after : at q0 and q1.
    control : of both forces.
    bodies : evaluates the forces of a scene of rigid bodies in less time.
    """
    kinematics = system.kinematics
    d, change = (None, None) if bodies is None else bodies.change(before, after, control)
    if d is None:
        d = kinematics.between(before.pose, after.pose)
    if not np.abs(d).max() > STILL:
        return False
    if change is None:
        f0, f1 = system.force(before.q, control).f, system.force(after.q, control).f
        change = kinematics.generalised_force(f0, before.pose)
        change = change - kinematics.generalised_force(f1, after.pose)
    return dot(d, change) < -ROUNDING * norm(d) * norm(change)
