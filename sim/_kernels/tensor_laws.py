"""Laws of the whole strain tensor: energy W(C), S = 2 dW/dC and D = 2 dS/dC.

The second family, for laws that depend on more than one scalar: two invariants, the principal
stretches, or material axes. Symmetric tensors are six numbers in the order xx yy zz xy yz zx, all
of them tensor components (no factor two on shears), and D is 6 x 6 in the same order.

A law receives the right Cauchy-Green tensor in the form of its `strain measure`:

    ISOCHORIC   J^(-2/3) C;   `project` converts its derivatives to those by C
    FINITE      C
    SMALL       I + 2 eps, eps the symmetric part of F - I; W is then not frame indifferent

A new law is one function and one line in `tensor_law`; its class in `sim.laws.tensor` contains code
and measure. Viscoelastic scalar isochoric laws have the codes `ISOCHORIC_FIRST` + code.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import math

from sim._kernels.laws import isochoric
from sim._kernels.options import inner, kernel_and_inner
from sim._kernels.symmetric import (
    COLUMN,
    PLACE,
    ROW,
    contract,
    from_principal,
    power_slope,
    principal,
)

ISOCHORIC = 0
FINITE = 1
SMALL_STRAIN = 2

FIVE_TERM_MOONEY_RIVLIN = 0
OGDEN = 1
FUNG = 2
LINEAR = 3
CO_ROTATIONAL = 4
ISOCHORIC_FIRST = 100


@inner
def add_symmetric_identity(D, factor):
    """D += factor (1/2) (d_ik d_jl + d_il d_jk)."""
    for i in range(6):
        D[i, i] += factor if i < 3 else 0.5 * factor


@inner
def five_term_mooney_rivlin(p, C, S, D, with_tangent):
    """C10 (I1-3) + C01 (I2-3) + C20 (I1-3)^2 + C11 (I1-3)(I2-3) + C02 (I2-3)^2."""
    I1 = C[0] + C[1] + C[2]
    x, y = I1 - 3.0, 0.5 * (I1 * I1 - contract(C, C)) - 3.0
    W1 = p[0] + 2.0 * p[2] * x + p[3] * y
    W2 = p[1] + p[3] * x + 2.0 * p[4] * y
    for i in range(6):
        one = 1.0 if i < 3 else 0.0
        S[i] = 2.0 * (W1 * one + W2 * (I1 * one - C[i]))
    if with_tangent:
        for i in range(6):
            one_i = 1.0 if i < 3 else 0.0
            n_i = I1 * one_i - C[i]  # dI2/dC
            for j in range(6):
                one_j = 1.0 if j < 3 else 0.0
                n_j = I1 * one_j - C[j]
                D[i, j] = 4.0 * (
                    (2.0 * p[2] + W2) * one_i * one_j
                    + p[3] * (one_i * n_j + n_i * one_j)
                    + 2.0 * p[4] * n_i * n_j
                )
        add_symmetric_identity(D, -4.0 * W2)
    return p[0] * x + p[1] * y + p[2] * x * x + p[3] * x * y + p[4] * y * y


@inner
def ogden(p, C, S, D, with_tangent, work):
    """Sum of mu/alpha (l1^alpha + l2^alpha + l3^alpha - 3); p = number of terms, mu, alpha, mu, ..."""
    c, s, shear = work[0, 0], work[0, 1], work[0, 2]
    N, d = work[1, 0:3], work[1, 3:6]
    for i in range(3):
        s[i] = shear[i] = 0.0
        for j in range(3):
            d[i, j] = 0.0
    principal(C, c, N)
    W = 0.0
    for k in range(int(p[0])):
        mu, b = p[1 + 2 * k], 0.5 * p[2 + 2 * k]
        for i in range(3):
            W += 0.5 * mu / b * math.expm1(b * math.log(c[i]))
            s[i] += mu * c[i] ** (b - 1.0)
            if with_tangent:
                d[i, i] += 2.0 * mu * (b - 1.0) * c[i] ** (b - 2.0)
                shear[i] += 2.0 * mu * power_slope(c[i], c[(i + 1) % 3], b - 1.0)
    from_principal(N, s, d, shear, S, D, with_tangent, work)
    return W


@inner
def co_rotational(p, C, S, D, with_tangent, work):
    """Mu |U - I|^2 + lame/2 (tr U - 3)^2 with the right stretch U; p = lame, mu."""
    c, s, shear = work[0, 0], work[0, 1], work[0, 2]
    N, d = work[1, 0:3], work[1, 3:6]
    principal(C, c, N)
    lame, mu = p[0], p[1]
    trace = math.sqrt(c[0]) + math.sqrt(c[1]) + math.sqrt(c[2]) - 3.0
    W = 0.5 * lame * trace * trace
    for i in range(3):
        stretch = math.sqrt(c[i])
        W += mu * (stretch - 1.0) ** 2
        s[i] = 2.0 * mu + (lame * trace - 2.0 * mu) / stretch
        if with_tangent:
            for j in range(3):
                d[i, j] = lame / (stretch * math.sqrt(c[j]))
            d[i, i] -= (lame * trace - 2.0 * mu) / (stretch * c[i])
            shear[i] = 2.0 * (lame * trace - 2.0 * mu) * power_slope(c[i], c[(i + 1) % 3], -0.5)
    from_principal(N, s, d, shear, S, D, with_tangent, work)
    return W


@inner
def linear(p, C, S, D, with_tangent):
    """Mu E:E + lame/2 (tr E)^2 with E = (C - I)/2; p = lame, mu."""
    trace = 0.5 * (C[0] + C[1] + C[2] - 3.0)
    W = 0.5 * p[0] * trace * trace
    for i in range(6):
        one = 1.0 if i < 3 else 0.0
        e = 0.5 * (C[i] - one)
        W += p[1] * (e * e if i < 3 else 2.0 * e * e)
        S[i] = p[0] * trace * one + 2.0 * p[1] * e
    if with_tangent:
        for i in range(6):
            for j in range(6):
                D[i, j] = p[0] if i < 3 and j < 3 else 0.0
        add_symmetric_identity(D, 2.0 * p[1])
    return W


@inner
def fung(p, C, axes, S, D, with_tangent, work):
    """c/2 (exp Q - 1), Q quadratic in the strain along the material axes (columns of axes).

    p = c, mu1, mu2, mu3, then lambda 11 22 33 12 23 31. With E = C - I in these axes
    4 c Q = 2 sum_ij mu_i E_ij^2 + sum_ij lambda_ij E_ii E_jj.
    """
    E, s = work[0, 0], work[0, 1]  # s: stress along the axes without the factor exp Q
    for a in range(6):
        i, j = ROW[a], COLUMN[a]
        x = 0.0
        for k in range(3):
            for m in range(3):
                x += axes[k, i] * C[PLACE[k, m]] * axes[m, j]
        E[a] = x - (1.0 if a < 3 else 0.0)
    for a in range(6):
        i, j = ROW[a], COLUMN[a]
        s[a] = 0.5 * (p[1 + i] + p[1 + j]) * E[a]
        if a < 3:
            for k in range(3):
                s[a] += 0.5 * p[4 + PLACE[i, k]] * E[k]
    Q = contract(s, E) / (2.0 * p[0])
    e = math.exp(Q)
    R, M, T = work[1], work[2], work[3]  # R transforms components along the axes to those in space
    for a in range(6):
        k, m = ROW[a], COLUMN[a]
        for b in range(6):
            i, j = ROW[b], COLUMN[b]
            R[a, b] = axes[k, i] * axes[m, j]
            if b >= 3:
                R[a, b] += axes[k, j] * axes[m, i]
    for a in range(6):
        x = 0.0
        for b in range(6):
            x += R[a, b] * s[b]
        S[a] = e * x
    if with_tangent:
        for b in range(6):
            for g in range(6):
                x = 2.0 / p[0] * s[b] * s[g]
                if b == g:
                    mean = p[1 + ROW[b]] + p[1 + COLUMN[b]]
                    x += mean if b < 3 else 0.5 * mean
                if b < 3 and g < 3:
                    x += p[4 + PLACE[b, g]]
                M[b, g] = e * x
        for a in range(6):
            for g in range(6):
                x = 0.0
                for b in range(6):
                    x += R[a, b] * M[b, g]
                T[a, g] = x
        for a in range(6):
            for b in range(6):
                x = 0.0
                for g in range(6):
                    x += T[a, g] * R[b, g]
                D[a, b] = x
    return 0.5 * p[0] * math.expm1(Q)


@inner
def scalar_isochoric(code, p, C, S, D, with_tangent):
    """A law of I1bar only, from its scalar form."""
    w, w1, w11 = isochoric(code, p, C[0] + C[1] + C[2])
    for i in range(6):
        S[i] = 2.0 * w1 if i < 3 else 0.0
    if with_tangent:
        for i in range(6):
            for j in range(6):
                D[i, j] = 4.0 * w11 if i < 3 and j < 3 else 0.0
    return w


@kernel_and_inner
def tensor_law(code, p, C, axes, S, D, with_tangent, work):
    """Energy of the law with this code; S and, if requested, D by the strain passed to it.

    work (4, 6, 6) is scratch, because an array created here would be allocated at every Gauss
    point.
    """
    if code == FIVE_TERM_MOONEY_RIVLIN:
        return five_term_mooney_rivlin(p, C, S, D, with_tangent)
    if code == OGDEN:
        return ogden(p, C, S, D, with_tangent, work)
    if code == FUNG:
        return fung(p, C, axes, S, D, with_tangent, work)
    if code == LINEAR:
        return linear(p, C, S, D, with_tangent)
    if code == CO_ROTATIONAL:
        return co_rotational(p, C, S, D, with_tangent, work)
    if code >= ISOCHORIC_FIRST:
        return scalar_isochoric(code - ISOCHORIC_FIRST, p, C, S, D, with_tangent)
    for i in range(6):
        S[i] = math.nan
        for j in range(6):
            D[i, j] = math.nan
    return math.nan
