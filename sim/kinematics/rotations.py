"""Rotations as unit quaternions (scalar first) and rotation vectors, one row per body."""

from collections.abc import Callable

import numpy as np

from sim.pattern import Array

Change = Callable[[Array, Array], Array]  #: a change of vectors (n, 3) by rotation vectors (n, 3)
SMALL_ANGLE = 1e-3  #: angle [rad] below which series replace quotients, with an error below 1e-16


def matrices(quaternion: Array) -> Array:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4)."""
    w, x, y, z = quaternion.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.ascontiguousarray(np.array(rows).transpose(2, 0, 1))


def product(p: Array, q: Array) -> Array:
    """Quaternion products p q (n, 4): the rotation q followed by p."""
    w, v = p[:, :1], p[:, 1:]
    a, b = q[:, :1], q[:, 1:]
    scalar = w * a - (v * b).sum(axis=1, keepdims=True)
    return np.concatenate([scalar, w * b + a * v + np.cross(v, b)], axis=1)


def exponential(theta: Array) -> Array:
    """Unit quaternions (n, 4) of rotation vectors (n, 3) [rad]."""
    angle = np.sqrt((theta * theta).sum(axis=1, keepdims=True))
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1.0, angle)
    half = np.where(small, 0.5 - angle**2 / 48.0, np.sin(0.5 * safe) / safe)
    return np.concatenate([np.cos(0.5 * angle), half * theta], axis=1)


def logarithm(quaternion: Array) -> Array:
    """Rotation vectors (n, 3) of unit quaternions, of angles up to pi."""
    q = np.where(quaternion[:, :1] < 0.0, -quaternion, quaternion)
    sine = np.sqrt((q[:, 1:] ** 2).sum(axis=1, keepdims=True))
    angle = 2.0 * np.arctan2(sine, q[:, :1])
    return q[:, 1:] * np.where(
        sine < SMALL_ANGLE, 2.0 + sine**2 / 3.0, angle / np.where(sine > 0, sine, 1)
    )


def turned(quaternion: Array, theta: Array) -> Array:
    """Orientations exp(theta) q, normalised."""
    q = product(exponential(theta), quaternion)
    return q / np.sqrt((q * q).sum(axis=1, keepdims=True))


def difference(start: Array, end: Array) -> Array:
    """Rotation vectors theta with exp(theta) start = end."""
    return logarithm(product(end, start * np.array([1.0, -1.0, -1.0, -1.0])))


def vector_rate(theta: Array, omega: Array) -> Array:
    """Rate of the rotation vector of exp(theta) by an angular velocity in space, dexp^-1(theta) omega.

    Source: Iserles, Munthe-Kaas, Norsett and Zanna 2000, Lie-group methods, Acta Numerica 9,
    equation 2.46 and the closed form for SO(3).
    """
    angle = np.sqrt((theta * theta).sum(axis=1, keepdims=True))
    safe = np.where(angle < SMALL_ANGLE, 1.0, angle)
    closed = (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2
    second = np.where(angle < SMALL_ANGLE, 1.0 / 12.0 + angle**2 / 720.0, closed)
    once = np.cross(theta, omega)
    return omega - 0.5 * once + second * np.cross(theta, once)


def vector_gradient(theta: Array, moment: Array) -> Array:
    """Derivative by theta of an energy whose moment in space is given, dexp(theta)' m."""
    angle = np.sqrt((theta * theta).sum(axis=1, keepdims=True))
    safe = np.where(angle < SMALL_ANGLE, 1.0, angle)
    first = np.where(angle < SMALL_ANGLE, 0.5 - angle**2 / 24.0, (1.0 - np.cos(safe)) / safe**2)
    second = np.where(
        angle < SMALL_ANGLE, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3
    )
    once = np.cross(theta, moment)
    return moment - first * once + second * np.cross(theta, once)
