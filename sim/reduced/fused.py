"""Linearly implicit Euler steps of a reduced solid in compiled kernels."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim._kernels.reduced import DONE, INVERTED, move, predict
from sim.errors import InvertedElement, SceneError, SingularSystem
from sim.integrators.workspace import Workspace
from sim.reduced.contact import ALLOWED, IMPULSES, ReducedContact
from sim.reduced.tissue import CompiledReducedSolid
from sim.state import Array, ControlAt, State, StepReport
from sim.system import System

OMITTED = "omitted coordinates"
"""Memory of a state: displacements and velocities of the omitted modes (2, n - r)."""


@dataclass(frozen=True)
class FusedEuler:
    """`LinearlyImplicitEuler` of a reduced solid, with the motion of the omitted modes.

    It solves the same equation, with an LDL' factor without pivoting; the memory of the state contains
    the estimated displacements of the omitted modes (`OMITTED`). With a contact, impulses keep its gaps
    open, linearised at the start of the step.
    """

    contact: ReducedContact | None = None

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
            det F <= 0 at a chosen point, at the start or at the end of the step.
        SingularSystem
            The matrix could not be factorised.
        """
        term = system.terms[0]
        if len(system.terms) > 1 or not isinstance(term, CompiledReducedSolid):
            raise SceneError(
                "FusedEuler requires the system of a ReducedModel: use another integrator"
            )
        solid, n = term.solid, len(term.solid.load)
        y, v = state.q.reshape(-1).copy(), state.v.reshape(-1).copy()
        omitted = np.array(state.memory.get(OMITTED, np.zeros((2, n - term.r))))
        activation = control.chord(state.t, h).at(1.0).activation
        about = solid.table, term.linear
        memory, impulse = dict[str, Array](), np.zeros(n)
        status, least, at, negative = predict(*about, h, activation, y, v, term.scratch)
        if status == DONE:
            if self.contact is not None:
                memory, impulse = self._touched(self.contact, state, y, v, h, term)
            moving = y, v, omitted[0], omitted[1], impulse
            status, least, at = move(*about, term.relaxed(h), h, activation, *moving, term.scratch)
        if status == INVERTED:
            raise InvertedElement(int(solid.table.place[at]) // 8, float(least), state.t + h)
        if status != DONE:
            raise SingularSystem(
                f"the reduced matrix of the step from t = {state.t:.4g} s is singular: shorten it"
            )
        memory[OMITTED] = omitted
        new = State(state.t + h, y.reshape(-1, 3), v.reshape(-1, 3), memory)
        return new, StepReport(h=h, smallest_J=float(least), indefinite=int(negative > 0))

    @staticmethod
    def _touched(
        contact: ReducedContact,
        state: State,
        y: Array,
        v: Array,
        h: float,
        term: CompiledReducedSolid,
    ) -> tuple[dict[str, Array], Array]:
        """Memory and impulses of the contact; the predicted velocities of the term change."""
        known, none = state.memory.get(ALLOWED), np.zeros(len(contact.slots))
        allowed = contact.depths(y) if known is None else known
        rows = contact.rows(y, v, allowed, h)
        _, gap, at = rows
        deep = np.maximum(allowed[at] - gap, 0.0)
        left = none.copy()
        np.maximum.at(left, at, np.minimum(allowed[at], deep))  # a depth may only decrease
        new, before = term.scratch.b[: len(y)], state.memory.get(IMPULSES, none)
        every, impulse = contact.pushed(term.scratch.A, rows, h, new, before)
        return {ALLOWED: left, IMPULSES: every}, impulse
