"""Implicit Euler with one linear solution per step."""

from dataclasses import dataclass
from typing import ClassVar

from sim.integrators.contract import Workspace, require_upright
from sim.state import Control, State, StepReport
from sim.system import System


@dataclass(frozen=True)
class LinearlyImplicitEuler:
    """One Newton step of implicit Euler, (M + h D + h^2 K) v1 = M v0 + h f(q0), q1 = q0 + h v1.

    K, D and f are taken at q0 with the control of the step's end. First order; it follows the
    published simulator, and like it can invert elements when forces are large.

    Notes
    -----
    The equation is solved as it stands also when its matrix is not positive definite, as strongly
    active muscles make it; the report counts such steps as ``indefinite``.
    """

    order: ClassVar[int] = 1

    def step(
        self, system: System, state: State, control: Control, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        InvertedElement
            det F <= 0 somewhere at the start or at the end of the step.
        SingularSystem
            The matrix could not be factorised.
        """
        system = system.during(state, h)
        with work.timed("tangent"):
            at_start, K = system.tangent(state.q, control)
            D = system.damping(state.q, control, K)
        require_upright(at_start.element, at_start.smallest_J, state.t)
        mass, diagonal = system.mass, system.pattern.diagonal
        A = h * D + h * h * K
        A[diagonal] += mass
        v0 = system.reduce(state.v)
        v1, definite = work.solve_any(A, mass * v0 + h * system.reduce(at_start.f))
        q1 = system.expand(system.reduce(state.q) + h * v1, state.q)
        t1 = state.t + h
        with work.timed("force"):
            least, element = system.smallest_J(q1)
        require_upright(element, least, t1)
        new = State(t1, q1, system.expand(v1, state.v), system.remember(q1))
        return new, StepReport(
            h=h, smallest_J=least, factorisations=1 if definite else 2, indefinite=int(not definite)
        )
