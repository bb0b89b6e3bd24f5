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
    measure_segments,
    morsel_gap,
)
from sim._kernels.body_rows import hold_rows, project_on_rows
from sim._kernels.body_tables import BodyTable, Flags, Index, Led, RowKinds, Scratch
from sim._kernels.dense import copy, factorise, solve_lower, solve_upper
from sim._kernels.frames import (
    add,
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
from sim._kernels.options import bare, bare_kernel

Array = NDArray[np.float64]


@bare
def _place_points(table, frames, scratch):
    for p in range(len(table.body)):
        arm = rotated(frames, table.body[p], vector(table.arm, p))
        put(scratch.arm, p, 0, arm, 1.0)
        put(scratch.q, p, 0, arm, 1.0)
        if table.body[p] >= 0:
            add(scratch.q, p, 0, vector(frames, table.body[p]), 1.0)


@bare
def _velocities(table, twists, scratch, v):
    """Velocities of points at the lever arms of `scratch.arm`."""
    for p in range(len(table.body)):
        b = table.body[p]
        for d in range(3):
            v[p, d] = 0.0
        if b >= 0:
            u = cross((twists[b, 3], twists[b, 4], twists[b, 5]), vector(scratch.arm, p))
            for d in range(3):
                v[p, d] = twists[b, d] + u[d]


@bare
def _carry(table, led, i, scratch):
    """Velocities of points by the prescribed bodies at the end of step i."""
    for k in range(len(led.body)):
        u = (led.twists[i, k, 3], led.twists[i, k, 4], led.twists[i, k, 5])
        for p in range(len(table.body)):
            if table.body[p] == led.body[k]:
                v = cross(u, vector(scratch.arm, p))
                for d in range(3):
                    scratch.carried[p, d] = led.twists[i, k, d] + v[d]


@bare
def _start(table, frames, twists, scratch):
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


@bare
def _add_mass(table, h, scratch):
    """A += M at the pose predicted by the initial velocities; `scratch.ahead` are the initial frames."""
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


@bare
def _equation(table, lines, activation, whole, h, theta, scratch):
    """Factor of A = M + theta h D + (theta h)^2 K, and the velocities w1 without rows.

    Returns the number of negative eigenvalues of A, -1 without a factor.

    A w1 = p + h f - (1 - theta)/theta (A - M) w0: implicit Euler for theta = 1, the trapezoidal rule for
    theta = 1/2.
    """
    A, r, w0, w1, n = scratch.A, scratch.r, scratch.w0, scratch.w1, len(scratch.w0)
    by_damping, by_stiffness = theta * h, (theta * h) ** 2
    for i in range(n):
        r[i] = 0.0
    copy(table.load, scratch.force)
    measure_segments(table, scratch)
    for k in range(len(table.start) - 1):
        add_line(table, lines, k, activation, scratch, by_damping, by_stiffness)
    add_morsels(table, whole, scratch, by_damping, by_stiffness)
    add_points(table, scratch, by_stiffness)
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
    negative = factorise(A, scratch.sign, n)
    if negative >= 0:
        solve_lower(A, w1, n)
        for i in range(n):
            w1[i] *= scratch.sign[i]
        solve_upper(A, w1, n)
    return negative


@bare_kernel
def change_of_bodies(
    table: BodyTable,
    lines: LineTable,
    scratch: Scratch,
    start: Array,
    end: Array,
    activation: Array,
    d: Array,
    change: Array,
) -> None:
    """Motion d (n,) between frames, and decrease (n,) of the generalised forces at one activation.

    Forces are those of loads and line muscles, without morsels and rates.
    """
    scratch.A[:] = 0.0  # no share of a matrix is added to it
    scratch.carried[:] = 0.0
    scratch.v[:] = 0.0
    for side in range(2):
        _place_points(table, start if side == 0 else end, scratch)
        scratch.r[:] = 0.0
        copy(table.load, scratch.force)
        measure_segments(table, scratch)
        for k in range(len(table.start) - 1):
            add_line(table, lines, k, activation, scratch, 0.0, 0.0)
        add_points(table, scratch, 0.0)
        for i in range(len(change)):
            change[i] = scratch.r[i] if side == 0 else change[i] - scratch.r[i]
    for b in range(len(table.column)):
        c = table.column[b]
        if c >= 0:
            theta = turn_between(start, end, b)
            d[c + 3], d[c + 4], d[c + 5] = theta
            for i in range(3):
                d[c + i] = end[b, i] - start[b, i]


@bare_kernel
def place_bodies(
    table: BodyTable, scratch: Scratch, frames: Array, twists: Array, q: Array, v: Array
) -> None:
    """Positions q and velocities v (n_points, 3) of all points."""
    _place_points(table, frames, scratch)
    _velocities(table, twists, scratch, v)
    copy(scratch.q, q)


@bare_kernel
def advance_bodies(
    table: BodyTable,
    lines: LineTable,
    rows: RowTable,
    kinds: RowKinds,
    led: Led,
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
    still = scratch.still
    rated = False
    for k in range(len(lines.relation)):
        rated = rated or lines.relation[k, 0] > 0.0
    for i in range(len(h)):
        copy(frames[i], scratch.frames)
        copy(frames[i], scratch.ahead)
        if rated:
            _place_points(table, scratch.frames, scratch)
            _velocities(table, twists[i], scratch, scratch.v)
        for k in range(len(led.body)):
            for d in range(7):
                scratch.frames[led.body[k], d] = led.frames[i, k, d]
            for d in range(6):
                still[led.body[k], d] = led.twists[i, k, d]
        _start(table, scratch.ahead, twists[i], scratch)
        _place_points(table, scratch.frames, scratch)
        _carry(table, led, i, scratch)
        negative[i] = _equation(table, lines, activation[i], whole[i], h[i], theta, scratch)
        if negative[i] < 0:
            return i
        if len(scratch.c) > 0 and not hold_rows(rows, kinds, table, still, h[i], scratch):
            return i
        for j in range(len(scratch.g)):
            scratch.g[j] = h[i] * ((1.0 - theta) * scratch.w0[j] + theta * scratch.w1[j])
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                move(scratch.frames, b, scratch.g, table.column[b])
        if len(scratch.c) > 0 and not project_on_rows(
            rows, kinds, table, still, most, drift, scratch
        ):
            return i
        finite = True
        for j in range(len(scratch.w1)):
            finite = finite and math.isfinite(scratch.w1[j])
        if not finite:
            return i
        copy(scratch.frames, frames[i + 1])
        # forces of rows in their direction at the start, and those due to the rotation of the rows
        for j in range(len(scratch.c)):
            reaction[i, j] = scratch.held[j] + scratch.f[j] / h[i]
        copy(still, twists[i + 1])
        for b in range(len(table.column)):
            if table.column[b] >= 0:
                for d in range(6):
                    twists[i + 1, b, d] = scratch.w1[table.column[b] + d]
        for k in range(len(table.morsel)):
            p = table.morsel[k]
            d = morsel_gap(table, k, placed(scratch.frames, table.body[p], vector(table.arm, p)))
            whole[i + 1, k] = d > table.plane[k, 6] or (whole[i, k] and d >= gone)
    return len(h)
