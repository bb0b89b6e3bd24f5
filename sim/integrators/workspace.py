"""Solver memory of a simulation, kept between steps and divided by its owners."""

import math
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager

from sim.contact.compliance import Compliance
from sim.integrators.bodies_alone import BodiesAlone
from sim.integrators.factor import AnalysedSolver, Key, NewtonFactor
from sim.integrators.step_solver import ConstraintSolver, Solution, StepSolver
from sim.linear import Factor, ReusedFactor
from sim.linear.contract import Matrix
from sim.linear.equations import Equations
from sim.state import Array, Pose, State
from sim.system import System


class ContactMemory:
    """Memory of converged steps with contact, for n unknowns.

    `stiffness` is the diagonal (n,) of the stiffness of an integrator and step, to which penalties are
    proportional [N/m].
    """

    def __init__(self, newton: NewtonFactor, n: int) -> None:
        self._newton, self._n = newton, n
        self._compliance: Compliance | None = None
        self._made_by: int | None = None
        self._scale = 0.0
        self.stiffness: tuple[Key, Array] | None = None

    def compliance(
        self, scale: float, solve_many: Callable[[Array], Array] | None = None
    ) -> Compliance:
        """Compliance of the tissue of the latest factor, or of earlier ones of the same scale.

        New parts come from `solve_many`, by default the latest factor of Newton's method, of `scale`
        times the stiffness without products, in its own precision. One of shorter steps would be too
        small: its updates correct it for the forces that have occurred, and any other force, such as
        rounding that is not symmetric, would grow from iteration to iteration.
        """

        def by_factor(rhs: Array) -> Array:
            return scale * self._newton.solve_many(rhs)

        if self._compliance is None or not math.isclose(scale, self._scale, rel_tol=1e-9):
            self._compliance, self._scale = Compliance(self._n, by_factor), scale
            self._made_by = self._newton.number
        self._compliance.solve_many = solve_many or by_factor
        return self._compliance

    def discard(self) -> None:
        """Discard the compliance."""
        self._compliance, self._made_by = None, None

    def forget_compliance(self) -> bool:
        """Discard the compliance if it is not of the latest factor; return True if discarded."""
        if self._made_by == self._newton.number:
            return False
        self.discard()
        return True

    def forget(self) -> None:
        """Discard compliance and stiffness."""
        self.discard()
        self.stiffness = None


class PhaseClock:
    """Wall time and calls of every phase.

    A workspace and its solver share it. If the solver referred to its workspace instead, this cycle
    would keep the hundreds of megabytes of a scene until the next garbage collection.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}

    @contextmanager
    def timed(self, phase: str) -> Generator[None]:
        """Add the wall time of a block to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] = self.seconds.get(phase, 0.0) + time.perf_counter() - start
            self.calls[phase] = self.calls.get(phase, 0) + 1


class Workspace:
    """Solver memory of one simulation.

    An older factor, quasi-Newton updates and initial guesses change results within the tolerance of an
    iteration. A simulation therefore starts without them, and discards them at its checkpoints.

    Parameters
    ----------
    system : System
    linear : str
        Name of the linear solver, or "auto".

    Attributes
    ----------
    steps : StepSolver
        Of linearly implicit steps.
    newton : NewtonFactor
        Of converged steps.
    constraints : ConstraintSolver
        Of steps under constraints.
    contact : ContactMemory
        Of converged steps with contact.
    bodies : BodiesAlone or None
        Fused steps of a scene of rigid bodies without tissue.
    estimates : bool
        True if steps with one linear solution estimate their error, which takes an evaluation of the
        forces and a solution.
    timed, seconds, calls
        `PhaseClock` of all phases.
    """

    def __init__(self, system: System, linear: str = "auto") -> None:
        clock = PhaseClock()
        self.timed, self.seconds, self.calls = clock.timed, clock.seconds, clock.calls
        self._solver = AnalysedSolver(system, linear, clock.timed)
        self.newton = NewtonFactor(self._solver, clock.timed)
        self.steps = StepSolver(self._solver, self.newton, clock.timed)
        self.constraints = ConstraintSolver(system, self.linear, clock.timed)
        self.contact = ContactMemory(self.newton, system.pattern.n)
        self.bodies = BodiesAlone.for_system(system)
        self.estimates = True

    @property
    def linear(self) -> Factor | ReusedFactor:
        """Solver of the matrices of steps."""
        return self._solver.linear

    @contextmanager
    def estimating(self, wanted: bool) -> Generator[None]:
        """Set `estimates` for a while."""
        before, self.estimates = self.estimates, wanted
        try:
            yield
        finally:
            self.estimates = before

    def solve(
        self,
        system: System,
        A: Matrix,
        rhs: Array,
        pose: Pose,
        start: Array,
        error: float,
        under: Equations | None = None,
    ) -> Solution:
        """Velocities of A w = rhs, under the constraints of the scene at a pose if it has any.

        Arguments and errors as of `StepSolver.solve`, or `ConstraintSolver.solve`
        without `under`.
        """
        if system.constraints is None:
            return self.steps.solve(A, rhs, start, error, under)
        self.constraints.take(system)
        return self.constraints.solve(A, rhs, pose, start, error)

    def form(
        self, system: System, state: State | None = None, *, rows_apart: bool = False
    ) -> System:
        """Return the system in the form required by the solver: with products, or fully assembled.

        Its matrix has entries for contact rows unless these are solved separately: always with
        `rows_apart`, and in a converged step from the initial `state` if there are few and no
        products. A factor of another form is discarded.
        """
        form = self._solver.form(system, state, rows_apart=rows_apart)
        if form.constraints is not None:
            self.constraints.take(form)
        begins = state is not None and form.contact is not None
        if begins and form.pattern is not self._solver.analysed:
            self.newton.forget()
            self._solver.analyse(form.pattern)
        return form

    def forget(self) -> None:
        """Discard all memory, as at the start of a simulation and at its checkpoints."""
        for owner in (self._solver, self.newton, self.contact, self.constraints, self.steps):
            owner.forget()
