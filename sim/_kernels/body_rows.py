"""Rows over the velocities of rigid bodies: forces from their Delassus matrix, projection of poses.

The equations are those of `sim.integrators.linear_rows` and `sim.joints.compiled.CompiledJoints`.
"""

# pyright: basic

from sim._kernels.dense import factorise, solve_lower, solve_upper
from sim._kernels.frames import move, turned_tensor
from sim._kernels.joints import evaluate_rows
from sim._kernels.options import inner

CHANGES, SINGLE_CHANGES = 20, 100
"""Largest number of updates of the whole active set, and of single rows after them."""

REPEATED, DIAGONAL_SHIFT = 1e-9, 1e-8
"""Fraction of its mobility below which a row depends on others, and relative increase of all then."""

SLACK = 1e-7
"""Relative error of the forces of softened rows by rounding."""

UNMET = 1e-6
"""Violation after all projections above which rows contradict others [m, rad]."""

EARLIER_FACTOR = 1e-9
"""Violation of rows up to which an earlier factor corrects them [m, rad]."""


@inner
def _factor(on, m, place, S, T, positive, softened):
    """Factor of S (m, m) over the active rows with an increased diagonal; their number, -1 if singular.

    Redundant rows, such as stops that are reached together, make S singular. If all rows have a small
    compliance, the force is divided among them by least squares.
    """
    k = 0
    for i in range(m):
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


@inner
def _solve(T, place, k, b, m, x, f):
    """Forces f (m,) with S f = -b of the k active rows, zero for the others."""
    for i in range(k):
        x[i] = -b[place[i]]
    solve_lower(T, x, k)
    solve_upper(T, x, k)
    for i in range(m):
        f[i] = 0.0
    for i in range(k):
        f[place[i]] = x[i]


@inner
def _complementary(unilateral, near, m, b, S, T, on, place, positive, x, f):
    """Forces with S f + b = 0 of equations, and 0 <= f, S f + b >= 0, f (S f + b) = 0 of inequalities.

    Row i of S (m, m) and b is row `near`[i] of the scene. The primal-dual active set strategy of
    `solve_lcp` in `sim.contact.cone`. It may cycle; then the last row that violates its condition is
    changed alone, which ends for a positive definite S. Source: Judice and Pires 1994, A block
    principal pivoting algorithm for large-scale strictly monotone linear complementarity problems,
    Comput. Oper. Res. 21, 587-596.
    """
    for softened in (0.0, DIAGONAL_SHIFT):
        for i in range(m):
            on[i] = not unilateral[near[i]] or b[i] < 0.0
        for change in range(CHANGES + SINGLE_CHANGES):
            k = _factor(on, m, place, S, T, positive, softened)
            if k < 0:
                break
            _solve(T, place, k, b, m, x, f)
            same, slack = True, 0.0
            for i in range(m):
                slack = max(slack, abs(f[i]))
            slack *= SLACK if softened > 0.0 else 0.0
            for i in range(m - 1, -1, -1):
                if unilateral[near[i]] and (same or change < CHANGES):
                    active = f[i] > -slack
                    if not on[i]:
                        s = b[i]
                        for j in range(m):
                            s += (S[i, j] if j <= i else S[j, i]) * f[j]
                        active = s < -slack * S[i, i]
                    if active != on[i]:
                        on[i], same = active, False
            if same:
                return True
    return False


@inner
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


@inner
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


@inner
def _mobility(column, mass, inverse, body_a, body_b, near, m, G, Y, S):
    """Y = G M^-1 (m, n) and S = G M^-1 G' of some rows, with the inverse inertia of all bodies."""
    n = Y.shape[1]
    for i in range(m):
        k = near[i]
        for j in range(n):
            Y[i, j] = 0.0
        for side in range(2):
            b = body_a[k] if side == 0 else body_b[k]
            c = column[b] if b >= 0 else -1
            if c >= 0:
                for d in range(3):
                    Y[i, c + d] = G[k, c + d] / mass[b]
                    Y[i, c + 3 + d] = (
                        inverse[b, d, 0] * G[k, c + 3]
                        + inverse[b, d, 1] * G[k, c + 4]
                        + inverse[b, d, 2] * G[k, c + 5]
                    )
        for j in range(i + 1):
            S[i, j] = 0.0
            for d in range(n):
                S[i, j] += G[near[j], d] * Y[i, d]


@inner
def _push(f, m, Y, g):
    """Sum f Y of the forces of rows, into g."""
    for j in range(len(g)):
        g[j] = 0.0
    for i in range(m):
        for j in range(len(g)):
            g[j] += f[i] * Y[i, j]


@inner
def _choose(chosen, near):
    """Numbers of the chosen rows, into near; their number."""
    m = 0
    for i in range(len(chosen)):
        if chosen[i]:
            near[m] = i
            m += 1
    return m


@inner
def _hold(table, kinds, twists, h, step, rows):
    """Add h A^-1 G'f with the forces of rows to w1, as `sim.integrators.linear_rows`.

    The forces are found for the equations and the inequalities that the motion without forces violates;
    others that it then violates are added.
    """
    n, S, G, Y, b, near = len(step.w0), rows.S, rows.G, rows.Y, rows.violated, rows.near
    drift, sign, w1, g = rows.drift, step.sign, step.w1, step.g
    _drift(table.body_a, table.body_b, rows.JA, rows.JB, twists, drift)
    for i in range(len(drift)):
        time = h if kinds.unilateral[i] else h + kinds.damping_time[i]
        for j in range(n):
            drift[i] += G[i, j] * w1[j]
        if not kinds.rigid[i]:
            drift[i] += rows.c[i] / time
        rows.chosen[i] = not kinds.unilateral[i] or drift[i] < 0.0
        rows.row_force[i] = 0.0
    m, more = 0, True
    while more:
        m = _choose(rows.chosen, near)
        for i in range(m):
            k = near[i]
            b[i] = drift[k]
            for j in range(n):
                Y[i, j] = G[k, j]
            solve_lower(step.A, Y[i], n)
            for j in range(i + 1):
                S[i, j] = 0.0
                for d in range(n):
                    S[i, j] += h * sign[d] * Y[i, d] * Y[j, d]
            time = h if kinds.unilateral[k] else h + kinds.damping_time[k]
            S[i, i] += kinds.compliance[k] / time
        good = _complementary(
            kinds.unilateral, near, m, b, S, rows.T, rows.on, rows.place, rows.positive, rows.target,
            rows.f,
        )  # fmt: skip
        if not good:
            return False
        _push(rows.f, m, Y, g)
        for j in range(n):
            g[j] *= h * sign[j]
        solve_upper(step.A, g, n)
        more = False
        for i in range(len(drift)):
            if not rows.chosen[i]:
                s = drift[i]
                for j in range(n):
                    s += G[i, j] * g[j]
                rows.chosen[i] = s < 0.0
                more = more or s < 0.0
    for i in range(m):
        rows.row_force[near[i]] = rows.f[i]
    for j in range(n):
        w1[j] += g[j]
    return True


@inner
def restrict(table, kinds, bodies, q, known, step, rows):
    """Remove from velocities g what rigid rows at the frames `step.ahead` do not allow.

    g -= M^-1 G'(G M^-1 G')^-1 G g, with the inverse inertia `step.inverse`. Returns False if rows are
    redundant there.
    """
    g, near, n = step.g, rows.near, len(step.g)
    if not known:
        _evaluate(
            bodies.column, table, step.ahead, q, rows.c, rows.G, rows.JA, rows.JB, rows.JP
        )  # fmt: skip
    m = _choose(kinds.rigid, near)
    if m == 0:
        return True
    for i in range(m):
        rows.on[i] = True
    _mobility(
        bodies.column, bodies.mass, step.inverse, table.body_a, table.body_b, near, m, rows.G, rows.Y,
        rows.S,
    )  # fmt: skip
    k = _factor(rows.on, m, rows.place, rows.S, rows.T, rows.positive, 0.0)
    if k < 0:
        return False
    for i in range(m):
        rows.violated[i] = 0.0
        for j in range(n):
            rows.violated[i] += rows.G[near[i], j] * g[j]
    _solve(rows.T, rows.place, k, rows.violated, m, rows.target, rows.f)
    for i in range(m):
        for j in range(n):
            g[j] += rows.f[i] * rows.Y[i, j]
    return True


@inner
def move_on_rows(table, kinds, bodies, twists, q, h, theta, known, most, drift, step, rows):
    """Move bodies by w1 with the forces of rows, and project frames and velocities to the rows.

    The projection is that of `sim.joints.compiled.CompiledJoints.projected`. The forces of the rows of
    the step, and the impulses on the velocities as forces over it, are added in `row_force`. If the rows
    are `known` at the first frames, they are not evaluated there.
    """
    n, c, column, near, g = len(step.w0), rows.c, bodies.column, rows.near, step.g
    frames, inverse = step.frames, step.inverse
    k, m = -1, 0
    for turn in range(-1, most + 1):
        if turn >= 0 or not known:
            _evaluate(column, table, frames, q, c, rows.G, rows.JA, rows.JB, rows.JP)
        last = turn == most
        if turn < 0:
            if not _hold(table, kinds, twists, h, step, rows):
                return False
            for j in range(n):
                g[j] = h * ((1.0 - theta) * step.w0[j] + theta * step.w1[j])
        else:
            worst, more = 0.0, k < 0
            for i in range(len(c)):
                rows.on[i] = True
                if kinds.rigid[i] or (kinds.unilateral[i] and c[i] < -drift):
                    worst = max(worst, abs(c[i]))
                    more = more or not rows.chosen[i]
            if last and worst > UNMET:
                return False
            last = last or not worst > drift
            if last:
                _drift(table.body_a, table.body_b, rows.JA, rows.JB, twists, rows.drift)
            # the directions at a short distance differ by less than rounding
            if last or more or worst > EARLIER_FACTOR:
                for i in range(len(c)):
                    fallen = kinds.unilateral[i] and c[i] < -drift
                    rows.chosen[i] = kinds.rigid[i] or (fallen and not last)
                m = _choose(rows.chosen, near)
                _mobility(
                    column, bodies.mass, inverse, table.body_a, table.body_b, near, m, rows.G, rows.Y,
                    rows.S,
                )  # fmt: skip
                k = -1
                for softened in (0.0, DIAGONAL_SHIFT):
                    if k < 0 and not (last and softened > 0.0):
                        k = _factor(rows.on, m, rows.place, rows.S, rows.T, rows.positive, softened)
                if k < 0:
                    return False
            for i in range(m):
                rows.violated[i] = c[near[i]]
                if last:  # the velocities are projected to the rigid rows
                    rows.violated[i] = rows.drift[near[i]]
                    for j in range(n):
                        rows.violated[i] += rows.G[near[i], j] * step.w1[j]
            # the forces of S f = -c change the rows by -c
            _solve(rows.T, rows.place, k, rows.violated, m, rows.target, rows.f)
            _push(rows.f, m, rows.Y, g)
            if last:
                break
        for b in range(len(column)):
            if column[b] >= 0:
                move(frames, b, g, column[b])
                if turn < 0:
                    turned_tensor(frames, b, bodies.inverse[b], inverse[b])
        if len(c) == 0:
            return True
    for i in range(m):
        rows.row_force[near[i]] += rows.f[i] / h
    for j in range(n):
        step.w1[j] += g[j]
    return True
