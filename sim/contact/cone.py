"""Forces of rows that share one Delassus matrix: equations, inequalities and Coulomb contacts.

They solve (5) of docs/step.md under the conditions (3): `solve_lcp` inequalities alone, `frictional`
contacts of tissue with a positive definite matrix, and `forces` also equations and rows that repeat
each other, as of joints and bodies.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cholesky, lstsq, solve_triangular
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs
from scipy.optimize import nnls

from sim._kernels.coulomb import sweep
from sim.dense import reported, solved
from sim.errors import SingularSystem
from sim.pattern import Flags
from sim.scene import Index
from sim.state import Array

CHANGES = 20  #: largest number of changes of an active set before a more robust method is used
LEAST_EIGENVALUE = (
    1e-6  #: smallest eigenvalue of a matrix of `solve_lcp`, relative to the largest one
)

STARTS, BETWEEN = 2, 50
"""Of `frictional`: starts of Newton's method, and sweeps before each but the first."""
NEWTON = 10  #: largest number of Newton's iterations from one start
VIOLATION_SHARE = 1e-5  #: largest violation that remains, relative to that by the initial forces
VIOLATION_ROUNDING = (
    1e-14  #: smallest such violation, relative to the gaps and slips without forces
)

SWEEPS, DIRECT_ATTEMPTS = 100, 40
"""Of `forces`: sweeps between two attempts to solve directly for the present states of all contacts;
attempts."""
SINGULAR_VALUES = (
    1e-12  #: relative size of singular values that are due to rows that repeat each other
)
REPEATED = 1e-9  #: share of its mobility that a row must retain under the equations
PROXIMAL = 1e-9  #: regularisation of proximal points, relative to the mobility
SLIP = 1e-9  #: share of the largest rate up to which a direct solution may violate a row


def solve_lcp(G: Array, c: Array, pushing: Flags) -> Array:
    """Forces f (m,) with f >= 0, G f + c >= 0 and f . (G f + c) = 0.

    G (m, m) is symmetric [m/N], and regularised until it is positive definite; c (m,) are the gaps
    without the forces [m]; `pushing` is the initial active set.

    Source: Hintermueller, Ito and Kunisch 2002, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13, 865-888. It may cycle for a general G; then the least squares |L'
    f + L^-1 c| with f >= 0 and G = L L' are solved by Lawson and Hanson 1974, which always ends.
    """
    try:
        return _pushes(G, c, pushing)
    except LinAlgError:
        with reported("the matrix of contacts"):
            values = np.linalg.eigvalsh(G)
            more = LEAST_EIGENVALUE * np.abs(values).max() - values[0]
            return _pushes(G + more * np.eye(len(G)), c, pushing)


def _pushes(G: Array, c: Array, pushing: Flags) -> Array:
    for _ in range(CHANGES):
        f, on = np.zeros(len(c)), np.flatnonzero(pushing)
        factor = cho_factor(G[on[:, None], on], check_finite=False)
        f[on] = cho_solve(factor, -c[on], check_finite=False)
        new = np.where(pushing, f > 0.0, G @ f + c < 0.0)
        if np.array_equal(new, pushing):
            return f
        pushing = new
    L = cholesky(G, lower=True)
    return np.asarray(nnls(L.T, -solve_triangular(L, c, lower=True))[0])


def frictional(
    G: Array, c: Array, first: Index, friction: Array, before: Array
) -> tuple[Array, float]:
    """Forces (m,) that obey Coulomb's law for gaps and slips u = G f + c, and their violation [m].

    With components n and t along the normal and across it, the forces of each contact satisfy

        f_n = max(0, f_n - u_n / G_n),   f_t = P(f_t - u_t / G_t),

    where P projects onto the disc of radius mu f_n. Newton's method solves these equations until their
    violation is `VIOLATION_SHARE` of that by the initial forces; where it cycles, sweeps over the
    contacts provide another start. Of forces that do not converge, the most accurate are returned, with
    the violation by which callers recognise them; it is 0 for others. All obey the bounds of Coulomb's
    law exactly.

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
        return solve_lcp(G, c, before > 0.0), 0.0
    trial = best = _Trial(G, c, first, friction, before)
    error = max(VIOLATION_SHARE * trial.missed, VIOLATION_ROUNDING * float(np.abs(c).max()))
    single = G.astype(np.float32)
    for turn in range(STARTS):
        if turn > 0:
            f = best.f.copy()
            sweep(G, c, first, friction, f, BETWEEN, error)
            trial = _Trial(G, c, first, friction, f)
        for _ in range(NEWTON):
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
        closed, slides, across = self._held, self._slides, self._across
        along, turned = self._mu[:, None] * self._along, self._turned
        s = np.einsum("ki,ki->k", turned, self.f[across])
        f = np.zeros(len(c))
        f[closed] = self.f[closed]
        f[across] = f[slides, None] * along + s[:, None] * turned
        u = G @ f + c
        missed = np.r_[u[closed], np.einsum("ki,ki->k", turned, u[across]) + self._turning * s]
        x = np.empty_like(missed)
        with reported("the matrix of frictional contacts"):
            x[:] = np.linalg.solve(self._matrix(single), -missed.astype(np.float32))
        f[closed] += x[: len(closed)]
        f[across] = f[slides, None] * along + (s + x[len(closed) :])[:, None] * turned
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


@dataclass(frozen=True, eq=False)
class Blocks:
    """Kinds of the unknown forces of m rows."""

    equations: Index  #: rows with S f + r = 0
    first: Index  #: (k,) first row of every other block
    #: (k,) Coulomb's coefficient; 0 for an inequality of one row, else the row is followed by two of
    #: tangential directions
    friction: Array

    @property
    def rest(self) -> Index:
        """Rows of all blocks."""
        size = np.where(self.friction > 0.0, 3, 1)
        start = np.repeat(self.first, size)
        return start + np.arange(len(start)) - np.repeat(np.cumsum(size) - size, size)


def forces(S: Array, r: Array, blocks: Blocks, before: Array, error: float) -> tuple[Array, float]:
    """Forces (m,), and the largest change of a rate that a further sweep would make.

    Equations are eliminated. Sweeps over the other blocks find which contacts are open, stick or slide,
    from the states of the initial forces; a direct solution for these states satisfies the rows to
    rounding, also where rows repeat each other. Forces of sweeps alone would leave a rate of `error` in
    every step, with which a stack turns over hundreds of steps.

    S (m, m) is symmetric positive semi-definite, r (m,) are the rates without forces and `before` (m,)
    the initial forces.

    Source: Jean 1999, The non-smooth contact dynamics method, Comput. Methods Appl. Mech. Eng. 177,
    235-257. The fixed points of the sweeps obey Coulomb's law, not the associated one that a quadratic
    programme over the friction cones has.
    """
    e, u = blocks.equations, blocks.rest
    f, left = np.zeros(len(r)), 0.0
    Seu = S[e[:, None], u]
    best = np.zeros((len(e), len(u) + 1))
    if len(e):
        best = solved(
            S[e[:, None], e], np.column_stack([Seu, r[e]]), "the matrix of equations of joints"
        )
    if len(u):
        among, b, x = S, r[u] - Seu.T @ best[:, -1], before[u].copy()
        if len(e):
            among = np.ascontiguousarray(S[u[:, None], u] - Seu.T @ best[:, :-1])
        # rows that the equations hold already may contradict them by rounding
        idle = np.abs(np.diag(among)) <= REPEATED * np.abs(np.diag(S)[u])
        if idle.any():
            among = np.where(idle[:, None] | idle, 0.0, among)
            b[idle], x[idle] = 0.0, 0.0
        first = np.searchsorted(u, blocks.first)
        f[u], left = _of_contacts(among, b, first, blocks.friction, x, error)
    f[e] = -best[:, -1] - best[:, :-1] @ f[u]
    return f, left


def _of_contacts(
    W: Array, b: Array, first: Index, friction: Array, x: Array, error: float
) -> tuple[Array, float]:
    """Forces of contacts and limits from initial ones; those that remain open are left out."""
    size = np.where(friction > 0.0, 3, 1)
    closed = (x[first] > 0.0) | ((W @ x + b)[first] < 0.0)
    if not closed.any():
        return np.zeros_like(x), 0.0
    while True:
        rows = np.flatnonzero(np.repeat(closed, size))
        some, start = W[rows[:, None], rows], np.cumsum(size[closed]) - size[closed]
        f, left = np.zeros_like(x), 0.0
        f[rows], left = _among(some, b[rows], start, friction[closed], x[rows], error)
        more = ~closed & ((W @ f + b)[first] < -error)
        if not more.any() or left == np.inf:
            return f, left
        closed, x = closed | more, f


def _among(
    W: Array, b: Array, first: Index, friction: Array, x: Array, error: float
) -> tuple[Array, float]:
    """Forces by a direct solution for the states of contacts, which sweeps find."""
    left = np.inf
    for turn in range(DIRECT_ATTEMPTS + 1):
        # directions of sliding change from step to step, so that those of the initial forces are not
        # exact
        stale = turn == 0 and _slides(first, friction, x).any()
        direct = None if stale else _direct(W, b, first, friction, x)
        if direct is None and turn == 0 and not (friction > 0.0).any():
            direct = _frictionless(W, b, first, friction, x)
        if direct is not None:
            return direct, 0.0
        if left <= error or turn == DIRECT_ATTEMPTS:
            break
        left = sweep(W, b, first, friction, x, SWEEPS, error)
        with np.errstate(invalid="ignore", over="ignore"):
            bounded = bool(np.isfinite(W @ x).all())
        if not bounded:
            return np.zeros_like(x), np.inf  # forces grow without bound if W is indefinite
        # an indefinite matrix may have rows that sweeps cannot close
        left = max(left, -float((W @ x + b)[first].min()))
    return x, left


def _slides(first: Index, friction: Array, x: Array) -> Flags:
    """Contacts with friction whose tangential force is at its bound."""
    n = first[friction > 0.0]
    bound = friction[friction > 0.0] * x[n]
    return (x[n] > 0.0) & (np.hypot(x[n + 1], x[n + 2]) >= bound * (1.0 - 1e-9))


def _solution(A: Array, b: Array) -> Array:
    """Solution of A x = b, the smallest one if rows repeat each other."""
    lu, pivots, info = dgetrf(A)
    if info == 0 and dgecon(lu, float(np.abs(A).sum(axis=0).max()))[0] > SINGULAR_VALUES:
        return np.asarray(dgetrs(lu, pivots, b)[0])
    with reported("the matrix of active contacts"):
        return np.asarray(lstsq(A, b, cond=SINGULAR_VALUES, check_finite=False)[0])


def _frictionless(W: Array, b: Array, first: Index, friction: Array, x: Array) -> Array | None:
    """Forces of contacts without friction by the primal-dual active set from x, or None.

    It ends wrongly where rows repeat each other with different gaps, of which only one can be closed.
    Proximal points, the forces of W + c 1 with the gaps b - c x, then approach a solution.

    Source: Hintermueller, Ito and Kunisch 2002, The primal-dual active set strategy as a semismooth
    Newton method, SIAM J. Optim. 13, 865-888; Rockafellar 1976, Monotone operators and the proximal
    point algorithm, SIAM J. Control Optim. 14, 877-898.
    """
    start, closed = x, x > 0.0
    for _ in range(CHANGES):
        on, x = np.flatnonzero(closed), np.zeros_like(x)
        if len(on):
            x[on] = _solution(W[on[:, None], on], -b[on])
        new = np.where(closed, x > 0.0, W @ x + b < 0.0)
        if (new == closed).all():
            direct = _direct(W, b, first, friction, x)
            if direct is not None:
                return direct
            break
        closed = new
    c, x = PROXIMAL * float(np.abs(np.diag(W)).max()), start
    for _ in range(CHANGES):
        x = solve_lcp(W + c * np.eye(len(W)), b - c * x, x > 0.0)
        direct = _direct(W, b, first, friction, x)
        if direct is not None:
            return direct
    return None


def _direct(W: Array, b: Array, first: Index, friction: Array, x: Array) -> Array | None:
    """Forces for the states of contacts at x, or None if these are not those of the solution."""
    n, rubs = first, np.flatnonzero(friction > 0.0)
    closed = x[n] > 0.0
    tangent = n[rubs, None] + np.array([1, 2])
    slides, size = _slides(first, friction, x), np.linalg.norm(x[tangent], axis=1)
    sticks = closed[rubs] & ~slides
    rows = np.concatenate([n[closed], tangent[sticks].ravel()])
    # friction of sliding contacts is a multiple of their normal force
    columns = W[:, rows].copy()
    normals = np.searchsorted(n[closed], n[rubs[slides]])
    along = friction[rubs[slides], None] * x[tangent[slides]] / size[slides, None]
    for k, place, direction in zip(normals, tangent[slides], along, strict=True):
        columns[:, k] += W[:, place] @ direction
    new = np.zeros_like(x)
    if len(rows):
        new[rows] = _solution(columns[rows], -b[rows])
    new[tangent[slides]] = along * new[n[rubs[slides]], None]
    rate = W @ new + b
    limit = SLIP * max(float(np.abs(b).max()), np.finfo(float).tiny)
    good = (new[n] >= 0.0).all() and (rate[n] >= -limit).all()
    good = good and float(np.abs(rate[rows]).max(initial=0.0)) <= limit
    friction_size = np.linalg.norm(new[tangent[sticks]], axis=1)
    good = (
        good
        and (friction_size <= friction[rubs[sticks]] * new[n[rubs[sticks]]] * (1.0 + 1e-9)).all()
    )
    slip = rate[tangent[slides]]
    across = slip[:, 0] * along[:, 1] - slip[:, 1] * along[:, 0]
    good = good and (np.einsum("ki,ki->k", slip, along) <= limit).all()
    good = good and float(np.abs(across).max(initial=0.0)) <= limit
    return new if good else None
