"""Limited-memory BFGS updates of an older factor."""

from collections import deque
from collections.abc import Callable, Mapping

import numpy as np

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

    def arrays(self) -> dict[str, Array]:
        """Steps s and gradient changes y (k, n) of all pairs; empty without pairs."""
        if not self._pairs:
            return {}
        s, y, _ = zip(*self._pairs, strict=True)
        return {"s": np.stack(s), "y": np.stack(y)}

    def restore(self, kept: Mapping[str, Array]) -> None:
        """Restore the pairs from `arrays`."""
        self.clear()
        if kept:
            rows = zip(kept["s"], kept["y"], strict=True)
            self._pairs.extend((s, y, 1.0 / dot(s, y)) for s, y in rows)

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
