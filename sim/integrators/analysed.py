"""Linear solver of a simulation, analysed for the sparsity of one form of its system."""

from collections.abc import Mapping

import numpy as np

from sim.integrators.kept import codes, named, part_of
from sim.linear import Factor, ReusedFactor, solver_of_steps
from sim.linear.reused import Timed
from sim.pattern import Sparsity
from sim.state import Array, State
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

    def form(self, system: System, state: State | None) -> System:
        """Return the system in the form required by the solver; see `Workspace.form`."""
        form = self._with_products(system)
        contact = form.contact
        if state is None or contact is None:
            return form
        few = len(contact.pushing(state)) * (3 if contact.rubs else 1) <= MOST_APART
        return form.apart if few and form.apart is not None else form

    def _with_products(self, system: System) -> System:
        reuses = isinstance(self.linear, ReusedFactor)
        return system.sparse if reuses and system.sparse is not None else system

    def _forms(self) -> list[System]:
        """Forms of the system for which the solver may have been analysed."""
        forms = [self._form]
        if self._form is not self.system:
            forms.append(self.system)
        if self._form.contact is not None and self._form.apart is not None:
            forms.append(self._form.apart)
        return forms

    def arrays(self) -> dict[str, Array]:
        """Name, form and precision of the solver, and its older factor."""
        forms = [form.pattern is self.analysed for form in self._forms()]
        own = {
            "name": codes(self.linear.name),
            "of": self._size(),
            "form": np.array([float(forms.index(True)) if any(forms) else -1.0]),
            "double": np.array([float(getattr(self.factor, "in_double", False))]),
        }
        reused = self.linear.arrays() if isinstance(self.linear, ReusedFactor) else {}
        return named("solver", own) | named("reused", reused)

    def restore(self, arrays: Mapping[str, Array]) -> None:
        """Restore the memory from `arrays`; empty ones are those of a new solver."""
        own = part_of(arrays, "solver")
        form = int(own["form"][0]) if own else -1
        if form >= 0:
            self.analyse(self._forms()[form].pattern)
        if self.analysed is None:
            return
        start_over = getattr(self.factor, "start_over", None)
        if start_over is not None:
            start_over(bool(own["double"][0]) if own else False)
        if isinstance(self.linear, ReusedFactor):
            self.linear.restore(part_of(arrays, "reused"))

    def fits(self, arrays: Mapping[str, Array]) -> bool:
        """Test if arrays are those of this solver and of a system of this size."""
        own = part_of(arrays, "solver")
        same = own and np.array_equal(own["name"], codes(self.linear.name))
        return bool(same) and np.array_equal(own["of"], self._size())

    def _size(self) -> Array:
        """Numbers of unknowns and entries."""
        return np.array([self.pattern.n, self.pattern.nnz], dtype=np.float64)
