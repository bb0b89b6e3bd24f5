"""Vectors as tuples of three numbers; frames (n, 7) of bodies: centre and quaternion, scalar first."""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import bare_kernel, inner

Array = NDArray[np.float64]

# numba looks a tuple up by a loop variable through a table: indices of tuples are written out

SMALL_ANGLE = 1e-3
"""Angle [rad] below which series replace quotients, with an error below 1e-16."""

COASTS, COAST_RESIDUAL = 30, 1e-13
"""Largest number of Newton iterations for a free rotation, and the relative momentum that remains."""


@inner
def cross(a, b):
    """Cross product."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@inner
def inner_product(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inner
def minus(a, b):
    """Difference."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@inner
def vector(x, i):
    """Row i of an array (n, 3)."""
    return (x[i, 0], x[i, 1], x[i, 2])


@inner
def add(x, i, j, v, factor):
    """x[i, j:j + 3] += factor v."""
    x[i, j] += factor * v[0]
    x[i, j + 1] += factor * v[1]
    x[i, j + 2] += factor * v[2]


@inner
def put(x, i, j, v, factor):
    """x[i, j:j + 3] = factor v."""
    x[i, j], x[i, j + 1], x[i, j + 2] = factor * v[0], factor * v[1], factor * v[2]


@inner
def times(I, k, e):  # noqa: E741
    """Sum of the three vectors e with row k of a matrix as factors."""
    a, b, c = I[k, 0], I[k, 1], I[k, 2]
    return (
        a * e[0][0] + b * e[1][0] + c * e[2][0],
        a * e[0][1] + b * e[1][1] + c * e[2][1],
        a * e[0][2] + b * e[1][2] + c * e[2][2],
    )


@inner
def rotated(frames, b, v):
    """Vector from the axes of body b to space, v + 2 w (r x v) + 2 r x (r x v); body -1 is space."""
    if b < 0:
        return v
    return turned(frames[b, 3], (frames[b, 4], frames[b, 5], frames[b, 6]), v)


@inner
def turned(w, r, v):
    """Vector turned by a quaternion with scalar part w and vector part r."""
    t = cross(r, v)
    u = cross(r, t)
    return (
        v[0] + 2.0 * (w * t[0] + u[0]),
        v[1] + 2.0 * (w * t[1] + u[1]),
        v[2] + 2.0 * (w * t[2] + u[2]),
    )


@inner
def placed(frames, b, v):
    """Position in space of a point that is v from the centre of body b, in its axes."""
    if b < 0:
        return v
    r = rotated(frames, b, v)
    return (frames[b, 0] + r[0], frames[b, 1] + r[1], frames[b, 2] + r[2])


@inner
def move(frames, b, d, i):
    """Move the centre of body b by d[i:i + 3] and turn it by the rotation vector d[i + 3:i + 6]."""
    add(frames, b, 0, (d[i], d[i + 1], d[i + 2]), 1.0)
    theta = (d[i + 3], d[i + 4], d[i + 5])
    angle = math.sqrt(inner_product(theta, theta))
    half = 0.5 - angle * angle / 48.0
    if angle >= SMALL_ANGLE:
        half = math.sin(0.5 * angle) / angle
    w, v = math.cos(0.5 * angle), (half * theta[0], half * theta[1], half * theta[2])
    a, c = frames[b, 3], (frames[b, 4], frames[b, 5], frames[b, 6])
    n = cross(v, c)
    new = (
        w * a - inner_product(v, c),
        w * c[0] + a * v[0] + n[0],
        w * c[1] + a * v[1] + n[1],
        w * c[2] + a * v[2] + n[2],
    )
    size = math.sqrt(new[0] * new[0] + new[1] * new[1] + new[2] * new[2] + new[3] * new[3])
    frames[b, 3], frames[b, 4] = new[0] / size, new[1] / size
    frames[b, 5], frames[b, 6] = new[2] / size, new[3] / size


@inner
def turn_between(start, end, b):
    """Rotation vector of body b from frames at the start to those at the end."""
    a, u = start[b, 3], (start[b, 4], start[b, 5], start[b, 6])
    c, v = end[b, 3], (end[b, 4], end[b, 5], end[b, 6])
    n = cross(u, v)
    r = (a * v[0] - c * u[0] + n[0], a * v[1] - c * u[1] + n[1], a * v[2] - c * u[2] + n[2])
    return rotation_vector(a * c + inner_product(u, v), r)


@inner
def rotation_vector(w, r):
    """Rotation vector of a quaternion with scalar part w and vector part r."""
    s = -1.0 if w < 0.0 else 1.0
    sine = math.sqrt(inner_product(r, r))
    size = s * (2.0 + sine * sine / 3.0)
    if sine >= SMALL_ANGLE:
        size = s * 2.0 * math.atan2(sine, s * w) / sine
    return (size * r[0], size * r[1], size * r[2])


@inner
def rate_of_vector(theta, v, half):
    """Sum v + half theta x v + s theta x (theta x v), s = (1 - a/2 cot(a/2))/a^2 with the angle a.

    Rate of a rotation vector theta at the angular velocity v for half = -1/2, its transpose for 1/2
    (`sim.kinematics.rotations.vector_rate`).
    """
    angle2 = inner_product(theta, theta)
    angle = math.sqrt(angle2)
    s = 1.0 / 12.0 + angle2 / 720.0
    if angle >= SMALL_ANGLE:
        s = (1.0 - 0.5 * angle / math.tan(0.5 * angle)) / angle2
    once = cross(theta, v)
    twice = cross(theta, once)
    return (
        v[0] + half * once[0] + s * twice[0],
        v[1] + half * once[1] + s * twice[1],
        v[2] + half * once[2] + s * twice[2],
    )


@inner
def turned_tensor(frames, b, I, out):  # noqa: E741
    """Symmetric tensor I (3, 3) from the axes of body b to space, Q I Q'."""
    e = (
        rotated(frames, b, (1.0, 0.0, 0.0)),
        rotated(frames, b, (0.0, 1.0, 0.0)),
        rotated(frames, b, (0.0, 0.0, 1.0)),
    )
    a, d, c = times(I, 0, e), times(I, 1, e), times(I, 2, e)
    out[0, 0] = e[0][0] * a[0] + e[1][0] * d[0] + e[2][0] * c[0]
    out[0, 1] = e[0][0] * a[1] + e[1][0] * d[1] + e[2][0] * c[1]
    out[0, 2] = e[0][0] * a[2] + e[1][0] * d[2] + e[2][0] * c[2]
    out[1, 1] = e[0][1] * a[1] + e[1][1] * d[1] + e[2][1] * c[1]
    out[1, 2] = e[0][1] * a[2] + e[1][1] * d[2] + e[2][1] * c[2]
    out[2, 2] = e[0][2] * a[2] + e[1][2] * d[2] + e[2][2] * c[2]
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@inner
def _momentum(I, v):  # noqa: E741
    """Product of a matrix (3, 3) and a vector."""
    return (
        I[0, 0] * v[0] + I[0, 1] * v[1] + I[0, 2] * v[2],
        I[1, 0] * v[0] + I[1, 1] * v[1] + I[1, 2] * v[2],
        I[2, 0] * v[0] + I[2, 1] * v[1] + I[2, 2] * v[2],
    )


@inner
def _turned_by(theta, v, sign):
    """Vector turned by the rotation vector sign theta."""
    angle = math.sqrt(inner_product(theta, theta))
    half = 0.5 - angle * angle / 48.0
    if angle >= SMALL_ANGLE:
        half = math.sin(0.5 * angle) / angle
    half *= sign
    return turned(math.cos(0.5 * angle), (half * theta[0], half * theta[1], half * theta[2]), v)


@inner
def _slope(theta, v):
    """Rotation in space that a change v of a rotation vector theta adds, dexp(theta) v."""
    angle2 = inner_product(theta, theta)
    angle = math.sqrt(angle2)
    first, second = 0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0
    if angle >= SMALL_ANGLE:
        first = (1.0 - math.cos(angle)) / angle2
        second = (angle - math.sin(angle)) / (angle2 * angle)
    once = cross(theta, v)
    twice = cross(theta, once)
    return (
        v[0] + first * once[0] + second * twice[0],
        v[1] + first * once[1] + second * twice[1],
        v[2] + first * once[2] + second * twice[2],
    )


@inner
def coasted(I, w0, h, theta):  # noqa: E741
    """Angular velocity w1 after a rotation without moment: I1 w1 = I w0, and True if it was found.

    I1 = R I R' with R = exp(h ((1 - theta) w0 + theta w1)), and I (3, 3) the inertia in space at the
    start: implicit Euler for theta = 1, for which the energy never grows; a symmetric rule for theta =
    1/2. Newton's method in the axes of the start, with d(R'v) = -R'(dexp(.) dw x v).
    """
    L, w = _momentum(I, w0), w0
    size = math.sqrt(inner_product(L, L))
    for _ in range(COASTS):
        d = (
            h * ((1.0 - theta) * w0[0] + theta * w[0]),
            h * ((1.0 - theta) * w0[1] + theta * w[1]),
            h * ((1.0 - theta) * w0[2] + theta * w[2]),
        )
        back, momentum = _turned_by(d, w, -1.0), _turned_by(d, L, -1.0)
        spin = _momentum(I, back)
        r = (spin[0] - momentum[0], spin[1] - momentum[1], spin[2] - momentum[2])
        if math.sqrt(inner_product(r, r)) <= COAST_RESIDUAL * size:
            return w, True
        # columns of the derivative of r by w
        a = _column(I, d, w, L, (1.0, 0.0, 0.0), h * theta)
        b = _column(I, d, w, L, (0.0, 1.0, 0.0), h * theta)
        c = _column(I, d, w, L, (0.0, 0.0, 1.0), h * theta)
        bc = cross(b, c)
        det = inner_product(a, bc)
        if det == 0.0:
            return w, False
        x = inner_product(r, bc) / det
        y = inner_product(r, cross(c, a)) / det
        z = inner_product(r, cross(a, b)) / det
        w = (w[0] - x, w[1] - y, w[2] - z)
    return w, False


@inner
def _column(I, d, w, L, e, s):  # noqa: E741
    """Derivative of I R'w - R'L along a change e of w, with the rotation s dexp(d) e of R."""
    turn = _slope(d, e)
    turn = (s * turn[0], s * turn[1], s * turn[2])
    n, m = cross(turn, w), cross(turn, L)
    inside = _momentum(I, _turned_by(d, (e[0] - n[0], e[1] - n[1], e[2] - n[2]), -1.0))
    m = _turned_by(d, m, -1.0)
    return (inside[0] + m[0], inside[1] + m[1], inside[2] + m[2])


@bare_kernel
def coast_all(I: Array, w0: Array, h: float, theta: float, w1: Array) -> int:  # noqa: E741
    """Velocities w1 (k, 3) of `coasted` for inertia I (k, 3, 3); the first body without, or -1."""
    for b in range(len(w0)):
        w, converged = coasted(I[b], vector(w0, b), h, theta)
        if not converged:
            return b
        put(w1, b, 0, w, 1.0)
    return -1
