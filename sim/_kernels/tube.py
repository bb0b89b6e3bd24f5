"""Waves in a tube of changing area and length, with vocal folds, and Kelly-Lochbaum scattering.

Pressure p at nodes and velocity u in the cells between them, at alternate half steps. Mouth and nose
lie in one array: nodes 0..N of the mouth, then those of the nose, whose first is a copy of the node
where it branches; the cell between the two is closed.
"""

# pyright: basic

import math

import numpy as np

from sim._kernels.options import inner, kernel


@inner
def fold_motion(dt, m, k, kc, zeta, rest, x, v, other, cubic, contact, load):
    """Move one mass by a step of the linearised trapezoidal rule, which damps at any step.

    m x'' + r x' + k x (1 + cubic x^2) + kc (x - other) = load, r = 2 zeta sqrt(m k); where the folds
    touch, x < -rest, also 3 k y (1 + contact y^2) with y = x + rest, and zeta is 1 larger.
    """
    force = load - k * x * (1.0 + cubic * x * x) - kc * (x - other)
    slope = k * (1.0 + 3.0 * cubic * x * x) + kc
    y = x + rest
    if y < 0.0:
        force -= 3.0 * k * y * (1.0 + contact * y * y)
        slope += 3.0 * k * (1.0 + 3.0 * contact * y * y)
        zeta += 1.0
    r = 2.0 * zeta * math.sqrt(m * k)
    middle = (2.0 * m / dt * v + force) / (2.0 * m / dt + r + 0.5 * dt * slope)
    return x + dt * middle, 2.0 * middle - v


@inner
def hiss(gain, critical, flow, area, rho, mu):
    """Pressure [Pa] of turbulence per unit of noise: gain max(0, Re^2 - critical^2)."""
    re = 2.0 * rho * abs(flow) / (mu * math.sqrt(math.pi * area))
    return gain * max(0.0, re * re - critical * critical)


@inner
def glottal_flow(dt, rho, mu, a1, a2, shape, before, drive, pa, pb, beyond):
    """Flow through the glottis, implicit in the pressure pa + pb U of the tract.

    Loss at the entry 1.37 rho/2 (U/a1)^2, viscous 12 mu l^2 d/a^3, inertia rho d/a, step between the
    masses, recovery at the exit 2 N (1 - N), N = a2/S1 (Ishizaka and Flanagan 1972).
    """
    length, d1, d2 = shape
    ratio = min(a2 / beyond, 1.0)
    kinetic = 0.5 * rho * (0.37 / a1**2 + (1.0 - 2.0 * ratio * (1.0 - ratio)) / a2**2)
    viscous = 12.0 * mu * length**2 * (d1 / a1**3 + d2 / a2**3)
    mass = rho * (d1 / a1 + d2 / a2) / dt
    linear, driving = mass + viscous + pb, drive - pa + mass * before
    root = math.sqrt(linear * linear + 4.0 * kinetic * abs(driving))
    return 2.0 * driving / (linear + root)


@kernel
def advance(
    dt, block, air, wall, weight, decay, gain, p, u, q, r, z, y, w, motion, A, V, ih, lu, aw, ah,
    load, jet, ends, branch, folds, turbulence, inflow, lung, noise, out,
):  # fmt: skip
    """Advance the waves in a tube.

    Parameters
    ----------
    dt, block : step [s], and steps between the instants of A and V.
    air, wall : (rho, c, mu); (mass, damping, stiffness) of the walls per area.
    weight, decay, gain : (K,) terms of the losses that increase with sqrt(s): sum of w for the immediate
    part, and decay and gain per step of the delayed part, multiplied by w.
    p, u, q, r, z, y : state: pressures and velocities (M,), memory of both losses (K, M), times w,
        velocity and displacement of the walls (M,).
    w, motion : flows of the masses of both openings, filtered flow of the jet, flow of the glottis
        (4,); x1, v1, x2, v2 of the folds (4,).
    A, V : (blocks + 1, M) areas of cells [m^2], volumes of nodes [m^3].
    ih, lu, aw, ah : (blocks, M) inverse cell length, friction rate, wall area per volume, heat loss.
    load : (blocks, 2, 2) mass and resistance of both openings; mass 0: pressure 0.
    jet : (blocks, 2) cell with the narrowest area and its loss factor.
    ends, branch : nodes of the openings, -1: none; node of the branch, or -1.
    folds : (0,) or parameters of the folds, see `sim.acoustics.sources.Folds`.
    turbulence : gain [Pa], critical Reynolds number, rate of the filter of the flow [1/s].
    inflow, lung : (n,) flow into the tube [m^3/s] where there are no folds; lung pressure [Pa].
    noise : (2, n) unit noise at the glottis and behind the jet.
    out : (5, n) flow out of mouth and nose, into the tract [m^3/s]; pressure behind the glottis [Pa];
        smallest area of the glottis [m^2]; written.
    """
    rho, c, mu = air
    M, K = p.size, weight.size
    a, iv, s, flux, num = np.empty(M), np.empty(M), np.empty(M), np.zeros(M), np.empty(M)
    at_nodes, at_cells, awz = np.empty(M), np.empty(M), np.empty(M)
    one_node, one_cell, drag = np.empty(M), np.empty(M), np.empty(M)
    heat, friction = np.zeros(M), np.zeros(M)
    for k in range(K):
        heat += r[k]
        friction += q[k]
    k0, k1 = 2.0 / (dt * rho * c * c), 2.0 * rho / dt
    mass = 2.0 * wall[0] / dt
    zw = mass + wall[1] + 0.5 * dt * wall[2]
    stiff = wall[2]
    sw = np.sum(weight)
    last, now = ends[0] - 1, -1
    moves = False
    for n in range(out.shape[1]):
        b = n // block
        if b != now:  # short loops over few arrays, which compilers can vectorise
            now, moves = b, False
            for i in range(M):
                awz[i] = aw[b, i] / zw
                at_nodes[i] = k0 + awz[i] + ah[b, i] * sw
                drag[i] = rho * lu[b, i]
                at_cells[i] = k1 + drag[i] * sw
                one_node[i], one_cell[i] = 1.0 / at_nodes[i], 1.0 / at_cells[i]
                a[i], iv[i] = A[b, i], 1.0 / V[b, i]
                moves = moves or A[b + 1, i] != A[b, i] or V[b + 1, i] != V[b, i]
        if moves:
            f = (n - b * block + 0.5) / block
            for i in range(M):
                a[i] = A[b, i] + f * (A[b + 1, i] - A[b, i])
            for i in range(M):
                iv[i] = 1.0 / (V[b, i] + f * (V[b + 1, i] - V[b, i]))
        for i in range(M):
            flux[i] = a[i] * u[i]
        num[0] = k0 * p[0] - flux[0] * iv[0]
        for i in range(1, M):
            num[i] = k0 * p[i] - (flux[i] - flux[i - 1]) * iv[i]
        for i in range(M):
            num[i] += ah[b, i] * heat[i] - awz[i] * (mass * z[i] - stiff * y[i])
        if branch >= 0:
            g = ends[0] + 1
            v0, v1 = 1.0 / iv[branch], 1.0 / iv[g]
            joined = (num[branch] * v0 + num[g] * v1) / (at_nodes[branch] * v0 + at_nodes[g] * v1)
            num[branch], num[g] = joined * at_nodes[branch], joined * at_nodes[g]
        area = 0.0
        if folds.size > 0:
            q_t, length = folds[0], folds[10]
            a1 = folds[13] + 2.0 * length * motion[0]
            a2 = folds[13] + 2.0 * length * motion[2]
            area = max(0.0, min(a1, a2))
            open1, open2 = max(a1, 1e-10), max(a2, 1e-10)
            ps = lung[n] + noise[0, n] * hiss(
                turbulence[0], turbulence[1], w[3], max(area, 1e-8), rho, mu
            )
            flow = glottal_flow(
                dt, rho, mu, open1, open2, (length, folds[11], folds[12]), w[3], ps,
                num[0] / at_nodes[0], iv[0] / at_nodes[0], a[0],
            )  # fmt: skip
            change, w[3] = (flow - w[3]) / dt, flow
            p1 = p2 = lung[n]
            if a1 <= 0.0:
                p2 = (num[0] + flow * iv[0]) / at_nodes[0]
            elif a2 > 0.0:
                l1, l2 = rho * folds[11] / open1, rho * folds[12] / open2
                r1 = 12.0 * mu * length**2 * folds[11] / open1**3
                r2 = 12.0 * mu * length**2 * folds[12] / open2**3
                p1 -= 0.685 * rho * (flow / open1) ** 2 + 0.5 * (r1 * flow + l1 * change)
                p2 = p1 - 0.5 * ((r1 + r2) * flow + (l1 + l2) * change)
                p2 -= 0.5 * rho * flow * abs(flow) * (1.0 / open2**2 - 1.0 / open1**2)
            rest = folds[13] / (2.0 * length)
            x1, x2 = motion[0], motion[2]
            motion[0], motion[1] = fold_motion(
                dt, folds[1] / q_t, folds[3] * q_t, folds[5] * q_t, folds[6], rest, x1, motion[1],
                x2, folds[8], folds[9], length * folds[11] * p1,
            )  # fmt: skip
            motion[2], motion[3] = fold_motion(
                dt, folds[2] / q_t, folds[4] * q_t, folds[5] * q_t, folds[7], rest, x2, motion[3],
                x1, folds[8], folds[9], length * folds[12] * p2,
            )  # fmt: skip
        else:
            flow = inflow[n]
        num[0] += flow * iv[0]
        for e in range(2):
            at = ends[e]
            out[e, n] = 0.0
            if at >= 0:
                if load[b, e, 0] == 0.0:
                    num[at] = 0.0
                    out[e, n] = flux[at - 1]
                else:
                    extra = (1.0 / load[b, e, 1] + 0.5 * dt / load[b, e, 0]) * iv[at]
                    num[at] -= w[e] * iv[at]
                    num[at] *= at_nodes[at] / (at_nodes[at] + extra)
        for i in range(M):
            s[i] = num[i] * one_node[i]
        for i in range(M):
            p[i] = 2.0 * s[i] - p[i]
        for i in range(M):
            velocity = (s[i] + mass * z[i] - stiff * y[i]) / zw
            z[i] = 2.0 * velocity - z[i]
            y[i] += dt * velocity
        for i in range(M):
            heat[i] = 0.0
        for k in range(K):
            for i in range(M):
                r[k, i] = decay[k] * r[k, i] + gain[k] * s[i]
                heat[i] += r[k, i]
        for e in range(2):
            at = ends[e]
            if at >= 0 and load[b, e, 0] != 0.0:
                middle = s[at]
                through = 0.5 * dt / load[b, e, 0] * middle
                out[e, n] = middle / load[b, e, 1] + w[e] + through
                w[e] += 2.0 * through
        out[2, n], out[3, n], out[4, n] = flow, s[0], area
        for i in range(M - 1):
            num[i] = k1 * u[i] - ih[b, i] * (p[i + 1] - p[i])
        for i in range(M - 1):
            num[i] += drag[i] * friction[i]
        num[M - 1] = 0.0
        if branch >= 0:
            num[ends[0]] = 0.0
        # a jet loses its kinetic energy: loss/2 rho u |u|
        at, loss = int(jet[b, 0]), jet[b, 1]
        w[2] += min(1.0, dt * turbulence[2]) * (flux[at] - w[2])
        behind = min(at + 1, last)
        sound = hiss(turbulence[0], turbulence[1], w[2], a[at], rho, mu)
        num[behind] += noise[1, n] * sound * ih[b, behind]
        extra = 0.5 * rho * loss * abs(u[at]) * ih[b, at]
        num[at] *= at_cells[at] / (at_cells[at] + extra)
        if at != last:
            extra = 0.5 * rho * abs(u[last]) * ih[b, last]
            num[last] *= at_cells[last] / (at_cells[last] + extra)
        for i in range(M):
            s[i] = num[i] * one_cell[i]
        for i in range(M):
            u[i] = 2.0 * s[i] - u[i]
        for i in range(M):
            friction[i] = 0.0
        for k in range(K):
            for i in range(M):
                q[k, i] = decay[k] * q[k, i] + gain[k] * s[i]
                friction[i] += q[k, i]


@kernel
def scatter(reflection, glottis, lips, inflow, out):
    """Kelly-Lochbaum: forward and backward waves of flow, delayed by one sample per section.

    Parameters
    ----------
    reflection : (sections - 1,) (S_i - S_i+1)/(S_i + S_i+1), of waves of flow that travel forwards.
    glottis, lips : reflection of waves of flow at the ends.
    inflow : (n,) flow into the tube.
    out : (n,) flow out of the lips, written.
    """
    m = reflection.size + 1
    ahead, back = np.zeros(m), np.zeros(m)
    new_ahead, new_back = np.zeros(m), np.zeros(m)
    for n in range(inflow.size):
        new_ahead[0] = glottis * back[0] + inflow[n]
        for i in range(m - 1):
            k = reflection[i]
            # net flow ahead - back and pressure are continuous
            new_back[i] = k * ahead[i] + (1.0 + k) * back[i + 1]
            new_ahead[i + 1] = (1.0 - k) * ahead[i] - k * back[i + 1]
        new_back[m - 1] = lips * ahead[m - 1]
        out[n] = (1.0 - lips) * ahead[m - 1]
        for i in range(m):
            ahead[i], back[i] = new_ahead[i], new_back[i]
