"""Forces and time steps of a reduced solid: few coordinates y, and weighted elements.

Positions are q = q0 + Phi y and the energy is a sum over weighted elements, so that the coordinates
have the force

    f = Phi' sum_e w_e f_e(q0 + Phi y)

with the nodal forces f_e of `sim._kernels.solid`. A step solves its equation by conjugate gradients,
preconditioned by the inverse of the matrix at rest, with the stiffness at the start of the step: the
moduli of the elements are kept, and a product is a sum over the elements. The first r coordinates move;
forces on the others, which stay zero, estimate the error of leaving them out.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np

from sim._kernels.element import (
    Part,
    Reals,
    along_moduli,
    cofactor,
    deformation,
    determinant,
    gather,
    gradient,
    least,
    nodal,
)
from sim._kernels.lanes import LANES, load, store, total
from sim._kernels.laws import FibreTable, LawTable
from sim._kernels.options import inner, kernel
from sim._kernels.scatter import subtract_from_nodes
from sim._kernels.solid import MODULI, STRESS, element_stress

DONE, INVERTED, NOT_REACHED = 0, 1, 2
VECTORS = 4  #: vectors of a step
KEPT = 54  #: rows of moduli of an element
STILL = 1e-12  #: displacement in a step below which a solution ends [m]


class Elements(NamedTuple):
    """Weighted elements of a solid, and the positions of their k nodes."""

    parts: tuple[Part, ...]  #: numbered by these nodes
    laws: LawTable
    fibres: FibreTable
    weight: Reals  #: (n_elements,) factor on the energy of every element of the mesh
    rest: Reals  #: (k, 3) positions where all coordinates are zero [m]
    #: (3 k * blocks, 8) derivative of the positions by the n coordinates, filled with zeros
    modes: Reals


class Scratch(NamedTuple):
    """Memory for r moving coordinates of n, k nodes and the elements of the mesh."""

    q: Reals  #: (k, 3) positions
    f: Reals  #: (k, 3) forces
    x: Reals  #: (8, 3) of one element
    w: Reals  #: (ROWS, 8) of one element
    energy: Reals  #: (n_elements,)
    least: Reals  #: (n_elements,) smallest det F
    moduli: Reals  #: (KEPT * elements with a weight, 8) at the start of a step
    y: Reals  #: (blocks, 8) coordinates
    force: Reals  #: (blocks, 8) forces on the coordinates
    start: Reals  #: (n,) those of the elements at the start of a step
    #: (n,) K p of the last product, and K v of the solution
    change: Reals
    stiff: Reals
    vectors: Reals  #: (VECTORS, r)


class Linear(NamedTuple):
    """Constant force and matrices over all n coordinates."""

    load: Reals  #: (n,) generalised force [N kg^-1/2]
    damping: Reals  #: (n, n) [1/s]
    stiffness: Reals  #: (n, n) at rest [1/s^2]
    size: float  #: root of the mass of the tissue, which turns norms of coordinates into metres


@inner
def _place(t, s, moving, whole):
    """Positions at the coordinates `s.y`, of which `moving` rows are not zero; else their change."""
    blocks = s.y.shape[0]
    for i in range(s.q.shape[0]):
        for j in range(3):
            row = (3 * i + j) * blocks
            p = load(t.modes, row) * load(s.y, 0)
            for k in range(1, moving):
                p += load(t.modes, row + k) * load(s.y, k)
            s.q[i, j] = (t.rest[i, j] if whole else 0.0) + total(p)


@inner
def _project(t, s):
    """Forces on the coordinates from those on the nodes."""
    blocks = s.y.shape[0]
    s.force[:] = 0.0
    for i in range(s.q.shape[0]):
        for j in range(3):
            row, f = (3 * i + j) * blocks, s.f[i, j]
            for k in range(blocks):
                store(s.force, k, load(s.force, k) + f * load(t.modes, row + k))


@inner
def _forces(t, activation, s, moving, with_moduli):
    """Write the forces of the elements on all coordinates; return energy, least det F, its element."""
    _place(t, s, moving, np.bool_(True))
    s.f[:] = 0.0
    energy, smallest, at, first = 0.0, math.inf, -1, 0
    for part in t.parts:
        for e in range(part.element.size):
            element_stress(
                e, s.q, part, t.laws, t.fibres, activation, t.weight, with_moduli, s.x, s.w, s.energy,
                s.least,
            )  # fmt: skip
            own = part.element[e]
            energy += s.energy[own]
            if not (s.least[own] >= smallest):
                smallest, at = s.least[own], own
            if not (smallest > 0.0):
                return energy, smallest, at
            if with_moduli:
                for k in range(KEPT):
                    store(s.moduli, first + k, load(s.w, MODULI + k))
                first += KEPT
            nodal(s.w, STRESS, part.slope, STRESS)
            subtract_from_nodes(s.w, STRESS, part.nodes, e, s.f)
    _project(t, s)
    return energy, smallest, at


@inner
def _stiffness(t, s, moving):
    """Product -K y in `s.force`, for `s.y` and the kept moduli."""
    _place(t, s, moving, np.bool_(False))
    s.f[:] = 0.0
    first = 0
    for part in t.parts:
        for e in range(part.element.size):
            gather(s.q, part.nodes, e, s.x)
            along_moduli(s.moduli, first, gradient(s.x, part.slope_at), STRESS, s.w)
            nodal(s.w, STRESS, part.slope, STRESS)
            subtract_from_nodes(s.w, STRESS, part.nodes, e, s.f)
            first += KEPT
    _project(t, s)


@inner
def _smallest_J(t, s, moving):
    """Smallest det F at the coordinates `s.y`, and its element."""
    _place(t, s, moving, np.bool_(True))
    smallest, at = math.inf, -1
    for part in t.parts:
        for e in range(part.element.size):
            gather(s.q, part.nodes, e, s.x)
            F = deformation(s.x, part.slope_at, part.inverse, e)
            J = least(determinant(F, cofactor(F)))
            if not (J >= smallest):
                smallest, at = J, part.element[e]
            if not (smallest > 0.0):
                return smallest, at
    return smallest, at


@kernel
def forces(t: Elements, activation: Reals, s: Scratch) -> tuple[float, float, int]:
    """Forces on all coordinates, in `s.force`, at the coordinates `s.y`.

    Returns the energy, the smallest det F and its element; the sum ends at an element with det F <= 0.
    """
    return _forces(t, activation, s, s.y.shape[0], np.bool_(False))


@inner
def _write(s, y):
    """Write the coordinates y."""
    for i in range(y.size):
        s.y[i // LANES, i % LANES] = y[i]


@inner
def _apply(inverse, x, out):
    """Product out = inverse x, and its product with x."""
    norm = 0.0
    for i in range(x.size):
        s = 0.0
        for j in range(x.size):
            s += inverse[i, j] * x[j]
        out[i] = s
        norm += s * x[i]
    return norm


@inner
def _product(t, linear, h, p, s, out):
    """Matrix of the step times p, and K p of all coordinates in `s.change`."""
    _write(s, p)
    _stiffness(t, s, (p.size + LANES - 1) // LANES)
    for i in range(s.start.size):
        s.change[i] = -s.force[i // LANES, i % LANES]
    for i in range(p.size):
        d = 0.0
        for j in range(p.size):
            d += linear.damping[i, j] * p[j]
        out[i] = p[i] + h * d + h * h * s.change[i]


@inner
def _add(s, factor):
    """Add the last K p, times a factor, to that of the velocities."""
    for i in range(s.start.size):
        s.stiff[i] += factor * s.change[i]


@inner
def _improve(t, linear, inverse, h, right, v, tolerance, most, s):
    """Solve the equation of the step for v, from a given v; return status and number of products."""
    r, z, p, Ap = s.vectors[0], s.vectors[1], s.vectors[2], s.vectors[3]
    still = (STILL * linear.size / h) ** 2
    _product(t, linear, h, v, s, Ap)
    s.stiff[:] = 0.0
    one = np.float64(1.0)
    _add(s, one)
    for i in range(v.size):
        r[i] = right[i] - Ap[i]
    norm = _apply(inverse, r, z)
    for i in range(v.size):
        p[i] = z[i]
    for k in range(most):
        work, energy = 0.0, 0.0
        for i in range(v.size):
            work += v[i] * right[i]
            energy += v[i] * (right[i] - r[i])
        if not (norm > max(tolerance * tolerance * energy, still)):
            if energy > 0.0:
                # Without drive, the energy of the step then never grows.
                scale = work / energy
                for i in range(v.size):
                    v[i] *= scale
                for i in range(s.stiff.size):
                    s.stiff[i] *= scale
            return DONE, k + 1
        _product(t, linear, h, p, s, Ap)
        curvature = 0.0
        for i in range(v.size):
            curvature += p[i] * Ap[i]
        if not (curvature > 0.0):
            return NOT_REACHED, k + 2
        alpha = norm / curvature
        _add(s, alpha)
        for i in range(v.size):
            v[i] += alpha * p[i]
            r[i] -= alpha * Ap[i]
        new = _apply(inverse, r, z)
        beta = new / norm
        norm = new
        for i in range(v.size):
            p[i] = z[i] + beta * p[i]
    return NOT_REACHED, most + 1


@kernel
def predict(
    t: Elements,
    linear: Linear,
    inverse: Reals,
    h: float,
    activation: Reals,
    y: Reals,
    v: Reals,
    right: Reals,
    tolerance: float,
    most: int,
    s: Scratch,
) -> tuple[int, float, int, int]:
    """Velocities v, in place, at the end of a linearly implicit Euler step.

    (1 + h D + h^2 K) v1 = v0 + h f(y0) + impulses with the activation at the end. The error e of v1
    meets e' A e <= tolerance^2 v1' A v1 with the matrix A of the step, up to the preconditioner, and
    v1 has the length that makes it the best along its direction: v1' A v1 = v1' right, which implies
    that a step without drive does not increase the energy (to second order), as for the exact v1.

    `right` contains the impulses and becomes the right-hand side; the forces are kept in `s.start`, and
    the moduli in `s.moduli`. `inverse` is that of the matrix at rest. Returns status, smallest det F at
    the start, its element, and the number of products with the matrix, at most `most`.
    """
    _write(s, y)
    _, J, at = _forces(t, activation, s, (y.size + LANES - 1) // LANES, np.bool_(True))
    if not (J > 0.0):
        return INVERTED, J, at, 0
    for i in range(linear.load.size):
        s.start[i] = s.force[i // LANES, i % LANES]
    for i in range(y.size):
        right[i] += v[i] + h * (s.start[i] + linear.load[i])
    status, products = _improve(t, linear, inverse, h, right, v, tolerance, most, s)
    return status, J, at, products


@kernel
def improve(
    t: Elements,
    linear: Linear,
    inverse: Reals,
    h: float,
    right: Reals,
    v: Reals,
    tolerance: float,
    most: int,
    s: Scratch,
) -> tuple[int, int]:
    """Velocities v, in place, of the equation of `predict` with another right-hand side."""
    return _improve(t, linear, inverse, h, right, v, tolerance, most, s)


@kernel
def move(
    t: Elements,
    linear: Linear,
    relaxed: Reals,
    h: float,
    y: Reals,
    v: Reals,
    e: Reals,
    u: Reals,
    impulse: Reals,
    s: Scratch,
) -> tuple[int, float, int]:
    """End of a step with velocities v: y1 = y0 + h v, in place.

    The omitted coordinates e with velocities u follow the forces on them and the impulses (n,) of
    contacts, linearised: relaxed u1 = u0 + h (f(y0) - h K v - D v - K_rest e0) + impulse, where
    `relaxed` is the inverse of their 1 + h D + h^2 K_rest and K v is in `s.stiff`. Returns status,
    smallest det F at the end and its element.
    """
    D, K_rest, r, n = linear.damping, linear.stiffness, y.size, linear.load.size
    for i in range(r):
        y[i] += h * v[i]
    _write(s, y)
    J, at = _smallest_J(t, s, (r + LANES - 1) // LANES)
    if not (J > 0.0):
        return INVERTED, J, at
    for i in range(r, n):
        change = s.start[i] - h * s.stiff[i] + linear.load[i]
        for j in range(r):
            change -= D[i, j] * v[j]
        for j in range(r, n):
            change -= K_rest[i, j] * e[j - r]
        s.change[i] = u[i - r] + h * change + impulse[i]
    for i in range(n - r):
        new = 0.0
        for j in range(n - r):
            new += relaxed[i, j] * s.change[r + j]
        u[i] = new
        e[i] += h * new
    return DONE, J, at
