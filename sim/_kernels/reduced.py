"""Forces and time steps of a reduced solid: few coordinates y, and weighted elements.

Positions are q = q0 + Phi y and the energy is a sum over weighted elements, so that the coordinates
have the force

    f = Phi' sum_e w_e f_e(q0 + Phi y)

with the nodal forces f_e of `sim._kernels.solid`. A step solves its equation by conjugate gradients,
preconditioned by the inverse of the matrix at rest, with the stiffness at the start of the step: the
moduli of the elements are kept, and a product is a sum over the elements. The first r coordinates move;
forces on the others, which stay zero, estimate the error of leaving them out.

A product reads all modes twice and all moduli once, which takes most of its time. Both are therefore in
single precision: forces are still the exact derivatives of the energy, of modes changed by 6e-8.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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

Singles = NDArray[np.float32]
Flags = NDArray[np.bool_]

DONE, INVERTED, NOT_REACHED, INVERTED_AT_END = 0, 1, 2, 3
BEGIN, SOLVE, MOVE = 1, 2, 4  #: stages of a step, which are summed
VECTORS = 4  #: vectors of a step
KEPT = 54  #: rows of moduli of an element
STILL = 1e-12  #: displacement in a step below which a solution ends [m]


class Elements(NamedTuple):
    """Weighted elements of a solid, and the positions of their k nodes, of which the first m move."""

    parts: tuple[Part, ...]  #: numbered by these nodes
    laws: LawTable
    fibres: FibreTable
    weight: Reals  #: (n_elements,) factor on the energy of every element of the mesh
    rest: Reals  #: (k, 3) positions where all coordinates are zero [m]
    #: (3 m * blocks, 8) derivative of the positions by the n coordinates, filled with zeros
    modes: Singles


class Scratch(NamedTuple):
    """Memory for r moving coordinates of n, k nodes and the elements of the mesh."""

    q: Reals  #: (k, 3) positions
    f: Reals  #: (k, 3) forces
    x: Reals  #: (8, 3) of one element
    w: Reals  #: (ROWS, 8) of one element
    energy: Reals  #: (n_elements,)
    least: Reals  #: (n_elements,) smallest det F
    moduli: Singles  #: (KEPT * elements with a weight, 8) at the start of a step
    y: Reals  #: (blocks, 8) coordinates
    placed: Flags  #: (1,) True if the positions are those at these coordinates
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
    m = t.modes.shape[0] // (3 * blocks)
    for i in range(m):
        x, y, z = 3 * i * blocks, (3 * i + 1) * blocks, (3 * i + 2) * blocks
        c = load(s.y, 0)
        p0, p1, p2 = c * load(t.modes, x), c * load(t.modes, y), c * load(t.modes, z)
        for k in range(1, moving):
            c = load(s.y, k)
            p0 += c * load(t.modes, x + k)
            p1 += c * load(t.modes, y + k)
            p2 += c * load(t.modes, z + k)
        s.q[i, 0], s.q[i, 1], s.q[i, 2] = total(p0), total(p1), total(p2)
    s.q[m:] = 0.0
    if whole:
        for i in range(s.q.shape[0]):
            for j in range(3):
                s.q[i, j] += t.rest[i, j]
    s.placed[0] = whole


@inner
def _project(t, s):
    """Forces on the coordinates from those on the nodes."""
    blocks = s.y.shape[0]
    s.force[:] = 0.0
    for i in range(t.modes.shape[0] // (3 * blocks)):
        x, y, z = 3 * i * blocks, (3 * i + 1) * blocks, (3 * i + 2) * blocks
        f0, f1, f2 = s.f[i, 0], s.f[i, 1], s.f[i, 2]
        for k in range(blocks):
            change = f0 * load(t.modes, x + k) + f1 * load(t.modes, y + k)
            store(s.force, k, load(s.force, k) + (change + f2 * load(t.modes, z + k)))


@inner
def _forces(t, activation, s, with_moduli):
    """Write the forces of the elements on all coordinates; return energy, least det F, its element."""
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
    _place(t, s, s.y.shape[0], np.bool_(True))
    return _forces(t, activation, s, np.bool_(False))


@inner
def _write(s, y):
    """Write the coordinates y."""
    for i in range(y.size):
        s.y[i // LANES, i % LANES] = y[i]


@inner
def _differ(s, y):
    """Test if the positions are not those at the coordinates y."""
    if not s.placed[0]:
        return True
    for i in range(y.size):
        if not s.y[i // LANES, i % LANES] == y[i]:
            return True
    return False


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


@inner
def _begin(t, linear, h, activation, y, v, right, s):
    """Right-hand side, moduli and forces at the start of a step; least det F and its element."""
    if _differ(s, y):  # They are those of the end of the step before where steps follow each other.
        _write(s, y)
        _place(t, s, (y.size + LANES - 1) // LANES, np.bool_(True))
    _, J, at = _forces(t, activation, s, np.bool_(True))
    if J > 0.0:
        for i in range(linear.load.size):
            s.start[i] = s.force[i // LANES, i % LANES]
        for i in range(y.size):
            right[i] += v[i] + h * (s.start[i] + linear.load[i])
    return J, at


@inner
def _move(t, linear, relaxed, h, y, v, e, u, impulse, s):
    """End of a step with velocities v; least det F there and its element."""
    D, K_rest, r, n = linear.damping, linear.stiffness, y.size, linear.load.size
    for i in range(r):
        y[i] += h * v[i]
    _write(s, y)
    J, at = _smallest_J(t, s, (r + LANES - 1) // LANES)
    if not (J > 0.0):
        return J, at
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
    return J, at


@inner
def _bend(s, v):
    """Energy along the velocities, v'K v, relative to the lengths of v and K v."""
    work, of_v, of_Kv = 0.0, 0.0, 0.0
    for i in range(v.size):
        work += v[i] * s.stiff[i]
        of_v += v[i] * v[i]
        of_Kv += s.stiff[i] * s.stiff[i]
    size = math.sqrt(of_v) * math.sqrt(of_Kv)
    return work / size if size > 0.0 else 0.0


@kernel
def advance(
    stages: int,
    t: Elements,
    linear: Linear,
    inverse: Reals,
    relaxed: Reals,
    h: float,
    activation: Reals,
    tolerance: float,
    most: int,
    y: Reals,
    v: Reals,
    right: Reals,
    e: Reals,
    u: Reals,
    impulse: Reals,
    s: Scratch,
) -> tuple[int, float, int, int, float]:
    """Some stages of a linearly implicit Euler step of the coordinates y with velocities v, in place.

    BEGIN keeps the forces in `s.start` and the moduli in `s.moduli`, and adds v0 + h f(y0), with the
    activation at the end, to the impulses in `right`.

    SOLVE finds the v of (1 + h D + h^2 K) v = right. Its error e meets e' A e <= tolerance^2 v' A v
    with the matrix A of the step, up to the preconditioner `inverse`, that of the matrix at rest, and
    v has the length that makes it the best along its direction: v' A v = v' right, which implies that a
    step without drive does not increase the energy (to second order), as for the exact v. K v is kept
    in `s.stiff`.

    MOVE adds h v to y. The omitted coordinates e with velocities u follow the forces on them and the
    impulses (n,) of contacts, linearised: relaxed u1 = u0 + h (f(y0) - h K v - D v - K_rest e0) +
    impulse, where `relaxed` is the inverse of their 1 + h D + h^2 K_rest.

    Returns status, least det F and its element, the number of products with the matrix, at most
    `most`, and v'K v/(|v| |K v|). A stage that fails ends the step.
    """
    status, J, at, products, bend = DONE, math.inf, -1, 0, 0.0
    if stages & BEGIN:
        J, at = _begin(t, linear, h, activation, y, v, right, s)
        if not (J > 0.0):
            return INVERTED, J, at, products, bend
    if stages & SOLVE:
        status, products = _improve(t, linear, inverse, h, right, v, tolerance, most, s)
        if status != DONE:
            return status, J, at, products, bend
    if stages & MOVE:
        bend = _bend(s, v)
        J, at = _move(t, linear, relaxed, h, y, v, e, u, impulse, s)
        if not (J > 0.0):
            status = INVERTED_AT_END
    return status, J, at, products, bend
