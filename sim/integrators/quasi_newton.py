"""Quasi-Newton updates of the latest factor, from the steps since, (6) of docs/step.md."""

from collections import deque
from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from sim.dense import inverse
from sim.state import Array
from sim.vectors import dot, norm

Solve = Callable[[Array], Array]


class SecantMemory:
    """Limited-memory BFGS inverse Hessian, from the latest steps and gradient changes.

    A factor can be reused in many steps, because each pair (s, y) contains the difference of the
    current Hessian from the factorised one. Source: Nocedal and Wright, Numerical Optimization,
    Algorithm 7.4, with the old factor as initial inverse Hessian. `size` is the number of stored
    pairs.
    """

    def __init__(self, size: int = 8) -> None:
        self._pairs: deque[tuple[Array, Array, float]] = deque(maxlen=size)

    def clear(self) -> None:
        """Remove all pairs, as after a factorisation."""
        self._pairs.clear()

    def learn(self, s: Array, y: Array) -> None:
        """Add a step s and the gradient change y, if the curvature is positive."""
        sy = dot(s, y)
        if sy > 1e-10 * norm(s) * norm(y):
            self._pairs.append((s, y, 1.0 / sy))

    def direction(self, g: Array, solve: Solve) -> Array:
        """-H g, with `solve` the inverse of the factorised Hessian."""
        q, weights = -g, list[float]()
        for s, y, r in reversed(self._pairs):
            a = r * dot(s, q)
            q = q - a * y
            weights.append(a)
        z = solve(q)
        for (s, y, r), a in zip(self._pairs, reversed(weights), strict=True):
            z = z + (a - r * dot(y, z)) * s
        return z


class InverseSecants:
    """Compact BFGS H = H0 + E' M E of an inverse H0, with the latest steps and H0 y in E.

    Source: Byrd, Nocedal and Schnabel 1994, Representations of quasi-Newton matrices and their use
    in limited memory methods, Math. Programming 63, equation (2.6), with any H0. `size` is the
    number of stored pairs.
    """

    def __init__(self, size: int = 8) -> None:
        self._pairs: deque[tuple[Array, Array, Array]] = deque(maxlen=size)
        self._sides = np.empty((0, 0))
        self._middle = np.empty((0, 0))

    def clear(self) -> None:
        """Remove all pairs, as after a factorisation."""
        self._pairs.clear()
        self._lay_out()

    def learn(self, s: Array, y: Array, z: Array) -> None:
        """Add a step s, the change y of the gradient and z = H0 y, if the curvature is positive."""
        if dot(s, y) > 1e-10 * norm(s) * norm(y):
            self._pairs.append((s, y, z))
            self._lay_out()

    def _lay_out(self) -> None:
        m = len(self._pairs)
        if not m:
            self._sides, self._middle = np.empty((0, 0)), np.empty((0, 0))
            return
        S, Y, Z = (np.stack(part) for part in zip(*self._pairs, strict=True))
        SY, YZ = S @ Y.T, Y @ Z.T
        R = inverse(np.triu(SY), "the matrix of quasi-Newton updates")
        middle = R.T @ (np.diag(np.diag(SY)) + 0.5 * (YZ + YZ.T)) @ R
        self._sides = np.concatenate([S, Z])
        self._middle = np.block([[middle, -R.T], [-R, np.zeros((m, m))]])

    def added(self, r: Array) -> Array:
        """(H - H0) r."""
        if not len(self._middle):
            return np.zeros_like(r)
        return self._sides.T @ (self._middle @ (self._sides @ r))

    def seen_by(self, D: csr_array) -> Array:
        """D E' (m, k), for `between`."""
        if not len(self._middle):
            return np.zeros((D.shape[0], 0))
        return D @ self._sides.T

    def between(self, seen: Array) -> Array:
        """D (H - H0) D' (m, m) of directions `seen_by` this."""
        if not len(self._middle):
            return np.zeros((len(seen), len(seen)))
        return seen @ self._middle @ seen.T
