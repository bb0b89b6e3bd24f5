"""Scalar forms of the constitutive laws: energy and its first two derivatives.

Every law of the invariant family is a function of one scalar and therefore consists of three closed
forms:

    isochoric  w(I1bar)          I1bar  = J^(-2/3) tr C
    bulk       U(J)              J      = det F
    fibre      w(stretch, a)     stretch = J^(-1/3) |F a0|

The element loop computes stress and tangent from them by the chain rule. Laws are selected by
integer code because kernels built as closures over laws are not found in the disk cache. A new law
is one function and one line in its dispatcher; its class in `sim.laws` contains the code. Isochoric
and bulk laws also receive the eight points of an element at once (`sim._kernels.lanes`): they use
arithmetic, sqrt, exp and log, and no branches on their argument.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# pyright: reportGeneralTypeIssues=false
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np

from sim._kernels.element import Indices, Reals
from sim._kernels.lanes import above, largest
from sim._kernels.options import bare_kernel, inner

MOONEY_RIVLIN = 0
NEO_HOOKE = 1

QUADRATIC = 0
LOGARITHMIC = 1

BLEMKER = 0
GENERIC = 1
CONSTANT_FIBRE = 2

# At rest every stretch is at the kink of the passive curve up to rounding. The side without slope
# is used, so that the stiffness of a face at rest does not depend on rounding or on displacements
# of 1e-14 m. The omitted stress is below 1e-9 of sigma_max.
KINK = 1e-9

# Gauss-Legendre points and weights on (0, 1): the generic passive energy has no elementary form.
_GAUSS = np.polynomial.legendre.leggauss(16)
GAUSS_X = 0.5 * (_GAUSS[0] + 1.0)
GAUSS_W = 0.5 * _GAUSS[1]


class LawTable(NamedTuple):
    """Laws of materials, and the material of every element (or point).

    region : row of the material.
    code, p : codes and parameters (rows) of the isochoric laws.
    bulk_code, kappa : of the bulk laws.
    """

    region: Indices
    code: Indices
    p: Reals
    bulk_code: Indices
    kappa: Reals


class FibreTable(NamedTuple):
    """Fibres: those of element (or point) n are rows start[n]..start[n + 1].

    muscle, direction, weight : of every fibre; it fills the fraction `weight` of its element.
    code, p : codes and parameters (rows) of the laws of the muscles of the scene.
    """

    start: Indices
    muscle: Indices
    direction: Reals
    weight: Reals
    code: Indices
    p: Reals


@inner
def mooney_rivlin(p, I1bar):
    """C10 (I1bar - 3) + C20 (I1bar - 3)^2."""
    x = I1bar - 3.0
    return p[0] * x + p[1] * x * x, p[0] + 2.0 * p[1] * x, 2.0 * p[1]


@inner
def neo_hooke(p, I1bar):
    """mu/2 (I1bar - 3)."""
    return 0.5 * p[0] * (I1bar - 3.0), 0.5 * p[0], 0.0


@inner
def isochoric(code, p, I1bar):
    """Energy, slope and curvature of the isochoric law with this code."""
    if code == MOONEY_RIVLIN:
        return mooney_rivlin(p, I1bar)
    if code == NEO_HOOKE:
        return neo_hooke(p, I1bar)
    return math.nan, math.nan, math.nan


@inner
def quadratic_bulk(kappa, J):
    """kappa/2 (J - 1)^2."""
    x = J - 1.0
    return 0.5 * kappa * x * x, kappa * x, kappa


@inner
def logarithmic_bulk(kappa, J):
    """kappa/2 (ln J)^2."""
    log_J = math.log(J)
    return 0.5 * kappa * log_J * log_J, kappa * log_J / J, kappa * (1.0 - log_J) / (J * J)


@inner
def bulk(code, kappa, J):
    """Energy, slope and curvature of the bulk law with this code."""
    if code == QUADRATIC:
        return quadratic_bulk(kappa, J)
    if code == LOGARITHMIC:
        return logarithmic_bulk(kappa, J)
    return math.nan, math.nan, math.nan


@inner
def blemker_active(r):
    """Active force-length curve f_act(r), its integral from 0 and its slope."""
    x, y, z, end = r - 0.4, r - 1.0, r - 1.6, 508.0 / 750.0
    w = 0.024 + (y + 0.4) - 4.0 / 3.0 * (y * y * y + 0.064)
    f, k = 1.0 - 4.0 * y * y, -8.0 * y
    if not (largest(-r) < -0.6 and largest(r) < 1.4):
        w = above(-r, -1.4, w, above(-r, -1.6, end + 3.0 * z * z * z, end))
        f = above(-r, -1.4, f, above(-r, -1.6, 9.0 * z * z, 0.0))
        k = above(-r, -1.4, k, above(-r, -1.6, 18.0 * z, 0.0))
        w = above(r, 0.6, w, above(r, 0.4, 3.0 * x * x * x, 0.0))
        f = above(r, 0.6, f, above(r, 0.4, 9.0 * x * x, 0.0))
        k = above(r, 0.6, k, above(r, 0.4, 18.0 * x, 0.0))
    return w, f, k


@inner
def exponential_then_linear(P1, P2, r_star, r):
    """P1 (exp(P2 (r - 1)) - 1) up to r*, then its tangent line; integral from 1, value and slope."""
    low = above(r, r_star, r_star, r)
    e, x = math.exp(P2 * (low - 1.0)), r - low
    f, k = P1 * (e - 1.0), P1 * P2 * e
    w = P1 * ((e - 1.0) / P2 - (low - 1.0))
    return w + f * x + 0.5 * k * x * x, f + k * x, k


@inner
def blemker(p, stretch, activation):
    """dw/dstretch = sigma_max/stretch_opt (f_pas + a f_act), p = sigma_max, stretch_opt, r*, P1, P2."""
    r = stretch / p[1]
    w = f = k = 0.0 * r
    if largest(r) > 1.0 + KINK:
        # The curve begins with zero, but with a slope.
        w, f, k = exponential_then_linear(p[3], p[4], p[2] / p[1], above(r, 1.0 + KINK, r, 1.0))
        k = above(r, 1.0 + KINK, k, 0.0)
    if activation != 0.0:
        w_act, f_act, k_act = blemker_active(r)
        w, f, k = w + activation * w_act, f + activation * f_act, k + activation * k_act
    return p[0] * w, p[0] / p[1] * f, p[0] / (p[1] * p[1]) * k


@inner
def generic(p, stretch, activation):
    """dw/dstretch = f_pas(stretch)/stretch + a sigma_max; p as for blemker, P1 in pascals."""
    _, f_pas, k_pas = exponential_then_linear(p[3], p[4], p[2], stretch)
    w = p[0] * activation * (stretch - 1.0)
    f = p[0] * activation + f_pas / stretch
    k = (k_pas - f_pas / stretch) / stretch
    # The integral of f_pas/stretch has no elementary form; it is smooth on both sides of r*.
    low = above(stretch, p[2], p[2], stretch)
    width = low - 1.0
    for i in range(GAUSS_X.size):
        r = 1.0 + width * GAUSS_X[i]
        w += width * GAUSS_W[i] * exponential_then_linear(p[3], p[4], p[2], r)[1] / r
    if largest(stretch) > p[2]:
        e = math.exp(p[4] * (p[2] - 1.0))
        P3 = p[3] * p[4] * e
        P4 = p[3] * (e - 1.0) - P3 * p[2]
        w += P3 * (stretch - low) + P4 * math.log(stretch / low)
    return w, f, k


@inner
def constant(p, stretch, activation):
    """dw/dstretch = a sigma_max: no length dependence, no passive part."""
    return p[0] * activation * (stretch - 1.0), p[0] * activation, 0.0


@inner
def fibre(code, p, stretch, activation):
    """Energy, slope and curvature of the fibre law with this code."""
    if code == BLEMKER:
        return blemker(p, stretch, activation)
    if code == GENERIC:
        return generic(p, stretch, activation)
    if code == CONSTANT_FIBRE:
        return constant(p, stretch, activation)
    return math.nan, math.nan, math.nan


@bare_kernel
def fibre_slopes(code: int, p: Reals, stretch: Reals, activation: Reals, out: Reals) -> None:
    """Write the slopes dw/dstretch (n,) of a fibre law at stretches and activations (n,)."""
    for i in range(stretch.size):
        _, out[i], _ = fibre(code, p, stretch[i], activation[i])


@inner
def fibre_rests(code, p, longest, activation):
    """Test if a fibre has neither energy nor force at all stretches up to the longest."""
    if activation != 0.0:
        return False
    if code == BLEMKER:
        return longest / p[1] <= 1.0 + KINK
    return code == CONSTANT_FIBRE
