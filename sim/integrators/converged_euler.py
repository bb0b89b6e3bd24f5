"""Implicit Euler solved to a tolerance: Newton on the incremental potential."""

from dataclasses import asdict, dataclass
from typing import ClassVar

from sim.integrators.contract import Workspace, require_upright
from sim.integrators.incremental import IncrementalPotential
from sim.integrators.newton import Tolerances, minimise
from sim.state import Control, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class ConvergedEuler:
    """The minimiser of the incremental potential of one implicit Euler step.

    phi(q) = 1/(2 h^2) |q - q0 - h v0|^2_M + E(q) + 1/(2 h) (q - q0)' D0 (q - q0),

    with D0 the damping matrix at the start of the step. Newton's method with a line search that keeps
    det F > 0 at every Gauss point and phi decreasing. A factor serves, with secant updates, as long as
    the iteration contracts, over many steps; a matrix that is not positive definite is shifted.

    Attributes
    ----------
    tolerance : float
        Largest estimated error of a nodal position left by the iteration [m].
    residual_tolerance : float
        Largest nodal residual force [N].
    max_iterations : int
    keep_factor : float
        The factor is renewed after an iteration that shrinks the residual by less than this.

    Notes
    -----
    First order. Source of the potential: the variational form of implicit Euler (Martin et al. 2011,
    Example-based elastic materials); the damping is lagged so that the step has a potential.
    """

    tolerance: float = 1e-6
    residual_tolerance: float = 2e-5
    max_iterations: int = 80
    keep_factor: float = 0.6
    order: ClassVar[int] = 1

    def step(
        self, system: System, state: State, control: Control, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 at the start of the step.
        NotConverged
            The tolerances were not met, or no step length lowers the potential.
        SingularSystem
            The matrix could not be factorised.
        """
        system = system.during(state, h)
        with work.timed("force"):
            here = system.force(state.q, control)
        require_upright(here.element, here.smallest_J, state.t)
        with work.timed("tangent"):
            D = system.damping(state.q, control)
        phi = IncrementalPotential(system, state, control, h, D, work)
        tolerances = Tolerances(
            self.tolerance, self.residual_tolerance, self.max_iterations, self.keep_factor
        )
        key = (ConvergedEuler, h)
        end, went = minimise(phi, phi.start(here), work, key, tolerances, state.t + h)
        velocity = system.expand(end.d / h, state.v)
        q1 = phi.positions(end.d)
        new = State(state.t + h, q1, velocity, system.remember(q1))
        return new, StepReport(h=h, smallest_J=end.here.smallest_J, **asdict(went))
