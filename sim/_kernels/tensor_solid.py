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

from sim._kernels.laws import FLAGS, bulk
from sim._kernels.solid import CHUNKS, NODES, _gradient
from sim._kernels.symmetric import PLACE
from sim._kernels.tensor_laws import SMALL
from sim._kernels.tensor_point import (
    add_fibre,
    add_product,
    moduli,
    passive_law,
    project,
    strains,
)

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]


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
                if fibre_start[own + 1] > fibre_start[own]:
                    Sb[:] = 0.0
                    Db[:] = 0.0
                    for f in range(fibre_start[own], fibre_start[own + 1]):
                        muscle = fibre_muscle[f]
                        W += add_fibre(
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
                    moduli(F, St, Dt, A, T)
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
