"""Runge-Kutta steps of rigid bodies under constant forces on their points, without rows and lines."""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.body_tables import BodyTable
from sim._kernels.frames import cross, move, rate_of_vector, rotated, turned, vector
from sim._kernels.options import inner, kernel

Array = NDArray[np.float64]


@inner
def _back(frames, v):
    """Vector from space to the axes of the body, Q'v."""
    return turned(frames[0, 3], (-frames[0, 4], -frames[0, 5], -frames[0, 6]), v)


@inner
def _product(I, b, v):  # noqa: E741
    return (
        I[b, 0, 0] * v[0] + I[b, 0, 1] * v[1] + I[b, 0, 2] * v[2],
        I[b, 1, 0] * v[0] + I[b, 1, 1] * v[1] + I[b, 1, 2] * v[2],
        I[b, 2, 0] * v[0] + I[b, 2, 1] * v[1] + I[b, 2, 2] * v[2],
    )


@inner
def _acceleration(table, b, frame, w, a):
    """Rates a (6,) of the twist w: m dv/dt = f, I domega/dt = m - omega x I omega (Euler)."""
    f, moment = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for p in range(len(table.body)):
        if table.body[p] == b:
            load = vector(table.load, p)
            m = cross(rotated(frame, 0, vector(table.arm, p)), load)
            f = (f[0] + load[0], f[1] + load[1], f[2] + load[2])
            moment = (moment[0] + m[0], moment[1] + m[1], moment[2] + m[2])
    along, about = table.damping[b, 0], table.damping[b, 1]
    omega = _back(frame, (w[3], w[4], w[5]))
    spin = cross(omega, _product(table.inertia, b, omega))
    m = _back(frame, (moment[0] - about * w[3], moment[1] - about * w[4], moment[2] - about * w[5]))
    rate = _product(table.inverse, b, (m[0] - spin[0], m[1] - spin[1], m[2] - spin[2]))
    rate = rotated(frame, 0, rate)
    for d in range(3):
        a[d] = (f[d] - along * w[d]) / table.mass[b]
        a[3 + d] = rate[d]


@kernel
def run_free_bodies(table: BodyTable, h: Array, frames: Array, twists: Array) -> None:
    """Advance frames (n_bodies, 7) and twists (n_bodies, 6) by the classical method with steps h (n,).

    Rotations are integrated in the rotation vector since the start of each step (Munthe-Kaas 1999).
    """
    weight, share = (1.0, 2.0, 2.0, 1.0), (0.0, 0.5, 0.5, 1.0)
    frame, d, w = np.empty((1, 7)), np.empty(6), np.empty(6)
    rate, a, sum_rate, sum_a = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    for b in range(len(frames)):
        if table.column[b] < 0:
            continue
        for i in range(len(h)):
            for stage in range(4):
                s = share[stage] * h[i]
                frame[0] = frames[b]
                for k in range(6):
                    d[k], w[k] = 0.0, twists[b, k]
                    if stage > 0:
                        d[k], w[k] = s * rate[k], twists[b, k] + s * a[k]
                move(frame, 0, d, 0)
                turning = rate_of_vector((d[3], d[4], d[5]), (w[3], w[4], w[5]), -0.5)
                rate[0], rate[1], rate[2] = w[0], w[1], w[2]
                rate[3], rate[4], rate[5] = turning
                _acceleration(table, b, frame, w, a)
                for k in range(6):
                    before = (0.0, 0.0) if stage == 0 else (sum_rate[k], sum_a[k])
                    sum_rate[k] = before[0] + weight[stage] * rate[k]
                    sum_a[k] = before[1] + weight[stage] * a[k]
            for k in range(6):
                sum_rate[k] *= h[i] / 6.0
                twists[b, k] += h[i] / 6.0 * sum_a[k]
            frame[0] = frames[b]
            move(frame, 0, sum_rate, 0)
            frames[b] = frame[0]
