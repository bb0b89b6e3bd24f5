"""The element loop of the second family: laws of the whole strain tensor, with fibres and bulk law.

At every Gauss point the stresses S and moduli D of all laws are summed, then carried once to the nodes:

    P_iJ = F_iI S_IJ,     A_iJkL = d_ik S_JL + F_iI F_kK D_IJKL,
    f_a = P g_a,          K_ab = g_a . A . g_b

A law of small strain enters with F = I and without the term in d_ik. A viscoelastic law acts as
scale * (law) + history, a stress that stays the same over the step; both are given by the caller.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS, bulk, fibre
from sim._kernels.solid import CHUNKS, NODES, _gradient
from sim._kernels.tensor_laws import (
    COLUMN,
    ISOCHORIC,
    PLACE,
    ROW,
    SMALL,
    contract,
    tensor_law,
)

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


@nb.njit(cache=True, fastmath=FLAGS)
def _strains(F, J, cof, C, inverse, small):
    """Right Cauchy-Green tensor, its inverse, and I + 2 eps, all (6,)."""
    # written out, since the compiler does not see through arrays of indices
    r = 1.0 / (J * J)  # C^-1 = F^-1 F^-T and F^-T = cof/J
    C[0] = F[0, 0] * F[0, 0] + F[1, 0] * F[1, 0] + F[2, 0] * F[2, 0]
    C[1] = F[0, 1] * F[0, 1] + F[1, 1] * F[1, 1] + F[2, 1] * F[2, 1]
    C[2] = F[0, 2] * F[0, 2] + F[1, 2] * F[1, 2] + F[2, 2] * F[2, 2]
    C[3] = F[0, 0] * F[0, 1] + F[1, 0] * F[1, 1] + F[2, 0] * F[2, 1]
    C[4] = F[0, 1] * F[0, 2] + F[1, 1] * F[1, 2] + F[2, 1] * F[2, 2]
    C[5] = F[0, 2] * F[0, 0] + F[1, 2] * F[1, 0] + F[2, 2] * F[2, 0]
    inverse[0] = r * (cof[0, 0] * cof[0, 0] + cof[1, 0] * cof[1, 0] + cof[2, 0] * cof[2, 0])
    inverse[1] = r * (cof[0, 1] * cof[0, 1] + cof[1, 1] * cof[1, 1] + cof[2, 1] * cof[2, 1])
    inverse[2] = r * (cof[0, 2] * cof[0, 2] + cof[1, 2] * cof[1, 2] + cof[2, 2] * cof[2, 2])
    inverse[3] = r * (cof[0, 0] * cof[0, 1] + cof[1, 0] * cof[1, 1] + cof[2, 0] * cof[2, 1])
    inverse[4] = r * (cof[0, 1] * cof[0, 2] + cof[1, 1] * cof[1, 2] + cof[2, 1] * cof[2, 2])
    inverse[5] = r * (cof[0, 2] * cof[0, 0] + cof[1, 2] * cof[1, 0] + cof[2, 2] * cof[2, 0])
    small[0] = F[0, 0] + F[0, 0] - 1.0
    small[1] = F[1, 1] + F[1, 1] - 1.0
    small[2] = F[2, 2] + F[2, 2] - 1.0
    small[3] = F[0, 1] + F[1, 0]
    small[4] = F[1, 2] + F[2, 1]
    small[5] = F[2, 0] + F[0, 2]


@nb.njit(cache=True, fastmath=FLAGS)
def _add_product(D, inverse, dyad, symmetric):
    """D += dyad C^-1 x C^-1 + symmetric (1/2) (C^-1_ik C^-1_jl + C^-1_il C^-1_jk)."""
    for a in range(6):
        i, j = ROW[a], COLUMN[a]
        for b in range(6):
            k, m = ROW[b], COLUMN[b]
            D[a, b] += dyad * inverse[a] * inverse[b] + 0.5 * symmetric * (
                inverse[PLACE[i, k]] * inverse[PLACE[j, m]]
                + inverse[PLACE[i, m]] * inverse[PLACE[j, k]]
            )


@nb.njit(cache=True, fastmath=FLAGS)
def project(Sb, Db, J, C, inverse, S, D, with_tangent, work):
    """Add to S and D those of an energy of Cbar = J^(-2/3) C, from its derivatives Sb, Db by Cbar.

    Source: Holzapfel 2000, Nonlinear Solid Mechanics, Eqs 6.90 and 6.168.
    """
    s = J ** (-2.0 / 3.0)
    q = contract(Sb, C)
    if with_tangent:
        X = work[0, 0]
        for a in range(6):
            x = 0.0
            for b in range(6):
                x += Db[a, b] * C[b] * (1.0 if b < 3 else 2.0)
            X[a] = x
        Y = contract(X, C)
        for a in range(6):
            iso_a = s * (Sb[a] - q / 3.0 * inverse[a])
            for b in range(6):
                iso_b = s * (Sb[b] - q / 3.0 * inverse[b])
                D[a, b] += s * s * (
                    Db[a, b] - (X[a] * inverse[b] + inverse[a] * X[b]) / 3.0
                ) - 2.0 / 3.0 * (inverse[a] * iso_b + iso_a * inverse[b])
        _add_product(D, inverse, s * s * Y / 9.0 - 2.0 / 9.0 * s * q, 2.0 / 3.0 * s * q)
    for a in range(6):
        S[a] += s * (Sb[a] - q / 3.0 * inverse[a])


@nb.njit(cache=True, fastmath=FLAGS)
def _law(measure, code, p, J, C, inverse, small, axes, S, D, Sb, Db, Cb, with_tangent, work):
    """Energy of the passive law; its S and D replace those given."""
    if measure == SMALL:
        return tensor_law(code, p, small, axes, S, D, with_tangent, work)
    if measure != ISOCHORIC:
        return tensor_law(code, p, C, axes, S, D, with_tangent, work)
    s = J ** (-2.0 / 3.0)
    for a in range(6):
        Cb[a] = s * C[a]
        S[a] = 0.0
    if with_tangent:
        D[:] = 0.0
    W = tensor_law(code, p, Cb, axes, Sb, Db, with_tangent, work)
    project(Sb, Db, J, C, inverse, S, D, with_tangent, work)
    return W


@nb.njit(cache=True, fastmath=FLAGS)
def _fibre_stress(law_code, p, activation, weight, a0, J, C, Sb, Db, with_tangent):
    """Energy of one fibre; adds its derivatives by Cbar to Sb and Db."""
    I4 = 0.0
    for i in range(3):
        for j in range(3):
            I4 += a0[i] * C[PLACE[i, j]] * a0[j]
    I4 *= J ** (-2.0 / 3.0)
    stretch = math.sqrt(I4)
    w, wl, wll = fibre(law_code, p, stretch, activation)
    wl *= weight
    wll *= weight
    w4 = wl / (2.0 * stretch)
    w44 = (wll - wl / stretch) / (4.0 * I4)
    for a in range(6):
        dyad_a = a0[ROW[a]] * a0[COLUMN[a]]
        Sb[a] += 2.0 * w4 * dyad_a
        if with_tangent:
            for b in range(6):
                Db[a, b] += 4.0 * w44 * dyad_a * a0[ROW[b]] * a0[COLUMN[b]]
    return weight * w


@nb.njit(cache=True, fastmath=FLAGS)
def _moduli(F, S, D, A, T):
    """A = d_ik S_JL + F_iI F_kK D_IJKL, (9, 9); T (9, 6) is scratch."""
    for i in range(3):
        for j in range(3):
            for b in range(6):
                T[3 * i + j, b] = (
                    F[i, 0] * D[PLACE[0, j], b]
                    + F[i, 1] * D[PLACE[1, j], b]
                    + F[i, 2] * D[PLACE[2, j], b]
                )
    for r in range(9):
        for k in range(3):
            for m in range(3):
                A[r, 3 * k + m] = (
                    T[r, PLACE[0, m]] * F[k, 0]
                    + T[r, PLACE[1, m]] * F[k, 1]
                    + T[r, PLACE[2, m]] * F[k, 2]
                )
    for i in range(3):
        for j in range(3):
            for m in range(3):
                A[3 * i + j, 3 * i + m] += S[PLACE[j, m]]


@nb.njit(cache=True, fastmath=FLAGS)
def _add_rows(K, a, i, k, g, G):
    """K[a, i, k, b] += sum_J g[J, a] G[J, b] for all b; every load before every store."""
    p, q, r = g[0, a], g[1, a], g[2, a]
    k0 = K[a, i, k, 0] + p * G[0, 0] + q * G[1, 0] + r * G[2, 0]
    k1 = K[a, i, k, 1] + p * G[0, 1] + q * G[1, 1] + r * G[2, 1]
    k2 = K[a, i, k, 2] + p * G[0, 2] + q * G[1, 2] + r * G[2, 2]
    k3 = K[a, i, k, 3] + p * G[0, 3] + q * G[1, 3] + r * G[2, 3]
    k4 = K[a, i, k, 4] + p * G[0, 4] + q * G[1, 4] + r * G[2, 4]
    k5 = K[a, i, k, 5] + p * G[0, 5] + q * G[1, 5] + r * G[2, 5]
    k6 = K[a, i, k, 6] + p * G[0, 6] + q * G[1, 6] + r * G[2, 6]
    k7 = K[a, i, k, 7] + p * G[0, 7] + q * G[1, 7] + r * G[2, 7]
    K[a, i, k, 0] = k0
    K[a, i, k, 1] = k1
    K[a, i, k, 2] = k2
    K[a, i, k, 3] = k3
    K[a, i, k, 4] = k4
    K[a, i, k, 5] = k5
    K[a, i, k, 6] = k6
    K[a, i, k, 7] = k7


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def evaluate(
    q: Reals,
    element: Indices,
    nodes: Indices,
    gradient: Reals,
    volume: Reals,
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
    with_tangent: bool,
    force: Reals,
    energy: Reals,
    least_J: Reals,
    tangent: Reals,
) -> None:
    """Nodal forces, energy, smallest det F and, if wanted, stiffness of some elements.

    Row e of nodes (row, 8), gradient (row, point, 3, 8), volume (row, point), axes (row, 3, 3), scale
    (row,) and history (row, point, 6), or one without rows, belongs to the element element[e]; region,
    fibre_start and the four results are those of all elements, as in `sim._kernels.solid.evaluate`.
    """
    n = nodes.shape[0]
    for chunk in nb.prange(CHUNKS):
        x = np.empty((3, NODES))
        F, cof = np.empty((3, 3)), np.empty((3, 3))
        C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
        S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
        D, Db = np.empty((6, 6)), np.empty((6, 6))
        St, Dt = np.empty(6), np.empty((6, 6))
        P, A, T = np.empty((3, 3)), np.empty((9, 9)), np.empty((9, 6))
        work = np.empty((4, 6, 6))
        G = np.empty((3, NODES))
        fe = np.empty((3, NODES))
        K = np.empty((NODES, 3, 3, NODES))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            own = element[e]
            for a in range(NODES):
                for i in range(3):
                    x[i, a] = q[nodes[e, a], i]
            fe[:] = 0.0
            if with_tangent:
                K[:] = 0.0
            total = 0.0
            least = math.inf
            row = region[own]
            is_small, factor = measure[row] == SMALL, scale[e]
            for k in range(gradient.shape[1]):
                g = gradient[e, k]
                dV = volume[e, k]
                J = _gradient(x, g, F, cof)
                if not (J >= least):
                    least = J
                if not (J > 0.0):
                    continue
                _strains(F, J, cof, C, inverse, small)
                W = factor * _law(
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
                        _add_product(Dt, inverse, J * UJ + J * J * UJJ, -2.0 * J * UJ)
                if fibre_start[own + 1] > fibre_start[own]:
                    Sb[:] = 0.0
                    Db[:] = 0.0
                    for f in range(fibre_start[own], fibre_start[own + 1]):
                        muscle = fibre_muscle[f]
                        W += _fibre_stress(
                            muscle_code[muscle],
                            muscle_p[muscle],
                            activation[muscle],
                            fibre_weight[f],
                            fibre_direction[f],
                            J,
                            C,
                            Sb,
                            Db,
                            with_tangent,
                        )
                    project(Sb, Db, J, C, inverse, St, Dt, with_tangent, work)
                total += dV * W
                for i in range(3):
                    P[i, 0] = F[i, 0] * St[0] + F[i, 1] * St[3] + F[i, 2] * St[5]
                    P[i, 1] = F[i, 0] * St[3] + F[i, 1] * St[1] + F[i, 2] * St[4]
                    P[i, 2] = F[i, 0] * St[5] + F[i, 1] * St[4] + F[i, 2] * St[2]
                    if is_small:
                        for j in range(3):
                            P[i, j] += S[PLACE[i, j]]
                for i in range(3):
                    p0, p1, p2 = dV * P[i, 0], dV * P[i, 1], dV * P[i, 2]
                    for a in range(NODES):
                        fe[i, a] += p0 * g[0, a] + p1 * g[1, a] + p2 * g[2, a]
                if with_tangent:
                    _moduli(F, St, Dt, A, T)
                    if is_small:
                        for i in range(9):
                            for j in range(9):
                                A[i, j] += D[PLACE[i // 3, i % 3], PLACE[j // 3, j % 3]]
                    for i in range(3):
                        for j in range(i, 3):
                            for c in range(3):
                                a0 = dV * A[3 * i + c, 3 * j]
                                a1 = dV * A[3 * i + c, 3 * j + 1]
                                a2 = dV * A[3 * i + c, 3 * j + 2]
                                for b in range(NODES):
                                    G[c, b] = a0 * g[0, b] + a1 * g[1, b] + a2 * g[2, b]
                            for a in range(NODES):
                                _add_rows(K, a, i, j, g, G)
            energy[own] = total
            least_J[own] = least
            for i in range(3):
                for a in range(NODES):
                    force[own, i, a] = fe[i, a]
            if with_tangent:
                p = 0
                for a in range(NODES):
                    for b in range(a, NODES):
                        for i in range(3):
                            for j in range(3):
                                tangent[own, p, 3 * i + j] = (
                                    K[a, i, j, b] if i <= j else K[b, j, i, a]
                                )
                        p += 1


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def law_stress(
    q: Reals,
    element: Indices,
    nodes: Indices,
    gradient: Reals,
    axes: Reals,
    region: Indices,
    measure: Indices,
    law_code: Indices,
    law_p: Reals,
    out: Reals,
) -> None:
    """Stress S of the passive law alone, out (row, point, 6) [Pa]; NaN where det F <= 0."""
    n = nodes.shape[0]
    for chunk in nb.prange(CHUNKS):
        x = np.empty((3, NODES))
        F, cof = np.empty((3, 3)), np.empty((3, 3))
        C, inverse, small = np.empty(6), np.empty(6), np.empty(6)
        S, Sb, Cb = np.empty(6), np.empty(6), np.empty(6)
        D, Db = np.empty((6, 6)), np.empty((6, 6))
        work = np.empty((4, 6, 6))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            for a in range(NODES):
                for i in range(3):
                    x[i, a] = q[nodes[e, a], i]
            row = region[element[e]]
            for k in range(gradient.shape[1]):
                J = _gradient(x, gradient[e, k], F, cof)
                if not (J > 0.0):
                    out[e, k, :] = math.nan
                    continue
                _strains(F, J, cof, C, inverse, small)
                _law(
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
