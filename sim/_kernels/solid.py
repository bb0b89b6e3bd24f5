"""The element loop: deformation gradient once per Gauss point, all laws on it.

With g_a the material gradient of the shape function of node a, and

    F = sum_a x_a g_a',   J = det F,   u_a = 2 F g_a,   h_a = cof(F) g_a,   t_a = 2 F a0 (a0 . g_a),

an energy W(I1, J, I4) of the invariants I1 = F:F, J, I4 = |F a0|^2 has the nodal force and stiffness

    f_a  = W_1 u_a + W_J h_a + W_4 t_a
    K_ab = (2 W_1 g_a.g_b + 2 W_4 (a0.g_a)(a0.g_b)) I + W_11 u_a u_b' + W_1J (u_a h_b' + h_a u_b')
           + (W_JJ + W_J/J) h_a h_b' - W_J/J h_b h_a' + W_44 t_a t_b' + W_4J (t_a h_b' + h_a t_b')

(the term in W_J/J is the derivative of the cofactor). Every element has 8 node slots so that the
innermost loops have a constant length; unused slots carry zero gradients.
"""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import math

import numba as nb
import numpy as np
from numpy.typing import NDArray

from sim._kernels.laws import FLAGS, bulk, fibre, isochoric

Reals = NDArray[np.float64]
Indices = NDArray[np.int64]

NODES = 8
PAIRS = 36  # (a, b) with a <= b, row by row
CHUNKS = 64  # fixed, so that results do not depend on the number of threads


@nb.njit(cache=True, fastmath=FLAGS)
def _gradient(x, g, F, C):
    """F (3, 3) and its cofactor C from nodal positions x (3, 8) and gradients g (3, 8); det F."""
    for i in range(3):
        for j in range(3):
            s = 0.0
            for a in range(NODES):
                s += x[i, a] * g[j, a]
            F[i, j] = s
    C[0, 0] = F[1, 1] * F[2, 2] - F[1, 2] * F[2, 1]
    C[0, 1] = F[1, 2] * F[2, 0] - F[1, 0] * F[2, 2]
    C[0, 2] = F[1, 0] * F[2, 1] - F[1, 1] * F[2, 0]
    C[1, 0] = F[0, 2] * F[2, 1] - F[0, 1] * F[2, 2]
    C[1, 1] = F[0, 0] * F[2, 2] - F[0, 2] * F[2, 0]
    C[1, 2] = F[0, 1] * F[2, 0] - F[0, 0] * F[2, 1]
    C[2, 0] = F[0, 1] * F[1, 2] - F[0, 2] * F[1, 1]
    C[2, 1] = F[0, 2] * F[1, 0] - F[0, 0] * F[1, 2]
    C[2, 2] = F[0, 0] * F[1, 1] - F[0, 1] * F[1, 0]
    return F[0, 0] * C[0, 0] + F[0, 1] * C[0, 1] + F[0, 2] * C[0, 2]


@nb.njit(cache=True, fastmath=FLAGS)
def _add_rows(K, a, i, j, u, h, m, hm, c):
    """K[a, i, j, b] += u_ia m_jb + h_ia hm_jb - c h_ja h_ib for all b.

    Written out with every load before every store: the compiler cannot know that the arrays are
    distinct, and would not use vector instructions otherwise.
    """
    p, q, r = u[i, a], h[i, a], -c * h[j, a]
    k0 = K[a, i, j, 0] + p * m[j, 0] + q * hm[j, 0] + r * h[i, 0]
    k1 = K[a, i, j, 1] + p * m[j, 1] + q * hm[j, 1] + r * h[i, 1]
    k2 = K[a, i, j, 2] + p * m[j, 2] + q * hm[j, 2] + r * h[i, 2]
    k3 = K[a, i, j, 3] + p * m[j, 3] + q * hm[j, 3] + r * h[i, 3]
    k4 = K[a, i, j, 4] + p * m[j, 4] + q * hm[j, 4] + r * h[i, 4]
    k5 = K[a, i, j, 5] + p * m[j, 5] + q * hm[j, 5] + r * h[i, 5]
    k6 = K[a, i, j, 6] + p * m[j, 6] + q * hm[j, 6] + r * h[i, 6]
    k7 = K[a, i, j, 7] + p * m[j, 7] + q * hm[j, 7] + r * h[i, 7]
    K[a, i, j, 0] = k0
    K[a, i, j, 1] = k1
    K[a, i, j, 2] = k2
    K[a, i, j, 3] = k3
    K[a, i, j, 4] = k4
    K[a, i, j, 5] = k5
    K[a, i, j, 6] = k6
    K[a, i, j, 7] = k7


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def smallest_J(q: Reals, nodes: Indices, gradient: Reals, out: Reals) -> None:
    """Smallest det F over the Gauss points of every element, into out (element,)."""
    n = nodes.shape[0]
    for chunk in nb.prange(CHUNKS):
        x = np.empty((3, NODES))
        F = np.empty((3, 3))
        C = np.empty((3, 3))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            for a in range(NODES):
                for i in range(3):
                    x[i, a] = q[nodes[e, a], i]
            least = math.inf
            for k in range(gradient.shape[1]):
                J = _gradient(x, gradient[e, k], F, C)
                if not (J >= least):  # written so that a NaN wins
                    least = J
            out[e] = least


@nb.njit(cache=True, parallel=True, error_model="numpy", fastmath=FLAGS)
def evaluate(
    q: Reals,
    element: Indices,
    nodes: Indices,
    gradient: Reals,
    volume: Reals,
    region: Indices,
    isochoric_code: Indices,
    isochoric_p: Reals,
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

    q (node, 3). Row e of nodes (row, 8), gradient (row, point, 3, 8) and volume (row, point) belongs to
    the element element[e]. Of all elements: region, row of the passive parameters; fibre_start, the
    fibres of element n are rows fibre_start[n]..fibre_start[n + 1], each filling fibre_weight of it; and
    the results force (element, 3, 8) = dE/dx, energy, least_J, tangent (element, 36, 9) for the node
    pairs a <= b. An element with det F <= 0 contributes nothing; the caller reads least_J.
    """
    n = nodes.shape[0]
    for chunk in nb.prange(CHUNKS):
        x = np.empty((3, NODES))
        F = np.empty((3, 3))
        C = np.empty((3, 3))
        u = np.empty((3, NODES))
        h = np.empty((3, NODES))
        m = np.empty((3, NODES))
        hm = np.empty((3, NODES))
        t = np.empty((3, NODES))
        ag = np.empty(NODES)
        Fa = np.empty(3)
        fe = np.empty((3, NODES))
        s = np.empty((NODES, NODES))
        K = np.empty((NODES, 3, 3, NODES))
        for e in range(chunk * n // CHUNKS, (chunk + 1) * n // CHUNKS):
            own = element[e]
            for a in range(NODES):
                for i in range(3):
                    x[i, a] = q[nodes[e, a], i]
            fe[:] = 0.0
            if with_tangent:
                K[:] = 0.0
                s[:] = 0.0
            total = 0.0
            least = math.inf
            row = region[own]
            for k in range(gradient.shape[1]):
                g = gradient[e, k]
                dV = volume[e, k]
                J = _gradient(x, g, F, C)
                if not (J >= least):
                    least = J
                if not (J > 0.0):
                    continue
                I1 = 0.0
                for i in range(3):
                    for j in range(3):
                        I1 += F[i, j] * F[i, j]
                scale = J ** (-2.0 / 3.0)
                # d(I1bar)/dJ = dJ_ * I1bar and so on, the same for every isochoric invariant
                dJ = -2.0 / (3.0 * J)
                ddJ = 10.0 / (9.0 * J * J)
                I1bar = scale * I1
                w, w1, w11 = isochoric(isochoric_code[row], isochoric_p[row], I1bar)
                U, UJ, UJJ = bulk(bulk_code[row], kappa[row], J)
                W = w + U
                W_1 = dV * w1 * scale
                W_J = UJ + w1 * dJ * I1bar
                W_11 = dV * w11 * scale * scale
                W_1J = dV * (w11 * I1bar + w1) * scale * dJ
                W_JJ = UJJ + w11 * (dJ * I1bar) ** 2 + w1 * ddJ * I1bar
                for i in range(3):
                    for a in range(NODES):
                        u[i, a] = 2.0 * (F[i, 0] * g[0, a] + F[i, 1] * g[1, a] + F[i, 2] * g[2, a])
                        h[i, a] = C[i, 0] * g[0, a] + C[i, 1] * g[1, a] + C[i, 2] * g[2, a]
                        hm[i, a] = W_1J * u[i, a]
                for f in range(fibre_start[own], fibre_start[own + 1]):
                    muscle = fibre_muscle[f]
                    I4 = 0.0
                    for i in range(3):
                        Fa[i] = 0.0
                        for j in range(3):
                            Fa[i] += F[i, j] * fibre_direction[f, j]
                        I4 += Fa[i] * Fa[i]
                    I4bar = scale * I4
                    stretch = math.sqrt(I4bar)
                    w, wl, wll = fibre(
                        muscle_code[muscle], muscle_p[muscle], stretch, activation[muscle]
                    )
                    w *= fibre_weight[f]
                    wl *= fibre_weight[f]
                    wll *= fibre_weight[f]
                    W += w
                    if wl == 0.0 and wll == 0.0:  # a resting fibre costs one law evaluation
                        continue
                    w4 = wl / (2.0 * stretch)
                    w44 = (wll - wl / stretch) / (4.0 * I4bar)
                    W_4 = dV * w4 * scale
                    W_J += w4 * dJ * I4bar
                    W_JJ += w44 * (dJ * I4bar) ** 2 + w4 * ddJ * I4bar
                    W_44 = dV * w44 * scale * scale
                    W_4J = dV * (w44 * I4bar + w4) * scale * dJ
                    for a in range(NODES):
                        ag[a] = (
                            fibre_direction[f, 0] * g[0, a]
                            + fibre_direction[f, 1] * g[1, a]
                            + fibre_direction[f, 2] * g[2, a]
                        )
                    for i in range(3):
                        for a in range(NODES):
                            t[i, a] = 2.0 * Fa[i] * ag[a]
                            fe[i, a] += W_4 * t[i, a]
                    if with_tangent:
                        for i in range(3):
                            for a in range(NODES):
                                hm[i, a] += W_4J * t[i, a]
                                m[i, a] = W_44 * t[i, a] + W_4J * h[i, a]
                        for a in range(NODES):
                            for b in range(NODES):
                                s[a, b] += 2.0 * W_4 * ag[a] * ag[b]
                            for i in range(3):
                                for j in range(i, 3):
                                    for b in range(NODES):
                                        K[a, i, j, b] += t[i, a] * m[j, b]
                W_J *= dV
                W_JJ *= dV
                total += dV * W
                for i in range(3):
                    for a in range(NODES):
                        fe[i, a] += W_1 * u[i, a] + W_J * h[i, a]
                if with_tangent:
                    c = W_J / J
                    for i in range(3):
                        for a in range(NODES):
                            m[i, a] = W_11 * u[i, a] + W_1J * h[i, a]
                            hm[i, a] += (W_JJ + c) * h[i, a]
                    for a in range(NODES):
                        for b in range(NODES):
                            s[a, b] += (
                                2.0
                                * W_1
                                * (g[0, a] * g[0, b] + g[1, a] * g[1, b] + g[2, a] * g[2, b])
                            )
                        for i in range(3):
                            for j in range(i, 3):
                                _add_rows(K, a, i, j, u, h, m, hm, c)
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
                            tangent[own, p, 4 * i] += s[a, b]
                        p += 1
