"""Linearly implicit Euler steps of a reduced solid in compiled kernels, by conjugate gradients."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim._kernels.reduced import INVERTED, NOT_REACHED, improve, move, predict
from sim.errors import InvertedElement, SceneError, SingularSystem
from sim.integrators.workspace import Workspace
from sim.reduced.contact import ALLOWED, IMPULSES, ReducedContact
from sim.reduced.tissue import CompiledReducedSolid
from sim.snapping import ROUNDING
from sim.state import Array, Control, ControlAt, State, StepReport
from sim.system import System
from sim.vectors import dot, norm

MOST = 40  #: largest number of products in a solution
ROUNDS, CHANGED = 4, 1e-4
"""Largest number of solutions with contact in a step; change of a rate at which they end [m/s]."""
OMITTED = "omitted coordinates"
"""Memory of a state: displacements and velocities of the omitted modes (2, n - r)."""


@dataclass(frozen=True)
class FusedEuler:
    """`LinearlyImplicitEuler` of a reduced solid, with the motion of the omitted modes.

    It solves the same equation by conjugate gradients, preconditioned by the inverse of its matrix at
    rest, or directly where they do not converge or the matrix is not positive definite. The memory of
    the state contains the estimated displacements of the omitted modes (`OMITTED`). With a contact,
    impulses keep its gaps open, linearised at the start of the step.
    """

    contact: ReducedContact | None = None
    rate: float = 0.1
    """Error of the velocity, relative in the energy of a step of h, over h [1/s]."""

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "L-stable"

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises
        ------
        SceneError
            The scene is not one reduced solid.
        InvertedElement
            det F <= 0 in a chosen element, at the start or at the end of the step.
        SingularSystem
            The matrix could not be factorised.
        """
        term = system.terms[0]
        if len(system.terms) > 1 or not isinstance(term, CompiledReducedSolid):
            raise SceneError(
                "FusedEuler requires the system of a ReducedModel: use another integrator"
            )
        n = len(term.solid.load)
        y, v = state.q.reshape(-1).copy(), state.v.reshape(-1).copy()
        omitted = np.array(state.memory.get(OMITTED, np.zeros((2, n - term.r))))
        control_at_end = control.chord(state.t, h).at(1.0)
        inverse, relaxed = term.inverses(h)
        solution = _Solution(term, inverse, h, control_at_end, self.rate * h, y, v)
        memory, impulse = dict[str, Array](), np.zeros(n)
        if self.contact is None:
            solution.begin(impulse[: term.r])
        else:
            memory, impulse = self._touched(self.contact, state, solution)
        moving = y, v, omitted[0], omitted[1], impulse
        about = term.elements, term.linear, relaxed, h
        status, least, at = move(*about, *moving, term.scratch)
        if status == INVERTED:
            raise InvertedElement(int(at), float(least), state.t + h)
        memory[OMITTED] = omitted
        new = State(state.t + h, y.reshape(-1, 3), v.reshape(-1, 3), memory)
        stiff = term.scratch.stiff[: term.r]
        concave = dot(v, stiff) < -ROUNDING * norm(v) * norm(stiff)
        report = StepReport(
            h=h,
            iterations=solution.products,
            smallest_J=float(least),
            indefinite=solution.indefinite,
            concave=bool(concave),
        )
        return new, report

    @staticmethod
    def _touched(
        contact: ReducedContact, state: State, solution: "_Solution"
    ) -> tuple[dict[str, Array], Array]:
        """Memory and impulses of the contact; the solution becomes that with contact."""
        y, v, h = solution.y, solution.v, solution.h
        known, none = state.memory.get(ALLOWED), np.zeros(len(contact.slots))
        allowed = contact.depths(y) if known is None else known
        rows = contact.rows(y, v, allowed, h)
        N, gap, at = rows
        deep = np.maximum(allowed[at] - gap, 0.0)
        left = none.copy()
        np.maximum.at(left, at, np.minimum(allowed[at], deep))  # a depth may only decrease
        p, own = state.memory.get(IMPULSES, none)[at], np.ascontiguousarray(N[:, : len(v)])
        solution.begin(p @ own)
        if len(at):
            X = own @ solution.inverse
            W = X @ own.T
            for _ in range(ROUNDS):
                new, changed = contact.pushed(rows, W, h, v, p)
                v += (new - p) @ X
                solution.again((new - p) @ own)
                p = new
                if changed <= CHANGED:
                    break
        every = none.copy()
        every[at] = p
        return {ALLOWED: left, IMPULSES: every}, p @ N


@dataclass(eq=False)
class _Solution:
    """Velocities v, in place, of the equation of a step, and impulses on its right-hand side."""

    term: CompiledReducedSolid
    inverse: Array
    h: float
    control: Control
    tolerance: float
    y: Array
    v: Array
    products: int = 0
    indefinite: int = 0

    def begin(self, impulse: Array) -> None:
        """Solve with impulses (r,); InvertedElement if an element is inverted at the start."""
        self._right = impulse.copy()
        about = self.term.elements, self.term.linear, self.inverse, self.h
        given = self.y, self.v, self._right, self.tolerance, MOST
        activation = self.control.activation
        status, least, at, products = predict(*about, activation, *given, self.term.scratch)
        if status == INVERTED:
            raise InvertedElement(int(at), float(least), self.control.t)
        self._end(status, products)

    def again(self, impulse: Array) -> None:
        """Solve with further impulses (r,), from the velocities v."""
        self._right += impulse
        about = self.term.elements, self.term.linear, self.inverse, self.h
        given = self._right, self.v, self.tolerance, MOST
        self._end(*improve(*about, *given, self.term.scratch))

    def _end(self, status: int, products: int) -> None:
        self.products += int(products)
        if status != NOT_REACHED:
            return
        r, h, s = self.term.r, self.h, self.term.solid
        K = self.term.tangent(self.y, self.control)
        A = np.eye(r) + h * s.damping[:r, :r] + h * h * K[:r, :r]
        values, vectors = np.linalg.eigh(A)
        if not np.abs(values).min() > 1e-14 * np.abs(values).max():
            raise SingularSystem(
                f"the reduced matrix of the step to t = {self.control.t:.4g} s is singular: shorten it"
            )
        self.v[:] = vectors @ ((self._right @ vectors) / values)
        self.term.scratch.stiff[:] = K[:, :r] @ self.v
        self.indefinite = int(values[0] < 0.0)
