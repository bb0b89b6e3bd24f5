"""Tension of line muscles: energy, force and slope by the length of a fibre.

A new law is one function and one line in `_law`; its class in `sim.laws.line` has its code number.
"""

# pyright: basic
# numba compiles these functions; those called from Python carry types

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import KINK
from sim._kernels.options import bare_kernel, inner

Array = NDArray[np.float64]
Index = NDArray[np.int64]

CONSTANT, PECK, LINEAR_SPRING, HILL = 0, 1, 2, 3
PARAMETERS = 6

TENDON_ITERATIONS = 80
"""Largest number of Newton steps for the length of a tendon."""


class LineTable(NamedTuple):
    """Fibres (n) and their laws.

    muscle : number of the muscle of every fibre, -1 for a spring.
    share : factor on the tension of the law [1].
    rest : length at rest [m].
    code, parameters : (n,), (n, PARAMETERS) of the law, as in `sim.laws.line.LineLaw`.
    stiffness, damping : of a spring and a damper along the fibre [N/m], [N s/m].
    relation : (n, 3) force-velocity relation: v_max [1/s], 0 without one, curvature, lengthening.
    """

    muscle: Index
    share: Array
    rest: Array
    code: Index
    parameters: Array
    stiffness: Array
    damping: Array
    relation: Array


@inner
def _constant(p, k, length, rest, activation):
    """Energy, tension and slope of `sim.laws.line.ConstantForce`."""
    F = p[k, 0] * (activation + p[k, 1])
    return F * (length - rest), F, 0.0


@inner
def _peck(p, k, length, rest, activation):
    """Energy, tension and slope of `sim.laws.line.Peck`."""
    force_max, stretch_opt, stretch_max = p[k, 0], p[k, 1], p[k, 2]
    tendon, passive = p[k, 3], p[k, 4]
    optimal = stretch_opt * rest
    belly = optimal * (1.0 - tendon)
    r, turn = length / optimal, 2.0 * math.pi
    n = min(max((r - tendon) / (1.0 - tendon), 0.5), 1.5)
    w, F, slope = 0.0, 0.0, 0.0
    if activation > 0.0:
        sine = math.sin(turn * n)
        w = force_max * activation * belly * (0.5 * (n - 1.0) + sine / (2.0 * turn))
        F = force_max * activation * 0.5 * (1.0 + math.cos(turn * n))
        if 0.5 < n < 1.5:
            slope = -force_max * activation * 0.5 * turn * sine / belly
    phi, span = force_max * passive, stretch_max - 1.0
    x = min(max(r - 1.0, 0.0), span)
    w += phi * optimal * (0.5 * x * x / span + max(r - stretch_max, 0.0))
    if 1.0 + KINK < r < stretch_max:
        slope += phi / (span * optimal)
    return w, F + phi * x / span, slope


@inner
def _linear_spring(p, k, length, rest, activation):
    """Energy, tension and slope of `sim.laws.line.LinearSpring`."""
    slack, force_max = p[k, 2] * rest, p[k, 0]
    stiff = force_max * p[k, 1]
    x = max(length / slack - 1.0, 0.0)
    w = force_max * activation * (length - rest) + 0.5 * stiff * slack * x * x
    return w, force_max * activation + stiff * x, stiff / slack if x > KINK else 0.0


@inner
def _hill_fibres(force_max, passive, pennation, across, y, activation):
    """Energy, tension and slope of pennate fibres by their length y along the line of action."""
    l_opt = across / math.cos(pennation)
    thickness = l_opt * math.sin(pennation)
    length = math.sqrt(y * y + thickness * thickness)
    x = length / l_opt - 1.0
    beyond, share = max(x, 0.0), passive / math.expm1(5.0)
    active, grown = math.exp(-x * x / 0.45), math.exp(5.0 * beyond / 0.6)
    root = math.sqrt(0.45)
    w = activation * root * 0.5 * math.sqrt(math.pi) * math.erf(x / root)
    w += share * (0.12 * (grown - 1.0) - beyond)
    f = activation * active + share * (grown - 1.0)
    slope = -2.0 * x / 0.45 * activation * active
    if x > KINK:
        slope += share / 0.12 * grown
    if length == 0.0:
        return force_max * l_opt * w, force_max * f, force_max * slope / l_opt
    cos = y / length
    slope = slope / l_opt * cos * cos + f * (1.0 - cos * cos) / length
    return force_max * l_opt * w, force_max * f * cos, force_max * slope


@inner
def _hill(p, k, length, rest, activation):
    """Energy, tension and slope of `sim.laws.hill.Hill`, by Newton steps within a bracket."""
    force_max, passive, pennation, strain = p[k, 0], p[k, 3], p[k, 4], p[k, 5]
    optimal = p[k, 1] * rest
    tendon = p[k, 2] * optimal
    across, most = optimal - tendon, max(length - tendon, 0.0)
    stiff, low, high, y = force_max / (strain * tendon), 0.0, most, most
    w, F, slope = 0.0, 0.0, 0.0
    for turn in range(TENDON_ITERATIONS + 1):
        w, F, slope = _hill_fibres(force_max, passive, pennation, across, y, activation)
        if turn == 0 and (strain == 0.0 or tendon == 0.0 or F <= 0.0):
            return w, F, slope
        if most == 0.0:  # the tendon is slack
            return w, 0.0, 0.0
        miss = F - stiff * (most - y)
        if miss > 0.0:
            high = y
        else:
            low = y
        new = y - miss / (slope + stiff)
        if not low < new < high:
            new = 0.5 * (low + high)
        if turn == TENDON_ITERATIONS or abs(new - y) <= 1e-15 * most:
            break
        y = new
    e = most - y
    return w + 0.5 * stiff * e * e, F, slope * stiff / (slope + stiff)


@inner
def _law(code, p, k, length, rest, activation):
    """Energy, tension and slope of the law with parameters p[k]; NaN without one of this code."""
    if code == CONSTANT:
        return _constant(p, k, length, rest, activation)
    if code == PECK:
        return _peck(p, k, length, rest, activation)
    if code == LINEAR_SPRING:
        return _linear_spring(p, k, length, rest, activation)
    if code == HILL:
        return _hill(p, k, length, rest, activation)
    return math.nan, math.nan, math.nan


@inner
def tension(table, k, length, activation, factor):
    """Energy [J], tension [N] and slope [N/m] of fibre k at a length [m], with its spring.

    The factor is one on the activation: without activation the tension is the passive one.
    """
    a = factor * activation[table.muscle[k]] if table.muscle[k] >= 0 else 0.0
    w, F, slope = _law(table.code[k], table.parameters, k, length, table.rest[k], a)
    share, spring, strain = table.share[k], table.stiffness[k], length - table.rest[k]
    w = share * w + 0.5 * spring * strain * strain
    return w, share * F + spring * strain, share * slope + spring


@inner
def velocity_factor(table, k, rate):
    """Factor of the active tension at a rate of length [m/s], less 1, and its slope [s/m].

    As `sim.laws.rate.ForceVelocity`.
    """
    scale = table.relation[k, 0] * table.rest[k]
    curvature, more = table.relation[k, 1], table.relation[k, 2] - 1.0
    u, slope = rate / scale, 1.0 + 1.0 / curvature
    if u <= -1.0:
        return -1.0, 0.0
    if u <= 0.0:
        below = 1.0 - u / curvature
        return (1.0 + u) / below - 1.0, slope / (below * below * scale)
    above = 1.0 + slope * u / more
    return more - more / above, slope / (above * above * scale)


@bare_kernel
def tensions(table: LineTable, length: Array, activation: Array, F: Array, slope: Array) -> float:
    """Sum of the energies, with tension (n,) and slope (n,) of every fibre."""
    energy = 0.0
    for k in range(len(length)):
        w, F[k], slope[k] = tension(table, k, length[k], activation, 1.0)
        energy += w
    return energy
