"""Error estimate of a step, without the contribution of a jump of the load."""

from collections.abc import Callable

from sim.matrix import Matrix
from sim.state import Array, Pose
from sim.system import System


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
