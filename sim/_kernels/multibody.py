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
    add,
    cross,
    inner_product,
    minus,
    move,
    put,
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

KEPT = 1e-9
"""Violation of rows up to which an earlier factor corrects them [m, rad]."""


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
    held: Array
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
    first = 0
    while first < n and x[first] == 0.0:
        first += 1
    for i in range(first, n):
        s = x[i]
        for j in range(first, i):
            s -= L[i, j] * x[j]
        x[i] = s / L[i, i]


@inner
def _backward(L, x, n):
    for i in range(n - 1, -1, -1):
        x[i] /= L[i, i]
        for j in range(i):
            x[j] -= L[i, j] * x[i]


@inner
def _factor_rows(scratch):
    """Factor of S over the rows that are on; their number, -1 if S is singular."""
    on, index, T = scratch.on, scratch.index, scratch.T
    k = 0
    for i in range(len(on)):
        if on[i]:
            index[k] = i
            k += 1
    for i in range(k):
        for j in range(i + 1):
            T[i, j] = scratch.S[index[i], index[j]]
    return k if _cholesky(T, k) else -1


@inner
def _solve_rows(scratch, k, b):
    """Forces f with S f = -b of the k rows that are on, zero of others."""
    f, x = scratch.f, scratch.target
    for i in range(k):
        x[i] = -b[scratch.index[i]]
    _forward(scratch.T, x, k)
    _backward(scratch.T, x, k)
    for i in range(len(f)):
        f[i] = 0.0
    for i in range(k):
        f[scratch.index[i]] = x[i]


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
        k = _factor_rows(scratch)
        if k < 0:
            return False
        _solve_rows(scratch, k, b)
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
def _mobility(table, rows, scratch):
    """Y = G M^-1 and S = G M^-1 G' with the inverse inertia of `scratch.inverse`."""
    G, Y, S, n = scratch.G, scratch.Y, scratch.S, len(scratch.w0)
    for k in range(len(scratch.c)):
        for j in range(n):
            Y[k, j] = 0.0
        for side in range(2):
            b = rows.body_a[k] if side == 0 else rows.body_b[k]
            c = table.column[b] if b >= 0 else -1
            if c >= 0:
                for d in range(3):
                    Y[k, c + d] = G[k, c + d] / table.mass[b]
                    Y[k, c + 3 + d] = (
                        scratch.inverse[b, d, 0] * G[k, c + 3]
                        + scratch.inverse[b, d, 1] * G[k, c + 4]
                        + scratch.inverse[b, d, 2] * G[k, c + 5]
                    )
        for j in range(k + 1):
            S[k, j] = _row_product(G, k, Y, j, n)


@inner
def _slope(scratch, p, e, sign):
    """Derivative of e . x of point p by the twist of its body, times sign."""
    m = cross(vector(scratch.arm, p), e)
    return (sign * e[0], sign * e[1], sign * e[2], sign * m[0], sign * m[1], sign * m[2])


@inner
def _add_row(A, i, column, v, factor):
    """A[i, column:column + 6] += factor v, a pair of vectors."""
    add(A, i, column, v[0], factor)
    add(A, i, column + 3, v[1], factor)


@inner
def _add_outer(A, row, column, u, v, factor):
    """A += factor u v'."""
    v = (factor * v[0], factor * v[1], factor * v[2]), (factor * v[3], factor * v[4], factor * v[5])
    _add_row(A, row, column, v, u[0])
    _add_row(A, row + 1, column, v, u[1])
    _add_row(A, row + 2, column, v, u[2])
    _add_row(A, row + 3, column, v, u[3])
    _add_row(A, row + 4, column, v, u[4])
    _add_row(A, row + 5, column, v, u[5])


@inner
def _add_arms(A, row, column, s, t, factor):
    """A += factor V'W of the derivatives V, W of two points by twists, with arms s and t."""
    st = factor * inner_product(s, t)
    A[row, column] += factor
    A[row + 1, column + 1] += factor
    A[row + 2, column + 2] += factor
    A[row + 3, column + 3] += st
    A[row + 4, column + 4] += st
    A[row + 5, column + 5] += st
    add(A, row + 3, column + 3, s, -factor * t[0])
    add(A, row + 4, column + 3, s, -factor * t[1])
    add(A, row + 5, column + 3, s, -factor * t[2])
    A[row + 3, column + 1] -= factor * s[2]
    A[row + 3, column + 2] += factor * s[1]
    A[row + 4, column + 0] += factor * s[2]
    A[row + 4, column + 2] -= factor * s[0]
    A[row + 5, column + 0] -= factor * s[1]
    A[row + 5, column + 1] += factor * s[0]
    if row != column:  # of blocks on the diagonal the lower triangle suffices
        A[row + 0, column + 4] += factor * t[2]
        A[row + 0, column + 5] -= factor * t[1]
        A[row + 1, column + 3] -= factor * t[2]
        A[row + 1, column + 5] += factor * t[0]
        A[row + 2, column + 3] += factor * t[1]
        A[row + 2, column + 4] -= factor * t[0]


@inner
def _add_six(g, c, u):
    g[c] += u[0]
    g[c + 1] += u[1]
    g[c + 2] += u[2]
    g[c + 3] += u[3]
    g[c + 4] += u[4]
    g[c + 5] += u[5]


@inner
def _segment(q, a, b):
    """Unit vector and length from point a to point b."""
    d = minus(vector(q, b), vector(q, a))
    size = math.sqrt(inner_product(d, d))
    return (d[0] / size, d[1] / size, d[2] / size), size


@inner
def _add_segment(table, a, b, e, across, along, scratch):
    """A += across V'V + along (V'e)(V'e)' with the derivative V of the vector from point a to b."""
    A = scratch.A
    ca = table.column[table.body[a]] if table.body[a] >= 0 else -1
    cb = table.column[table.body[b]] if table.body[b] >= 0 else -1
    s, t = vector(scratch.arm, a), vector(scratch.arm, b)
    u, v = _slope(scratch, a, e, -1.0), _slope(scratch, b, e, 1.0)
    if ca >= 0:
        _add_arms(A, ca, ca, s, s, across)
        _add_outer(A, ca, ca, u, u, along)
    if cb >= 0:
        _add_arms(A, cb, cb, t, t, across)
        _add_outer(A, cb, cb, v, v, along)
    if ca > cb and cb >= 0:
        _add_arms(A, ca, cb, s, t, -across)
        _add_outer(A, ca, cb, u, v, along)
    if cb > ca and ca >= 0:
        _add_arms(A, cb, ca, t, s, -across)
        _add_outer(A, cb, ca, v, u, along)
    if ca >= 0:
        _add_six(scratch.g, ca, u)
    if cb >= 0:
        _add_six(scratch.g, cb, v)


@inner
def _add_line(table, lines, k, activation, scratch, by_damping, by_stiffness):
    """Forces of fibre k on its points, and its share of A.

    With the length L of the path the stiffness is F' g g' + F d2L/dx2, and the damping d g g', g =
    dL/dw. The turning of lever arms is added with the forces of all terms; segments between points of
    one body have none of them.
    """
    A, g, n = scratch.A, scratch.g, len(scratch.g)
    total, first, last = 0.0, table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        _, size = _segment(scratch.q, table.point[i], table.point[i + 1])
        total += size
    _, F, slope = tension(lines, k, total, activation)
    along = by_stiffness * slope + by_damping * lines.damping[k]
    one = last == first + 1
    for i in range(n):
        g[i] = 0.0
    rate = 0.0
    for i in range(first, last):
        a, b = table.point[i], table.point[i + 1]
        if table.body[a] == table.body[b]:
            continue
        e, size = _segment(scratch.q, a, b)
        rate += inner_product(e, minus(vector(scratch.carried, b), vector(scratch.carried, a)))
        add(scratch.force, a, 0, e, F)
        add(scratch.force, b, 0, e, -F)
        across = by_stiffness * F / size
        _add_segment(table, a, b, e, across, (along if one else 0.0) - across, scratch)
    pull = lines.damping[k] * rate
    if pull != 0.0:
        for i in range(n):
            scratch.r[i] -= pull * g[i]
    if not one and along != 0.0:
        for i in range(n):
            if g[i] != 0.0:
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
        _add_six(scratch.r, c, (f[0], f[1], f[2], moment[0], moment[1], moment[2]))
        # trace(s f') 1 less the symmetric part of s f'
        A, k, half = scratch.A, c + 3, 0.5 * by_stiffness
        A[k, k] += by_stiffness * (sf - s[0] * f[0])
        A[k + 1, k + 1] += by_stiffness * (sf - s[1] * f[1])
        A[k + 2, k + 2] += by_stiffness * (sf - s[2] * f[2])
        A[k + 1, k] -= half * (s[1] * f[0] + s[0] * f[1])
        A[k + 2, k] -= half * (s[2] * f[0] + s[0] * f[2])
        A[k + 2, k + 1] -= half * (s[2] * f[1] + s[1] * f[2])


@inner
def _place_points(table, frames, scratch):
    for p in range(len(table.body)):
        arm = rotated(frames, table.body[p], vector(table.arm, p))
        put(scratch.arm, p, 0, arm, 1.0)
        put(scratch.q, p, 0, arm, 1.0)
        if table.body[p] >= 0:
            add(scratch.q, p, 0, vector(frames, table.body[p]), 1.0)


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
        scratch.held[i] = scratch.f[i]
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
    k = -1
    for turn in range(most + 1):
        _evaluate(table, rows, scratch)
        worst, more = 0.0, k < 0
        for i in range(m):
            held = kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift)
            if held:
                worst = max(worst, abs(scratch.c[i]))
                more = more or not on[i]
        if turn == most or not worst > drift:
            break
        # the directions of a pose so near differ by less than rounding
        if more or worst > KEPT:
            for i in range(m):
                on[i] = kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift)
            _mobility(table, rows, scratch)
            k = _factor_rows(scratch)
            if k < 0:
                return False
        _solve_rows(scratch, k, scratch.c)
        # the forces of S f = -c change the rows by -c
        _push(scratch, n)
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                move(scratch.frames, b, scratch.g, table.column[b])
    _drift(rows, twists, scratch)
    for i in range(m):
        on[i] = kinds.rigid[i]
        for j in range(n):
            scratch.drift[i] += scratch.G[i, j] * scratch.w1[j]
    _mobility(table, rows, scratch)
    k = _factor_rows(scratch)
    if k < 0:
        return False
    _solve_rows(scratch, k, scratch.drift)
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
    reaction: Array,
) -> int:
    """Advance frames and twists by steps h (n,) under activations (n, n_muscles); return the steps done.

    Positions q and velocities v of the points, and the forces of rows in the last step, follow. A step
    that needs the general path leaves all as it was before it. Projections: at most `most`, until rows
    leave at most `drift`.
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
        # forces of rows in their direction at the start, and those by which the rows turn
        for j in range(len(reaction)):
            reaction[j] = scratch.held[j] + scratch.f[j] / h[i]
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
