"""Element loop: deformation gradient once per quadrature point, and all laws.

With the natural derivatives d_a and A of `sim._kernels.element`, F = (dx/dxi) A, J = det F and

    M = F A',   N = cof(F) A',   T = F a0 (A a0)'

an energy W(I1, J, I4) of the invariants I1 = F:F, J, I4 = |F a0|^2 has the stress and moduli

    Pn       = 2 W_1 M + W_J N + 2 W_4 T
    An_ij,lm = d_ij (2 W_1 A A' + 2 W_4 (A a0) (A a0)')_lm + 4 W_11 M_il M_jm
               + 2 W_1J (M_il N_jm + N_il M_jm) + (W_JJ + W_J/J) N_il N_jm - W_J/J N_im N_jl
               + 4 W_44 T_il T_jm + 2 W_4J (T_il N_jm + N_il T_jm)

(the terms in W_J/J are the derivative of the cofactor). Laws are evaluated at the eight points at
once.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

import math

import numpy as np

from sim._kernels.element import (
    BLOCKS,
    NODES,
    Part,
    Reals,
    along,
    clear,
    cofactor,
    deformation,
    determinant,
    gather,
    least,
    natural,
    nodal,
    put,
    stiffness_blocks,
    take,
)
from sim._kernels.lanes import largest, load, rows, smallest, store, total
from sim._kernels.laws import FibreTable, LawTable, bulk, fibre, fibre_rests, isochoric
from sim._kernels.options import by_chunk, by_colour, in_threads, inner
from sim._kernels.scatter import Places, add_to_matrix, fetch_matrix, subtract_from_nodes

# rows of the scratch array: stress, M, N and T, moduli, and blocks
STRESS, _M, _N, _T, MODULI, _K = map(np.int64, (0, 9, 18, 27, 36, 90))
SOLID_ROWS = 138


@inner
def inverse_cube_root(J):
    """J^(-1/3), by two steps of fourth order if the volume changes by less than a half."""
    x = J - 1.0
    if not (smallest(x) > -0.5 and smallest(-x) > -0.5):
        return math.exp(math.log(J) * (-1.0 / 3.0))
    y = 1.0 - x * (1.0 / 3.0 - x * (2.0 / 9.0))
    for _ in range(2):
        r = 1.0 - J * y * y * y
        y *= 1.0 + r * (1.0 / 3.0 + r * (2.0 / 9.0 + r * (14.0 / 81.0)))
    return y


@inner
def _add(w, row, value):
    """Add lanes to a row."""
    store(w, row, value + load(w, row))


@inner
def _write(w, row, value, more):
    """Write lanes into a row, in addition to those of fibres."""
    store(w, row, value + load(w, row) if more else value)


@inner
def _add_moduli(w, e_11, e_1J, e_JJ, c, p_1, inverse, e, more):
    """Moduli of isochoric and bulk laws, from M and N in the scratch array.

    e_11 = 4 W_11, e_1J = 2 W_1J, e_JJ = W_JJ, c = W_J/J, p_1 = 2 W_1, all times the volume.
    """
    r = 9 * e
    block = MODULI
    for i in range(3):
        for j in range(i, 3):
            jM, jN = _M + 3 * j, _N + 3 * j
            X0, X1, X2 = load(w, jM), load(w, jM + 1), load(w, jM + 2)
            Y0, Y1, Y2 = load(w, jN), load(w, jN + 1), load(w, jN + 2)
            m0, m1, m2 = e_11 * X0 + e_1J * Y0, e_11 * X1 + e_1J * Y1, e_11 * X2 + e_1J * Y2
            n0, n1, n2 = e_1J * X0 + e_JJ * Y0, e_1J * X1 + e_JJ * Y1, e_1J * X2 + e_JJ * Y2
            for n in range(3):
                u, v = load(w, _M + 3 * i + n), load(w, _N + 3 * i + n)
                a0, a1, a2 = u * m0 + v * n0, u * m1 + v * n1, u * m2 + v * n2
                if i == j:
                    g0 = p_1 * load(inverse, r + 3 * n)
                    g1 = p_1 * load(inverse, r + 3 * n + 1)
                    g2 = p_1 * load(inverse, r + 3 * n + 2)
                    a0 += g0 * load(inverse, r) + g1 * load(inverse, r + 1)
                    a1 += g0 * load(inverse, r + 3) + g1 * load(inverse, r + 4)
                    a2 += g0 * load(inverse, r + 6) + g1 * load(inverse, r + 7)
                    a0 += g2 * load(inverse, r + 2)
                    a1 += g2 * load(inverse, r + 5)
                    a2 += g2 * load(inverse, r + 8)
                else:
                    cv, y = c * v, c * load(w, jN + n)
                    a0 += cv * Y0 - y * load(w, _N + 3 * i)
                    a1 += cv * Y1 - y * load(w, _N + 3 * i + 1)
                    a2 += cv * Y2 - y * load(w, _N + 3 * i + 2)
                _write(w, block + 3 * n, a0, more)
                _write(w, block + 3 * n + 1, a1, more)
                _write(w, block + 3 * n + 2, a2, more)
            block += 9


@inner
def _add_fibre_moduli(w, e_44, e_4J, p_4, b0, b1, b2):
    """Moduli of one fibre with T and N in the scratch array, and b = A a0."""
    block = MODULI
    for i in range(3):
        for j in range(i, 3):
            for n in range(3):
                t = load(w, _T + 3 * i + n)
                v = e_4J * load(w, _N + 3 * i + n)
                g = p_4 * (b0 if n == 0 else b1 if n == 1 else b2)
                for m in range(3):
                    other = load(w, _T + 3 * j + m)
                    value = t * (e_44 * other + e_4J * load(w, _N + 3 * j + m)) + v * other
                    if i == j:
                        value += g * (b0 if m == 0 else b1 if m == 1 else b2)
                    _add(w, block + 3 * n + m, value)
            block += 9


@inner
def by_invariants(F, C, J, laws, row):
    """Energy W of the isochoric and bulk laws, 2 W_1, 4 W_11, 2 W_1J, W_J and W_JJ.

    They follow the factor J^(-2/3) of the invariants, and its derivatives dJ and ddJ by J over it.
    """
    I1 = F[0] * F[0] + F[1] * F[1] + F[2] * F[2] + F[3] * F[3] + F[4] * F[4]
    I1 += F[5] * F[5] + F[6] * F[6] + F[7] * F[7] + F[8] * F[8]
    root = inverse_cube_root(J)
    scale = root * root
    # One more step, because line searches near the minimum depend on the last digits of the energy.
    scale += scale * ((1.0 - J * J * scale * scale * scale) * (1.0 / 3.0))
    # d(I1bar)/dJ = dJ * I1bar and so on, the same for every isochoric invariant
    over = 1.0 / J
    dJ, ddJ = (-2.0 / 3.0) * over, (10.0 / 9.0) * over * over
    I1bar = scale * I1
    W, w1, w11 = isochoric(laws.code[row], laws.p[row], I1bar)
    U, UJ, UJJ = bulk(laws.bulk_code[row], laws.kappa[row], J)
    slope, e_1J = dJ * I1bar, 2.0 * (w11 * I1bar + w1) * scale * dJ
    W_J, W_JJ = UJ + w1 * slope, UJJ + w11 * slope * slope + w1 * ddJ * I1bar
    own = W + U, 2.0 * w1 * scale, 4.0 * w11 * scale * scale, e_1J
    return (scale, dJ, ddJ) + own + (W_J, W_JJ)


@inner
def by_stretch(fibres, row, I4bar, stretch, drive, scale, dJ, ddJ):
    """Share of one fibre in W, W_J and W_JJ, and its 2 W_4, 4 W_44 and 2 W_4J."""
    muscle, share = fibres.muscle[row], fibres.weight[row]
    W, wl, wll = fibre(fibres.code[muscle], fibres.p[muscle], stretch, drive)
    wl, wll = share * wl, share * wll
    w4 = wl / (2.0 * stretch)
    w44 = (wll - wl / stretch) / (4.0 * I4bar)
    slope = dJ * I4bar
    W_JJ = w44 * slope * slope + w4 * ddJ * I4bar
    moduli = 4.0 * w44 * scale * scale, 2.0 * (w44 * I4bar + w4) * scale * dJ
    return (share * W, w4 * slope, W_JJ, 2.0 * w4 * scale) + moduli


@in_threads(by_chunk)
def smallest_J(first: int, last: int, q: Reals, part: Part, out: Reals) -> None:
    """Smallest det F over the points of every element, into out of all elements."""
    x = np.empty((NODES, 3))
    for e in range(part.chunk[first], part.chunk[last]):
        gather(q, part.nodes, e, x)
        F = deformation(x, part.slope_at, part.inverse, e)
        out[part.element[e]] = least(determinant(F, cofactor(F)))


@inner
def element_stress(
    e, q, part, laws, fibres, activation, weight, with_moduli, x, w, energy, least_J
):
    """Write energy and least det F of element e of a part, and in w its stress and moduli at the points.

    The stress Pn is in rows STRESS.. and, if requested, the moduli An in rows MODULI.. of w, which is
    (SOLID_ROWS, 8), times the volumes; x (8, 3) is scratch memory. Returns False, without a stress, if
    det F <= 0 or the weight of the element is zero.
    """
    own = part.element[e]
    energy[own] = 0.0
    if weight.size > 0 and weight[own] == 0.0:
        least_J[own] = math.inf
        return False
    gather(q, part.nodes, e, x)
    F = deformation(x, part.slope_at, part.inverse, e)
    C = cofactor(F)
    J = determinant(F, C)
    least_J[own] = least(J)
    if not (least_J[own] > 0.0):
        return False
    row = laws.region[own]
    dV = load(part.volume, e)
    if weight.size > 0:
        dV = weight[own] * dV
    scale, dJ, ddJ, W, p_1, e_11, e_1J, W_J, W_JJ = by_invariants(F, C, J, laws, row)
    M, N = natural(F, part.inverse, e), natural(C, part.inverse, e)
    put(w, _M, M)
    put(w, _N, N)
    driven = np.bool_(False)  # An active or stretched fibre has written into the scratch array.
    for fibre_row in range(fibres.start[own], fibres.start[own + 1]):
        muscle = fibres.muscle[fibre_row]
        drive = activation[muscle]
        a0, a1, a2 = along(F, fibres.direction, fibre_row)
        I4bar = scale * (a0 * a0 + a1 * a1 + a2 * a2)
        stretch = math.sqrt(I4bar)
        code, longest = fibres.code[muscle], largest(stretch)
        if fibre_rests(code, fibres.p[muscle], longest, drive):
            continue
        if not driven:
            driven = np.bool_(True)
            clear(w, STRESS, 9)
            if with_moduli:
                clear(w, MODULI, 9 * BLOCKS)
        own_W, own_J, own_JJ, p_4, e_44, e_4J = by_stretch(
            fibres, fibre_row, I4bar, stretch, drive, scale, dJ, ddJ
        )
        W, W_J, W_JJ, p_4 = W + own_W, W_J + own_J, W_JJ + own_JJ, dV * p_4
        A = take(part.inverse, 9 * e)
        b0, b1, b2 = along(A, fibres.direction, fibre_row)
        first, second = (a0 * b0, a0 * b1, a0 * b2), (a1 * b0, a1 * b1, a1 * b2)
        put(w, _T, first + second + (a2 * b0, a2 * b1, a2 * b2))
        for n in range(9):
            _add(w, STRESS + n, p_4 * load(w, _T + n))
        if with_moduli:
            _add_fibre_moduli(w, dV * e_44, dV * e_4J, p_4, b0, b1, b2)
    energy[own] = total(dV * W)
    p_1, p_J = dV * p_1, dV * W_J
    for n in range(9):
        value = p_1 * load(w, _M + n) + p_J * load(w, _N + n)
        _write(w, STRESS + n, value, driven)
    if with_moduli:
        e_11, e_1J, e_JJ = dV * e_11, dV * e_1J, dV * W_JJ
        _add_moduli(w, e_11, e_1J, e_JJ, p_J / J, p_1, part.inverse, e, driven)
    return True


@in_threads(by_colour)
def evaluate(
    first: int,
    last: int,
    q: Reals,
    part: Part,
    places: Places,
    laws: LawTable,
    fibres: FibreTable,
    activation: Reals,
    weight: Reals,
    with_tangent: bool,
    f: Reals,
    energy: Reals,
    least_J: Reals,
    values: Reals,
) -> None:
    """Subtract dE/dx from the nodal forces f and, if requested, add the stiffness to values.

    q, f (node, 3). Of all elements: weight, a factor on the energy, or empty; and the results energy
    and least_J. An element with det F <= 0 does not contribute, and the caller checks least_J; one of
    weight zero is skipped.
    """
    x = np.empty((NODES, 3))
    w = rows(SOLID_ROWS)
    for e in range(part.chunk[first], part.chunk[last]):
        if with_tangent:
            fetch_matrix(places, e, values)
        if not element_stress(
            e, q, part, laws, fibres, activation, weight, with_tangent, x, w, energy, least_J
        ):
            continue
        nodal(w, STRESS, part.slope, STRESS)
        subtract_from_nodes(w, STRESS, part.nodes, e, f)
        if with_tangent:
            stiffness_blocks(w, MODULI, part.slope, _K)
            add_to_matrix(w, _K, part.nodes, places, e, values)
