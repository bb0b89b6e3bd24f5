"""Waves in a tube of changing area and length, with vocal folds, and Kelly-Lochbaum scattering.

Pressure p at nodes and velocity u in the cells between them, at alternate half steps. Mouth and nose
lie in one array: nodes 0..N of the mouth, then those of the nose, whose first is a copy of the node
where it branches; the cell between the two is closed, as are those that fill the arrays up to a whole
number of vector registers.
"""

# pyright: basic

import math

import numpy as np

from sim._kernels.options import inner, kernel

SHAPE_STEPS = 4
"""Steps between evaluations of a changing shape: at the usual steps more than 30 000 per second."""


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


@inner
def glottis(dt, air, folds, motion, w, lung, unit, turbulence, pa, pb, beyond):
    """Move the folds by a step under the pressure pa + pb U of the tract.

    Returns the flow [m^3/s] and the smallest area [m^2]; `unit` is noise, w[3] the flow before.
    """
    rho, _, mu = air
    q, length, d1, d2, at_rest = folds[0], folds[10], folds[11], folds[12], folds[13]
    a1, a2 = at_rest + 2.0 * length * motion[0], at_rest + 2.0 * length * motion[2]
    area = max(0.0, min(a1, a2))
    open1, open2 = max(a1, 1e-10), max(a2, 1e-10)
    drive = lung + unit * hiss(turbulence[0], turbulence[1], w[3], max(area, 1e-8), rho, mu)
    flow = glottal_flow(
        dt, rho, mu, open1, open2, (length, d1, d2), w[3], drive, pa, pb, beyond
    )  # fmt: skip
    change, w[3] = (flow - w[3]) / dt, flow
    p1 = p2 = lung
    if a1 <= 0.0:
        p2 = pa + pb * flow
    elif a2 > 0.0:
        l1, l2 = rho * d1 / open1, rho * d2 / open2
        r1 = 12.0 * mu * length**2 * d1 / open1**3
        r2 = 12.0 * mu * length**2 * d2 / open2**3
        p1 -= 0.685 * rho * (flow / open1) ** 2 + 0.5 * (r1 * flow + l1 * change)
        p2 = p1 - 0.5 * ((r1 + r2) * flow + (l1 + l2) * change)
        p2 -= 0.5 * rho * flow * abs(flow) * (1.0 / open2**2 - 1.0 / open1**2)
    rest, x1, x2 = at_rest / (2.0 * length), motion[0], motion[2]
    motion[0], motion[1] = fold_motion(
        dt, folds[1] / q, folds[3] * q, folds[5] * q, folds[6], rest, x1, motion[1], x2, folds[8],
        folds[9], length * d1 * p1,
    )  # fmt: skip
    motion[2], motion[3] = fold_motion(
        dt, folds[2] / q, folds[4] * q, folds[5] * q, folds[7], rest, x2, motion[3], x1, folds[8],
        folds[9], length * d2 * p2,
    )  # fmt: skip
    return flow, area


# Loops write few arrays: compilers vectorise a loop only with few comparisons of addresses.


@inner
def block_coefficients(b, k0, k1, zw, rho, immediate, grid, a, iv, awz, drag, one_node, one_cell):
    """Coefficients that are constant in block b; returns True where the shape changes in it."""
    A, V, _, lu, aw, ah, _, _ = grid
    moves = False
    for i in range(a.size):
        awz[i] = aw[b, i] / zw
        drag[i] = rho * lu[b, i]
        one_node[i] = 1.0 / (k0 + awz[i] + ah[b, i] * immediate)
        one_cell[i] = 1.0 / (k1 + drag[i] * immediate)
        a[i], iv[i] = A[b, i], 1.0 / V[b, i]
        moves = moves or A[b + 1, i] != A[b, i] or V[b + 1, i] != V[b, i]
    return moves


@inner
def shape_within(f, b, A, V, a, iv):
    """Areas and inverse volumes at the fraction f of block b."""
    for i in range(a.size):
        a[i] = A[b, i] + f * (A[b + 1, i] - A[b, i])
    for i in range(a.size):
        iv[i] = 1.0 / (V[b, i] + f * (V[b + 1, i] - V[b, i]))


@inner
def node_balance(k0, mass, stiff, p, heat, ah, awz, z, y, a, u, iv, num):
    """Known part of the continuity equation: pressure before, walls, heat, and flow of the cells."""
    for i in range(p.size):
        num[i] = k0 * p[i] + ah[i] * heat[i] - awz[i] * (mass * z[i] - stiff * y[i])
    num[0] -= a[0] * u[0] * iv[0]
    for i in range(1, p.size):
        num[i] -= (a[i] * u[i] - a[i - 1] * u[i - 1]) * iv[i]


@inner
def node_step(dt, mass, stiff, zw, one_node, s, p, z, y):
    """Pressure in the middle of the step into s, from its known part; pressure and walls after it."""
    inverse = 1.0 / zw
    for i in range(p.size):
        s[i] *= one_node[i]
        p[i] = 2.0 * s[i] - p[i]
    for i in range(p.size):
        velocity = (s[i] + mass * z[i] - stiff * y[i]) * inverse
        z[i] = 2.0 * velocity - z[i]
        y[i] += dt * velocity


@inner
def cell_balance(k1, u, ih, p, drag, friction, num):
    """Known part of the momentum equation; cells with ih = 0 are closed."""
    for i in range(p.size - 1):
        num[i] = k1 * u[i] - ih[i] * (p[i + 1] - p[i]) + drag[i] * friction[i]
    num[p.size - 1] = 0.0


@inner
def cell_step(one_cell, s, u):
    """Velocity in the middle of the step into s, from its known part; velocity after it."""
    for i in range(u.size):
        s[i] *= one_cell[i]
        u[i] = 2.0 * s[i] - u[i]


@inner
def remember(decay, gain, s, memory, total):
    """Advance the memory of the losses by a step, two terms at a time; their sum into total."""
    for k in range(0, decay.size, 2):
        one, two = memory[k], memory[k + 1]
        d1, d2, g1, g2 = decay[k], decay[k + 1], gain[k], gain[k + 1]
        if k == 0:
            for i in range(s.size):
                one[i] = d1 * one[i] + g1 * s[i]
                two[i] = d2 * two[i] + g2 * s[i]
                total[i] = one[i] + two[i]
        else:
            for i in range(s.size):
                one[i] = d1 * one[i] + g1 * s[i]
                two[i] = d2 * two[i] + g2 * s[i]
                total[i] += one[i] + two[i]


@inner
def join(branch, nose, iv, one_node, num):
    """Give the first node of the nose and the node where it branches the same pressure."""
    v0, v1 = 1.0 / iv[branch], 1.0 / iv[nose]
    sums = v0 / one_node[branch] + v1 / one_node[nose]
    joined = (num[branch] * v0 + num[nose] * v1) / sums
    num[branch], num[nose] = joined / one_node[branch], joined / one_node[nose]


@inner
def load_ends(dt, ends, load, iv, one_node, w, num):
    """Flow out of the openings, implicit in their pressure."""
    for e in range(2):
        at = ends[e]
        if at < 0:
            continue
        if load[e, 0] == 0.0:
            num[at] = 0.0
            continue
        extra = (1.0 / load[e, 1] + 0.5 * dt / load[e, 0]) * iv[at]
        num[at] = (num[at] - w[e] * iv[at]) / (1.0 + extra * one_node[at])


@inner
def flow_of_ends(dt, ends, load, a, u, s, w, out):
    """Flow out of the openings [m^3/s], and of the mass of their load after the step."""
    for e in range(2):
        at = ends[e]
        out[e] = 0.0
        if at >= 0 and load[e, 0] == 0.0:
            out[e] = a[at - 1] * u[at - 1]
        elif at >= 0:
            through = 0.5 * dt / load[e, 0] * s[at]
            out[e] = s[at] / load[e, 1] + w[e] + through
            w[e] += 2.0 * through


@inner
def jets(dt, air, turbulence, jet, last, unit, a, u, ih, one_cell, w, num):
    """Noise behind the narrowest cell; jets there and at the lips lose loss/2 rho u |u|."""
    rho, _, mu = air
    at, loss = int(jet[0]), jet[1]
    w[2] += min(1.0, dt * turbulence[2]) * (a[at] * u[at] - w[2])
    behind = min(at + 1, last)
    num[behind] += unit * hiss(turbulence[0], turbulence[1], w[2], a[at], rho, mu) * ih[behind]
    num[at] /= 1.0 + 0.5 * rho * loss * abs(u[at]) * ih[at] * one_cell[at]
    if at != last:
        num[last] /= 1.0 + 0.5 * rho * abs(u[last]) * ih[last] * one_cell[last]


@kernel
def advance(
    dt, block, air, wall, losses, state, w, motion, grid, ends, branch, folds, turbulence, inflow,
    lung, noise, out,
):  # fmt: skip
    """Advance the waves in a tube.

    Parameters
    ----------
    dt, block : step [s], and steps between the instants of A and V.
    air, wall : (rho, c, mu); (mass, damping, stiffness) of the walls per area.
    losses : immediate, decay, gain of the losses that increase with sqrt(s): sum of their immediate
        parts, and (K,) decay and gain per step of the delayed ones, K even.
    state : p, u, z, y (M,), r, q (K, M): pressures and velocities, velocity and displacement of the
        walls, memory of the losses of nodes and cells.
    w, motion : flows of the masses of both openings, filtered flow of the jet, flow of the glottis
        (4,); x1, v1, x2, v2 of the folds (4,).
    grid : A, V (blocks + 1, M) areas of cells [m^2], volumes of nodes [m^3]; ih, lu, aw, ah
        (blocks, M) inverse cell length, friction rate, wall area per volume, heat loss; load
        (blocks, 2, 2) mass and resistance of both openings, mass 0: pressure 0; jet (blocks, 2) cell
        with the narrowest area and its loss factor.
    ends, branch : nodes of the openings, -1: none; node of the branch, or -1.
    folds : (0,) or parameters of the folds, see `sim.acoustics.sources.Folds`.
    turbulence : gain [Pa], critical Reynolds number, rate of the filter of the flow [1/s].
    inflow, lung : (n,) flow into the tube [m^3/s] where there are no folds; lung pressure [Pa].
    noise : (2, n) unit noise at the glottis and behind the jet.
    out : (n, 5) flow out of mouth and nose, into the tract [m^3/s]; pressure behind the glottis [Pa];
        smallest area of the glottis [m^2]; written.
    """
    rho, c, _ = air
    immediate, decay, gain = losses
    p, u, z, y, r, q = state
    A, V, ih, _, _, ah, load, jet = grid
    M = p.size
    a, iv, awz, drag, num = np.empty(M), np.empty(M), np.empty(M), np.empty(M), np.empty(M)
    one_node, one_cell, heat, friction = np.empty(M), np.empty(M), np.zeros(M), np.zeros(M)
    for k in range(decay.size):
        heat += r[k]
        friction += q[k]
    k0, k1 = 2.0 / (dt * rho * c * c), 2.0 * rho / dt
    mass, stiff = 2.0 * wall[0] / dt, wall[2]
    zw = mass + wall[1] + 0.5 * dt * wall[2]
    now, moves = -1, False
    for n in range(out.shape[0]):
        b = n // block
        if b != now:
            now = b
            moves = block_coefficients(
                b, k0, k1, zw, rho, immediate, grid, a, iv, awz, drag, one_node, one_cell
            )
        if moves and (n - b * block) % SHAPE_STEPS == 0:
            shape_within((n - b * block + 0.5 * SHAPE_STEPS) / block, b, A, V, a, iv)
        node_balance(k0, mass, stiff, p, heat, ah[b], awz, z, y, a, u, iv, num)
        if branch >= 0:
            join(branch, ends[0] + 1, iv, one_node, num)
        flow, area = inflow[n], 0.0
        if folds.size > 0:
            flow, area = glottis(
                dt, air, folds, motion, w, lung[n], noise[0, n], turbulence,
                num[0] * one_node[0], iv[0] * one_node[0], a[0],
            )  # fmt: skip
        num[0] += flow * iv[0]
        load_ends(dt, ends, load[b], iv, one_node, w, num)
        node_step(dt, mass, stiff, zw, one_node, num, p, z, y)
        remember(decay, gain, num, r, heat)
        flow_of_ends(dt, ends, load[b], a, u, num, w, out[n])
        out[n, 2], out[n, 3], out[n, 4] = flow, num[0], area
        cell_balance(k1, u, ih[b], p, drag, friction, num)
        jets(dt, air, turbulence, jet[b], ends[0] - 1, noise[1, n], a, u, ih[b], one_cell, w, num)
        cell_step(one_cell, num, u)
        remember(decay, gain, num, q, friction)


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
