"""Rows over the velocities of rigid bodies: forces from their Delassus matrix, projection of poses.

The equations are those of `sim.integrators.held.held_solution` and `sim.joints.compiled.Rows`.
"""

# pyright: basic

from sim._kernels.dense import (
    add_product,
    factorise,
    solve_lower,
    solve_lower_all,
    solve_upper,
)
from sim._kernels.frames import move, turned_tensor
from sim._kernels.joints import evaluate_rows
from sim._kernels.options import bare

CHANGES, SINGLE = 20, 100
"""Largest number of updates of the whole active set, and of single rows after them."""

REPEATED, SOFTENED = 1e-9, 1e-8
"""Fraction of its mobility below which a row depends on others, and relative increase of all then."""

SLACK = 1e-7
"""Relative error of the forces of softened rows by rounding."""

KEPT = 1e-9
"""Violation of rows up to which an earlier factor corrects them [m, rad]."""


@bare
def factor_rows(scratch, softened):
    """Factor of S over the active rows with an increased diagonal; their number, -1 if S is singular.

    Redundant rows, such as stops that are reached together, make S singular. If all rows have a small
    compliance, the force is divided among them by least squares.
    """
    on, place, T = scratch.on, scratch.place, scratch.T
    k = 0
    for i in range(len(on)):
        if on[i]:
            place[k] = i
            k += 1
    for i in range(k):
        for j in range(i + 1):
            T[i, j] = scratch.S[place[i], place[j]]
        T[i, i] *= 1.0 + softened
    good = factorise(T, scratch.positive, k) == 0
    for i in range(k):
        good = good and T[i, i] * T[i, i] > REPEATED * scratch.S[place[i], place[i]]
    return k if good else -1


@bare
def _solve_rows(scratch, k, b):
    """Forces f with S f = -b of the k active rows, zero for the others."""
    f, x = scratch.f, scratch.target
    for i in range(k):
        x[i] = -b[scratch.place[i]]
    solve_lower(scratch.T, x, k)
    solve_upper(scratch.T, x, k)
    for i in range(len(f)):
        f[i] = 0.0
    for i in range(k):
        f[scratch.place[i]] = x[i]


@bare
def _complementary(scratch, kinds, b):
    """Forces with S f + b = 0 of equations, and 0 <= f, S f + b >= 0, f (S f + b) = 0 of inequalities.

    The primal-dual active set strategy of `sim.contact.pushes`. It may cycle; then the last row that
    violates its condition is changed alone, which ends for a positive definite S. Source: Judice and
    Pires 1994, A block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems, Comput. Oper. Res. 21, 587-596.
    """
    on, f, S = scratch.on, scratch.f, scratch.S
    m = len(on)
    for softened in (0.0, SOFTENED):
        for i in range(m):
            on[i] = not kinds.unilateral[i] or b[i] < 0.0
        for change in range(CHANGES + SINGLE):
            k = factor_rows(scratch, softened)
            if k < 0:
                break
            _solve_rows(scratch, k, b)
            same, slack = True, 0.0
            for i in range(m):
                slack = max(slack, abs(f[i]))
            slack *= SLACK if softened > 0.0 else 0.0
            for i in range(m - 1, -1, -1):
                if kinds.unilateral[i] and (same or change < CHANGES):
                    pushes = f[i] > -slack
                    if not on[i]:
                        s = b[i]
                        for j in range(m):
                            s += (S[i, j] if j <= i else S[j, i]) * f[j]
                        pushes = s < -slack * S[i, i]
                    if pushes != on[i]:
                        on[i], same = pushes, False
            if same:
                return True
    return False


@bare
def _evaluate(table, rows, scratch):
    """Values c, derivatives G by the velocities, and rates by prescribed motion, at `scratch.frames`."""
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


@bare
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


@bare
def _mobility(table, rows, scratch):
    """Y = M^-1 G' and S = G M^-1 G' of active rows, with the inverse inertia of `scratch.inverse`."""
    G, Y, S, n = scratch.G, scratch.Y, scratch.S, len(scratch.w0)
    for k in range(len(scratch.c)):
        for j in range(n):
            Y[j, k] = 0.0
        if not scratch.on[k]:
            continue
        for side in range(2):
            b = rows.body_a[k] if side == 0 else rows.body_b[k]
            c = table.column[b] if b >= 0 else -1
            if c >= 0:
                for d in range(3):
                    Y[c + d, k] = G[k, c + d] / table.mass[b]
                    Y[c + 3 + d, k] = (
                        scratch.inverse[b, d, 0] * G[k, c + 3]
                        + scratch.inverse[b, d, 1] * G[k, c + 4]
                        + scratch.inverse[b, d, 2] * G[k, c + 5]
                    )
    S[:] = 0.0
    for k in range(n):
        for i in range(len(scratch.c)):
            if scratch.on[i]:
                add_product(S, i, G[i, k], Y, k)


@bare
def _push(scratch, n):
    """Sum Y f of the forces of rows, into g."""
    for j in range(n):
        s = 0.0
        for i in range(len(scratch.f)):
            s += scratch.f[i] * scratch.Y[j, i]
        scratch.g[j] = s


@bare
def hold_rows(rows, kinds, table, twists, h, scratch):
    """Add h A^-1 G'f with the forces of rows to w1, as `sim.integrators.held.held_solution`."""
    m, n, S, G, Y = len(scratch.c), len(scratch.w0), scratch.S, scratch.G, scratch.Y
    _evaluate(table, rows, scratch)
    _drift(rows, twists, scratch)
    for i in range(m):
        for j in range(n):
            Y[j, i] = G[i, j]
    solve_lower_all(scratch.A, Y, n, m)
    S[:] = 0.0
    for k in range(n):
        for i in range(m):
            add_product(S, i, h * scratch.sign[k] * Y[k, i], Y, k)
    for i in range(m):
        time = h if kinds.unilateral[i] else h + kinds.damping_time[i]
        S[i, i] += kinds.compliance[i] / time
        b = scratch.drift[i]
        for j in range(n):
            b += G[i, j] * scratch.w1[j]
        scratch.drift[i] = b if kinds.rigid[i] else b + scratch.c[i] / time
    if not _complementary(scratch, kinds, scratch.drift):
        return False
    for i in range(m):
        scratch.held[i] = scratch.f[i]
    _push(scratch, n)
    for j in range(n):
        scratch.g[j] *= h * scratch.sign[j]
    solve_upper(scratch.A, scratch.g, n)
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True


@bare
def project_on_rows(rows, kinds, table, twists, most, drift, scratch):
    """Project frames and velocities to the rows, as `sim.joints.compiled.Rows.projected`."""
    m, n, on = len(scratch.c), len(scratch.w0), scratch.on
    for b in range(len(table.column)):
        if table.column[b] >= 0:
            turned_tensor(scratch.frames, b, table.inverse[b], scratch.inverse[b])
    k = -1
    for turn in range(most + 1):
        _evaluate(table, rows, scratch)
        worst, more = 0.0, k < 0
        for i in range(m):
            if kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift):
                worst = max(worst, abs(scratch.c[i]))
                more = more or not on[i]
        last = turn == most or not worst > drift
        if last:
            _drift(rows, twists, scratch)
        # the directions at a short distance differ by less than rounding
        if last or more or worst > KEPT:
            for i in range(m):
                fallen = kinds.unilateral[i] and scratch.c[i] < -drift
                on[i] = kinds.rigid[i] or (fallen and not last)
                if last:  # the velocities are projected to the rigid rows
                    scratch.c[i] = scratch.drift[i]
                    for j in range(n):
                        scratch.c[i] += scratch.G[i, j] * scratch.w1[j]
            _mobility(table, rows, scratch)
            k = -1
            for softened in (0.0, SOFTENED):
                if k < 0 and not (last and softened > 0.0):
                    k = factor_rows(scratch, softened)
            if k < 0:
                return False
        # the forces of S f = -c change the rows by -c
        _solve_rows(scratch, k, scratch.c)
        _push(scratch, n)
        if last:
            break
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                move(scratch.frames, b, scratch.g, table.column[b])
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True
