"""Equations of rows of joints at a motion, and their solution by a factor of the tissue."""

import math
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from sim.contact.rows import Flags
from sim.dense import inverse as inverted
from sim.dense import least, reported, solved
from sim.held import held
from sim.integrators.incremental import PotentialOfMoves
from sim.integrators.newton import Point
from sim.integrators.newton_factor import Key
from sim.integrators.workspace import Workspace
from sim.joints.compiled import REDUNDANT, ROWS, Rows
from sim.scene import Index
from sim.state import Array

CHANGES = 20  #: largest number of changes of the active inequalities in one iteration
BESIDE = 1e-5  #: motions between which the curvature of rows is differenced [m, rad]
ON = 1e-9  #: value below which an inequality counts as active [m, rad]
NOTHING = 1e-14  #: relative size of singular values that are zero but for rounding
CONVEX = 1e-4  #: least curvature along motions that the rows allow, relative to the largest one


@dataclass(frozen=True, eq=False)
class Conditions:
    """Rows r + compliance f = 0, or r >= 0, at a motion.

    Rigid rows hold for velocities, r = s (G w + drift), so that stages keep their order and no fast mode
    is left in their forces; with a time constant T, r = (c + T (G w + drift))/(1 + T/s).
    """

    rows: Rows
    #: (m,)
    r: Array
    compliance: Array
    G: Array  #: (m, k) derivatives by the motion of `Rows.columns`

    def lagrangian(self, g: Array, f: Array) -> Array:
        """Gradient g (n,) of the potential less the forces of the rows."""
        out = g.copy()
        out[self.rows.columns] -= self.G.T @ f
        return out

    @property
    def broken(self) -> Array:
        """Violations of the rows that do not yield."""
        broken = np.where(self.rows.unilateral, np.minimum(self.r, 0.0), self.r)
        return np.abs(broken[self.compliance == 0.0])


def conditions(potential: PotentialOfMoves, d: Array) -> Conditions:
    """Rows at a motion d (n,)."""
    rows, s = potential.system.rows, potential.duration
    assert rows is not None  # Callers check that the scene has joints.
    now = rows.evaluate(potential.pose(d))
    share = 1.0 + rows.damping_time / s
    rate = np.zeros(len(now.c)) if s == math.inf else now.G @ d[rows.columns] / s + now.drift
    r = (now.c + rows.damping_time * rate) / share
    if s < math.inf:
        r[rows.rigid] = s * rate[rows.rigid]
    return Conditions(rows, r, rows.compliance / share, rows.by_motion(now.G, d))


@dataclass(frozen=True, eq=False)
class Reduced:
    """A factor of A + sigma E E', and what follows from it for the velocities E'x on which rows act."""

    columns: Index  #: (k,)
    scale: float
    sigma: float
    X: Array  #: (k, n) solutions for unit vectors
    K: Array  #: (k, k) inverse of their part E'X', less sigma: A reduced to the columns
    work: Workspace
    curvature: Array | float = 0.0

    def bent(self, curvature: Array) -> "Reduced":
        """Return a copy with the curvature of the rows (k, k)."""
        return replace(self, curvature=self.scale * curvature)

    def multipliers(self, now: Conditions, g: Array, active: Flags) -> Array:
        """Forces (m,) of rows that leave least of a gradient g (n,), in the norm of the solutions X.

        What is left then has no part that rows bear, for which quasi-Newton updates would be wrong.
        """
        f, soft = np.zeros(len(now.r)), now.compliance > 0.0
        f[soft] = -now.r[soft] / now.compliance[soft]
        on = now.rows.rigid | (now.rows.unilateral & active)
        if on.any():
            G = now.G[on]
            f[on] = self._pushed(G, G @ (self.X @ now.lagrangian(g, f)))
        return f

    def _pushed(self, G: Array, motion: Array) -> Array:
        """Forces of rows G that cause their motion, the least ones if rows repeat each other."""
        S = G @ self.X[:, self.columns] @ G.T
        return least(S, motion, ROWS, NOTHING)

    def step(self, now: Conditions, g: Array, before: Array) -> tuple[Array, Array]:
        """Motion (n,) and forces of rows (m,) of one iteration.

        The gradient g (n,) is less the forces `before` (m,) of the rows.
        """
        free, rows = (
            self.work.newton.secants.direction(g, lambda r: self.work.newton.solve(self.scale * r)),
            now.rows,
        )
        pull = solved(self.X[:, self.columns], free[self.columns], ROWS)
        on = ~rows.unilateral | (now.r < 0.0)
        f, x = before, free[self.columns]
        for _ in range(CHANGES):
            x, f = self._held(now, pull, before, on)
            new = ~rows.unilateral | np.where(on, f > 0.0, now.r + now.G @ x < 0.0)
            if (new == on).all():
                break
            on = new
        share = self.sigma * x + self.scale * now.G.T @ (f - before)
        return free + share @ self.X, f

    def restored(self, now: Conditions) -> Array:
        """Least motion (n,) that closes rigid rows and opens inequalities that are violated."""
        on = now.rows.rigid | (now.rows.unilateral & (now.r < 0.0))
        if not on.any():
            return np.zeros(int(self.X.shape[1]))
        G = now.G[on]
        return -(G.T @ self._pushed(G, now.r[on])) @ self.X

    def held(self, now: Conditions, f: Array, rhs: Array) -> Array:
        """Solution (n,) for a right-hand side while rigid and active rows stay as they are."""
        x, on = self.work.newton.solve(rhs), now.rows.rigid | (now.rows.unilateral & (f > 0.0))
        if not on.any():
            return x
        G = np.zeros((int(on.sum()), len(x)))
        G[:, self.columns] = now.G[on]
        Y = now.G[on] @ self.X
        return held(x, G, Y @ G.T, lambda f: f @ Y, ROWS, cutoff=NOTHING)[0]

    def _held(self, now: Conditions, pull: Array, before: Array, on: Flags) -> tuple[Array, Array]:
        """Motion x (k,) and forces f of these rows: K x - s G'(f - f0) = p, G x + r + C f = 0.

        It solves for the change of the forces f0, because rounding of f, which may be 1e9 times the
        tolerance, would be left in the motion.
        """
        k, m, G = len(pull), int(on.sum()), now.G[on]
        stiffness = self.K + self.curvature
        # in units in which the diagonal is 1, because motions are in m and rad
        unit = np.sqrt(
            np.abs(np.diag(stiffness)).clip(1e-12 * float(np.abs(stiffness).max()) or 1.0)
        )
        hard, free = G[now.compliance[on] == 0.0] / unit, np.eye(k)
        if len(hard):
            with reported(ROWS):
                _, size, V = np.linalg.svd(hard)
            free = V[int((size > 1e-10 * size[0]).sum()) :].T
        if free.shape[1]:
            with reported(ROWS):
                bent = free.T @ (stiffness / np.outer(unit, unit)) @ free
                lowest = float(np.linalg.eigvalsh(bent)[0])
            if lowest < CONVEX:  # a descent direction needs a convex model along free motions
                stiffness = stiffness + (abs(lowest) + CONVEX) * np.diag(unit**2)
        saddle = np.block([[stiffness, -G.T], [G, np.diag(now.compliance[on] / self.scale)]])
        released = self.scale * now.G[~on].T @ before[~on]
        wanted = np.concatenate([pull - released, -(now.r + now.compliance * before)[on]])
        found = least(saddle, wanted, ROWS, NOTHING)
        f = np.zeros(len(on))
        f[on] = before[on] + found[k : k + m] / self.scale
        return found[:k], f


def curvature(potential: PotentialOfMoves, d: Array, now: Conditions, g: Array) -> Array:
    """Second derivative (k, k) of -f . c, with the forces f that balance a gradient g (k,) best.

    By differences: equilibria under joints may owe their stability to it alone, as a pendulum does.
    """
    columns, on = now.rows.columns, ~now.rows.unilateral | (now.r < ON)
    f = np.zeros(len(on))
    f[on] = least(now.G[on].T, g, ROWS, REDUNDANT)
    out, way = np.empty((len(columns), len(columns))), np.zeros(len(d))
    for k, column in enumerate(columns):
        way[column] = BESIDE
        out[k] = f @ (conditions(potential, d - way).G - conditions(potential, d + way).G)
        way[column] = 0.0
    return (out + out.T) / (4.0 * BESIDE)


def factorise(
    potential: PotentialOfMoves, point: Point, columns: Index, key: Key, work: Workspace
) -> int:
    """Factorise the matrix at a point; return the number of shifts.

    A multiple of the unit matrix is added on the columns of rows, unless the mass makes A definite.
    """
    with work.timed("tangent"):
        A = potential.matrix(point.d)
    sigma = 0.0
    if potential.duration == math.inf:
        sigma = float(np.abs(A.values[A.pattern.diagonal]).max()) or 1.0
    A.values[A.pattern.diagonal[columns]] += sigma
    shifts = work.newton.factorise(A, potential.shift, key)
    work.newton.on_rows = None
    potential.sigma = sigma
    return shifts


def reduced(potential: PotentialOfMoves, columns: Index, work: Workspace) -> Reduced:
    """Solutions for the columns by the present factor, once for each factor."""
    if work.newton.on_rows is not None and work.newton.on_rows[0] == work.newton.number:
        return cast(Reduced, work.newton.on_rows[1])
    unit = np.zeros((len(columns), potential.system.pattern.n))
    unit[np.arange(len(columns)), columns] = 1.0
    X = np.array([work.newton.solve(e) for e in unit])
    inverse = inverted(X[:, columns], ROWS)
    K = 0.5 * (inverse + inverse.T) - potential.sigma * np.eye(len(columns))
    made = Reduced(columns, potential.scale, potential.sigma, X, K, work)
    work.newton.on_rows = work.newton.number, made
    return made
