"""Stiffness of an equilibrium under joints, (9) of docs/step.md.

It is that of the tissue, reduced to the few velocities x_c = E'x on which joints act, with the curvature
B of the rows, to which a pendulum alone owes its stability. Multiples of G'G of rigid rows, G x + r = 0,
make it definite and leave the motion as it is (augmented Lagrangian; Nocedal and Wright, Numerical
Optimization, 17.3).
"""

import numpy as np
from scipy.sparse import csr_array

from sim.dense import inverse, least, reported
from sim.integrators.factor import NewtonFactor
from sim.integrators.newton import Point, PotentialOfMoves
from sim.integrators.rows_of_step import JointRows, joint_rows
from sim.joints.compiled import JOINT_MATRIX, REDUNDANT
from sim.linear.contract import Matrix
from sim.scene import Index
from sim.state import Array

CURVATURE_DIFFERENCE = 1e-5  #: motions between which the curvature of rows is differenced [m, rad]
ON = 1e-9  #: value below which an inequality counts as active [m, rad]
CONVEX = 1e-4  #: least curvature along motions that the rows allow, relative to the largest one
TENFOLD_SHIFTS = 12  #: largest number of tenfold multiples of G'G
LARGEST_MOTION = 0.5
"""Largest motion of bodies in an iteration [m, rad], beyond which the model is not used."""


class ReducedStiffness:
    """Solutions with the stiffness A + E (B - sigma) E' by a factor of A + sigma E E'."""

    def __init__(self, columns: Index, sigma: float, factor: NewtonFactor) -> None:
        self._columns, self._sigma, self._factor = columns, sigma, factor
        self._solutions: Array | None = None
        self._factorised = self._stiffness = self._inverse = np.zeros((0, 0))

    @classmethod
    def regularised(
        cls, phi: PotentialOfMoves, A: Matrix, factor: NewtonFactor
    ) -> "ReducedStiffness":
        """Add sigma to a matrix on the velocities of joints, before it is factorised."""
        assert phi.system.rows is not None  # callers check that the scene has joints
        columns = phi.system.rows.columns
        sigma = float(np.abs(A.values[A.pattern.diagonal]).max()) or 1.0
        A.values[A.pattern.diagonal[columns]] += sigma
        return cls(columns, sigma, factor)

    def bend(self, phi: PotentialOfMoves, at: Point, rows: JointRows) -> None:
        """Set the curvature of the rows at a point."""
        if self._solutions is None:
            unit = np.zeros((len(self._columns), len(at.d)))
            unit[np.arange(len(unit)), self._columns] = 1.0
            self._solutions = np.array([self._factor.solve(e) for e in unit])
            self._factorised = inverse(self._solutions[:, self._columns], JOINT_MATRIX)
        own = self._factorised - self._sigma * np.eye(len(self._columns))
        own = 0.5 * (own + own.T) + _curvature(phi, at, rows)
        rigid = ~rows.unilateral & (rows.compliance == 0.0)
        self._stiffness = _definite(own, rows.G[rigid], self._sigma)
        self._inverse = inverse(self._stiffness, JOINT_MATRIX)

    def solve(self, rhs: Array) -> Array:
        """Solution (n,) for a right-hand side."""
        assert self._solutions is not None  # `bend` sets it
        x = self._factor.solve(rhs)
        pull = self._factorised @ x[self._columns]
        return x - ((self._stiffness - self._factorised) @ (self._inverse @ pull)) @ self._solutions

    def between(self, G: csr_array) -> Array:
        """Delassus matrix (m, m) of rows (m, n)."""
        own = np.asarray(G.toarray())[:, self._columns]
        return np.asarray(own @ self._inverse @ own.T)


def _definite(K: Array, G: Array, rho: float) -> Array:
    """K with a multiple of G'G, at least `rho`, and of a diagonal if it is not convex along G x = 0."""
    # in units in which the diagonal is 1, because motions are in m and rad
    size = np.abs(np.diag(K))
    unit = np.sqrt(size.clip(1e-12 * float(np.abs(K).max()) or 1.0))
    hard, free, stiffness = G / unit, np.eye(len(K)), K
    with reported(JOINT_MATRIX):
        if len(hard):
            _, singular, V = np.linalg.svd(hard)
            free = V[int((singular > 1e-10 * singular[0]).sum()) :].T
        if free.shape[1]:
            lowest = float(np.linalg.eigvalsh(free.T @ (K / np.outer(unit, unit)) @ free)[0])
            if lowest < CONVEX:
                stiffness = K + (abs(lowest) + CONVEX) * np.diag(unit**2)
        for _ in range(TENFOLD_SHIFTS if len(G) else 0):
            closing = stiffness + rho * (G.T @ G)
            if np.linalg.eigvalsh(closing / np.outer(unit, unit))[0] > 0.0:
                return closing
            rho *= 10.0
    return stiffness


def _curvature(phi: PotentialOfMoves, at: Point, now: JointRows) -> Array:
    """Second derivative (k, k) of -f . c by differences; the forces f balance the gradient best."""
    columns, on = now.columns, ~now.unilateral | (now.value < ON)
    f = np.zeros(len(on))
    f[on] = least(now.G[on].T, at.g[columns], JOINT_MATRIX, REDUNDANT)
    out, way = np.empty((len(columns), len(columns))), np.zeros(len(at.d))
    for k, column in enumerate(columns):
        way[column] = CURVATURE_DIFFERENCE
        out[k] = f @ (joint_rows(phi, at.d - way).G - joint_rows(phi, at.d + way).G)
        way[column] = 0.0
    return (out + out.T) / (4.0 * CURVATURE_DIFFERENCE)
