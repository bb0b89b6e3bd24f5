"""Forces of contacts with Coulomb friction that share a positive definite Delassus matrix."""

import numpy as np
from numpy.typing import NDArray

from sim._kernels.coulomb import sweep
from sim.contact.pushes import pushes
from sim.dense import reported
from sim.errors import SingularSystem
from sim.scene import Index
from sim.state import Array

CHANGES = 10  #: largest number of Newton's iterations from one start
TURNS, SWEEPS = 2, 50  #: starts, and sweeps before each but the first
SHARE = 1e-5  #: largest violation that remains, relative to that by the initial forces
ROUNDING = 1e-14  #: smallest such violation, relative to the gaps and slips without forces


def frictional(
    G: Array, c: Array, first: Index, friction: Array, before: Array
) -> tuple[Array, float]:
    """Forces (m,) that obey Coulomb's law for gaps and slips u = G f + c, and their violation [m].

    With components n and t along the normal and across it, the forces of each contact satisfy

        f_n = max(0, f_n - u_n / G_n),   f_t = P(f_t - u_t / G_t),

    where P projects onto the disc of radius mu f_n. Newton's method solves these equations until their
    violation is `SHARE` of that by the initial forces; where it cycles, sweeps over the contacts provide
    another start. Of forces that do not converge, the most accurate are returned, with the violation by
    which callers recognise them; it is 0 for others. All obey the bounds of Coulomb's law exactly.

    Parameters
    ----------
    G : (m, m) symmetric, positive definite [m/N].
    c : (m,) gaps and slips without the forces [m].
    first : (k,) normal force of each contact.
    friction : (k,) Coulomb's coefficient; where it is above 0, two forces across follow the normal one.
    before : (m,) initial forces [N].

    Notes
    -----
    Source: Hueeber, Stadler and Wohlmuth 2008, A primal-dual active set algorithm for three-dimensional
    contact problems with Coulomb friction, SIAM J. Sci. Comput. 30, 572-596.
    """
    if not (friction > 0.0).any():
        return pushes(G, c, before > 0.0), 0.0
    trial = best = _Trial(G, c, first, friction, before)
    error = max(SHARE * trial.missed, ROUNDING * float(np.abs(c).max()))
    single = G.astype(np.float32)
    for turn in range(TURNS):
        if turn > 0:
            f = best.f.copy()
            sweep(G, c, first, friction, f, SWEEPS, error)
            trial = _Trial(G, c, first, friction, f)
        for _ in range(CHANGES):
            try:
                f = trial.next(G, c, single)
            except SingularSystem:
                break
            trial = _Trial(G, c, first, friction, f)
            best = min(best, trial, key=lambda one: one.missed)
            if best.missed <= error:
                return best.bounded(first, friction), 0.0
    return best.bounded(first, friction), best.missed


class _Trial:
    """State of each contact at forces f (m,), and the largest violation of its equations [m]."""

    def __init__(self, G: Array, c: Array, first: Index, friction: Array, f: Array) -> None:
        u, stiff = G @ f + c, 1.0 / np.diag(G)
        pressed = f[first] - stiff[first] * u[first]
        closed = pressed > 0.0
        missed = np.abs(np.maximum(pressed, 0.0) - f[first]) / stiff[first]
        self.missed = float(missed.max(initial=0.0))
        rubs = np.flatnonzero(friction > 0.0)
        across = first[rubs, None] + np.array([1, 2])
        stiff_across = stiff[across].mean(axis=1)
        tau = f[across] - stiff_across[:, None] * u[across]
        size, bound = np.linalg.norm(tau, axis=1), friction[rubs] * np.maximum(pressed[rubs], 0.0)
        share = np.minimum(1.0, bound / np.where(size > 0.0, size, 1.0))
        missed = np.abs(share[:, None] * tau - f[across]) / stiff_across[:, None]
        self.missed = max(self.missed, float(missed.max(initial=0.0)))
        sticks, slides = closed[rubs] & (size <= bound), closed[rubs] & (size > bound)
        self.f, self._across = f, across[slides]
        self._held = np.concatenate([first[closed], across[sticks].ravel()])
        self._slides, self._mu = first[rubs[slides]], friction[rubs[slides]]
        self._place = np.searchsorted(first[closed], self._slides)
        self._along = tau[slides] / size[slides, None]
        self._turned = np.stack([-self._along[:, 1], self._along[:, 0]], axis=1)
        self._turning = (1.0 - share[slides]) / (share[slides] * stiff_across[slides])

    def bounded(self, first: Index, friction: Array) -> Array:
        """Forces (m,) within the bounds of Coulomb's law."""
        f, rubs = self.f.copy(), np.flatnonzero(friction > 0.0)
        f[first] = np.maximum(f[first], 0.0)
        across, bound = first[rubs, None] + np.array([1, 2]), friction[rubs] * f[first[rubs]]
        size = np.linalg.norm(f[across], axis=1)
        f[across] *= np.minimum(1.0, bound / np.where(size > 0.0, size, 1.0))[:, None]
        return f

    def next(self, G: Array, c: Array, single: NDArray[np.float32]) -> Array:
        """Forces (m,) of the equations linearised at the present ones.

        A sliding contact has f_t = mu f_n e + s p, with the unit vectors e along f_t - u_t / G_t and p
        across it, and (1 - b) s / b + p . u_t / G_t = 0 with the ratio b of bound and |f_t - u_t / G_t|.
        The correction is solved in single precision: its error is that of the next start.
        """
        held, slides, across = self._held, self._slides, self._across
        along, turned = self._mu[:, None] * self._along, self._turned
        s = np.einsum("ki,ki->k", turned, self.f[across])
        f = np.zeros(len(c))
        f[held] = self.f[held]
        f[across] = f[slides, None] * along + s[:, None] * turned
        u = G @ f + c
        missed = np.r_[u[held], np.einsum("ki,ki->k", turned, u[across]) + self._turning * s]
        x = np.empty_like(missed)
        with reported("the matrix of frictional contacts"):
            x[:] = np.linalg.solve(self._matrix(single), -missed.astype(np.float32))
        f[held] += x[: len(held)]
        f[across] = f[slides, None] * along + (s + x[len(held) :])[:, None] * turned
        return f

    def _matrix(self, G: NDArray[np.float32]) -> NDArray[np.float32]:
        """Derivative of the gaps and slips of held rows, and along p, by their forces and by s."""
        n, across = len(self._held), self._across
        turned, along = (
            self._turned.astype(G.dtype),
            (self._mu[:, None] * self._along).astype(G.dtype),
        )
        rows = np.empty((n + len(across), len(G)), G.dtype)
        rows[:n] = G[self._held]
        rows[n:] = turned[:, :1] * G[across[:, 0]] + turned[:, 1:] * G[across[:, 1]]
        matrix = np.empty((len(rows), len(rows)), G.dtype)
        matrix[:, :n] = rows[:, self._held]
        one, two = rows[:, across[:, 0]], rows[:, across[:, 1]]
        matrix[:, n:] = one * turned[:, 0] + two * turned[:, 1]
        matrix[:, self._place] += one * along[:, 0] + two * along[:, 1]
        at = np.arange(n, len(rows))
        matrix[at, at] += self._turning.astype(G.dtype)
        return matrix
