"""A linearly implicit step with contact: one linear system per set of rows that touch."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sim.contact.rows import Acting, Law, Places, Rows
from sim.contact.step import TOUCH, ContactStep, penalties
from sim.errors import NotConverged
from sim.integrators.contract import Workspace
from sim.linear import ReusedFactor
from sim.matrix import Matrix
from sim.scene import Index
from sim.state import Array, State
from sim.system import System
from sim.vectors import dot, norm

PENALTY = 30.0  # of the stiffness that a row meets
SETTLED = 1e-6  # what gaps and slips are closed to [m]
INSIDE = 1e-5  # depth of a row that does not push that is left to the correction [m]
PULL = 0.1  # of the mean force, what a row may pull before it lets go in the next step
LINEAR_ERROR = 3e-7  # that an iterative solution leaves [m]
SHARE = 0.1  # of a correction that its solution may miss
ROUGHLY = 1e-5  # what is accepted where the sets do not settle [m]
FRICTION_SETTLED = 1e-4  # of the largest bound
ENOUGH = 0.1  # of the slope at its start, where a move may end
PASSES, ROUNDS, CORRECTIONS, HALVINGS = 60, 6, 4, 40
MAX_FLIPS = 6  # a row that comes and goes more often is let go for the step
NOTICED = 3e-6  # depth that is corrected [m]
CONSIDERABLE = 1e-4  # depth of a row that pushes that is no matter of a correction [m]
AT_ALL = 2e-5  # the same of one that does not [m]

Solve = Callable[[Array, float], Array]
"""Solution for a right-hand side, and the largest error that an iterative one may leave [m]."""


@dataclass(frozen=True)
class Touched:
    """Velocities and positions of a step with contact, and how it went."""

    v: Array
    q: Array
    memory: Mapping[str, Array]
    solutions: int
    factorisations: int
    definite: bool


class Equation(Protocol):
    """The equation of a linearly implicit step, A v1 = rhs."""

    @property
    def A(self) -> Matrix:
        """Matrix for the velocities."""
        ...

    @property
    def rhs(self) -> Array:
        """Right-hand side (n_free,) [N s]."""
        ...

    @property
    def moves(self) -> float:
        """Share of the new velocity in the motion."""
        ...


class LinearContact:
    """The equation A x = b + scale N'f of x = h v1 with the forces f of the rows.

    Parameters
    ----------
    system : System
        With a contact.
    state : State
    equation : Equation
        Matrix and right-hand side for the velocities.
    h : float
    work : Workspace
    """

    def __init__(
        self,
        system: System,
        state: State,
        equation: Equation,
        h: float,
        work: Workspace,
    ) -> None:
        assert system.contact is not None  # callers choose this by it
        self._system, self._state, self._work = system, state, work
        self._A, self._moves = equation.A, equation.moves
        self._diagonal = equation.A.to_factorise()[system.pattern.diagonal]
        self._h, self._b, self._scale = h, h * equation.rhs, h * h
        self._v0 = system.reduce(state.v)
        self._step = ContactStep(system.contact, state, state.t + h)
        self.solutions = self.factorisations = 0
        self.definite = True

    def solve(self) -> Touched:
        """Velocities and positions at the end.

        Raises
        ------
        NotConverged
            The rows that touch did not settle.
        SingularSystem
            A matrix could not be factorised.
        """
        step, h = self._step, self._h
        if isinstance(self._work.linear, ReusedFactor):
            # rows turn from step to step, which the factor of an older step would not know
            self._work.linear.forget()
        speed = np.sqrt((self._state.v**2).sum(axis=1))
        law = self._law(step.at_start(1.5 * h * speed))
        x = h * self._v0
        for _ in range(ROUNDS):
            x, acting, solve = self._settle(law, x)
            q = self._positions(x)
            near = step.at(q)
            missed = self._missed(law, acting, q, near)
            if not len(missed):
                break
            law = self._law(law.rows.joined(missed), law)
        else:
            raise NotConverged((), self._state.t + h, "contact finds new rows in every round")
        if self._moves < 1.0:
            near = near.joined(self._through(law.rows, q, near))
        q = self._corrected(q, near, law.rows.slot[acting.force > 0.0], solve)
        return Touched(
            self._system.expand(x / h, self._state.v),
            q,
            step.memory(q, law, acting),
            self.solutions,
            self.factorisations,
            self.definite,
        )

    def _law(self, rows: Rows, before: Law | None = None) -> Law:
        """Rows that allow no way in, with their multipliers."""
        pattern = self._system.pattern
        stiffness = self._diagonal / self._scale
        law = self._step.law(rows.outside_gap(), penalties(pattern, stiffness, rows, PENALTY))
        if before is not None:
            k = len(before.rows)
            law.normal[:k], law.tangent[:k] = before.normal, before.tangent
            law.normal[k:], law.tangent[k:] = 0.0, 0.0
            law.bound = law.rows.friction * law.normal
        return law

    def _displacement(self, x: Array) -> Array:
        """Nodal vector (n_nodes, 3) of x, zero at what is held."""
        return self._system.expand(x, np.zeros_like(self._state.q))

    def _positions(self, x: Array) -> Array:
        way = self._h * (1.0 - self._moves) * self._v0 + self._moves * x
        return self._system.expand(self._system.reduce(self._state.q) + way, self._state.q)

    def _settle(self, law: Law, x: Array) -> tuple[Array, Acting, Solve]:
        """Solution with the rows that touch, by a semi-smooth Newton iteration on the augmentation."""
        system, rows = self._system, law.rows
        n = self._state.q.shape[0]
        if not len(rows):
            solve = self._solver(None, rows, np.empty((0, 3, 3)))
            move = solve(self._b - self._A.times(x), LINEAR_ERROR)
            return x + move, law.at(self._displacement(x + move)), solve
        places = self._step.places(system.pattern, rows)
        acting = law.at(self._displacement(x))
        # rows that pushed in the step before, and those that the motion would bring inside
        pushes = (law.normal > 0.0) | (acting.gap < -TOUCH)
        factored, sticks, solve = pushes, acting.sticks, None
        flips, miss, last = np.zeros(len(rows), dtype=np.int64), np.inf, np.inf
        for _ in range(PASSES):
            force = law.held(acting, pushes)[:, None] * rows.normal + acting.friction
            Ax = self._A.times(x)
            missing = self._b + self._scale * system.reduce(rows.spread(force, n)) - Ax
            left = norm(missing)
            same = np.array_equal(factored, pushes) and np.array_equal(sticks, acting.sticks)
            # the stiffness of a sliding contact turns with its way
            if solve is None or not same or (acting.turn.any() and left > 0.3 * last):
                first = solve is None
                solve = self._solver(places, rows, law.stiffness(acting, pushes))
                factored, sticks = pushes, acting.sticks
            else:
                first = False
            move, last = solve(missing, LINEAR_ERROR), left
            if first:
                x, acting = x + move, law.at(self._displacement(x + move))
            else:
                x, acting = self._along(law, x, move, Ax - self._b)
            rough = float(np.abs(move).max()) if law.bound.any() else 0.0
            settled = np.array_equal(sticks, acting.sticks) and rough <= ROUGHLY
            if not (settled and self._stand(law, acting, pushes)):
                now = acting.force > 0.0
                flips += now != pushes
                law.released |= flips > MAX_FLIPS
                pushes = now & ~law.released
                continue
            miss, bound = acting.miss(law, pushes), law.bound
            law.update(acting)
            change = np.abs(law.bound - bound).max(initial=0.0)
            small = FRICTION_SETTLED * law.bound.max(initial=0.0) + 1e-12
            if max(miss, rough) <= SETTLED and change <= small:
                return x, acting, solve
            acting, last = law.at(self._displacement(x)), np.inf
        if miss > ROUGHLY:
            raise NotConverged(
                (), self._state.t + self._h, f"contact did not settle, {miss:.2g} m are left"
            )
        assert solve is not None  # the loop ran
        return x, acting, solve

    def _stand(self, law: Law, acting: Acting, pushes: NDArray[np.bool_]) -> bool:
        """Whether these rows may stay as they are for the step: nothing goes in, little is pulled."""
        inside = float(-acting.gap[~pushes & ~law.released].min(initial=0.0))
        if inside > INSIDE:
            return False
        force = law.held(acting, pushes)
        pull = float(-force.min(initial=0.0))
        pushing = force[force > 0.0]
        return pull == 0.0 or (len(pushing) > 0 and pull <= PULL * float(pushing.mean()))

    def _along(self, law: Law, x: Array, move: Array, residual: Array) -> tuple[Array, Acting]:
        """Point of a move where the augmentation is lowest, its end if it falls till there.

        residual is A x - b.
        """
        start = law.rows.displacement(self._displacement(x))
        way = law.rows.displacement(self._displacement(x + move)) - start
        straight = dot(residual, move)
        bent = dot(move, self._A.times(move))

        def slope(length: float) -> tuple[float, Acting]:
            acting = law.at_relative(start + length * way)
            pushed = self._scale * dot(acting.on_vertices(law.rows), way)
            return straight + length * bent - pushed, acting

        first, _ = slope(0.0)
        last, acting = slope(1.0)
        if first >= 0.0 or last <= ENOUGH * abs(first):
            return x + move, acting
        low, high, length = 0.0, 1.0, 1.0
        for _ in range(HALVINGS):
            length = 0.5 * (low + high)
            here, acting = slope(length)
            if abs(here) <= ENOUGH * abs(first):
                break
            low, high = (low, length) if here > 0.0 else (length, high)
        return x + length * move, acting

    def _missed(self, law: Law, acting: Acting, q: Array, near: Rows) -> Rows:
        """Rows that the step has passed and that are no matter of a small correction."""
        passed = self._step.passed(q, near)
        depth = -passed.gaps(q - self._state.q)
        held = np.isin(passed.slot, law.rows.slot[acting.force > 0.0])
        same = np.isin(_keys(passed), _keys(law.rows))
        return passed.take(np.flatnonzero(~same & (depth > np.where(held, CONSIDERABLE, AT_ALL))))

    def _through(self, rows: Rows, q: Array, near: Rows) -> Rows:
        """Rows that are broken where no face is near any more.

        The old velocities, which no row bears on, may carry a vertex through a thin sheet.
        """
        rows = rows.joined(self._step.passed(q, near))
        broken = rows.gaps(q - self._state.q) < -TOUCH
        rows = rows.take(np.flatnonzero(broken & ~np.isin(rows.slot, near.slot)))
        return rows.take(np.unique(_keys(rows), return_index=True)[1])

    def _corrected(self, q: Array, near: Rows, pushing: Index, solve: Solve) -> Array:
        """Positions with what has come to lie inside moved out, as the tissue gives way."""
        system, q0 = self._system, self._state.q
        stiffness = self._diagonal / self._scale
        for _ in range(CORRECTIONS):
            gap = near.gaps(q - q0)
            deep = np.flatnonzero(gap < -NOTICED)
            if not len(deep):
                break
            rows, wanted = near.take(deep), -gap[deep]
            # the matrix answers to rows that push by their penalty
            factor = np.where(np.isin(rows.slot, pushing), PENALTY, 1.0)
            rho = factor * penalties(system.pattern, stiffness, rows, 1.0)
            push = rows.spread((rho * wanted)[:, None] * rows.normal, len(q))
            f, error = self._scale * system.reduce(push), SHARE * float(wanted.max())
            move = self._displacement(solve(f, error))
            moved = rows.gaps(move) - rows.gaps(0.0 * move)
            share = float(moved @ wanted) / max(float(moved @ moved), 1e-300)
            q = q + min(max(share, 0.0), 2.0) * move
        return q

    def _solver(self, places: Places | None, rows: Rows, block: Array) -> Solve:
        """Solver for the matrix with the stiffness of rows, under the conditions of the scene."""
        system, work = self._system, self._work
        A = replace(self._A, values=self._A.values.copy())
        if places is not None:
            places.add(block, self._scale, A.values)
        if system.constraints is not None:
            _, G = system.constraints.evaluate(self._state.q)
            none = np.zeros(system.constraints.n)
            work.factorise_constrained(A.values, G)
            self.factorisations += 1
            return lambda r, _: self._counted(work.saddle.solve(r, none)[0])
        if not isinstance(work.linear, ReusedFactor):
            direct, definite = work.solver_of(A.values)
            self.factorisations += 1
            self.definite &= definite
            return lambda r, _: self._counted(direct(r))

        def solve(r: Array, error: float) -> Array:
            found = work.solve_any(A, r, np.zeros(len(r)), error)
            self.factorisations += found.factorisations
            self.definite &= found.definite
            return self._counted(found.x, found.iterations)

        return solve

    def _counted(self, x: Array, solutions: int = 1) -> Array:
        self.solutions += solutions
        return x


def _keys(rows: Rows) -> Index:
    """One number per vertex and face."""
    return rows.slot * (1 << 32) + rows.face
