"""Solver memory of a simulation, kept between steps and divided by its owners."""

import time
from collections.abc import Generator
from contextlib import contextmanager

from sim.integrators.analysed import AnalysedSolver
from sim.integrators.bodies_alone import BodiesAlone
from sim.integrators.constraint_solver import ConstraintSolver
from sim.integrators.contact_memory import ContactMemory
from sim.integrators.newton_factor import NewtonFactor
from sim.integrators.step_solver import Solution, StepSolver
from sim.linear import Factor, ReusedFactor
from sim.linear.equations import Equations
from sim.matrix import Matrix
from sim.state import Array, Pose, State
from sim.system import System


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
        self.bodies = BodiesAlone.of(system)
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
