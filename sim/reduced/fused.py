"""Linearly implicit Euler steps of a reduced solid in compiled kernels, by conjugate gradients."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import ClassVar

import numpy as np

from sim._kernels.reduced import BEGIN, DONE, MOVE, NOT_REACHED, SOLVE_STAGE, Passed, advance
from sim._kernels.reduced import INVERTED as AT_START
from sim.errors import InvertedElement, SceneError, SingularSystem
from sim.integrators.workspace import Workspace
from sim.reduced.contact import ALLOWED_DEPTHS, IMPULSES, ReducedContact
from sim.reduced.tissue import CompiledReducedSolid
from sim.scene import Index
from sim.snapping import ROUNDING
from sim.state import Array, Control, ControlAt, Outputs, State, StepReport, united
from sim.system import System

PRODUCTS = 40  #: largest number of products in a solution
STEPS_AT_ONCE = 1000  #: number of steps that are computed without a check for interruption
FUSED_ROUNDS, CHANGED = 4, 1e-4
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

    def fuses(self, work: Workspace) -> bool:
        """Steps with contact are taken one by one."""
        return self.contact is None

    def run(
        self,
        system: System,
        state: State,
        control: ControlAt,
        groups: Sequence[Sequence[float]],
        work: Workspace,
    ) -> Iterator[Outputs]:
        """States after each group of steps that end at the given times [s]; errors as of `step`."""
        at_once = max(STEPS_AT_ONCE // len(groups[0]), 1)
        for first in range(0, len(groups), at_once):
            some = groups[first : first + at_once]
            time = np.array([state.t, *chain.from_iterable(some)])
            motion = _Motion(self.rate, _solid_of(system), state, control, time)
            error, after = None, np.cumsum([len(group) for group in some])
            try:
                motion.run()
            except (InvertedElement, SingularSystem) as found:
                error = found
            after = after[after <= motion.done]
            if len(after):
                outputs = motion.outputs(after)
                yield outputs
                state = outputs.state(-1)
            if error is not None:
                raise error

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
        time, memory = np.array([state.t, state.t + h]), dict[str, Array]()
        motion = _Motion(self.rate, _solid_of(system), state, control, time, np.array([h]))
        if self.contact is None:
            motion.run()
        else:
            memory = self._touched(self.contact, state, motion)
            motion.run(MOVE)
        outputs = motion.outputs(np.array([1]))
        new = outputs.state(0)
        return replace(new, memory={**memory, **new.memory}), outputs.reports[0]

    @staticmethod
    def _touched(contact: ReducedContact, state: State, motion: "_Motion") -> dict[str, Array]:
        """Memory of the contact; the velocities of the motion become those with its impulses."""
        y, v, h = motion.y, motion.v, float(motion.h[0])
        known, none = state.memory.get(ALLOWED_DEPTHS), np.zeros(len(contact.contact_vertices))
        allowed = contact.depths(y) if known is None else known
        rows = contact.rows(y, v, allowed, h)
        N, gap, at = rows
        deep = np.maximum(allowed[at] - gap, 0.0)
        left = none.copy()
        np.maximum.at(left, at, np.minimum(allowed[at], deep))  # a depth may only decrease
        p, own = state.memory.get(IMPULSES, none)[at], np.ascontiguousarray(N[:, : len(v)])
        motion.right += p @ own
        motion.run(BEGIN | SOLVE_STAGE)
        if len(at):
            X = own @ motion.term.inverses(h)[0]
            W = X @ own.T
            for _ in range(FUSED_ROUNDS):
                new, changed = contact.pushed(rows, W, h, v, p)
                v += (new - p) @ X
                motion.right += (new - p) @ own
                motion.run(SOLVE_STAGE)
                p = new
                if changed <= CHANGED:
                    break
        every = none.copy()
        every[at] = p
        motion.impulse += p @ N
        return {ALLOWED_DEPTHS: left, IMPULSES: every}


def _solid_of(system: System) -> CompiledReducedSolid:
    """The reduced solid of a scene; SceneError if there are other terms."""
    term = system.terms[0]
    if len(system.terms) > 1 or not isinstance(term, CompiledReducedSolid):
        raise SceneError("FusedEuler requires the system of a ReducedModel: use another integrator")
    return term


def _some(passed: Passed, own: slice) -> Passed:
    """Some of the steps."""
    y, v, omitted = passed.y[own], passed.v[own], passed.omitted[own]
    at = passed.element[own], passed.products[own]
    return Passed(y, v, omitted, passed.least_J[own], *at, passed.bend[own])


class _Motion:
    """Successive steps, which change coordinates, velocities and omitted coordinates in place.

    `rate` is that of `FusedEuler`, `time` (n + 1,) the start and the ends of the steps [s], and `h`
    (n,) their lengths [s] if they are not the differences of these.
    """

    def __init__(
        self,
        rate: float,
        term: CompiledReducedSolid,
        state: State,
        control: ControlAt,
        time: Array,
        h: Array | None = None,
    ) -> None:
        n, r, every = len(time) - 1, term.r, len(term.solid.load)
        self.term, self.rate, self.time, self.done = term, rate, time, 0
        self.h = np.diff(time) if h is None else h
        self.activation = control.at_ends(time.tolist())
        self.y, self.v = state.q.reshape(-1).copy(), state.v.reshape(-1).copy()
        self.right, self.impulse = np.zeros(r), np.zeros(every)
        self._omitted = np.array(state.memory.get(OMITTED, np.zeros((2, every - r))))
        self._indefinite = np.zeros(n, dtype=np.int64)
        whole = np.zeros((2, n), dtype=np.int64)
        self._passed = Passed(
            y=np.zeros((n, r)),
            v=np.zeros((n, r)),
            omitted=np.zeros((n, 2, every - r)),
            least_J=np.zeros(n),
            element=whole[0],
            products=whole[1],
            bend=np.zeros(n),
        )

    def run(self, stages: int = BEGIN | SOLVE_STAGE | MOVE) -> None:
        """Run stages of `sim._kernels.reduced.advance` for the steps that are left.

        Raises InvertedElement or SingularSystem for the first that fails; those before are done.
        """
        while self.done < len(self.h):
            own = np.abs(self.h[self.done :] - self.h[self.done]) > 1e-9 * self.h[self.done]
            equal = slice(self.done, self.done + int(np.append(own, True).argmax()))
            status, done = self._advance(stages, equal)
            self.done += done if stages & MOVE else 0
            if status == NOT_REACHED:
                self._solve_directly()
                if stages & MOVE:
                    status, done = self._advance(MOVE, slice(self.done, self.done + 1))
                    self.done += done
            if status not in (DONE, NOT_REACHED):
                own = self.done
                element, J = self._passed.element[own], self._passed.least_J[own]
                when = self.time[own if status == AT_START else own + 1]
                raise InvertedElement(int(element), float(J), float(when))
            if not stages & MOVE:
                return

    def _advance(self, stages: int, own: slice) -> tuple[int, int]:
        term, h = self.term, self.h[own]
        inverses = term.inverses(float(h[0]))
        solved = self.rate, PRODUCTS, self.y, self.v, self.right
        moved = self._omitted[0], self._omitted[1], self.impulse, term.scratch
        passed = _some(self._passed, own)
        about = stages, term.elements, term.linear, *inverses, h, self.activation[own]
        status, done = advance(*about, *solved, *moved, passed)
        return int(status), int(done)

    def _solve_directly(self) -> None:
        """Solve the equation with its matrix, also with one that is not positive definite."""
        r, h, s, k = self.term.r, float(self.h[self.done]), self.term.solid, self.done
        K = self.term.tangent(self.y, Control(self.activation[k]))
        A = np.eye(r) + h * s.damping[:r, :r] + h * h * K[:r, :r]
        values, vectors = np.linalg.eigh(A)
        if not np.abs(values).min() > 1e-14 * np.abs(values).max():
            raise SingularSystem(
                f"the reduced matrix of the step to t = {self.time[k + 1]:.4g} s is singular: shorten it"
            )
        self.v[:] = vectors @ ((self.right @ vectors) / values)
        self.term.scratch.stiff[:] = K[:, :r] @ self.v
        self._indefinite[k] = int(values[0] < 0.0)

    def outputs(self, after: Index) -> Outputs:
        """States after numbers > 0 of steps that ascend."""
        own, n, passed = after - 1, len(after), self._passed
        q, v = (x[own].reshape(n, -1, 3) for x in (passed.y, passed.v))
        reports = [self._report(k) for k in range(int(after[-1]))]
        bounds = zip([0, *after[:-1].tolist()], after.tolist(), strict=True)
        together = [united(reports[a:b], 0) for a, b in bounds]
        memory = {OMITTED: passed.omitted[own]}
        bodies = np.zeros((n, 0, 7)), np.zeros((n, 0, 6))
        return Outputs(self.time[after], q, v, memory, *bodies, together)

    def _report(self, k: int) -> StepReport:
        passed = self._passed
        return StepReport(
            h=float(self.h[k]),
            iterations=int(passed.products[k]),
            smallest_J=float(passed.least_J[k]),
            indefinite=int(self._indefinite[k]),
            concave=bool(passed.bend[k] < -ROUNDING),
        )
