"""Linearly implicit Euler steps of a reduced solid in compiled kernels, by conjugate gradients."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim._kernels.reduced import BEGIN, DONE, MOVE, NOT_REACHED, SOLVE, advance
from sim._kernels.reduced import INVERTED as AT_START
from sim.errors import InvertedElement, SceneError, SingularSystem
from sim.integrators.workspace import Workspace
from sim.reduced.contact import ALLOWED, IMPULSES, ReducedContact
from sim.reduced.tissue import CompiledReducedSolid
from sim.snapping import ROUNDING
from sim.state import Array, Control, ControlAt, State, StepReport
from sim.system import System

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
    rate: float = 3.0
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
        solution = _Solution(term, state.t, h, control_at_end, self.rate * h, y, v, omitted)
        if self.contact is None:
            memory = dict[str, Array]()
            solution.run(BEGIN | SOLVE | MOVE)
        else:
            memory = self._touched(self.contact, state, solution)
            solution.run(MOVE)
        memory[OMITTED] = omitted
        new = State(state.t + h, y.reshape(-1, 3), v.reshape(-1, 3), memory)
        report = StepReport(
            h=h,
            iterations=solution.products,
            smallest_J=solution.smallest_J,
            indefinite=solution.indefinite,
            concave=solution.bend < -ROUNDING,
        )
        return new, report

    @staticmethod
    def _touched(contact: ReducedContact, state: State, solution: "_Solution") -> dict[str, Array]:
        """Memory of the contact; the solution becomes that with its impulses."""
        y, v, h = solution.y, solution.v, solution.h
        known, none = state.memory.get(ALLOWED), np.zeros(len(contact.slots))
        allowed = contact.depths(y) if known is None else known
        rows = contact.rows(y, v, allowed, h)
        N, gap, at = rows
        deep = np.maximum(allowed[at] - gap, 0.0)
        left = none.copy()
        np.maximum.at(left, at, np.minimum(allowed[at], deep))  # a depth may only decrease
        p, own = state.memory.get(IMPULSES, none)[at], np.ascontiguousarray(N[:, : len(v)])
        solution.right += p @ own
        solution.run(BEGIN | SOLVE)
        if len(at):
            X = own @ solution.inverse
            W = X @ own.T
            for _ in range(ROUNDS):
                new, changed = contact.pushed(rows, W, h, v, p)
                v += (new - p) @ X
                solution.right += (new - p) @ own
                solution.run(SOLVE)
                p = new
                if changed <= CHANGED:
                    break
        every = none.copy()
        every[at] = p
        solution.impulse = p @ N
        return {ALLOWED: left, IMPULSES: every}


@dataclass(eq=False)
class _Solution:
    """Stages of a step, which change coordinates, velocities and omitted coordinates in place."""

    term: CompiledReducedSolid
    start: float  #: time [s]
    h: float
    control: Control  #: at the end
    tolerance: float
    y: Array
    v: Array
    omitted: Array
    products: int = 0
    indefinite: int = 0
    smallest_J: float = math.inf
    bend: float = 0.0  #: v'K v/(|v| |K v|)

    def __post_init__(self) -> None:
        """Begin without impulses (n,), of which those (r,) on the moving coordinates are in `right`."""
        self.inverse, self.relaxed = self.term.inverses(self.h)
        self.impulse = np.zeros(len(self.term.solid.load))
        self.right = np.zeros(len(self.v))

    def run(self, stages: int) -> None:
        """Run stages of `sim._kernels.reduced.advance`; InvertedElement if an element is inverted."""
        term, h = self.term, self.h
        about = term.elements, term.linear, self.inverse, self.relaxed, h
        solved = self.control.activation, self.tolerance, MOST, self.y, self.v, self.right
        moved = self.omitted[0], self.omitted[1], self.impulse, term.scratch
        status, least, at, products, bend = advance(stages, *about, *solved, *moved)
        self.products += int(products)
        if status == NOT_REACHED:
            self._solve_directly()
            if stages & MOVE:
                self.run(MOVE)
        elif status != DONE:
            when = self.start if status == AT_START else self.start + h
            raise InvertedElement(int(at), float(least), when)
        elif stages & MOVE:
            self.smallest_J, self.bend = float(least), float(bend)

    def _solve_directly(self) -> None:
        """Solve the equation with its matrix, also with one that is not positive definite."""
        r, h, s = self.term.r, self.h, self.term.solid
        K = self.term.tangent(self.y, self.control)
        A = np.eye(r) + h * s.damping[:r, :r] + h * h * K[:r, :r]
        values, vectors = np.linalg.eigh(A)
        if not np.abs(values).min() > 1e-14 * np.abs(values).max():
            raise SingularSystem(
                f"the reduced matrix of the step to t = {self.control.t:.4g} s is singular: shorten it"
            )
        self.v[:] = vectors @ ((self.right @ vectors) / values)
        self.term.scratch.stiff[:] = K[:, :r] @ self.v
        self.indefinite = int(values[0] < 0.0)
