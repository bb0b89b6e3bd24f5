"""Operations of the second element loop at one Gauss point: strains, laws, projection."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import fibre
from sim._kernels.options import allocating, inner, kernel_and_inner
from sim._kernels.symmetric import COLUMN, PLACE, ROW, contract
from sim._kernels.tensor_laws import ISOCHORIC, SMALL_STRAIN, tensor_law


class PointScratch(NamedTuple):
    """Memory for one point.

    F, cof : deformation gradient and its cofactor.
    C, inverse, small : right Cauchy-Green tensor, its inverse, and I + 2 eps.
    S, D : stress and moduli of the passive law; Sb, Db by Cbar = J^(-2/3) C, which is Cb.
    work : scratch of the laws.
    """

    F: NDArray[np.float64]
    cof: NDArray[np.float64]
    C: NDArray[np.float64]
    inverse: NDArray[np.float64]
    small: NDArray[np.float64]
    S: NDArray[np.float64]
    D: NDArray[np.float64]
    Sb: NDArray[np.float64]
    Db: NDArray[np.float64]
    Cb: NDArray[np.float64]
    work: NDArray[np.float64]


@allocating
def point_scratch():
    """Empty memory for one point."""
    F, cof, C, inverse = np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6)
    small, S, D, Sb = np.empty(6), np.empty(6), np.empty((6, 6)), np.empty(6)
    Db, Cb, work = np.empty((6, 6)), np.empty(6), np.empty((4, 6, 6))
    return PointScratch(F, cof, C, inverse, small, S, D, Sb, Db, Cb, work)


@inner
def strains(at, J):
    """Write the right Cauchy-Green tensor, its inverse, and I + 2 eps, from F and its cofactor."""
    F, cof, C, inverse, small = at.F, at.cof, at.C, at.inverse, at.small
    # Written out, because the compiler does not resolve arrays of indices.
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


@inner
def add_product(D, inverse, dyad, symmetric):
    """D += dyad C^-1 x C^-1 + symmetric (1/2) (C^-1_ik C^-1_jl + C^-1_il C^-1_jk)."""
    for a in range(6):
        i, j = ROW[a], COLUMN[a]
        for b in range(6):
            k, m = ROW[b], COLUMN[b]
            D[a, b] += dyad * inverse[a] * inverse[b] + 0.5 * symmetric * (
                inverse[PLACE[i, k]] * inverse[PLACE[j, m]]
                + inverse[PLACE[i, m]] * inverse[PLACE[j, k]]
            )


@kernel_and_inner
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
        add_product(D, inverse, s * s * Y / 9.0 - 2.0 / 9.0 * s * q, 2.0 / 3.0 * s * q)
    for a in range(6):
        S[a] += s * (Sb[a] - q / 3.0 * inverse[a])


@inner
def passive_law(measure, code, p, J, axes, at, with_tangent):
    """Energy of the passive law, which overwrites S and D."""
    C, S, D, Sb, Db, Cb, work = at.C, at.S, at.D, at.Sb, at.Db, at.Cb, at.work
    if measure == SMALL_STRAIN:
        return tensor_law(code, p, at.small, axes, S, D, with_tangent, work)
    if measure != ISOCHORIC:
        return tensor_law(code, p, C, axes, S, D, with_tangent, work)
    s = J ** (-2.0 / 3.0)
    for a in range(6):
        Cb[a] = s * C[a]
        S[a] = 0.0
    if with_tangent:
        D[:] = 0.0
    W = tensor_law(code, p, Cb, axes, Sb, Db, with_tangent, work)
    project(Sb, Db, J, C, at.inverse, S, D, with_tangent, work)
    return W


@inner
def add_fibre(fibres, row, activation, J, at, with_tangent):
    """Energy of one fibre; adds its derivatives by Cbar to Sb and Db."""
    a0, C, Sb, Db = fibres.direction[row], at.C, at.Sb, at.Db
    muscle, weight = fibres.muscle[row], fibres.weight[row]
    I4 = 0.0
    for i in range(3):
        for j in range(3):
            I4 += a0[i] * C[PLACE[i, j]] * a0[j]
    I4 *= J ** (-2.0 / 3.0)
    stretch = math.sqrt(I4)
    w, wl, wll = fibre(fibres.code[muscle], fibres.p[muscle], stretch, activation[muscle])
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
