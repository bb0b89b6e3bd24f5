"""Forces, stiffness and time steps of a reduced solid, summed over weighted points.

The deformation gradient at a point is linear in the coordinates, F = F0 + G y, so that an energy
sum_p V_p W(F_p) has the force and stiffness

    f = -sum_p V_p G_p' P_p,        K = sum_p V_p G_p' A_p G_p

with the stress P (9) and the moduli A = dP/dF (9 x 9) of the laws of `sim._kernels.laws`. The first r
coordinates move; forces on the others, which stay zero, estimate the error of leaving them out.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np

from sim._kernels.element import Indices, Reals
from sim._kernels.lanes import LANES, load, store, total
from sim._kernels.laws import FibreTable, LawTable, bulk, fibre, fibre_rests, isochoric
from sim._kernels.options import inner, kernel

# rows of the scratch array: F, cofactor, stress, direction of a fibre (F a0) a0', moduli
_F, _C, _P, _T, _A = map(np.int64, (0, 1, 2, 3, 4))
ROWS = 13
DONE, INVERTED, SINGULAR = 0, 1, 2


class PointTable(NamedTuple):
    """Weighted points of a solid."""

    place: Indices  #: (p,) 8 e + k of point k of element e
    F0: Reals  #: (p, 9) deformation gradient where all coordinates are zero, row by row
    #: (p * 9 * blocks, 8) its derivative by the coordinates [1/m]: the n columns of entry c of point p
    #: in rows (9 p + c) blocks.., filled with zeros
    G: Reals
    volume: Reals  #: (p,) stress-free volume [m^3], times the weight of the point
    #: of every point
    laws: LawTable
    fibres: FibreTable


class Scratch(NamedTuple):
    """Memory for r moving coordinates of n, in rows of eight numbers."""

    w: Reals  #: (ROWS, 9) of one point
    x: Reals  #: coordinates
    f: Reals  #: forces, of all coordinates
    K: Reals  #: stiffness, row by row
    A: Reals  #: (r, r) matrix of a step
    b: Reals  #: (n,) its right-hand side


class Linear(NamedTuple):
    """Constant force and matrices over all n coordinates."""

    load: Reals  #: (n,) generalised force [N]
    damping: Reals  #: (n, n) [1/s]
    stiffness: Reals  #: (n, n) at rest [1/s^2]


@inner
def _cofactor(w):
    """Write the cofactor of F; return det F."""
    F, C = w[_F], w[_C]
    C[0] = F[4] * F[8] - F[5] * F[7]
    C[1] = F[5] * F[6] - F[3] * F[8]
    C[2] = F[3] * F[7] - F[4] * F[6]
    C[3] = F[2] * F[7] - F[1] * F[8]
    C[4] = F[0] * F[8] - F[2] * F[6]
    C[5] = F[1] * F[6] - F[0] * F[7]
    C[6] = F[1] * F[5] - F[2] * F[4]
    C[7] = F[2] * F[3] - F[0] * F[5]
    C[8] = F[0] * F[4] - F[1] * F[3]
    return F[0] * C[0] + F[1] * C[1] + F[2] * C[2]


@inner
def _deform(t, p, y, w):
    """Write F and its cofactor at a point; return det F. y has eight numbers in each row."""
    blocks = t.G.shape[0] // (9 * t.volume.size)
    for c in range(9):
        row = (9 * p + c) * blocks
        s = load(t.G, row) * load(y, 0)
        for k in range(1, y.shape[0]):
            s += load(t.G, row + k) * load(y, k)
        w[_F, c] = t.F0[p, c] + total(s)
    return _cofactor(w)


@inner
def _stress(t, p, J, activation, with_moduli, w):
    """Write the stress and, if requested, the moduli of a point, times its volume; return its energy.

    P = 2 W_1 F + W_J C + 2 W_4 T and A = dP/dF with dC_iJ/dF_kL = (C_iJ C_kL - C_iL C_kJ)/J.
    """
    F, C, P, T = w[_F], w[_C], w[_P], w[_T]
    laws, fibres = t.laws, t.fibres
    V, row = t.volume[p], laws.region[p]
    scale = math.exp(math.log(J) * (-2.0 / 3.0))
    over = 1.0 / J
    dJ, ddJ = (-2.0 / 3.0) * over, (10.0 / 9.0) * over * over
    I1 = 0.0
    for c in range(9):
        I1 += F[c] * F[c]
    I1bar = scale * I1
    W, w1, w11 = isochoric(laws.code[row], laws.p[row], I1bar)
    U, UJ, UJJ = bulk(laws.bulk_code[row], laws.kappa[row], J)
    W += U
    slope = dJ * I1bar
    W_J = UJ + w1 * slope
    W_JJ = UJJ + w11 * slope * slope + w1 * ddJ * I1bar
    p_1 = 2.0 * V * w1 * scale
    for c in range(9):
        P[c] = p_1 * F[c]
    if with_moduli:
        e_11 = 4.0 * V * w11 * scale * scale
        e_1J = 2.0 * V * (w11 * I1bar + w1) * scale * dJ
        for c in range(9):
            for d in range(9):
                w[_A + c, d] = e_11 * F[c] * F[d] + e_1J * (F[c] * C[d] + C[c] * F[d])
            w[_A + c, c] += p_1
    for k in range(fibres.start[p], fibres.start[p + 1]):
        m = fibres.muscle[k]
        drive, code, share = activation[m], fibres.code[m], fibres.weight[k]
        b0, b1, b2 = fibres.direction[k, 0], fibres.direction[k, 1], fibres.direction[k, 2]
        I4 = 0.0
        for i in range(3):
            a = F[3 * i] * b0 + F[3 * i + 1] * b1 + F[3 * i + 2] * b2
            I4 += a * a
            T[3 * i], T[3 * i + 1], T[3 * i + 2] = a * b0, a * b1, a * b2
        I4bar = scale * I4
        stretch = math.sqrt(I4bar)
        if fibre_rests(code, fibres.p[m], stretch, drive):
            continue
        own, wl, wll = fibre(code, fibres.p[m], stretch, drive)
        wl, wll = share * wl, share * wll
        W += share * own
        w4 = wl / (2.0 * stretch)
        w44 = (wll - wl / stretch) / (4.0 * I4bar)
        slope = dJ * I4bar
        W_J += w4 * slope
        W_JJ += w44 * slope * slope + w4 * ddJ * I4bar
        p_4 = 2.0 * V * w4 * scale
        for c in range(9):
            P[c] += p_4 * T[c]
        if with_moduli:
            e_44 = 4.0 * V * w44 * scale * scale
            e_4J = 2.0 * V * (w44 * I4bar + w4) * scale * dJ
            for c in range(9):
                for d in range(9):
                    w[_A + c, d] += e_44 * T[c] * T[d] + e_4J * (T[c] * C[d] + C[c] * T[d])
            for i in range(3):
                row_i = _A + 3 * i
                for n in range(3):
                    g = p_4 * (b0 if n == 0 else b1 if n == 1 else b2)
                    w[row_i + n, 3 * i] += g * b0
                    w[row_i + n, 3 * i + 1] += g * b1
                    w[row_i + n, 3 * i + 2] += g * b2
    p_J = V * W_J
    for c in range(9):
        P[c] += p_J * C[c]
    if with_moduli:
        e_JJ, c_J = V * W_JJ, p_J * over
        for c in range(9):
            i, n = c // 3, c % 3
            for d in range(9):
                k, m = d // 3, d % 3
                w[_A + c, d] += (e_JJ + c_J) * C[c] * C[d] - c_J * C[3 * i + m] * C[3 * k + n]
    return V * W


@inner
def _add_force(t, p, f, w):
    """Subtract G'P of a point from rows of eight numbers."""
    blocks = f.shape[0]
    for k in range(blocks):
        row = 9 * p * blocks + k
        s = load(f, k)
        for c in range(9):
            s -= w[_P, c] * load(t.G, row + c * blocks)
        store(f, k, s)


@inner
def _product(w, c, g0, g1, g2, g3, g4, g5, g6, g7, g8):
    """Row c of the moduli times nine lanes."""
    a = _A + c
    s = w[a, 0] * g0 + w[a, 1] * g1 + w[a, 2] * g2
    s += w[a, 3] * g3 + w[a, 4] * g4 + w[a, 5] * g5
    s += w[a, 6] * g6 + w[a, 7] * g7 + w[a, 8] * g8
    return s


@inner
def _add_stiffness(t, p, K, n, w):
    """Add G'A G of a point to the lower triangle of K, row i in rows i blocks.. of eight numbers."""
    every, blocks = t.G.shape[0] // (9 * t.volume.size), K.shape[0] // n
    first = 9 * p * every
    for k in range(blocks):
        r = first + k
        g0, g1, g2 = load(t.G, r), load(t.G, r + every), load(t.G, r + 2 * every)
        g3, g4 = load(t.G, r + 3 * every), load(t.G, r + 4 * every)
        g5, g6 = load(t.G, r + 5 * every), load(t.G, r + 6 * every)
        g7, g8 = load(t.G, r + 7 * every), load(t.G, r + 8 * every)
        h0 = _product(w, 0, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h1 = _product(w, 1, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h2 = _product(w, 2, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h3 = _product(w, 3, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h4 = _product(w, 4, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h5 = _product(w, 5, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h6 = _product(w, 6, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h7 = _product(w, 7, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        h8 = _product(w, 8, g0, g1, g2, g3, g4, g5, g6, g7, g8)
        for i in range(LANES * k, n):
            q, m = first + i // LANES, i % LANES
            s = load(K, i * blocks + k)
            s += t.G[q, m] * h0 + t.G[q + every, m] * h1 + t.G[q + 2 * every, m] * h2
            s += t.G[q + 3 * every, m] * h3 + t.G[q + 4 * every, m] * h4
            s += t.G[q + 5 * every, m] * h5 + t.G[q + 6 * every, m] * h6
            s += t.G[q + 7 * every, m] * h7 + t.G[q + 8 * every, m] * h8
            store(K, i * blocks + k, s)


@inner
def _fill(rows, x):
    """Write x into rows of eight numbers."""
    for i in range(x.size):
        rows[i // LANES, i % LANES] = x[i]


@inner
def _sum(t, y, activation, with_moduli, w, f, K, n):
    """Add force and stiffness of all points; return energy, smallest det F and its point."""
    energy, least, at = 0.0, math.inf, -1
    for p in range(t.volume.size):
        J = _deform(t, p, y, w)
        if not (J > 0.0):
            return energy, J, p
        if J < least:
            least, at = J, p
        energy += _stress(t, p, J, activation, with_moduli, w)
        _add_force(t, p, f, w)
        if with_moduli:
            _add_stiffness(t, p, K, n, w)
    return energy, least, at


@kernel
def evaluate(
    t: PointTable, activation: Reals, with_moduli: bool, scratch: Scratch, n: int
) -> tuple[float, float, int]:
    """Add the forces and, if requested, the lower triangle of the stiffness (n, n), at `scratch.x`.

    Returns the energy, the smallest det F and its point; the sum ends at a point with det F <= 0.
    """
    s = scratch
    return _sum(t, s.x, activation, with_moduli, s.w, s.f, s.K, n)


@kernel
def point_stresses(t: PointTable, y: Reals, activation: Reals, w: Reals, out: Reals) -> None:
    """Stress times volume of every point, out (p, 9); NaN where det F <= 0."""
    for p in range(t.volume.size):
        J = _deform(t, p, y, w)
        if J > 0.0:
            _stress(t, p, J, activation, np.bool_(False), w)
        for c in range(9):
            out[p, c] = w[_P, c] if J > 0.0 else math.nan


@inner
def _factorise(A, n):
    """Factor L D L' in the lower triangle; return the number of negative pivots, -1 if singular."""
    negative = 0
    for i in range(n):
        for j in range(i):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s
        d = A[i, i]
        for j in range(i):
            u = A[i, j]
            A[i, j] = u / A[j, j]
            d -= u * A[i, j]
        if not (abs(d) > 1e-14 * abs(A[i, i])):
            return -1
        negative += d < 0.0
        A[i, i] = d
    return negative


@inner
def solve(A, x, n):
    """Solve L D L' y = x in place."""
    for i in range(n):
        s = x[i]
        for j in range(i):
            s -= A[i, j] * x[j]
        x[i] = s
    for i in range(n):
        x[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        s = x[i]
        for j in range(i):
            x[j] -= A[i, j] * s


@inner
def _velocity(t, linear, h, activation, y, v, b, scratch):
    """Factorise the matrix of a step and write its velocities without contact into b.

    Returns status, smallest det F, its point and the number of negative pivots.
    """
    r, D, K, A, f = y.size, linear.damping, scratch.K, scratch.A, scratch.f
    blocks = scratch.x.shape[0]
    _fill(scratch.x, y)
    _fill(f, linear.load)
    K[:] = 0.0
    _, J, at = _sum(t, scratch.x, activation, np.bool_(True), scratch.w, f, K, r)
    if not (J > 0.0):
        return INVERTED, J, at, 0
    for i in range(r):
        for j in range(i + 1):
            A[i, j] = h * D[i, j] + h * h * K[i * blocks + j // LANES, j % LANES]
        A[i, i] += 1.0
        b[i] = v[i] + h * f[i // LANES, i % LANES]
    negative = _factorise(A, r)
    if negative < 0:
        return SINGULAR, J, at, 0
    solve(A, b, r)
    return DONE, J, at, negative


@inner
def _moved(t, linear, relaxed, h, activation, y, v, e, u, impulse, scratch):
    """Move by the velocities in `scratch.b`, and the omitted coordinates by the forces on them.

    Returns status, smallest det F and its point.
    """
    D, K_rest, f, b = linear.damping, linear.stiffness, scratch.f, scratch.b
    r, n = y.size, linear.load.size
    for i in range(r):
        v[i] = b[i]
        y[i] += h * v[i]
    _fill(scratch.x, y)
    _fill(f, linear.load)
    _, J, at = _sum(t, scratch.x, activation, np.bool_(False), scratch.w, f, scratch.K, r)
    if not (J > 0.0):
        return INVERTED, J, at
    for i in range(r, n):
        s = f[i // LANES, i % LANES]
        for j in range(r):
            s -= D[i, j] * v[j]
        for j in range(r, n):
            s -= K_rest[i, j] * e[j - r]
        b[i] = u[i - r] + h * s + impulse[i]
    for i in range(n - r):
        s = 0.0
        for j in range(n - r):
            s += relaxed[i, j] * b[r + j]
        u[i] = s
        e[i] += h * s
    return DONE, J, at


@kernel
def predict(
    t: PointTable,
    linear: Linear,
    h: float,
    activation: Reals,
    y: Reals,
    v: Reals,
    scratch: Scratch,
) -> tuple[int, float, int, int]:
    """Velocities at the end of a linearly implicit Euler step, in `scratch.b`.

    (1 + h D + h^2 K) v1 = v0 + h f(y0) with the activation at the end; `scratch.A` becomes the factor of
    the matrix. Returns status, smallest det F at the start, its point, number of negative pivots.
    """
    return _velocity(t, linear, h, activation, y, v, scratch.b, scratch)


@kernel
def move(
    t: PointTable,
    linear: Linear,
    relaxed: Reals,
    h: float,
    activation: Reals,
    y: Reals,
    v: Reals,
    e: Reals,
    u: Reals,
    impulse: Reals,
    scratch: Scratch,
) -> tuple[int, float, int]:
    """End of a step with the velocities in `scratch.b`: y1 = y0 + h v1, in place.

    The omitted coordinates e with velocities u follow the forces on them and the impulses (n,) of
    contacts, linearised at rest: relaxed u1 = u0 + h (f(y1) - D v1 - K_rest e0) + impulse, where
    `relaxed` is the inverse of their 1 + h D + h^2 K_rest. Returns status, smallest det F at the end
    and its point.
    """
    return _moved(t, linear, relaxed, h, activation, y, v, e, u, impulse, scratch)
