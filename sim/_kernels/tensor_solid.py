"""The element loop of the second family: laws of the whole strain tensor, with fibres and bulk law.

At every point the stresses S and moduli D of all laws are summed; then all points together are carried
to natural coordinates (`sim._kernels.element`), with E_il = (F_iI A_lJ + F_iJ A_lI)/2:

    Pn = F S A',     An_ij,lm = d_ij (A S A')_lm + E_il : D : E_jm

A law of small strain enters with F = I and without the term in d_ij. A viscoelastic law acts as
scale * (law) + history, a stress that stays the same over the step; both are given by the caller.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math

import numba as nb
import numpy as np

from sim._kernels.element import (
    BLOCKS,
    NODES,
    Indices,
    Part,
    Places,
    Reals,
    add_to_matrix,
    add_to_nodes,
    clear,
    cofactor,
    deformation,
    fetch_matrix,
    gather,
    least,
    natural,
    nodal,
    put,
    stiffness_block,
)
from sim._kernels.lanes import load, rows, smallest, store, total
from sim._kernels.laws import FLAGS, bulk, fibre_rests
from sim._kernels.tensor_laws import SMALL
from sim._kernels.tensor_point import add_fibre, add_product, passive_law, project, strains

# rows of the scratch array: F and its cofactor, J, energy, S and D by finite and by small strain,
# stress, E, D : E, moduli, blocks
_F, _C, _J, _W, _S, _D, _SMALL_S, _SMALL_D = 0, 9, 18, 19, 20, 26, 62, 68
_P, _E, _DE, _A, _K = 104, 113, 167, 221, 275
ROWS = 323


@nb.njit(cache=True, fastmath=FLAGS)
def _strain_rows(w, inverse, e, small):
    """Six rows E_il for every (i, l); shears are E_IJ + E_JI. With small strain F = I."""
    for i in range(3):
        f0, f1, f2 = load(w, _F + 3 * i), load(w, _F + 3 * i + 1), load(w, _F + 3 * i + 2)
        if small:
            zero = f0 - f0
            f0, f1, f2 = zero, zero, zero
            if i == 0:
                f0 = zero + 1.0
            elif i == 1:
                f1 = zero + 1.0
            else:
                f2 = zero + 1.0
        for n in range(3):
            r = 9 * e + 3 * n
            a0, a1, a2 = load(inverse, r), load(inverse, r + 1), load(inverse, r + 2)
            r = _E + 18 * i + 6 * n
            store(w, r, f0 * a0)
            store(w, r + 1, f1 * a1)
            store(w, r + 2, f2 * a2)
            store(w, r + 3, f0 * a1 + f1 * a0)
            store(w, r + 4, f1 * a2 + f2 * a1)
            store(w, r + 5, f2 * a0 + f0 * a2)


@nb.njit(cache=True, fastmath=FLAGS)
def _add_moduli(w, D, dV):
    """Moduli += dV E_il : D : E_jm, from 36 rows D."""
    for r in range(9):
        E = _E + 6 * r
        e0, e1, e2 = load(w, E), load(w, E + 1), load(w, E + 2)
        e3, e4, e5 = load(w, E + 3), load(w, E + 4), load(w, E + 5)
        for a in range(6):
            d = D + 6 * a
            x = load(w, d) * e0 + load(w, d + 1) * e1 + load(w, d + 2) * e2
            x += load(w, d + 3) * e3 + load(w, d + 4) * e4 + load(w, d + 5) * e5
            store(w, _DE + 6 * r + a, dV * x)
    block = _A
    for i in range(3):
        for j in range(i, 3):
            for n in range(3):
                E = _E + 18 * i + 6 * n
                e0, e1, e2 = load(w, E), load(w, E + 1), load(w, E + 2)
                e3, e4, e5 = load(w, E + 3), load(w, E + 4), load(w, E + 5)
                for m in range(3):
                    d = _DE + 18 * j + 6 * m
                    x = load(w, block + 3 * n + m)
                    x += load(w, d) * e0 + load(w, d + 1) * e1 + load(w, d + 2) * e2
                    x += load(w, d + 3) * e3 + load(w, d + 4) * e4 + load(w, d + 5) * e5
                    store(w, block + 3 * n + m, x)
            block += 9


@nb.njit(cache=True, fastmath=FLAGS)
def _add_geometric(w, inverse, e, dV):
    """Moduli of equal axes += dV A S A'."""
    s0, s1, s2 = dV * load(w, _S), dV * load(w, _S + 1), dV * load(w, _S + 2)
    s3, s4, s5 = dV * load(w, _S + 3), dV * load(w, _S + 4), dV * load(w, _S + 5)
    for n in range(3):
        r = 9 * e + 3 * n
        a0, a1, a2 = load(inverse, r), load(inverse, r + 1), load(inverse, r + 2)
        b0 = s0 * a0 + s3 * a1 + s5 * a2
        b1 = s3 * a0 + s1 * a1 + s4 * a2
        b2 = s5 * a0 + s4 * a1 + s2 * a2
        for m in range(3):
            r = 9 * e + 3 * m
            x = b0 * load(inverse, r) + b1 * load(inverse, r + 1) + b2 * load(inverse, r + 2)
            for block in (_A, _A + 27, _A + 45):
                store(w, block + 3 * n + m, x + load(w, block + 3 * n + m))


@nb.njit(cache=True, fastmath=FLAGS)
def _stress(w, small):
    """First Piola-Kirchhoff stress F S, plus the stress by small strain."""
    F, S = _F, _S
    s0, s1, s2 = load(w, S), load(w, S + 1), load(w, S + 2)
    s3, s4, s5 = load(w, S + 3), load(w, S + 4), load(w, S + 5)
    a0, a1, a2 = load(w, F), load(w, F + 1), load(w, F + 2)
    b0, b1, b2 = load(w, F + 3), load(w, F + 4), load(w, F + 5)
    c0, c1, c2 = load(w, F + 6), load(w, F + 7), load(w, F + 8)
    P = (
        a0 * s0 + a1 * s3 + a2 * s5,
        a0 * s3 + a1 * s1 + a2 * s4,
        a0 * s5 + a1 * s4 + a2 * s2,
        b0 * s0 + b1 * s3 + b2 * s5,
        b0 * s3 + b1 * s1 + b2 * s4,
        b0 * s5 + b1 * s4 + b2 * s2,
        c0 * s0 + c1 * s3 + c2 * s5,
        c0 * s3 + c1 * s1 + c2 * s4,
        c0 * s5 + c1 * s4 + c2 * s2,
    )
    if not small:
        return P
    t0, t1, t2 = load(w, _SMALL_S), load(w, _SMALL_S + 1), load(w, _SMALL_S + 2)
    t3, t4, t5 = load(w, _SMALL_S + 3), load(w, _SMALL_S + 4), load(w, _SMALL_S + 5)
    upper = (P[0] + t0, P[1] + t3, P[2] + t5, P[3] + t3, P[4] + t1, P[5] + t4)
    return upper + (P[6] + t5, P[7] + t4, P[8] + t2)


@nb.njit(cache=True, fastmath=FLAGS)
def _at_point(w, k, F, cof):
    """F (3, 3) and cof (3, 3) of one point; its J."""
    for i in range(3):
        for j in range(3):
            F[i, j] = w[_F + 3 * i + j, k]
            cof[i, j] = w[_C + 3 * i + j, k]
    return w[_J, k]


@nb.njit(cache=True, fastmath=FLAGS)
def _deform(w, q, part, e, x):
    """Write F, its cofactor and J of all points; J."""
    gather(q, part.nodes, e, x)
    F = deformation(x, part.slope_at, part.inverse, e)
    C = cofactor(F)
    J = F[0] * C[0] + F[1] * C[1] + F[2] * C[2]
    put(w, _F, F)
    put(w, _C, C)
    store(w, _J, J)
    return J


@nb.njit(cache=True, fastmath=FLAGS)
def _all_rest(w, J, first, last, muscle, direction, code, p, activation):
    """Whether no fibre of rows first..last has energy."""
    for row in range(first, last):
        d0, d1, d2 = direction[row, 0], direction[row, 1], direction[row, 2]
        a0 = load(w, _F) * d0 + load(w, _F + 1) * d1 + load(w, _F + 2) * d2
        a1 = load(w, _F + 3) * d0 + load(w, _F + 4) * d1 + load(w, _F + 5) * d2
        a2 = load(w, _F + 6) * d0 + load(w, _F + 7) * d1 + load(w, _F + 8) * d2
        square = -smallest(-(a0 * a0 + a1 * a1 + a2 * a2))
        longest = math.sqrt(square) * smallest(J) ** (-1.0 / 3.0)  # not less than the longest
        m = muscle[row]
        if not fibre_rests(code[m], p[m], longest, activation[m]):
            return False
    return True


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def evaluate(
    q: Reals,
    part: Part,
    places: Places,
    axes: Reals,
    scale: Reals,
    history: Reals,
    region: Indices,
    measure: Indices,
    law_code: Indices,
    law_p: Reals,
    bulk_code: Indices,
    kappa: Reals,
    fibre_start: Indices,
    fibre_muscle: Indices,
    fibre_direction: Reals,
    fibre_weight: Reals,
    muscle_code: Indices,
    muscle_p: Reals,
    activation: Reals,
    weight: Reals,
    with_tangent: bool,
    f: Reals,
    energy: Reals,
    least_J: Reals,
    values: Reals,
) -> None:
    """Subtract dE/dx from the nodal forces f and, if wanted, add the stiffness to values.

    Row e of axes (row, 3, 3), scale (row,) and history (row, point, 6), or one without rows, belongs to
    element e of the part; all else is as in `sim._kernels.solid.evaluate`.
    """
    points = part.slope.shape[0] // 3
    for colour in range(part.colour.size - 1):
        for chunk in nb.prange(part.colour[colour], part.colour[colour + 1]):
            x = np.empty((NODES, 3))
            F, cof = np.empty((3, 3)), np.empty((3, 3))
            C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
            S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
            D, Db = np.empty((6, 6)), np.empty((6, 6))
            St, Dt = np.empty(6), np.empty((6, 6))
            work = np.empty((4, 6, 6))
            w = rows(ROWS)
            clear(w, 0, ROWS)
            for e in range(part.chunk[chunk], part.chunk[chunk + 1]):
                own = part.element[e]
                energy[own] = 0.0
                if weight.size > 0 and weight[own] == 0.0:
                    least_J[own] = math.inf
                    continue
                all_J = _deform(w, q, part, e, x)
                least_J[own] = least(all_J)
                if not (least_J[own] > 0.0):
                    continue
                if with_tangent:
                    fetch_matrix(places, e, values)
                dV = load(part.volume, e)
                if weight.size > 0:
                    dV = weight[own] * dV
                row = region[own]
                is_small, factor = measure[row] == SMALL, scale[e]
                rests = _all_rest(
                    w,
                    all_J,
                    fibre_start[own],
                    fibre_start[own + 1],
                    fibre_muscle,
                    fibre_direction,
                    muscle_code,
                    muscle_p,
                    activation,
                )
                for k in range(points):
                    J = _at_point(w, k, F, cof)
                    strains(F, J, cof, C, inverse, small)
                    W = factor * passive_law(
                        measure[row],
                        law_code[row],
                        law_p[row],
                        J,
                        C,
                        inverse,
                        small,
                        axes[e],
                        S,
                        D,
                        Sb,
                        Db,
                        Cb,
                        with_tangent,
                        work,
                    )
                    for a in range(6):
                        S[a] *= factor
                    if history.shape[0] > 0:
                        for a in range(6):
                            H = history[e, k, a]
                            one = 1.0 if a < 3 else 0.0
                            strain = 0.5 * ((small[a] if is_small else C[a]) - one)
                            S[a] += H
                            W += H * strain * (1.0 if a < 3 else 2.0)
                    # St and Dt are those by C; a law of small strain keeps its S and D apart
                    share = 0.0 if is_small else 1.0
                    for a in range(6):
                        St[a] = share * S[a]
                    if with_tangent:
                        for a in range(6):
                            for b in range(6):
                                D[a, b] *= factor
                                Dt[a, b] = share * D[a, b]
                    if kappa[row] != 0.0:
                        U, UJ, UJJ = bulk(bulk_code[row], kappa[row], J)
                        W += U
                        for a in range(6):
                            St[a] += UJ * J * inverse[a]
                        if with_tangent:
                            add_product(Dt, inverse, J * UJ + J * J * UJJ, -2.0 * J * UJ)
                    if not rests:
                        Sb[:] = 0.0
                        Db[:] = 0.0
                        for fibre in range(fibre_start[own], fibre_start[own + 1]):
                            muscle = fibre_muscle[fibre]
                            W += add_fibre(
                                muscle_code[muscle],
                                muscle_p[muscle],
                                activation[muscle],
                                fibre_weight[fibre],
                                fibre_direction[fibre],
                                J,
                                C,
                                Sb,
                                Db,
                                with_tangent,
                            )
                        project(Sb, Db, J, C, inverse, St, Dt, with_tangent, work)
                    w[_W, k] = W
                    for a in range(6):
                        w[_S + a, k] = St[a]
                        if is_small:
                            w[_SMALL_S + a, k] = S[a]
                        if with_tangent:
                            for b in range(6):
                                w[_D + 6 * a + b, k] = Dt[a, b]
                                if is_small:
                                    w[_SMALL_D + 6 * a + b, k] = D[a, b]
                energy[own] = total(dV * load(w, _W))
                P = natural(_stress(w, is_small), part.inverse, e)
                put(w, _P, P)
                for r in range(_P, _P + 9):
                    store(w, r, dV * load(w, r))
                f0, f1, f2 = nodal(w, _P, part.slope)
                store(w, _P, f0)
                store(w, _P + 1, f1)
                store(w, _P + 2, f2)
                add_to_nodes(w, _P, part.nodes, e, -1.0, f)
                if with_tangent:
                    clear(w, _A, 9 * BLOCKS)
                    _strain_rows(w, part.inverse, e, False)
                    _add_moduli(w, _D, dV)
                    _add_geometric(w, part.inverse, e, dV)
                    if is_small:
                        _strain_rows(w, part.inverse, e, True)
                        _add_moduli(w, _SMALL_D, dV)
                    for block in range(BLOCKS):
                        stiffness_block(w, _A + 9 * block, part.slope, _K + NODES * block)
                    add_to_matrix(w, _K, part.nodes, places, e, values)


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def law_stress(
    q: Reals,
    part: Part,
    axes: Reals,
    region: Indices,
    measure: Indices,
    law_code: Indices,
    law_p: Reals,
    out: Reals,
) -> None:
    """Stress S of the passive law alone, out (row, point, 6) [Pa]; NaN where det F <= 0."""
    for chunk in nb.prange(part.chunk.size - 1):
        x = np.empty((NODES, 3))
        F, cof = np.empty((3, 3)), np.empty((3, 3))
        C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
        S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
        D, Db = np.empty((6, 6)), np.empty((6, 6))
        work = np.empty((4, 6, 6))
        w = rows(_S)
        for e in range(part.chunk[chunk], part.chunk[chunk + 1]):
            _deform(w, q, part, e, x)
            row = region[part.element[e]]
            for k in range(out.shape[1]):
                J = _at_point(w, k, F, cof)
                if not (J > 0.0):
                    out[e, k, :] = math.nan
                    continue
                strains(F, J, cof, C, inverse, small)
                passive_law(
                    measure[row],
                    law_code[row],
                    law_p[row],
                    J,
                    C,
                    inverse,
                    small,
                    axes[e],
                    S,
                    D,
                    Sb,
                    Db,
                    Cb,
                    False,
                    work,
                )
                for a in range(6):
                    out[e, k, a] = S[a]
