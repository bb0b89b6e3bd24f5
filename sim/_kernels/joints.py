"""Values and derivatives of joint rows, by bodies and points."""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import inner, kernel

Array = NDArray[np.float64]

TRAVEL, ALIGNED, CURVE, ANGLE = 0, 1, 2, 3


class RowTable(NamedTuple):
    """Rows (m) laid out; frame A is on body a, frame B on body b or, with a point, at that point.

    kind : TRAVEL, n_i . (x_B - x_A); ALIGNED, u_i . v_j; CURVE, z - f(x) in frame A; ANGLE about the
        third axis of A. Axes u, n are columns of `axes_a`, v of `axes_b`, in the axes of their bodies.
    body_a, body_b : -1 for space.
    point : number of a point, -1 without.
    i, j : axes.
    sign, offset : the value is sign (raw - offset).
    curve : (m, 6) first and last x of f, then its coefficients of x^0 to x^3; straight beyond.
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
def _rotated(frame, v, out):
    """Rotate v by the quaternion of a frame, v + 2 w (r x v) + 2 r x (r x v)."""
    w, x, y, z = frame[3], frame[4], frame[5], frame[6]
    a = 2.0 * (y * v[2] - z * v[1])
    b = 2.0 * (z * v[0] - x * v[2])
    c = 2.0 * (x * v[1] - y * v[0])
    out[0] = v[0] + w * a + y * c - z * b
    out[1] = v[1] + w * b + z * a - x * c
    out[2] = v[2] + w * c + x * b - y * a


@inner
def _axis(frames, body, axes, k, out):
    if body < 0:
        for d in range(3):
            out[d] = axes[d, k]
    else:
        _rotated(frames[body], axes[:, k], out)


@inner
def _place(frames, body, origin, out):
    if body < 0:
        for d in range(3):
            out[d] = origin[d]
    else:
        _rotated(frames[body], origin, out)
        for d in range(3):
            out[d] += frames[body, d]


@inner
def _cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@inner
def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def _height(curve, x):
    """Height of a curve and its slope."""
    at = min(max(x, curve[0]), curve[1])
    f = curve[2] + at * (curve[3] + at * (curve[4] + at * curve[5]))
    slope = curve[3] + at * (2.0 * curve[4] + 3.0 * at * curve[5])
    return f + slope * (x - at), slope


@kernel
def evaluate_rows(
    table: RowTable, frames: Array, q: Array, c: Array, JA: Array, JB: Array, JP: Array
) -> None:
    """Values c (m,), and their derivatives by twists of both bodies (m, 6) and points (m, 3)."""
    xa, xb, r = np.empty(3), np.empty(3), np.empty(3)
    n, u, v = np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(c)):
        a, b, p = table.body_a[k], table.body_b[k], table.point[k]
        sign = table.sign[k]
        JA[k], JB[k], JP[k] = 0.0, 0.0, 0.0
        if table.kind[k] == ALIGNED or table.kind[k] == ANGLE:
            if table.kind[k] == ALIGNED:
                _axis(frames, a, table.axes_a[k], table.i[k], u)
                _axis(frames, b, table.axes_b[k], table.j[k], v)
                raw = _dot(u, v)
                _cross(v, u, n)
            else:
                _axis(frames, a, table.axes_a[k], 0, u)
                _axis(frames, a, table.axes_a[k], 1, n)
                _axis(frames, b, table.axes_b[k], 0, v)
                raw = math.atan2(_dot(v, n), _dot(v, u))
                _axis(frames, a, table.axes_a[k], 2, n)
            c[k] = sign * (raw - table.offset[k])
            for d in range(3):
                JA[k, 3 + d], JB[k, 3 + d] = -sign * n[d], sign * n[d]
            continue
        _place(frames, a, table.origin_a[k], xa)
        if p >= 0:
            for d in range(3):
                xb[d] = q[p, d]
        else:
            _place(frames, b, table.origin_b[k], xb)
        for d in range(3):
            r[d] = xb[d] - xa[d]
        if table.kind[k] == TRAVEL:
            _axis(frames, a, table.axes_a[k], table.i[k], n)
            raw = _dot(n, r)
        else:
            _axis(frames, a, table.axes_a[k], 0, u)
            _axis(frames, a, table.axes_a[k], 2, n)
            f, slope = _height(table.curve[k], _dot(u, r))
            raw = _dot(n, r) - f
            for d in range(3):
                n[d] -= slope * u[d]
        c[k] = sign * (raw - table.offset[k])
        for d in range(3):
            n[d] *= sign
        # of body a: -n at x_B, since n and x_A turn with it
        if a >= 0:
            for d in range(3):
                r[d] = xb[d] - frames[a, d]
                JA[k, d] = -n[d]
            _cross(n, r, u)
            for d in range(3):
                JA[k, 3 + d] = u[d]
        if p >= 0:
            for d in range(3):
                JP[k, d] = n[d]
        elif b >= 0:
            for d in range(3):
                r[d] = xb[d] - frames[b, d]
                JB[k, d] = n[d]
            _cross(r, n, u)
            for d in range(3):
                JB[k, 3 + d] = u[d]
