"""Generalised forces of line muscles and loads on rigid bodies, and their share of the step's matrix."""

# pyright: basic

import math

from sim._kernels.frames import add, cross, inner_product, minus, put, vector
from sim._kernels.lines import passive_tension, tension, velocity_factor
from sim._kernels.options import bare


@bare
def _add_block(A, row, column, s, t, e, across, along):
    """A += V'(across 1 + along e e')W of derivatives V, W of two points by twists, with arms s, t.

    V = (1, -s x), so the block is (M, t x M_i; s x M, t x (s x M)_i) with M = across 1 + along e e'.
    """
    x, y, z = along * e[0], along * e[1], along * e[2]
    a = (x * e[0] + across, x * e[1], x * e[2])
    b = (a[1], y * e[1] + across, y * e[2])
    c = (a[2], b[2], z * e[2] + across)
    _add_row(A, row, column, t, a)
    _add_row(A, row + 1, column, t, b)
    _add_row(A, row + 2, column, t, c)
    _add_row(A, row + 3, column, t, _combined(c, s[1], b, s[2]))
    _add_row(A, row + 4, column, t, _combined(a, s[2], c, s[0]))
    _add_row(A, row + 5, column, t, _combined(b, s[0], a, s[1]))


@bare
def _combined(u, x, v, y):
    """Vector x u - y v."""
    return (x * u[0] - y * v[0], x * u[1] - y * v[1], x * u[2] - y * v[2])


@bare
def _add_row(A, i, column, t, m):
    """A[i, column:column + 6] += (m, t x m)."""
    add(A, i, column, m, 1.0)
    add(A, i, column + 3, cross(t, m), 1.0)


@bare
def _add_wrench(x, c, s, f, factor):
    """x[c:c + 6] += factor (f, s x f)."""
    m = cross(s, f)
    x[c] += factor * f[0]
    x[c + 1] += factor * f[1]
    x[c + 2] += factor * f[2]
    x[c + 3] += factor * m[0]
    x[c + 4] += factor * m[1]
    x[c + 5] += factor * m[2]


@bare
def _column(table, p):
    """First velocity of the body of point p, -1 where it is not free."""
    return table.column[table.body[p]] if table.body[p] >= 0 else -1


@bare
def measure_segments(table, scratch):
    """Unit vectors and lengths of the segments of all fibres, into `scratch.way`."""
    for i in range(len(table.point) - 1):
        d = minus(vector(scratch.q, table.point[i + 1]), vector(scratch.q, table.point[i]))
        size = math.sqrt(inner_product(d, d))
        put(scratch.way, i, 0, d, 1.0 / size if size > 0.0 else 0.0)
        scratch.way[i, 3] = size


@bare
def _add_segment(table, i, across, along, scratch):
    """A += across V'V + along (V'e)(V'e)' and g += V'e with the derivative V of segment i."""
    a, b, e = table.point[i], table.point[i + 1], vector(scratch.way, i)
    ca, cb = _column(table, a), _column(table, b)
    for block in range(3):
        first = block == 0 or (block == 2 and ca > cb)
        p, row = (a, ca) if first else (b, cb)
        other = first if block < 2 else not first
        r, column = (a, ca) if other else (b, cb)
        if row < 0 or column < 0 or (block == 2 and row == column):
            continue
        sign = 1.0 if block < 2 else -1.0
        s, t = vector(scratch.arm, p), vector(scratch.arm, r)
        _add_block(scratch.A, row, column, s, t, e, sign * across, sign * along)
        if block < 2:
            _add_wrench(scratch.g, row, s, e, -1.0 if first else 1.0)


@bare
def _rate(table, k, v, scratch):
    """Rate of the length of fibre k by the velocities v of points [m/s]."""
    rate = 0.0
    for i in range(table.start[k], table.start[k + 1] - 1):
        away = minus(vector(v, table.point[i + 1]), vector(v, table.point[i]))
        rate += inner_product(vector(scratch.way, i), away)
    return rate


@bare
def add_line(table, lines, k, activation, scratch, by_damping, by_stiffness):
    """Forces of fibre k on its points, and its share of A, after `measure_segments`.

    With the length L of the path the stiffness is F' g g' + F d2L/dx2, and the damping d g g', g =
    dL/dw. The rotation of lever arms is added with the forces of all terms; segments between points of
    one body contribute nothing. A force-velocity relation is linear about the rate r of the start of the
    step, with the force F_act (f_v(r) - 1 - f_v' r) and the damping F_act f_v'.
    """
    A, g, n = scratch.A, scratch.g, len(scratch.g)
    total, first, last = 0.0, table.start[k], table.start[k + 1] - 1
    for i in range(first, last):
        total += scratch.way[i, 3]
    _, F, slope = tension(lines, k, total, activation)
    damping, excess = lines.damping[k], 0.0
    if lines.relation[k, 0] > 0.0:
        rate = _rate(table, k, scratch.v, scratch)
        active = F - passive_tension(lines, k, total)
        excess, steep = velocity_factor(lines, k, rate)
        excess = active * (excess - steep * rate)
        damping += active * steep
    along = by_stiffness * slope + by_damping * damping
    one = last == first + 1
    pull = damping * _rate(table, k, scratch.carried, scratch) + excess
    whole = pull != 0.0 or not one
    if whole:
        for i in range(n):
            g[i] = 0.0
    for i in range(first, last):
        a, b = table.point[i], table.point[i + 1]
        if table.body[a] == table.body[b]:
            continue
        e = vector(scratch.way, i)
        add(scratch.force, a, 0, e, F)
        add(scratch.force, b, 0, e, -F)
        across = by_stiffness * F / scratch.way[i, 3]
        _add_segment(table, i, across, (along if one else 0.0) - across, scratch)
    if whole:
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
        normal = vector(table.plane[k : k + 1, 3:6], 0)
        d = morsel_gap(table, k, vector(scratch.q, p))
        left = table.plane[k, 6] - d
        if not whole[k] or left <= 0.0:
            continue
        stiffness = table.plane[k, 7] / table.plane[k, 6]
        add(scratch.force, p, 0, normal, stiffness * left)
        c, s = _column(table, p), vector(scratch.arm, p)
        if c >= 0:
            along = by_stiffness * stiffness + by_damping * table.plane[k, 8]
            _add_block(scratch.A, c, c, s, s, normal, 0.0, along)


@bare
def morsel_gap(table, k, x):
    """Distance of the point of morsel k, at x, from its plane."""
    place, normal = vector(table.plane, k), vector(table.plane[k : k + 1, 3:6], 0)
    return inner_product(minus(x, place), normal)


@bare
def add_points(table, scratch, by_stiffness):
    """Forces and moments of the loads of all points, and the rotation of their arms."""
    for p in range(len(table.body)):
        c = _column(table, p)
        if c < 0:
            continue
        s, f = vector(scratch.arm, p), vector(scratch.force, p)
        sf = inner_product(s, f)
        _add_wrench(scratch.r, c, s, f, 1.0)
        # trace(s f') 1 less the symmetric part of s f'
        A, k, half = scratch.A, c + 3, 0.5 * by_stiffness
        A[k, k] += by_stiffness * (sf - s[0] * f[0])
        A[k + 1, k + 1] += by_stiffness * (sf - s[1] * f[1])
        A[k + 2, k + 2] += by_stiffness * (sf - s[2] * f[2])
        A[k + 1, k] -= half * (s[1] * f[0] + s[0] * f[1])
        A[k + 2, k] -= half * (s[2] * f[0] + s[0] * f[2])
        A[k + 2, k + 1] -= half * (s[2] * f[1] + s[1] * f[2])
