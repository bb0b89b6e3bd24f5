"""Linearly implicit steps of rigid bodies with joints and line muscles, dense and without allocation.

The equations are those of `sim.integrators.linearly_implicit` and `held`; matrices hold their lower
triangle. A step whose matrix has no factor without exchange of rows, or whose rows are redundant, is
left to them.
"""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math

import numpy as np
from numpy.typing import NDArray

from sim._kernels.body_forces import (
    add_line,
    add_morsels,
    add_points,
    add_tension,
    add_wrench,
    measure_segments,
    morsel_gap,
)
from sim._kernels.body_rows import move_on_rows, restrict
from sim._kernels.body_tables import BodyTable, Flags, Index, PrescribedBodies, RowKinds, Scratch
from sim._kernels.dense import copy, factorise, solve_lower, solve_upper
from sim._kernels.frames import (
    add,
    coasted,
    cross,
    move,
    placed,
    put,
    rotated,
    turn_between,
    turned_tensor,
    vector,
)
from sim._kernels.joints import RowTable
from sim._kernels.lines import LineTable
from sim._kernels.options import bare_kernel, inner

Array = NDArray[np.float64]


@inner
def _place_points(body, place, frames, q, arm):
    """Positions of points, and their lever arms, from their places in the axes of their bodies."""
    for p in range(len(body)):
        r = rotated(frames, body[p], vector(place, p))
        put(arm, p, 0, r, 1.0)
        put(q, p, 0, r, 1.0)
        if body[p] >= 0:
            add(q, p, 0, vector(frames, body[p]), 1.0)


@inner
def _velocities(body, arm, twists, v):
    """Velocities of points at their lever arms."""
    for p in range(len(body)):
        b = body[p]
        for d in range(3):
            v[p, d] = 0.0
        if b >= 0:
            u = cross((twists[b, 3], twists[b, 4], twists[b, 5]), vector(arm, p))
            for d in range(3):
                v[p, d] = twists[b, d] + u[d]


@inner
def _carry(body, arm, led, twists, carried):
    """Velocities of points by the prescribed bodies (k,) with twists (k, 6); others stay zero."""
    for k in range(len(led)):
        u = (twists[k, 3], twists[k, 4], twists[k, 5])
        for p in range(len(body)):
            if body[p] == led[k]:
                v = cross(u, vector(arm, p))
                for d in range(3):
                    carried[p, d] = twists[k, d] + v[d]


@inner
def _start(column, mass, inertia, frames, twists, step):
    """Momentum p and velocities w0 of the state, and A = 0."""
    I = step.I  # noqa: E741
    step.A[:] = 0.0
    for b in range(len(column)):
        c = column[b]
        if c < 0:
            continue
        for d in range(6):
            step.w0[c + d] = twists[b, d]
        turned_tensor(frames, b, inertia[b], I)
        for d in range(3):
            step.p[c + d] = mass[b] * twists[b, d]
            step.p[c + 3 + d] = (
                I[d, 0] * twists[b, 3] + I[d, 1] * twists[b, 4] + I[d, 2] * twists[b, 5]
            )


@inner
def _coast(bodies, table, kinds, known, h, theta, points, step, rows):
    """Move the initial frames `step.ahead` to the pose of the mass, after a motion without forces.

    The motion is that of `sim.integrators.linearly_implicit.predicted_pose`. Rigid rows, which are
    evaluated at the initial frames unless `known`, restrict the change of the velocities. Returns False
    if a body turns too far.
    """
    column, g, turns = bodies.column, step.g, False
    for b in range(len(column)):
        c = column[b]
        if c < 0:
            continue
        turned_tensor(step.ahead, b, bodies.inertia[b], step.I)
        w0 = (step.w0[c + 3], step.w0[c + 4], step.w0[c + 5])
        w, converged = coasted(step.I, w0, h, theta)
        if not converged:
            return False
        g[c], g[c + 1], g[c + 2] = 0.0, 0.0, 0.0
        g[c + 3], g[c + 4], g[c + 5] = w[0] - w0[0], w[1] - w0[1], w[2] - w0[2]
        turns = turns or g[c + 3] != 0.0 or g[c + 4] != 0.0 or g[c + 5] != 0.0
        turned_tensor(step.ahead, b, bodies.inverse[b], step.inverse[b])
    if turns and len(rows.c) > 0:
        if not known:
            _place_points(bodies.body, bodies.arm, step.ahead, points.q, points.arm)
        if not restrict(table, kinds, bodies, points.q, known, step, rows):
            return False
    for j in range(len(g)):
        g[j] = h * (step.w0[j] + theta * g[j])
    for b in range(len(column)):
        if column[b] >= 0:
            move(step.ahead, b, g, column[b])
    return True


@inner
def _add_mass(column, mass, inertia, step):
    """A += M at the pose `step.ahead`."""
    for b in range(len(column)):
        c = column[b]
        if c < 0:
            continue
        turned_tensor(step.ahead, b, inertia[b], step.I)
        for i in range(3):
            step.A[c + i, c + i] += mass[b]
            for j in range(i + 1):
                step.A[c + 3 + i, c + 3 + j] += step.I[i, j]


@inner
def _equation(table, lines, activation, whole, h, theta, points, step):
    """Factor of A = M + theta h D + (theta h)^2 K, and the velocities w1 without rows.

    Returns the number of negative eigenvalues of A, -1 without a factor.

    A w1 = p + h f - (1 - theta)/theta (A - M) w0: implicit Euler for theta = 1, the trapezoidal rule for
    theta = 1/2.
    """
    A, r, w0, w1, n, column = step.A, step.r, step.w0, step.w1, len(step.w0), table.column
    by_damping, by_stiffness = theta * h, (theta * h) ** 2
    for i in range(n):
        r[i] = 0.0
    copy(table.load, points.force)
    measure_segments(table.start, table.point, points.q, points.way)
    for k in range(len(table.start) - 1):
        add_line(table, lines, k, activation, points, by_damping, by_stiffness, A, r, step.g)
    add_morsels(table.morsel, table.plane, table.first, whole, points, by_damping, by_stiffness, A)
    add_points(table.first, points, by_stiffness, A, r)
    for b in range(len(column)):
        c = column[b]
        if c >= 0:
            for d in range(6):
                A[c + d, c + d] += by_damping * table.damping[b, d // 3]
    for i in range(n):
        w1[i] = step.p[i] + h * r[i]
    if theta < 1.0:
        left = (1.0 - theta) / theta
        for i in range(n):
            w1[i] -= left * A[i, i] * w0[i]
            for j in range(i):
                w1[i] -= left * A[i, j] * w0[j]
                w1[j] -= left * A[i, j] * w0[i]
    _add_mass(column, table.mass, table.inertia, step)
    negative = factorise(A, step.sign, n)
    if negative >= 0:
        solve_lower(A, w1, n)
        for i in range(n):
            w1[i] *= step.sign[i]
        solve_upper(A, w1, n)
    return negative


@bare_kernel
def change_of_bodies(
    table: BodyTable,
    lines: LineTable,
    scratch: Scratch,
    frames: Array,
    activation: Array,
    d: Array,
    change: Array,
) -> None:
    """Motions d (n, k) between frames (n + 1, ...), and decrease (n, k) of the generalised forces.

    The forces at both ends of a motion are those under its activation, one of (n, n_muscles).

    Forces are those of loads and line muscles, without morsels and rates.
    """
    points, r = scratch.points, scratch.step.r
    for i in range(len(d)):
        for side in range(2):
            _place_points(table.body, table.arm, frames[i + side], points.q, points.arm)
            copy(table.load, points.force)
            measure_segments(table.start, table.point, points.q, points.way)
            for k in range(len(table.start) - 1):
                add_tension(table, lines, k, activation[i], points)
            for j in range(len(r)):
                r[j] = 0.0
            for p in range(len(table.first)):
                if table.first[p] >= 0:
                    force = vector(points.force, p)
                    add_wrench(r, table.first[p], vector(points.arm, p), force, 1.0)
            for j in range(len(r)):
                change[i, j] = r[j] if side == 0 else change[i, j] - r[j]
        for b in range(len(table.column)):
            c = table.column[b]
            if c >= 0:
                theta = turn_between(frames[i], frames[i + 1], b)
                d[i, c + 3], d[i, c + 4], d[i, c + 5] = theta
                for j in range(3):
                    d[i, c + j] = frames[i + 1, b, j] - frames[i, b, j]


@bare_kernel
def place_bodies(
    body: Index, place: Array, frames: Array, twists: Array, arm: Array, q: Array, v: Array
) -> None:
    """Positions q and velocities v (n, n_points, 3) of points at places in the axes of their bodies."""
    for i in range(len(q)):
        _place_points(body, place, frames[i], q[i], arm)
        _velocities(body, arm, twists[i], v[i])


@bare_kernel
def advance_bodies(
    table: BodyTable,
    lines: LineTable,
    rows: RowTable,
    kinds: RowKinds,
    led: PrescribedBodies,
    scratch: Scratch,
    h: Array,
    activation: Array,
    whole: Flags,
    gone: float,
    theta: float,
    most: int,
    drift: float,
    frames: Array,
    twists: Array,
    reaction: Array,
    negative: Index,
) -> int:
    """Advance by steps h (n,) under activations (n, n_muscles); return the steps done.

    Frames and twists (n + 1, n_bodies, ...) and `whole` (n + 1, n_morsels) hold the start first;
    `reaction` (n, n_rows) are the forces of rows, `negative` (n,) the numbers of negative eigenvalues of
    the matrix. At most `most` projections reduce the values of rows to `drift`. Morsels are whole from a
    distance above their diameter to `gone`.
    """
    points, step, row = scratch.points, scratch.step, scratch.rows
    column, still, q = table.column, step.still, points.q
    rated = False
    for k in range(len(lines.relation)):
        rated = rated or lines.relation[k, 0] > 0.0
    for i in range(len(h)):
        copy(frames[i], step.frames)
        copy(frames[i], step.ahead)
        if rated:
            _place_points(table.body, table.arm, step.frames, q, points.arm)
            _velocities(table.body, points.arm, twists[i], points.v)
        for k in range(len(led.body)):
            for d in range(7):
                step.frames[led.body[k], d] = led.frames[i, k, d]
            for d in range(6):
                still[led.body[k], d] = led.twists[i, k, d]
        _start(column, table.mass, table.inertia, step.ahead, twists[i], step)
        # without prescribed bodies the rows were evaluated at these frames last
        known = i > 0 and len(led.body) == 0
        if not _coast(table, rows, kinds, known, h[i], theta, points, step, row):
            return i
        _place_points(table.body, table.arm, step.frames, q, points.arm)
        if len(led.body) > 0:
            _carry(table.body, points.arm, led.body, led.twists[i], points.carried)
        negative[i] = _equation(table, lines, activation[i], whole[i], h[i], theta, points, step)
        if negative[i] < 0:
            return i
        if not move_on_rows(
            rows, kinds, table, still, q, h[i], theta, known, most, drift, step, row
        ):
            return i
        finite = True
        for j in range(len(step.w1)):
            finite = finite and math.isfinite(step.w1[j])
        if not finite:
            return i
        copy(step.frames, frames[i + 1])
        # forces of rows in their direction at the start, and those due to the rotation of the rows
        for j in range(len(row.c)):
            reaction[i, j] = row.row_force[j]
        copy(still, twists[i + 1])
        for b in range(len(column)):
            if column[b] >= 0:
                for d in range(6):
                    twists[i + 1, b, d] = step.w1[column[b] + d]
        for k in range(len(table.morsel)):
            p = table.morsel[k]
            x = placed(step.frames, table.body[p], vector(table.arm, p))
            d = morsel_gap(table.plane, k, x)
            whole[i + 1, k] = d > table.plane[k, 6] or (whole[i, k] and d >= gone)
    return len(h)
