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
def _factor(on, place, S, T, positive, softened):
    """Factor of S over the active rows with an increased diagonal; their number, -1 if S is singular.

    Redundant rows, such as stops that are reached together, make S singular. If all rows have a small
    compliance, the force is divided among them by least squares.
    """
    k = 0
    for i in range(len(on)):
        if on[i]:
            place[k] = i
            k += 1
    for i in range(k):
        for j in range(i + 1):
            T[i, j] = S[place[i], place[j]]
        T[i, i] *= 1.0 + softened
    good = factorise(T, positive, k) == 0
    for i in range(k):
        good = good and T[i, i] * T[i, i] > REPEATED * S[place[i], place[i]]
    return k if good else -1


@bare
def _solve(T, place, k, b, x, f):
    """Forces f with S f = -b of the k active rows, zero for the others."""
    for i in range(k):
        x[i] = -b[place[i]]
    solve_lower(T, x, k)
    solve_upper(T, x, k)
    for i in range(len(f)):
        f[i] = 0.0
    for i in range(k):
        f[place[i]] = x[i]


@bare
def _complementary(unilateral, b, S, T, on, place, positive, x, f):
    """Forces with S f + b = 0 of equations, and 0 <= f, S f + b >= 0, f (S f + b) = 0 of inequalities.

    The primal-dual active set strategy of `sim.contact.pushes`. It may cycle; then the last row that
    violates its condition is changed alone, which ends for a positive definite S. Source: Judice and
    Pires 1994, A block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems, Comput. Oper. Res. 21, 587-596.
    """
    m = len(on)
    for softened in (0.0, SOFTENED):
        for i in range(m):
            on[i] = not unilateral[i] or b[i] < 0.0
        for change in range(CHANGES + SINGLE):
            k = _factor(on, place, S, T, positive, softened)
            if k < 0:
                break
            _solve(T, place, k, b, x, f)
            same, slack = True, 0.0
            for i in range(m):
                slack = max(slack, abs(f[i]))
            slack *= SLACK if softened > 0.0 else 0.0
            for i in range(m - 1, -1, -1):
                if unilateral[i] and (same or change < CHANGES):
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
def _evaluate(column, table, frames, q, c, G, JA, JB, JP):
    """Values c, derivatives G by the velocities, and by twists of both bodies, at frames."""
    evaluate_rows(table, frames, q, c, JA, JB, JP)
    for k in range(len(c)):
        G[k] = 0.0
        for side in range(2):
            b = table.body_a[k] if side == 0 else table.body_b[k]
            if b >= 0 and column[b] >= 0:
                J = JA if side == 0 else JB
                for d in range(6):
                    G[k, column[b] + d] += J[k, d]


@bare
def _drift(body_a, body_b, JA, JB, twists, drift):
    """Rates of rows by twists (n_bodies, 6)."""
    for k in range(len(drift)):
        s = 0.0
        for side in range(2):
            b = body_a[k] if side == 0 else body_b[k]
            J = JA if side == 0 else JB
            if b >= 0:
                for d in range(6):
                    s += J[k, d] * twists[b, d]
        drift[k] = s


@bare
def _mobility(column, mass, inverse, body_a, body_b, on, G, Y, S):
    """Y = M^-1 G' and S = G M^-1 G' of active rows, with the inverse inertia of all bodies."""
    n = Y.shape[0]
    for k in range(len(on)):
        for j in range(n):
            Y[j, k] = 0.0
        if not on[k]:
            continue
        for side in range(2):
            b = body_a[k] if side == 0 else body_b[k]
            c = column[b] if b >= 0 else -1
            if c >= 0:
                for d in range(3):
                    Y[c + d, k] = G[k, c + d] / mass[b]
                    Y[c + 3 + d, k] = (
                        inverse[b, d, 0] * G[k, c + 3]
                        + inverse[b, d, 1] * G[k, c + 4]
                        + inverse[b, d, 2] * G[k, c + 5]
                    )
    S[:] = 0.0
    for k in range(n):
        for i in range(len(on)):
            if on[i]:
                add_product(S, i, G[i, k], Y, k)


@bare
def _push(f, Y, g):
    """Sum Y f of the forces of rows, into g."""
    for j in range(len(g)):
        s = 0.0
        for i in range(len(f)):
            s += f[i] * Y[j, i]
        g[j] = s


@bare
def hold_rows(table, kinds, column, twists, q, h, step, rows):
    """Add h A^-1 G'f with the forces of rows to w1, as `sim.integrators.held.held_solution`."""
    m, n, S, G, Y = len(rows.c), len(step.w0), rows.S, rows.G, rows.Y
    drift, sign, w1, g = rows.drift, step.sign, step.w1, step.g
    _evaluate(column, table, step.frames, q, rows.c, G, rows.JA, rows.JB, rows.JP)
    _drift(table.body_a, table.body_b, rows.JA, rows.JB, twists, drift)
    for i in range(m):
        for j in range(n):
            Y[j, i] = G[i, j]
    solve_lower_all(step.A, Y, n, m)
    S[:] = 0.0
    for k in range(n):
        for i in range(m):
            add_product(S, i, h * sign[k] * Y[k, i], Y, k)
    for i in range(m):
        time = h if kinds.unilateral[i] else h + kinds.damping_time[i]
        S[i, i] += kinds.compliance[i] / time
        for j in range(n):
            drift[i] += G[i, j] * w1[j]
        if not kinds.rigid[i]:
            drift[i] += rows.c[i] / time
    if not _complementary(
        kinds.unilateral, drift, S, rows.T, rows.on, rows.place, rows.positive, rows.target, rows.f
    ):
        return False
    for i in range(m):
        rows.held[i] = rows.f[i]
    _push(rows.f, Y, g)
    for j in range(n):
        g[j] *= h * sign[j]
    solve_upper(step.A, g, n)
    for j in range(n):
        w1[j] += g[j]
    return True


@bare
def project_on_rows(table, kinds, bodies, twists, q, most, drift, step, rows):
    """Project frames and velocities to the rows, as `sim.joints.compiled.Rows.projected`."""
    m, n, on, c, column = len(rows.c), len(step.w0), rows.on, rows.c, bodies.column
    frames, inverse = step.frames, step.inverse
    for b in range(len(column)):
        if column[b] >= 0:
            turned_tensor(frames, b, bodies.inverse[b], inverse[b])
    k = -1
    for turn in range(most + 1):
        _evaluate(column, table, frames, q, c, rows.G, rows.JA, rows.JB, rows.JP)
        worst, more = 0.0, k < 0
        for i in range(m):
            if kinds.rigid[i] or (kinds.unilateral[i] and c[i] < -drift):
                worst = max(worst, abs(c[i]))
                more = more or not on[i]
        last = turn == most or not worst > drift
        if last:
            _drift(table.body_a, table.body_b, rows.JA, rows.JB, twists, rows.drift)
        # the directions at a short distance differ by less than rounding
        if last or more or worst > KEPT:
            for i in range(m):
                fallen = kinds.unilateral[i] and c[i] < -drift
                on[i] = kinds.rigid[i] or (fallen and not last)
                if last:  # the velocities are projected to the rigid rows
                    c[i] = rows.drift[i]
                    for j in range(n):
                        c[i] += rows.G[i, j] * step.w1[j]
            _mobility(
                column, bodies.mass, inverse, table.body_a, table.body_b, on, rows.G, rows.Y, rows.S
            )
            k = -1
            for softened in (0.0, SOFTENED):
                if k < 0 and not (last and softened > 0.0):
                    k = _factor(on, rows.place, rows.S, rows.T, rows.positive, softened)
            if k < 0:
                return False
        # the forces of S f = -c change the rows by -c
        _solve(rows.T, rows.place, k, c, rows.target, rows.f)
        _push(rows.f, rows.Y, step.g)
        if last:
            break
        for b in range(len(column)):
            if column[b] >= 0:
                move(frames, b, step.g, column[b])
    for j in range(n):
        step.w1[j] += step.g[j]
    return True
