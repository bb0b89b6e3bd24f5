"""Linearly implicit steps of rigid bodies with joints and line muscles, dense and without allocation.

The equations are those of `sim.integrators.linearly_implicit` and `held`; matrices hold their lower
triangle. A step that needs more (an indefinite matrix, rows that repeat each other) is left to them.
"""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.frames import (
    cross,
    inner_product,
    minus,
    move,
    rotated,
    turned_tensor,
    vector,
)
from sim._kernels.joints import RowTable, evaluate_rows
from sim._kernels.lines import LineTable, tension
from sim._kernels.options import inner, kernel

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]

CHANGES = 20
"""Largest number of active-set updates."""


class BodyTable(NamedTuple):
    """Bodies, points on them, and paths of fibres.

    column : (n_bodies,) first velocity of every body, -1 where it is not free.
    mass, inertia, inverse, damping : (n_bodies,), (n_bodies, 3, 3) in the axes of the body, its inverse,
        and (n_bodies, 2).
    body, arm : body of every point, -1 for space, and its place in the axes of the body [m].
    load : (n_points, 3) constant forces [N].
    start, point : points start[k]..start[k + 1] of fibre k, entries of `point`.
    """

    column: Index
    mass: Array
    inertia: Array
    inverse: Array
    damping: Array
    body: Index
    arm: Array
    load: Array
    start: Index
    point: Index


class RowKinds(NamedTuple):
    """Kinds of rows, as of `sim.joints.compiled.Rows`."""

    unilateral: Flags
    rigid: Flags
    compliance: Array
    damping_time: Array


class Led(NamedTuple):
    """Prescribed bodies (k,), with frames (n, k, 7) and twists (n, k, 6) at the ends of steps."""

    body: Index
    frames: Array
    twists: Array


class Scratch(NamedTuple):
    """Memory of a step for n velocities, m rows, p points and k bodies."""

    frames: Array
    ahead: Array
    q: Array
    arm: Array
    force: Array
    carried: Array
    A: Array
    w0: Array
    w1: Array
    p: Array
    r: Array
    g: Array
    V: Array
    I: Array  # noqa: E741
    inverse: Array
    G: Array
    Y: Array
    S: Array
    T: Array
    c: Array
    drift: Array
    target: Array
    f: Array
    JA: Array
    JB: Array
    JP: Array
    on: Flags
    index: Index


@inner
def _row_product(A, i, B, j, n):
    s = 0.0
    for k in range(n):
        s += A[i, k] * B[j, k]
    return s


@inner
def _cholesky(A, n):
    """Lower factor in place of a lower triangle; False unless it is positive definite."""
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j] - _row_product(A, i, A, j, j)
            if j < i:
                A[i, j] = s / A[j, j]
            elif s > 0.0:
                A[i, i] = math.sqrt(s)
            else:
                return False
    return True


@inner
def _forward(L, x, n):
    for i in range(n):
        s = x[i]
        for j in range(i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]


@inner
def _backward(L, x, n):
    for i in range(n - 1, -1, -1):
        x[i] /= L[i, i]
        for j in range(i):
            x[j] -= L[i, j] * x[i]


@inner
def _solve_rows(scratch, b):
    """Forces f of the rows that are on with S f = -b, zero of others; False if S is singular."""
    on, index, f, T = scratch.on, scratch.index, scratch.f, scratch.T
    k = 0
    for i in range(len(on)):
        if on[i]:
            index[k] = i
            k += 1
    for i in range(k):
        for j in range(i + 1):
            T[i, j] = scratch.S[index[i], index[j]]
    if not _cholesky(T, k):
        return False
    x = scratch.target
    for i in range(k):
        x[i] = -b[index[i]]
    _forward(T, x, k)
    _backward(T, x, k)
    for i in range(len(on)):
        f[i] = 0.0
    for i in range(k):
        f[index[i]] = x[i]
    return True


@inner
def _complementary(scratch, kinds, b):
    """Forces with S f + b = 0 of equations and 0 <= f, S f + b >= 0 of inequalities, one of them zero.

    The primal-dual active set strategy of `sim.contact.pushes`.
    """
    on, f, S = scratch.on, scratch.f, scratch.S
    m = len(on)
    for i in range(m):
        on[i] = not kinds.unilateral[i] or b[i] < 0.0
    for _ in range(CHANGES):
        if not _solve_rows(scratch, b):
            return False
        same = True
        for i in range(m):
            if kinds.unilateral[i]:
                pushes = f[i] > 0.0
                if not on[i]:
                    s = b[i]
                    for j in range(m):
                        s += (S[i, j] if j <= i else S[j, i]) * f[j]
                    pushes = s < 0.0
                if pushes != on[i]:
                    on[i], same = pushes, False
        if same:
            return True
    return False


@inner
def _evaluate(table, rows, scratch):
    """Values c, derivatives G by the velocities, and rates by what is led, at `scratch.frames`."""
    G, JA, JB, c = scratch.G, scratch.JA, scratch.JB, scratch.c
    evaluate_rows(rows, scratch.frames, scratch.q, c, JA, JB, scratch.JP)
    for k in range(len(c)):
        G[k] = 0.0
        for side in range(2):
            b = rows.body_a[k] if side == 0 else rows.body_b[k]
            if b >= 0 and table.column[b] >= 0:
                J = JA if side == 0 else JB
                for d in range(6):
                    G[k, table.column[b] + d] += J[k, d]


@inner
def _drift(rows, twists, scratch):
    """Rates of rows by twists (n_bodies, 6)."""
    for k in range(len(scratch.c)):
        s = 0.0
        for side in range(2):
            b = rows.body_a[k] if side == 0 else rows.body_b[k]
            J = scratch.JA if side == 0 else scratch.JB
            if b >= 0:
                for d in range(6):
                    s += J[k, d] * twists[b, d]
        scratch.drift[k] = s


@inner
def _mobility(table, scratch):
    """Y = G M^-1 and S = G M^-1 G' with the inverse inertia of `scratch.inverse`."""
    G, Y, S, n = scratch.G, scratch.Y, scratch.S, len(scratch.w0)
    m = len(scratch.c)
    for b in range(len(table.column)):
        c, J = table.column[b], scratch.inverse[b]
        if c >= 0:
            for k in range(m):
                for d in range(3):
                    Y[k, c + d] = G[k, c + d] / table.mass[b]
                    Y[k, c + 3 + d] = (
                        J[d, 0] * G[k, c + 3] + J[d, 1] * G[k, c + 4] + J[d, 2] * G[k, c + 5]
                    )
    for i in range(m):
        for j in range(i + 1):
            S[i, j] = _row_product(G, i, Y, j, n)


@inner
def _side(V, s, e, sign):
    """Derivative V (3, 6) of a point at arm s by the twist of its body, times sign; V[3] = e . V."""
    for d in range(3):
        for k in range(6):
            V[d, k] = 0.0
        V[d, d] = sign
    V[1, 3], V[2, 3] = -sign * s[2], sign * s[1]
    V[0, 4], V[2, 4] = sign * s[2], -sign * s[0]
    V[0, 5], V[1, 5] = -sign * s[1], sign * s[0]
    for k in range(6):
        V[3, k] = e[0] * V[0, k] + e[1] * V[1, k] + e[2] * V[2, k]


@inner
def _add_block(A, row, column, V, W, factor):
    """A += factor V'(1 - e e') W."""
    for i in range(6):
        for j in range(6):
            A[row + i, column + j] += factor * (
                V[0, i] * W[0, j] + V[1, i] * W[1, j] + V[2, i] * W[2, j] - V[3, i] * W[3, j]
            )


@inner
def _segment(scratch, k):
    """Unit vector and length from point k to the next of a path."""
    d = minus(vector(scratch.q, k[1]), vector(scratch.q, k[0]))
    size = math.sqrt(inner_product(d, d))
    return (d[0] / size, d[1] / size, d[2] / size), size


@inner
def _add_line(table, lines, k, activation, scratch, by_damping, by_stiffness):
    """Forces of fibre k on its points, and its share of A.

    With the length L of the path the stiffness is F' g g' + F d2L/dx2, and the damping d g g', g =
    dL/dw. The turning of lever arms is added with the forces of all terms.
    """
    A, g, n, V = scratch.A, scratch.g, len(scratch.g), scratch.V
    total, first, last = 0.0, table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        _, size = _segment(scratch, (table.point[i], table.point[i + 1]))
        total += size
    _, F, slope = tension(lines, k, total, activation)
    for i in range(n):
        g[i] = 0.0
    rate = 0.0
    for i in range(first, last):
        a, b = table.point[i], table.point[i + 1]
        e, size = _segment(scratch, (a, b))
        rate += inner_product(e, minus(vector(scratch.carried, b), vector(scratch.carried, a)))
        for d in range(3):
            scratch.force[a, d] += F * e[d]
            scratch.force[b, d] -= F * e[d]
        ca = table.column[table.body[a]] if table.body[a] >= 0 else -1
        cb = table.column[table.body[b]] if table.body[b] >= 0 else -1
        _side(V[0], vector(scratch.arm, a), e, -1.0)
        _side(V[1], vector(scratch.arm, b), e, 1.0)
        factor = by_stiffness * F / size
        if ca >= 0:
            _add_block(A, ca, ca, V[0], V[0], factor)
        if cb >= 0:
            _add_block(A, cb, cb, V[1], V[1], factor)
        if ca >= 0 and cb >= 0:
            if ca >= cb:
                _add_block(A, ca, cb, V[0], V[1], factor)
            if cb >= ca:
                _add_block(A, cb, ca, V[1], V[0], factor)
        for d in range(6):
            if ca >= 0:
                g[ca + d] += V[0, 3, d]
            if cb >= 0:
                g[cb + d] += V[1, 3, d]
    along = by_stiffness * slope + by_damping * lines.damping[k]
    for i in range(n):
        if g[i] != 0.0:
            scratch.r[i] -= lines.damping[k] * rate * g[i]
            x = along * g[i]
            for j in range(i + 1):
                A[i, j] += x * g[j]


@inner
def _add_points(table, scratch, by_stiffness):
    """Forces and moments of the loads of all points, and the turning of their arms."""
    for p in range(len(table.body)):
        b = table.body[p]
        c = table.column[b] if b >= 0 else -1
        if c < 0:
            continue
        s, f = vector(scratch.arm, p), vector(scratch.force, p)
        moment = cross(s, f)
        sf = inner_product(s, f)
        for i in range(3):
            scratch.r[c + i] += f[i]
            scratch.r[c + 3 + i] += moment[i]
            scratch.A[c + 3 + i, c + 3 + i] += by_stiffness * sf
            for j in range(i + 1):
                scratch.A[c + 3 + i, c + 3 + j] -= by_stiffness * 0.5 * (s[i] * f[j] + s[j] * f[i])


@inner
def _place_points(table, frames, scratch):
    for p in range(len(table.body)):
        arm = rotated(frames, table.body[p], vector(table.arm, p))
        for d in range(3):
            scratch.arm[p, d] = arm[d]
            scratch.q[p, d] = arm[d]
            if table.body[p] >= 0:
                scratch.q[p, d] += frames[table.body[p], d]


@inner
def _carry(table, led, i, scratch):
    """Velocities of points by the prescribed bodies at the end of step i."""
    for p in range(len(table.body)):
        for d in range(3):
            scratch.carried[p, d] = 0.0
    for k in range(len(led.body)):
        u = (led.twists[i, k, 3], led.twists[i, k, 4], led.twists[i, k, 5])
        for p in range(len(table.body)):
            if table.body[p] == led.body[k]:
                v = cross(u, vector(scratch.arm, p))
                for d in range(3):
                    scratch.carried[p, d] = led.twists[i, k, d] + v[d]


@inner
def _start(table, frames, twists, h, scratch):
    """Momentum p and velocities w0 of the state, and A = 0."""
    scratch.A[:] = 0.0
    for b in range(len(table.column)):
        c = table.column[b]
        if c < 0:
            continue
        for d in range(6):
            scratch.w0[c + d] = twists[b, d]
        turned_tensor(frames, b, table.inertia[b], scratch.I)
        for d in range(3):
            scratch.p[c + d] = table.mass[b] * twists[b, d]
            scratch.p[c + 3 + d] = (
                scratch.I[d, 0] * twists[b, 3]
                + scratch.I[d, 1] * twists[b, 4]
                + scratch.I[d, 2] * twists[b, 5]
            )


@inner
def _add_mass(table, h, scratch):
    """A += M where the velocities at the start lead; `scratch.ahead` are the frames at the start."""
    for b in range(len(table.column)):
        c = table.column[b]
        if c < 0:
            continue
        for d in range(6):
            scratch.g[c + d] = h * scratch.w0[c + d]
        move(scratch.ahead, b, scratch.g, c)
        turned_tensor(scratch.ahead, b, table.inertia[b], scratch.I)
        for i in range(3):
            scratch.A[c + i, c + i] += table.mass[b]
            for j in range(i + 1):
                scratch.A[c + 3 + i, c + 3 + j] += scratch.I[i, j]


@inner
def _equation(table, lines, activation, h, theta, scratch):
    """Factor of A = M + theta h D + (theta h)^2 K, and the velocities w1 without rows.

    A w1 = p + h f - (1 - theta)/theta (A - M) w0: implicit Euler for theta = 1, the trapezoidal rule for
    theta = 1/2.
    """
    A, r, w0, w1, n = scratch.A, scratch.r, scratch.w0, scratch.w1, len(scratch.w0)
    by_damping, by_stiffness = theta * h, (theta * h) ** 2
    for i in range(n):
        r[i] = 0.0
    for p in range(len(table.body)):
        for d in range(3):
            scratch.force[p, d] = table.load[p, d]
    for k in range(len(table.start) - 1):
        _add_line(table, lines, k, activation, scratch, by_damping, by_stiffness)
    _add_points(table, scratch, by_stiffness)
    for b in range(len(table.column)):
        c = table.column[b]
        if c >= 0:
            for d in range(6):
                A[c + d, c + d] += by_damping * table.damping[b, d // 3]
    for i in range(n):
        w1[i] = scratch.p[i] + h * r[i]
    if theta < 1.0:
        left = (1.0 - theta) / theta
        for i in range(n):
            w1[i] -= left * A[i, i] * w0[i]
            for j in range(i):
                w1[i] -= left * A[i, j] * w0[j]
                w1[j] -= left * A[i, j] * w0[i]
    _add_mass(table, h, scratch)
    if not _cholesky(A, n):
        return False
    _forward(A, w1, n)
    _backward(A, w1, n)
    return True


@inner
def _hold(rows, kinds, table, twists, h, scratch):
    """Add h A^-1 G'f with the forces of rows to w1, as `sim.integrators.held.held_solution`."""
    m, n, S, G, Y = len(scratch.c), len(scratch.w0), scratch.S, scratch.G, scratch.Y
    _evaluate(table, rows, scratch)
    _drift(rows, twists, scratch)
    for i in range(m):
        for j in range(n):
            Y[i, j] = G[i, j]
        _forward(scratch.A, Y[i], n)
        for j in range(i + 1):
            S[i, j] = h * _row_product(Y, i, Y, j, n)
        time = h if kinds.unilateral[i] else h + kinds.damping_time[i]
        S[i, i] += kinds.compliance[i] / time
        b = scratch.drift[i]
        for j in range(n):
            b += G[i, j] * scratch.w1[j]
        scratch.drift[i] = b if kinds.rigid[i] else b + scratch.c[i] / time
    if not _complementary(scratch, kinds, scratch.drift):
        return False
    for j in range(n):
        scratch.g[j] = 0.0
    for i in range(m):
        for j in range(n):
            scratch.g[j] += h * scratch.f[i] * Y[i, j]
    _backward(scratch.A, scratch.g, n)
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True


@inner
def _push(scratch, n):
    """Sum Y'f of the forces of rows, into g."""
    for j in range(n):
        scratch.g[j] = 0.0
    for i in range(len(scratch.f)):
        if scratch.f[i] != 0.0:
            for j in range(n):
                scratch.g[j] += scratch.f[i] * scratch.Y[i, j]


@inner
def _project(rows, kinds, table, twists, most, drift, scratch):
    """Bring frames and velocities back to the rows, as `sim.joints.compiled.Rows.projected`."""
    m, n, on = len(scratch.c), len(scratch.w0), scratch.on
    for b in range(len(table.column)):
        if table.column[b] >= 0:
            turned_tensor(scratch.frames, b, table.inverse[b], scratch.inverse[b])
    for turn in range(most + 1):
        _evaluate(table, rows, scratch)
        worst = 0.0
        for i in range(m):
            on[i] = kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift)
            if on[i]:
                worst = max(worst, abs(scratch.c[i]))
        _mobility(table, scratch)
        if turn == most or not worst > drift:
            break
        if not _solve_rows(scratch, scratch.c):
            return False
        # the force of S f = -c changes the rows by -c
        _push(scratch, n)
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                move(scratch.frames, b, scratch.g, table.column[b])
    _drift(rows, twists, scratch)
    for i in range(m):
        on[i] = kinds.rigid[i]
        for j in range(n):
            scratch.drift[i] += scratch.G[i, j] * scratch.w1[j]
    if not _solve_rows(scratch, scratch.drift):
        return False
    _push(scratch, n)
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True


@kernel
def advance_bodies(
    table: BodyTable,
    lines: LineTable,
    rows: RowTable,
    kinds: RowKinds,
    led: Led,
    scratch: Scratch,
    h: Array,
    activation: Array,
    theta: float,
    most: int,
    drift: float,
    frames: Array,
    twists: Array,
    q: Array,
    v: Array,
) -> int:
    """Advance frames and twists by steps h (n,) under activations (n, n_muscles); return the steps done.

    Positions q and velocities v of the points follow. A step that needs the general path leaves all as
    it was before it. Projections: at most `most`, until rows leave at most `drift`.
    """
    done, still = 0, np.zeros_like(twists)
    for i in range(len(h)):
        scratch.frames[:] = frames
        scratch.ahead[:] = frames
        for k in range(len(led.body)):
            scratch.frames[led.body[k]] = led.frames[i, k]
            still[led.body[k]] = led.twists[i, k]
        _start(table, frames, twists, h[i], scratch)
        _place_points(table, scratch.frames, scratch)
        _carry(table, led, i, scratch)
        if not _equation(table, lines, activation[i], h[i], theta, scratch):
            break
        if len(scratch.c) > 0 and not _hold(rows, kinds, table, still, h[i], scratch):
            break
        for j in range(len(scratch.g)):
            scratch.g[j] = h[i] * ((1.0 - theta) * scratch.w0[j] + theta * scratch.w1[j])
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                move(scratch.frames, b, scratch.g, table.column[b])
        if len(scratch.c) > 0 and not _project(rows, kinds, table, still, most, drift, scratch):
            break
        finite = True
        for j in range(len(scratch.w1)):
            finite = finite and math.isfinite(scratch.w1[j])
        if not finite:
            break
        frames[:] = scratch.frames
        twists[:] = still
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                for d in range(6):
                    twists[b, d] = scratch.w1[table.column[b] + d]
        done = i + 1
    _place_points(table, frames, scratch)
    for p in range(len(table.body)):
        b = table.body[p]
        for d in range(3):
            q[p, d] = scratch.q[p, d]
            v[p, d] = 0.0
        if b >= 0:
            u = cross((twists[b, 3], twists[b, 4], twists[b, 5]), vector(scratch.arm, p))
            for d in range(3):
                v[p, d] = twists[b, d] + u[d]
    return done
