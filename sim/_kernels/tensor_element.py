"""Operations of the second element loop on all points: deformation, stress, moduli.

With the stress S and the moduli D of the points in rows, and E_il = (F_iI A_lJ + F_iJ A_lI)/2:

    Pn = F S A',     An_ij,lm = d_ij (A S A')_lm + E_il : D : E_jm

(A and the natural coordinates are those of `sim._kernels.element`).
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

import math

from sim._kernels.element import (
    along,
    cofactor,
    deformation,
    determinant,
    gather,
    product,
    put,
    take,
)
from sim._kernels.lanes import load, smallest, store
from sim._kernels.laws import fibre_rests
from sim._kernels.options import inner

# first rows in the scratch array: F and its cofactor, J, energy, S and D by finite and by small
# strain, stress, E, D : E, moduli, blocks
F_ROW, COFACTOR_ROW, J_ROW, W_ROW, S_ROW, D_ROW, SMALL_S_ROW, SMALL_D_ROW = (
    0,
    9,
    18,
    19,
    20,
    26,
    62,
    68,
)
P_ROW, E_ROW, DE_ROW, MODULI_ROW, BLOCK_ROW = 104, 113, 167, 221, 275
TENSOR_ROWS = 323


@inner
def deform(w, q, part, e, x):
    """Write F, its cofactor and J of all points; J."""
    gather(q, part.nodes, e, x)
    F = deformation(x, part.slope_at, part.inverse, e)
    C = cofactor(F)
    J = determinant(F, C)
    put(w, F_ROW, F)
    put(w, COFACTOR_ROW, C)
    store(w, J_ROW, J)
    return J


@inner
def all_rest(w, J, own, fibres, activation):
    """Test if no fibre of element `own` has energy or force."""
    for row in range(fibres.start[own], fibres.start[own + 1]):
        a0, a1, a2 = along(take(w, F_ROW), fibres.direction, row)
        square = -smallest(-(a0 * a0 + a1 * a1 + a2 * a2))
        longest = math.sqrt(square) * smallest(J) ** (-1.0 / 3.0)  # not less than the longest
        m = fibres.muscle[row]
        if not fibre_rests(fibres.code[m], fibres.p[m], longest, activation[m]):
            return False
    return True


@inner
def take_symmetric(w, row):
    """Six lanes of a symmetric tensor from rows."""
    first = load(w, row), load(w, row + 1), load(w, row + 2)
    return first + (load(w, row + 3), load(w, row + 4), load(w, row + 5))


@inner
def whole(T):
    """Nine lanes of a symmetric tensor from its six."""
    return T[0], T[3], T[5], T[3], T[1], T[4], T[5], T[4], T[2]


@inner
def first_stress(w, small):
    """First Piola-Kirchhoff stress F S, plus the stress by small strain."""
    P = product(take(w, F_ROW), whole(take_symmetric(w, S_ROW)))
    if not small:
        return P
    T = whole(take_symmetric(w, SMALL_S_ROW))
    first, second = (P[0] + T[0], P[1] + T[1], P[2] + T[2]), (P[3] + T[3], P[4] + T[4], P[5] + T[5])
    return first + second + (P[6] + T[6], P[7] + T[7], P[8] + T[8])


@inner
def strain_rows(w, inverse, e, small):
    """Six rows E_il for every (i, l); shears are E_IJ + E_JI. With small strain F = I."""
    for i in range(3):
        f0, f1, f2 = load(w, F_ROW + 3 * i), load(w, F_ROW + 3 * i + 1), load(w, F_ROW + 3 * i + 2)
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
            r = E_ROW + 18 * i + 6 * n
            store(w, r, f0 * a0)
            store(w, r + 1, f1 * a1)
            store(w, r + 2, f2 * a2)
            store(w, r + 3, f0 * a1 + f1 * a0)
            store(w, r + 4, f1 * a2 + f2 * a1)
            store(w, r + 5, f2 * a0 + f0 * a2)


@inner
def contracted(w, row, e):
    """Sum of the products of six rows with six lanes."""
    x = load(w, row) * e[0] + load(w, row + 1) * e[1] + load(w, row + 2) * e[2]
    x += load(w, row + 3) * e[3] + load(w, row + 4) * e[4] + load(w, row + 5) * e[5]
    return x


@inner
def add_moduli(w, first, dV):
    """Moduli += dV E_il : D : E_jm, with D in the 36 rows from the first one."""
    for r in range(9):
        e = take_symmetric(w, E_ROW + 6 * r)
        for a in range(6):
            store(w, DE_ROW + 6 * r + a, dV * contracted(w, first + 6 * a, e))
    block = MODULI_ROW
    for i in range(3):
        for j in range(i, 3):
            for n in range(3):
                e = take_symmetric(w, E_ROW + 18 * i + 6 * n)
                for m in range(3):
                    x = contracted(w, DE_ROW + 18 * j + 6 * m, e)
                    store(w, block + 3 * n + m, x + load(w, block + 3 * n + m))
            block += 9


@inner
def add_geometric(w, inverse, e, dV):
    """Moduli of equal axes += dV A S A'."""
    s0, s1, s2, s3, s4, s5 = take_symmetric(w, S_ROW)
    s0, s1, s2, s3, s4, s5 = dV * s0, dV * s1, dV * s2, dV * s3, dV * s4, dV * s5
    for n in range(3):
        r = 9 * e + 3 * n
        a0, a1, a2 = load(inverse, r), load(inverse, r + 1), load(inverse, r + 2)
        b0 = s0 * a0 + s3 * a1 + s5 * a2
        b1 = s3 * a0 + s1 * a1 + s4 * a2
        b2 = s5 * a0 + s4 * a1 + s2 * a2
        for m in range(3):
            r = 9 * e + 3 * m
            x = b0 * load(inverse, r) + b1 * load(inverse, r + 1) + b2 * load(inverse, r + 2)
            for block in (MODULI_ROW, MODULI_ROW + 27, MODULI_ROW + 45):
                store(w, block + 3 * n + m, x + load(w, block + 3 * n + m))
