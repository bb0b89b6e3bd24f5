"""Values and derivatives of joint rows, by bodies and points."""

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
    placed,
    put,
    rate_of_vector,
    rotated,
    rotation_vector,
    vector,
)
from sim._kernels.options import bare_kernel, inner

Array = NDArray[np.float64]

TRAVEL, ALIGNED, CURVE, ANGLE, TURN = 0, 1, 2, 3, 4


class RowTable(NamedTuple):
    """Rows (m) laid out; frame A is on body a, frame B on body b or, with a point, at that point.

    kind : TRAVEL, n_i . (x_B - x_A); ALIGNED, u_i . v_j; CURVE, z - f(x) in frame A; ANGLE about the
        third axis of A; TURN, n_i . theta with the rotation vector theta from A to B. Axes u, n are
        columns of `axes_a`, v of `axes_b`, in the axes of their bodies.
    body_a, body_b : -1 for space.
    point : number of a point, -1 without.
    i, j : axes.
    sign, offset : the value is sign (raw - offset).
    curve : (m, 6) first and last x of f, then its coefficients of x^0 to x^3; straight beyond. Of an
        ANGLE, the first is the middle of the turn within which it is measured [rad].
    """

    kind: NDArray[np.int64]
    body_a: NDArray[np.int64]
    body_b: NDArray[np.int64]
    point: NDArray[np.int64]
    i: NDArray[np.int64]
    j: NDArray[np.int64]
    sign: NDArray[np.float64]
    offset: NDArray[np.float64]
    origin_a: NDArray[np.float64]
    axes_a: NDArray[np.float64]
    origin_b: NDArray[np.float64]
    axes_b: NDArray[np.float64]
    curve: NDArray[np.float64]


@inner
def _axis(frames, body, axes, k, i):
    return rotated(frames, body, (axes[k, 0, i], axes[k, 1, i], axes[k, 2, i]))


@inner
def _height(curve, k, x):
    """Height of a curve and its slope."""
    at = min(max(x, curve[k, 0]), curve[k, 1])
    f = curve[k, 2] + at * (curve[k, 3] + at * (curve[k, 4] + at * curve[k, 5]))
    slope = curve[k, 3] + at * (2.0 * curve[k, 4] + 3.0 * at * curve[k, 5])
    return f + slope * (x - at), slope


@inner
def _set(J, k, force, moment):
    put(J, k, 0, force, 1.0)
    put(J, k, 3, moment, 1.0)


@inner
def _between_axes(table, frames, k):
    """Value of a row of axes, and its derivative by the angular velocity of B less that of A."""
    a, b = table.body_a[k], table.body_b[k]
    if table.kind[k] == ALIGNED:
        u = _axis(frames, a, table.axes_a, k, table.i[k])
        v = _axis(frames, b, table.axes_b, k, table.j[k])
        return inner_product(u, v), cross(v, u)
    if table.kind[k] == TURN:
        return _rotation(table, frames, k)
    u, n = _axis(frames, a, table.axes_a, k, 0), _axis(frames, a, table.axes_a, k, 1)
    v = _axis(frames, b, table.axes_b, k, 0)
    angle = math.atan2(inner_product(v, n), inner_product(v, u))
    turn = 2.0 * math.pi
    angle += turn * math.floor((table.curve[k, 0] - angle) / turn + 0.5)
    return angle, _axis(frames, a, table.axes_a, k, 2)


@inner
def _quaternion(frames, b):
    if b < 0:
        return (1.0, 0.0, 0.0, 0.0)
    return (frames[b, 3], frames[b, 4], frames[b, 5], frames[b, 6])


@inner
def _rotation(table, frames, k):
    """Component of the rotation vector theta of B in the axes of A, and its derivative, both turned.

    The derivative of n . theta is the transpose of the map from the relative angular velocity to
    d theta/dt, applied to n.
    """
    a, b, i = table.body_a[k], table.body_b[k], table.i[k]
    p, q = _quaternion(frames, a), _quaternion(frames, b)
    u, v = (p[1], p[2], p[3]), (q[1], q[2], q[3])
    w, x = p[0] * q[0] + inner_product(u, v), cross(u, v)
    r = (
        p[0] * v[0] - q[0] * u[0] - x[0],
        p[0] * v[1] - q[0] * u[1] - x[1],
        p[0] * v[2] - q[0] * u[2] - x[2],
    )
    theta = rotation_vector(w, r)
    n = (table.axes_a[k, 0, i], table.axes_a[k, 1, i], table.axes_a[k, 2, i])
    slope = rate_of_vector(theta, n, 0.5)
    return inner_product(n, theta), rotated(frames, a, slope)


@inner
def _of_place(table, frames, k, r):
    """Value of a row of the vector r from x_A to x_B, and its derivative by r."""
    a = table.body_a[k]
    if table.kind[k] == TRAVEL:
        n = _axis(frames, a, table.axes_a, k, table.i[k])
        return inner_product(n, r), n
    u, n = _axis(frames, a, table.axes_a, k, 0), _axis(frames, a, table.axes_a, k, 2)
    f, slope = _height(table.curve, k, inner_product(u, r))
    along = (n[0] - slope * u[0], n[1] - slope * u[1], n[2] - slope * u[2])
    return inner_product(n, r) - f, along


@inner
def evaluate_rows(table, frames, q, c, JA, JB, JP):
    """Values c (m,), and their derivatives by twists of both bodies (m, 6) and points (m, 3)."""
    for k in range(len(c)):
        a, b, p = table.body_a[k], table.body_b[k], table.point[k]
        sign = table.sign[k]
        JA[k], JB[k], JP[k] = 0.0, 0.0, 0.0
        if table.kind[k] == ALIGNED or table.kind[k] == ANGLE or table.kind[k] == TURN:
            raw, n = _between_axes(table, frames, k)
            put(JA, k, 3, n, -sign)
            put(JB, k, 3, n, sign)
        else:
            x = vector(q, p) if p >= 0 else placed(frames, b, vector(table.origin_b, k))
            raw, n = _of_place(
                table, frames, k, minus(x, placed(frames, a, vector(table.origin_a, k)))
            )
            n = (sign * n[0], sign * n[1], sign * n[2])
            # of body a: -n at x_B, since n and x_A turn with it
            if a >= 0:
                _set(JA, k, (-n[0], -n[1], -n[2]), cross(n, minus(x, vector(frames, a))))
            if p >= 0:
                put(JP, k, 0, n, 1.0)
            elif b >= 0:
                _set(JB, k, n, cross(minus(x, vector(frames, b)), n))
        c[k] = sign * (raw - table.offset[k])


@bare_kernel
def rows_at(
    table: RowTable, frames: Array, q: Array, c: Array, JA: Array, JB: Array, JP: Array
) -> None:
    """Values c (n, m), and their derivatives as of `evaluate_rows`, at n poses."""
    for i in range(len(c)):
        evaluate_rows(table, frames[i], q[i], c[i], JA[i], JB[i], JP[i])
