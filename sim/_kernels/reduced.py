"""Forces and time steps of a reduced solid: few coordinates y, and weighted elements.

Positions are q = q0 + Phi y and the energy is a sum over weighted elements, so that the coordinates
have the force

    f = Phi' sum_e w_e f_e(q0 + Phi y)

with the nodal forces f_e of `sim._kernels.reduced_element`. A step solves its equation by conjugate
gradients, preconditioned by the inverse of the matrix at rest, with the stiffness at the start of the
step: a product is a sum over the elements, which evaluates no law. The first r coordinates move; forces
on the others, which stay zero, estimate the error of leaving them out.

A product reads the modes of all nodes and what is kept of all elements, which takes much of its time.
Both are therefore in single precision: forces are still the exact derivatives of the energy, of modes
changed by 6e-8.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.element import Indices, Part, Reals
from sim._kernels.lanes import LANES, load, store, total
from sim._kernels.laws import FibreTable, LawTable
from sim._kernels.options import bare_kernel, inner
from sim._kernels.reduced_element import add_stiffness, add_stress, rows_of

Singles = NDArray[np.float32]
Flags = NDArray[np.bool_]

DONE, INVERTED, NOT_REACHED, INVERTED_AT_END = 0, 1, 2, 3
BEGIN, SOLVE_STAGE, MOVE = 1, 2, 4  #: stages of a step, which are summed
VECTORS = 4  #: vectors of a step
SOLVED_MOTION = 1e-12  #: displacement in a step below which a solution ends [m]


class Elements(NamedTuple):
    """Weighted elements of a solid, and the positions of their k nodes, of which the first m move."""

    parts: tuple[Part, ...]  #: of elements with a weight, numbered by these nodes
    laws: LawTable
    fibres: FibreTable
    weight: Reals  #: (n_elements,) factor on the energy of every element of the mesh
    rest: Reals  #: (k, 3) positions where all coordinates are zero [m]
    #: (3 m * blocks, 8) derivative of the positions by the n coordinates, filled with zeros
    modes: Singles
    moving: int  #: m


class Scratch(NamedTuple):
    """Memory for r moving coordinates of n and k nodes."""

    q: Reals  #: (k, 3) positions
    f: Reals  #: (k, 3) forces
    x: Reals  #: (8, 3) of one element
    w: Reals  #: (SOLID_ROWS, 8) of one element
    kept: Singles  #: (rows, 8) of all elements at the start of a step (`sim._kernels.reduced_element`)
    acts: Flags  #: (n_fibres,) True for those with a force
    y: Reals  #: (blocks, 8) coordinates
    force: Reals  #: (blocks, 8) forces on the coordinates
    start: Reals  #: (n,) those of the elements at the start of a step
    #: (n,) K p of the last product, and K v of the solution
    change: Reals
    stiff: Reals
    vectors: Reals  #: (VECTORS, r)


class Passed(NamedTuple):
    """Ends of n steps: coordinates, velocities, and what a report contains."""

    y: Reals  #: (n, r)
    v: Reals  #: (n, r)
    omitted: Reals  #: (n, 2, n - r) displacements and velocities of the omitted coordinates
    least_J: Reals  #: (n,) smallest det F
    element: Indices  #: (n,) of it
    products: Indices  #: (n,) with the matrix
    bend: Reals  #: (n,) v'K v/(|v| |K v|)


class Linear(NamedTuple):
    """Constant force and matrices over all n coordinates."""

    load: Reals  #: (n,) generalised force [N kg^-1/2]
    damping: Reals  #: (n, n) [1/s]
    stiffness: Reals  #: (n, n) at rest [1/s^2]
    size: float  #: root of the mass of the tissue, which turns norms of coordinates into metres


@inner
def _place(t, s, i, moving, share):
    """Position of moving node i at coordinates `s.y` in `moving` rows, plus a share of that at rest."""
    blocks = s.y.shape[0]
    x, y, z = 3 * i * blocks, (3 * i + 1) * blocks, (3 * i + 2) * blocks
    c = load(s.y, 0)
    p0, p1, p2 = c * load(t.modes, x), c * load(t.modes, y), c * load(t.modes, z)
    for k in range(1, moving):
        c = load(s.y, k)
        p0 += c * load(t.modes, x + k)
        p1 += c * load(t.modes, y + k)
        p2 += c * load(t.modes, z + k)
    s.q[i, 0] = total(p0) + share * t.rest[i, 0]
    s.q[i, 1] = total(p1) + share * t.rest[i, 1]
    s.q[i, 2] = total(p2) + share * t.rest[i, 2]


@inner
def _project(t, s, i):
    """Add the forces on moving node i to those on the coordinates."""
    blocks = s.y.shape[0]
    x, y, z = 3 * i * blocks, (3 * i + 1) * blocks, (3 * i + 2) * blocks
    f0, f1, f2 = s.f[i, 0], s.f[i, 1], s.f[i, 2]
    for k in range(blocks):
        change = f0 * load(t.modes, x + k) + f1 * load(t.modes, y + k)
        store(s.force, k, load(s.force, k) + (change + f2 * load(t.modes, z + k)))


@inner
def _place_all(t, s, moving, share):
    """Positions of all nodes, of those that do not move at a share of their positions at rest."""
    for i in range(t.moving):
        _place(t, s, i, moving, share)
    for i in range(t.moving, s.q.shape[0]):
        for j in range(3):
            s.q[i, j] = share * t.rest[i, j]
    s.f[:] = 0.0


@inner
def _project_all(t, s):
    """Forces on the coordinates, of those on all moving nodes."""
    s.force[:] = 0.0
    for i in range(t.moving):
        _project(t, s, i)


@inner
def _forces(t, activation, s, moving):
    """Forces of the elements on all coordinates, at those of `s.y`; energy, least det F, its element."""
    energy, smallest, at, first = 0.0, math.inf, -1, 0
    _place_all(t, s, moving, np.float64(1.0))
    for part in t.parts:
        for e in range(part.element.size):
            own, J = add_stress(e, part, t.laws, t.fibres, activation, t.weight, first, s)
            energy += own
            if not (J >= smallest):
                smallest, at = J, part.element[e]
            if not (smallest > 0.0):
                return energy, smallest, at
            first += rows_of(e, part, t.fibres)
    _project_all(t, s)
    return energy, smallest, at


@inner
def _stiffness(t, s, moving):
    """Product -K y in `s.force`, for `s.y` and what is kept of the elements."""
    first = 0
    _place_all(t, s, moving, np.float64(0.0))
    for part in t.parts:
        for e in range(part.element.size):
            add_stiffness(e, part, t.fibres, first, s)
            first += rows_of(e, part, t.fibres)
    _project_all(t, s)


@bare_kernel
def forces(t: Elements, activation: Reals, s: Scratch) -> tuple[float, float, int]:
    """Forces on all coordinates, in `s.force`, at the coordinates `s.y`.

    Returns the energy, the smallest det F and its element; the sum ends at an element with det F <= 0.
    """
    return _forces(t, activation, s, s.y.shape[0])


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
    still = (SOLVED_MOTION * linear.size / h) ** 2
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
def _move(linear, relaxed, h, y, v, e, u, impulse, s):
    """Coordinates and omitted coordinates at the end of a step with velocities v."""
    D, K_rest, r, n = linear.damping, linear.stiffness, y.size, linear.load.size
    for i in range(r):
        y[i] += h * v[i]
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


@bare_kernel
def advance(
    stages: int,
    t: Elements,
    linear: Linear,
    inverse: Reals,
    relaxed: Reals,
    h: Reals,
    activation: Reals,
    rate: float,
    most: int,
    y: Reals,
    v: Reals,
    right: Reals,
    e: Reals,
    u: Reals,
    impulse: Reals,
    s: Scratch,
    passed: Passed,
) -> tuple[int, int]:
    """Linearly implicit Euler steps h (n,) [s] of the coordinates y with velocities v, in place.

    BEGIN keeps the forces in `s.start` and what products require, and adds v0 + h f(y0), with the
    activation (n, n_muscles) at the end of each step, to the impulses in `right`.

    SOLVE finds the v of (1 + h D + h^2 K) v = right. Its error e meets e' A e <= (rate h)^2 v' A v
    with the matrix A of the step, up to the preconditioner `inverse`, that of the matrix at rest, and
    v has the length that makes it the best along its direction: v' A v = v' right, which implies that a
    step without drive does not increase the energy (to second order), as for the exact v. K v is kept
    in `s.stiff`.

    MOVE adds h v to y and clears `right`. The omitted coordinates e with velocities u follow the forces
    on them and the impulses (n,) of contacts, linearised: relaxed u1 = u0 + h (f(y0) - h K v - D v -
    K_rest e0) + impulse, where `relaxed` is the inverse of their 1 + h D + h^2 K_rest. The end of the
    step is written into `passed`; its det F is that at the start of the following one.

    Without MOVE, there is one step. Returns the status and the number of steps that are done. If the
    solution was not reached with `most` products in the next step, its equation is in `right`; if an
    element is inverted at its start or at its end, `passed` contains it.
    """
    n, r, rows = h.size, y.size, (y.size + LANES - 1) // LANES
    for k in range(n + 1):
        if k == n and not stages & MOVE:
            break
        if k == n or stages & BEGIN:
            _write(s, y)
            _, J, at = _forces(t, activation[min(k, n - 1)], s, rows)
            own = max(k - 1, 0)
            passed.least_J[own], passed.element[own] = J, at
            if not (J > 0.0):
                return INVERTED if k == 0 else INVERTED_AT_END, own
            if k == n:
                break
            for i in range(linear.load.size):
                s.start[i] = s.force[i // LANES, i % LANES]
            for i in range(r):
                right[i] += v[i] + h[k] * (s.start[i] + linear.load[i])
        if stages & SOLVE_STAGE:
            status, products = _improve(t, linear, inverse, h[k], right, v, rate * h[k], most, s)
            passed.products[k] += products
            if status != DONE:
                return status, k
        if stages & MOVE:
            passed.bend[k] = _bend(s, v)
            _move(linear, relaxed, h[k], y, v, e, u, impulse, s)
            for i in range(r):
                passed.y[k, i], passed.v[k, i], right[i] = y[i], v[i], 0.0
            for i in range(e.size):
                passed.omitted[k, 0, i], passed.omitted[k, 1, i] = e[i], u[i]
    return DONE, n
