"""Vectors of three numbers; frames (n, 7) of bodies: centre and unit quaternion, scalar first."""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math

from sim._kernels.options import inner

SMALL = 1e-3
"""Angle [rad] below which series replace quotients; what they leave out is below 1e-16."""


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
def rotated(frames, b, v):
    """Vector from the axes of body b to space, v + 2 w (r x v) + 2 r x (r x v); body -1 is space."""
    if b < 0:
        return v
    w, r = frames[b, 3], (frames[b, 4], frames[b, 5], frames[b, 6])
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
    for k in range(3):
        frames[b, k] += d[i + k]
    theta = (d[i + 3], d[i + 4], d[i + 5])
    angle = math.sqrt(inner_product(theta, theta))
    half = 0.5 - angle * angle / 48.0
    if angle >= SMALL:
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
    for k in range(4):
        frames[b, 3 + k] = new[k] / size


@inner
def turned_tensor(frames, b, I, out):  # noqa: E741
    """Symmetric tensor I (3, 3) from the axes of body b to space, Q I Q'."""
    e = (
        rotated(frames, b, (1.0, 0.0, 0.0)),
        rotated(frames, b, (0.0, 1.0, 0.0)),
        rotated(frames, b, (0.0, 0.0, 1.0)),
    )
    for i in range(3):
        for j in range(i, 3):
            s = 0.0
            for k in range(3):
                for m in range(3):
                    s += e[k][i] * I[k, m] * e[m][j]
            out[i, j] = s
            out[j, i] = s
