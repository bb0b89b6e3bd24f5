"""Linear solver of a simulation, analysed for the sparsity of one form of its system."""

from sim.linear import Factor, ReusedFactor, solver_of_steps
from sim.linear.reused import Timed
from sim.pattern import Sparsity
from sim.scene import having
from sim.state import State
from sim.system import System

MOST_APART = 1000
"""Largest number of active rows for the Schur complement, whose compliance takes 0.2 GB.

With friction, a vertex has three.
"""


class AnalysedSolver:
    """Linear solver, and the form of the system for which it is analysed.

    The name is that of the linear solver, or "auto". `system` is the whole one with its `pattern`,
    `form_pattern` is of the form that the solver requires, and `analysed` the sparsity for which it is
    analysed.
    """

    linear: Factor | ReusedFactor  #: solver for the matrix of a step
    factor: Factor  #: computes the factors, also for Newton's method

    def __init__(self, system: System, name: str, timed: Timed) -> None:
        self._name, self._timed = name, timed
        self._take(system.pattern.n)
        self.system, self.pattern = system, system.pattern
        self._form = self._with_products(system)
        self.form_pattern = self._form.pattern
        self.analysed: Sparsity | None = None
        if self._form.contact is None:
            # with contact the form is chosen at the first step
            self.analyse(self.form_pattern)

    def _take(self, n: int) -> None:
        self.linear = solver_of_steps(self._name, n)
        if isinstance(self.linear, ReusedFactor):
            self.linear.timed = self._timed
            self.factor = self.linear.factor
        else:
            self.factor = self.linear

    def analyse(self, pattern: Sparsity) -> None:
        """Set the solver for a sparsity, unless it is already set."""
        if pattern is self.analysed:
            return
        if self.analysed is not None:
            self._take(pattern.n)
        self.linear.analyse(pattern)
        self.analysed = pattern

    def form(self, system: System, state: State | None, *, rows_apart: bool) -> System:
        """Return the system in the form required by the solver; see `Workspace.form`."""
        form, contact = self._with_products(system), system.contact
        if contact is None or system.with_rows is None or rows_apart:
            return form
        if state is not None and not having(form.terms, "product"):
            few = len(contact.pushing(state)) * (3 if contact.rubs else 1) <= MOST_APART
            if few:
                return form
        return self._with_products(system.with_rows.system)

    def _with_products(self, system: System) -> System:
        reuses = isinstance(self.linear, ReusedFactor)
        return system.sparse if reuses and system.sparse is not None else system

    def forget(self) -> None:
        """Discard an older factor and a choice of its precision."""
        if self.analysed is None:
            return
        start_over = getattr(self.factor, "start_over", None)
        if start_over is not None:
            start_over()
        if isinstance(self.linear, ReusedFactor):
            self.linear.start_over()
