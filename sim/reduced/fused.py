"""Linearly implicit Euler steps of a reduced solid in one kernel."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sim._kernels.reduced import DONE, INVERTED, advance
from sim.errors import InvertedElement, SceneError, SingularSystem
from sim.integrators.workspace import Workspace
from sim.reduced.tissue import CompiledReducedSolid
from sim.state import ControlAt, State, StepReport
from sim.system import System

OMITTED = "omitted coordinates"
"""Memory of a state: displacements and velocities of the omitted modes (2, n - r)."""


@dataclass(frozen=True)
class FusedEuler:
    """`LinearlyImplicitEuler` of a reduced solid, with the motion of the omitted modes.

    It solves the same equation, with an LDL' factor without pivoting; the memory of the state contains
    the estimated displacements of the omitted modes (`OMITTED`).
    """

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
        solid, m = term.solid, len(term.solid.load) - term.r
        y, v = state.q.reshape(-1).copy(), state.v.reshape(-1).copy()
        omitted = np.array(state.memory.get(OMITTED, np.zeros((2, m))))
        activation = control.chord(state.t, h).at(1.0).activation
        moving = y, v, omitted[0], omitted[1]
        status, J, at, negative = advance(
            solid.table, term.linear, term.relaxed(h), h, activation, *moving, term.scratch
        )
        if status == INVERTED:
            raise InvertedElement(int(solid.table.place[at]) // 8, float(J), state.t + h)
        if status != DONE:
            raise SingularSystem(
                f"the reduced matrix of the step from t = {state.t:.4g} s is singular: shorten it"
            )
        new = State(state.t + h, y.reshape(-1, 3), v.reshape(-1, 3), {OMITTED: omitted})
        return new, StepReport(h=h, smallest_J=float(J), indefinite=int(negative > 0))
