"""Generalised forces of line muscles and loads on rigid bodies, and their share of the step's matrix."""

# pyright: basic

import math

from sim._kernels.frames import add, cross, inner_product, minus, vector
from sim._kernels.lines import passive_tension, tension, velocity_factor
from sim._kernels.options import bare


@bare
def _slope(scratch, p, e, sign):
    """Derivative of e . x of point p by the twist of its body, times sign."""
    m = cross(vector(scratch.arm, p), e)
    return (sign * e[0], sign * e[1], sign * e[2], sign * m[0], sign * m[1], sign * m[2])


@bare
def _add_row(A, i, column, v, factor):
    """A[i, column:column + 6] += factor v, a pair of vectors."""
    add(A, i, column, v[0], factor)
    add(A, i, column + 3, v[1], factor)


@bare
def _add_outer(A, row, column, u, v, factor):
    """A += factor u v'."""
    v = (factor * v[0], factor * v[1], factor * v[2]), (factor * v[3], factor * v[4], factor * v[5])
    _add_row(A, row, column, v, u[0])
    _add_row(A, row + 1, column, v, u[1])
    _add_row(A, row + 2, column, v, u[2])
    _add_row(A, row + 3, column, v, u[3])
    _add_row(A, row + 4, column, v, u[4])
    _add_row(A, row + 5, column, v, u[5])


@bare
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
    if row != column:  # only the lower triangle of blocks on the diagonal is required
        A[row + 0, column + 4] += factor * t[2]
        A[row + 0, column + 5] -= factor * t[1]
        A[row + 1, column + 3] -= factor * t[2]
        A[row + 1, column + 5] += factor * t[0]
        A[row + 2, column + 3] += factor * t[1]
        A[row + 2, column + 4] -= factor * t[0]


@bare
def _add_six(g, c, u):
    g[c] += u[0]
    g[c + 1] += u[1]
    g[c + 2] += u[2]
    g[c + 3] += u[3]
    g[c + 4] += u[4]
    g[c + 5] += u[5]


@bare
def _segment(q, a, b):
    """Unit vector and length from point a to point b."""
    d = minus(vector(q, b), vector(q, a))
    size = math.sqrt(inner_product(d, d))
    return (d[0] / size, d[1] / size, d[2] / size), size


@bare
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


@bare
def _rate(table, k, scratch):
    """Rate of the length of fibre k at the start of the step [m/s]."""
    rate = 0.0
    for i in range(table.start[k], table.start[k + 1] - 1):
        a, b = table.point[i], table.point[i + 1]
        e, _ = _segment(scratch.q, a, b)
        rate += inner_product(e, minus(vector(scratch.v, b), vector(scratch.v, a)))
    return rate


@bare
def add_line(table, lines, k, activation, scratch, by_damping, by_stiffness):
    """Forces of fibre k on its points, and its share of A.

    With the length L of the path the stiffness is F' g g' + F d2L/dx2, and the damping d g g', g =
    dL/dw. The rotation of lever arms is added with the forces of all terms; segments between points of
    one body contribute nothing. A force-velocity relation is linear about the rate r of the start of the
    step, with the force F_act (f_v(r) - 1 - f_v' r) and the damping F_act f_v'.
    """
    A, g, n = scratch.A, scratch.g, len(scratch.g)
    total, first, last = 0.0, table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        _, size = _segment(scratch.q, table.point[i], table.point[i + 1])
        total += size
    _, F, slope = tension(lines, k, total, activation)
    damping, excess = lines.damping[k], 0.0
    if lines.relation[k, 0] > 0.0:
        rate = _rate(table, k, scratch)
        active = F - passive_tension(lines, k, total)
        excess, steep = velocity_factor(lines, k, rate)
        excess = active * (excess - steep * rate)
        damping += active * steep
    along = by_stiffness * slope + by_damping * damping
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
    pull = damping * rate + excess
    if pull != 0.0:
        for i in range(n):
            scratch.r[i] -= pull * g[i]
    if not one and along != 0.0:
        for i in range(n):
            if g[i] != 0.0:
                x = along * g[i]
                for j in range(i + 1):
                    A[i, j] += x * g[j]


@bare
def add_morsels(table, whole, scratch, by_damping, by_stiffness):
    """Forces of whole morsels on their points, and their share of A, as `sim.terms.crushable`."""
    for k in range(len(table.morsel)):
        p = table.morsel[k]
        normal, d = vector(table.plane[k : k + 1, 3:6], 0), morsel_gap(table, k, scratch)
        left = table.plane[k, 6] - d
        if not whole[k] or left <= 0.0:
            continue
        stiffness = table.plane[k, 7] / table.plane[k, 6]
        add(scratch.force, p, 0, normal, stiffness * left)
        c = table.column[table.body[p]] if table.body[p] >= 0 else -1
        if c >= 0:
            u = _slope(scratch, p, normal, 1.0)
            along = by_stiffness * stiffness + by_damping * table.plane[k, 8]
            _add_outer(scratch.A, c, c, u, u, along)


@bare
def morsel_gap(table, k, scratch):
    """Distance of the point of morsel k from its plane, at the positions of `scratch.q`."""
    d = 0.0
    for i in range(3):
        d += (scratch.q[table.morsel[k], i] - table.plane[k, i]) * table.plane[k, 3 + i]
    return d


@bare
def add_points(table, scratch, by_stiffness):
    """Forces and moments of the loads of all points, and the rotation of their arms."""
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
