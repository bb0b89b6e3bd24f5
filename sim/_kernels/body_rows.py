"""Rows over the velocities of rigid bodies: forces from their Delassus matrix, projection of poses.

The equations are those of `sim.integrators.held.held_solution` and `sim.joints.compiled.Rows`.
"""

# pyright: basic

from sim._kernels.dense import cholesky, row_product, solve_lower, solve_upper
from sim._kernels.frames import move, turned_tensor
from sim._kernels.joints import evaluate_rows
from sim._kernels.options import bare

CHANGES, SINGLE = 20, 400
"""Largest number of updates of the whole active set, and of single rows after them."""

REPEATED, SOFTENED = 1e-9, 1e-8
"""Fraction of its mobility below which a row depends on others, and relative increase of all then."""

KEPT = 1e-9
"""Violation of rows up to which an earlier factor corrects them [m, rad]."""


@bare
def factor_rows(scratch):
    """Factor of S over the active rows; returns their number, -1 if S is singular.

    Redundant rows, such as stops that are reached together, make S singular. All rows then have a
    small compliance, which divides the force among them by least squares.
    """
    on, place, T = scratch.on, scratch.place, scratch.T
    k = 0
    for i in range(len(on)):
        if on[i]:
            place[k] = i
            k += 1
    for turn in range(2):
        for i in range(k):
            for j in range(i + 1):
                T[i, j] = scratch.S[place[i], place[j]]
            if turn > 0:
                T[i, i] *= 1.0 + SOFTENED
        good = cholesky(T, k)
        for i in range(k):
            good = good and (
                turn > 0 or T[i, i] * T[i, i] > REPEATED * scratch.S[place[i], place[i]]
            )
        if good:
            return k
    return -1


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
    for i in range(m):
        on[i] = not kinds.unilateral[i] or b[i] < 0.0
    for change in range(CHANGES + SINGLE):
        k = factor_rows(scratch)
        if k < 0:
            return False
        _solve_rows(scratch, k, b)
        same = True
        for i in range(m - 1, -1, -1):
            if kinds.unilateral[i] and (same or change < CHANGES):
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
            S[k, j] = row_product(G, k, Y, j, n)


@bare
def hold_rows(rows, kinds, table, twists, h, scratch):
    """Add h A^-1 G'f with the forces of rows to w1, as `sim.integrators.held.held_solution`."""
    m, n, S, G, Y = len(scratch.c), len(scratch.w0), scratch.S, scratch.G, scratch.Y
    _evaluate(table, rows, scratch)
    _drift(rows, twists, scratch)
    for i in range(m):
        for j in range(n):
            Y[i, j] = G[i, j]
        solve_lower(scratch.A, Y[i], n)
        for j in range(i + 1):
            S[i, j] = h * row_product(Y, i, Y, j, n)
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
    solve_upper(scratch.A, scratch.g, n)
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True


@bare
def _push(scratch, n):
    """Sum Y'f of the forces of rows, into g."""
    for j in range(n):
        scratch.g[j] = 0.0
    for i in range(len(scratch.f)):
        if scratch.f[i] != 0.0:
            for j in range(n):
                scratch.g[j] += scratch.f[i] * scratch.Y[i, j]


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
            held = kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift)
            if held:
                worst = max(worst, abs(scratch.c[i]))
                more = more or not on[i]
        if turn == most or not worst > drift:
            break
        # the directions at this distance differ by less than rounding
        if more or worst > KEPT:
            for i in range(m):
                on[i] = kinds.rigid[i] or (kinds.unilateral[i] and scratch.c[i] < -drift)
            _mobility(table, rows, scratch)
            k = factor_rows(scratch)
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
    k = factor_rows(scratch)
    if k < 0:
        return False
    _solve_rows(scratch, k, scratch.drift)
    _push(scratch, n)
    for j in range(n):
        scratch.w1[j] += scratch.g[j]
    return True
