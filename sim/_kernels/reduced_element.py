"""Elements of a reduced solid: stress, and the change of the stress along a displacement.

With the deformation gradient F, its cofactor C, J = det F and an energy W(I1, J, I4) of the invariants
I1 = F:F, J and I4 = |F a|^2, the stress is

    P = 2 W_1 F + W_J C + 2 W_4 (F a) a'

and its change along dF = H, with the change dC of the cofactor, which is linear in H,

    dP = 2 W_1 H + (4 W_11 F:H + 2 W_1J C:H) F + (2 W_1J F:H + W_JJ C:H) C + W_J dC
       + 2 W_4 (H a) a' + 4 W_44 t (F a) a' + 2 W_4J (t C + C:H (F a) a'),    t = F a . H a.

F and the derivatives of W are kept from the start of a step: `STORED_ROWS` rows for an element and
`OF_FIBRE` more for each of its fibres, in single precision. The change of the stress then evaluates no
law and reads a quarter of what moduli would be. `sim._kernels.solid` states the same derivatives as
moduli.
"""

# pyright: basic, reportAttributeAccessIssue=false, reportCallIssue=false
# numba compiles these functions; those called from Python carry types

import math

import numpy as np

from sim._kernels.element import (
    along,
    cofactor,
    deformation,
    determinant,
    gather,
    gradient,
    least,
    natural,
    nodal,
    product,
    put,
    take,
)
from sim._kernels.lanes import largest, load, store, total
from sim._kernels.laws import fibre_rests
from sim._kernels.options import inner
from sim._kernels.scatter import subtract_from_nodes
from sim._kernels.solid import STRESS, by_invariants, by_stretch

STORED_ROWS = 14  #: rows of an element: F, 2 W_1, W_J, 4 W_11, 2 W_1J, W_JJ, times the volumes
OF_FIBRE = 3  #: rows of a fibre: 2 W_4, 4 W_44, 2 W_4J


@inner
def _dot(S, T):
    """S:T of two tensors."""
    s = S[0] * T[0] + S[1] * T[1] + S[2] * T[2] + S[3] * T[3] + S[4] * T[4]
    return s + (S[5] * T[5] + S[6] * T[6] + S[7] * T[7] + S[8] * T[8])


@inner
def _scaled(s, T, t, S):
    """Sum s T + t S of two tensors."""
    first = s * T[0] + t * S[0], s * T[1] + t * S[1], s * T[2] + t * S[2]
    second = s * T[3] + t * S[3], s * T[4] + t * S[4], s * T[5] + t * S[5]
    return first + second + (s * T[6] + t * S[6], s * T[7] + t * S[7], s * T[8] + t * S[8])


@inner
def _with_dyad(P, u, v, w, fibres, row):
    """P + (u, v, w) a' with the direction a of a fibre."""
    a0, a1, a2 = fibres.direction[row, 0], fibres.direction[row, 1], fibres.direction[row, 2]
    first, second = (P[0] + u * a0, P[1] + u * a1, P[2] + u * a2), (P[3] + v * a0, P[4] + v * a1)
    return first + second + (P[5] + v * a2, P[6] + w * a0, P[7] + w * a1, P[8] + w * a2)


@inner
def _cofactor_change(F, H):
    """Change of the cofactor of F along H."""
    return (
        F[4] * H[8] + H[4] * F[8] - F[5] * H[7] - H[5] * F[7],
        F[5] * H[6] + H[5] * F[6] - F[3] * H[8] - H[3] * F[8],
        F[3] * H[7] + H[3] * F[7] - F[4] * H[6] - H[4] * F[6],
        F[2] * H[7] + H[2] * F[7] - F[1] * H[8] - H[1] * F[8],
        F[0] * H[8] + H[0] * F[8] - F[2] * H[6] - H[2] * F[6],
        F[1] * H[6] + H[1] * F[6] - F[0] * H[7] - H[0] * F[7],
        F[1] * H[5] + H[1] * F[5] - F[2] * H[4] - H[2] * F[4],
        F[2] * H[3] + H[2] * F[3] - F[0] * H[5] - H[0] * F[5],
        F[0] * H[4] + H[0] * F[4] - F[1] * H[3] - H[1] * F[3],
    )


@inner
def _subtract(P, part, e, w, f):
    """Subtract the forces of a stress P from those on the nodes."""
    put(w, STRESS, natural(P, part.inverse, e))
    nodal(w, STRESS, part.slope, STRESS)
    subtract_from_nodes(w, STRESS, part.nodes, e, f)


@inner
def add_stress(e, part, laws, fibres, activation, weight, first, s):
    """Subtract the forces of element e at positions `s.q` from `s.f`; return energy and least det F.

    What its products require is kept from row `first` of `s.kept`, and whether its fibres act in
    `s.acts`. Nothing is changed if det F <= 0.
    """
    gather(s.q, part.nodes, e, s.x)
    F = deformation(s.x, part.slope_at, part.inverse, e)
    C = cofactor(F)
    J = determinant(F, C)
    least_J = least(J)
    if not (least_J > 0.0):
        return 0.0, least_J
    own = part.element[e]
    row = laws.region[own]
    dV = weight[own] * load(part.volume, e)
    scale, dJ, ddJ, W, p_1, e_11, e_1J, W_J, W_JJ = by_invariants(F, C, J, laws, row)
    p_1 = dV * p_1
    put(s.kept, first, F)
    store(s.kept, first + 9, p_1)
    store(s.kept, first + 11, dV * e_11)
    store(s.kept, first + 12, dV * e_1J)
    P, at = _scaled(p_1, F, p_1 - p_1, F), first + STORED_ROWS
    for fibre in range(fibres.start[own], fibres.start[own + 1]):
        muscle = fibres.muscle[fibre]
        drive, code = activation[muscle], fibres.code[muscle]
        a0, a1, a2 = along(F, fibres.direction, fibre)
        I4bar = scale * (a0 * a0 + a1 * a1 + a2 * a2)
        stretch = math.sqrt(I4bar)
        s.acts[fibre] = not fibre_rests(code, fibres.p[muscle], largest(stretch), drive)
        if s.acts[fibre]:
            own_W, own_J, own_JJ, p_4, e_44, e_4J = by_stretch(
                fibres, fibre, I4bar, stretch, drive, scale, dJ, ddJ
            )
            W, W_J, W_JJ, p_4 = W + own_W, W_J + own_J, W_JJ + own_JJ, dV * p_4
            P = _with_dyad(P, p_4 * a0, p_4 * a1, p_4 * a2, fibres, fibre)
            store(s.kept, at, p_4)
            store(s.kept, at + 1, dV * e_44)
            store(s.kept, at + 2, dV * e_4J)
        at += OF_FIBRE
    store(s.kept, first + 10, dV * W_J)
    store(s.kept, first + 13, dV * W_JJ)
    _subtract(_scaled(np.float64(1.0), P, dV * W_J, C), part, e, s.w, s.f)
    return total(dV * W), least_J


@inner
def add_stiffness(e, part, fibres, first, s):
    """Subtract the change of the forces of element e along displacements `s.q` from `s.f`."""
    gather(s.q, part.nodes, e, s.x)
    H, F = product(gradient(s.x, part.slope_at), take(part.inverse, 9 * e)), take(s.kept, first)
    C, dC = cofactor(F), _cofactor_change(F, H)
    FH, CH = _dot(F, H), _dot(C, H)
    e_1J = load(s.kept, first + 12)
    of_F = load(s.kept, first + 11) * FH + e_1J * CH
    of_C = e_1J * FH + load(s.kept, first + 13) * CH
    P = _scaled(load(s.kept, first + 9), H, load(s.kept, first + 10), dC)
    own, at = part.element[e], first + STORED_ROWS
    for fibre in range(fibres.start[own], fibres.start[own + 1]):
        if s.acts[fibre]:
            a0, a1, a2 = along(F, fibres.direction, fibre)
            h0, h1, h2 = along(H, fibres.direction, fibre)
            t = a0 * h0 + a1 * h1 + a2 * h2
            p_4, e_4J = load(s.kept, at), load(s.kept, at + 2)
            of_a = load(s.kept, at + 1) * t + e_4J * CH
            of_C = of_C + e_4J * t
            u, v, w = p_4 * h0 + of_a * a0, p_4 * h1 + of_a * a1, p_4 * h2 + of_a * a2
            P = _with_dyad(P, u, v, w, fibres, fibre)
        at += OF_FIBRE
    more, one = _scaled(of_F, F, of_C, C), np.float64(1.0)
    _subtract(_scaled(one, P, one, more), part, e, s.w, s.f)


@inner
def rows_of(e, part, fibres):
    """Number of rows that an element keeps."""
    own = part.element[e]
    return STORED_ROWS + OF_FIBRE * (fibres.start[own + 1] - fibres.start[own])
