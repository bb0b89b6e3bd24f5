"""Waves in a tube of changing area and length, with vocal folds, and Kelly-Lochbaum scattering.

Pressure p at nodes and velocity u in the cells between them, at alternate half steps. Mouth and nose
lie in one row: nodes 0..N of the mouth, then those of the nose, whose first is a copy of the node
where it branches; the cell between the two is closed.
"""

# pyright: basic

import math

import numpy as np

from sim._kernels.options import bare_kernel, inner, kernel

STRIDE = 520
"""Distance of the rows of the state, which limits the number of nodes: a constant, so that compilers
know that rows do not overlap and vectorise loops that write several of them. A multiple of 8 of an odd
number of cache lines."""
TERMS = 4  #: relaxations of the losses
SHAPE_STEPS = 4
"""Steps between evaluations of a changing shape: at the usual steps more than 30 000 per second."""
# rows of the state: pressure, velocity, walls, memory of the losses of nodes and cells
P, U, Z, Y, R, Q = (k * STRIDE for k in (0, 1, 2, 3, 4, 8))
# coefficients: area and inverse cell length of cells, inverse volume, losses, inverse of the implicit
# parts, additional flow into nodes and pressure across cells
A, IH, IV, HEAT, WALL, NODE, PUSH, DRAG, CELL, BLOW = (k * STRIDE for k in range(12, 22))
ROWS = 22


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
def glottis(
    dt, air, folds, at_rest, motion, w, lung, unit, turbulence, pa, pb, beyond
):  # fmt: skip
    """Move the folds by a step under the pressure pa + pb U of the tract.

    Returns the flow [m^3/s] and the smallest area [m^2]; `unit` is noise, w[1] the flow before.
    """
    rho, _, mu = air
    q, length, d1, d2 = folds[0], folds[10], folds[11], folds[12]
    a1, a2 = at_rest + 2.0 * length * motion[0], at_rest + 2.0 * length * motion[2]
    area = max(0.0, min(a1, a2))
    open1, open2 = max(a1, 1e-10), max(a2, 1e-10)
    drive = lung + unit * hiss(turbulence[0], turbulence[1], w[1], max(area, 1e-8), rho, mu)
    flow = glottal_flow(
        dt, rho, mu, open1, open2, (length, d1, d2), w[1], drive, pa, pb, beyond
    )  # fmt: skip
    change, w[1] = (flow - w[1]) / dt, flow
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


@inner
def block_coefficients(b, k0, k1, zw, rho, immediate, per_wall, grid, s):
    """Coefficients that are constant in block b; returns True where the shape changes in it."""
    area, volume, inverse, rate, steady, surface, _ = grid
    M = area.shape[1]
    moves = False
    for i in range(M):
        s[WALL + i] = per_wall[0] * surface[b, i] / zw
        s[HEAT + i] = per_wall[1] * surface[b, i]
        s[DRAG + i] = rho * rate[b, i]
        s[IH + i] = inverse[b, i]
        s[A + i], s[IV + i] = area[b, i], 1.0 / volume[b, i]
        s[PUSH + i], s[BLOW + i] = 0.0, 0.0
        moves = moves or area[b + 1, i] != area[b, i] or volume[b + 1, i] != volume[b, i]
    for i in range(M):
        s[NODE + i] = 1.0 / (k0 + s[WALL + i] + s[HEAT + i] * immediate)
        s[CELL + i] = 1.0 / (k1 + s[DRAG + i] * immediate + rho * steady[b, i])
    return moves


@inner
def end_loads(dt, k0, immediate, ends, load, s, port):
    """Inverse mass and resistance of the openings, and their implicit parts; load 0: pressure 0."""
    for e in range(2):
        at = ends[e]
        if at >= 0:
            s[NODE + at] = 0.0
            if load[0] > 0.0:
                area = s[A + at - 1]
                port[e, 0], port[e, 1] = math.sqrt(area) / load[0], area / load[1]
                extra = (port[e, 1] + 0.5 * dt * port[e, 0]) * s[IV + at]
                s[NODE + at] = 1.0 / (k0 + s[WALL + at] + s[HEAT + at] * immediate + extra)


@inner
def shape_within(f, b, area, volume, s):
    """Areas and inverse volumes at the fraction f of block b."""
    for i in range(area.shape[1]):
        s[A + i] = area[b, i] + f * (area[b + 1, i] - area[b, i])
        s[IV + i] = 1.0 / (volume[b, i] + f * (volume[b + 1, i] - volume[b, i]))


@inner
def known(i, k0, mass, stiff, s):
    """Known part of the continuity equation: pressure before, walls, heat, and flow of the cells."""
    j = max(i - 1, 0)
    before = s[A + j] * s[U + j] if i > 0 else 0.0
    heat = (s[R + i] + s[R + STRIDE + i]) + (s[R + 2 * STRIDE + i] + s[R + 3 * STRIDE + i])
    walls = s[WALL + i] * (mass * s[Z + i] - stiff * s[Y + i])
    flow = (s[A + i] * s[U + i] - before) * s[IV + i]
    return k0 * s[P + i] + s[HEAT + i] * heat - walls - flow


@inner
def node_step(M, dt, k0, mass, stiff, zw, decay, gain, s):
    """Pressures and walls after a step; the walls and the memory follow the pressure in its middle."""
    d0, d1, d2, d3 = decay[0], decay[1], decay[2], decay[3]
    g0, g1, g2, g3 = gain[0], gain[1], gain[2], gain[3]
    inverse = 1.0 / zw
    for i in range(M):
        r0, r1 = s[R + i], s[R + STRIDE + i]
        r2, r3 = s[R + 2 * STRIDE + i], s[R + 3 * STRIDE + i]
        z, y, p = s[Z + i], s[Y + i], s[P + i]
        walls = mass * z - stiff * y
        before = s[A - 1 + i] * s[U - 1 + i]  # 0 where i = 0: the end of a row is not used
        flow = (s[A + i] * s[U + i] - before) * s[IV + i]
        middle = k0 * p + s[HEAT + i] * ((r0 + r1) + (r2 + r3)) - s[WALL + i] * walls
        middle = (middle - flow + s[PUSH + i]) * s[NODE + i]
        velocity = (middle + walls) * inverse
        s[P + i] = 2.0 * middle - p
        s[Z + i] = 2.0 * velocity - z
        s[Y + i] = y + dt * velocity
        s[R + i] = d0 * r0 + g0 * middle
        s[R + STRIDE + i] = d1 * r1 + g1 * middle
        s[R + 2 * STRIDE + i] = d2 * r2 + g2 * middle
        s[R + 3 * STRIDE + i] = d3 * r3 + g3 * middle


@inner
def cell_step(M, k1, decay, gain, s):
    """Velocities after a step; cells without inverse length are closed."""
    d0, d1, d2, d3 = decay[0], decay[1], decay[2], decay[3]
    g0, g1, g2, g3 = gain[0], gain[1], gain[2], gain[3]
    for i in range(M):
        q0, q1 = s[Q + i], s[Q + STRIDE + i]
        q2, q3 = s[Q + 2 * STRIDE + i], s[Q + 3 * STRIDE + i]
        u = s[U + i]
        middle = k1 * u - s[IH + i] * (s[P + 1 + i] - s[P + i])
        middle = (middle + s[DRAG + i] * ((q0 + q1) + (q2 + q3)) + s[BLOW + i]) * s[CELL + i]
        s[U + i] = 2.0 * middle - u
        s[Q + i] = d0 * q0 + g0 * middle
        s[Q + STRIDE + i] = d1 * q1 + g1 * middle
        s[Q + 2 * STRIDE + i] = d2 * q2 + g2 * middle
        s[Q + 3 * STRIDE + i] = d3 * q3 + g3 * middle


@inner
def join(branch, nose, k0, mass, stiff, s):
    """Give the first node of the nose and the node where it branches the same pressure."""
    one, two = known(branch, k0, mass, stiff, s), known(nose, k0, mass, stiff, s)
    v0, v1 = 1.0 / s[IV + branch], 1.0 / s[IV + nose]
    sums = v0 / s[NODE + branch] + v1 / s[NODE + nose]
    joined = (one * v0 + two * v1) / sums
    s[PUSH + branch] = joined / s[NODE + branch] - one
    s[PUSH + nose] = joined / s[NODE + nose] - two


@inner
def jets(dt, air, turbulence, jet, last, unit, base, s, w):
    """Noise behind the narrowest cell; jets there and at the lips lose loss/2 rho u |u|."""
    rho, _, mu = air
    at, loss = int(jet[0]), jet[1]
    w[0] += min(1.0, dt * turbulence[2]) * (s[A + at] * s[U + at] - w[0])
    behind = min(at + 1, last)
    noise = unit * hiss(turbulence[0], turbulence[1], w[0], s[A + at], rho, mu)
    s[BLOW + behind] = noise * s[IH + behind]
    u = abs(s[U + at])
    s[CELL + at] = base[0] / (1.0 + 0.5 * rho * loss * u * s[IH + at] * base[0])
    if at != last:
        u = abs(s[U + last])
        s[CELL + last] = base[1] / (1.0 + 0.5 * rho * u * s[IH + last] * base[1])


@bare_kernel
def advance(
    dt, first, block, air, wall, losses, s, port, w, motion, grid, load, ends, branch, folds,
    turbulence, given, noise, hold, out,
):  # fmt: skip
    """Advance the waves in a tube.

    Parameters
    ----------
    dt, first, block : step [s]; number of the first step; steps between the instants of the grid.
    air, wall : (rho, c, mu); (mass, damping, stiffness, factor, heat loss) of the walls per area.
    losses : immediate, decay, gain of the losses that increase with sqrt(s): sum of their immediate
        parts, and (TERMS,) decay and gain per step of the delayed ones.
    s : (ROWS * STRIDE,) state and coefficients, in rows.
    port : (2, 3) of both openings: inverse mass and resistance of the air before them, and its momentum
        per area, which remains when the opening changes.
    w, motion : filtered flow of the jet, flow of the glottis (2,); x1, v1, x2, v2 of the folds (4,).
    grid : area, volume (blocks + 1, M) of cells [m^2] and nodes [m^3]; inverse cell length, friction
        rate and that of steady flow, wall surface per volume (blocks, M); jet (blocks, 2) cell with the
        narrowest area and its loss factor.
    load : mass times the root of the area and resistance times the area of an opening; 0: pressure 0.
    ends, branch : nodes of the openings, -1: none; node of the branch, or -1.
    folds : (0,) or parameters of the folds, see `emgface.acoustics.sources.Folds`.
    turbulence : gain [Pa], critical Reynolds number, rate of the filter of the flow [1/s].
    given : (3, n) flow into the tube [m^3/s] where there are no folds; lung pressure [Pa]; area of the
        glottis at rest [m^2].
    noise, hold : (2, k) unit noise at the glottis and behind the jet, linear between samples of `hold`
        steps, of which the first is that of step 0.
    out : (5, all) flow out of mouth and nose, into the tract [m^3/s]; pressure behind the glottis [Pa];
        smallest area of the glottis [m^2]; written.
    """
    rho, c, _ = air
    immediate, decay, gain = losses
    area, volume, _, _, _, _, jet = grid
    M = area.shape[1]
    base = (0.0, 0.0)
    k0, k1 = 2.0 / (dt * rho * c * c), 2.0 * rho / dt
    mass, stiff = 2.0 * wall[0] / dt, wall[2]
    zw = mass + wall[1] + 0.5 * dt * wall[2]
    if M >= STRIDE or s.size < ROWS * STRIDE:
        return
    moves, last = False, ends[0] - 1
    b, within, k, offset = 0, 0, first // hold, first % hold  # counted, since divisions are slow
    for n in range(given.shape[1]):
        if within == 0:
            moves = block_coefficients(b, k0, k1, zw, rho, immediate, (wall[3], wall[4]), grid, s)
            end_loads(dt, k0, immediate, ends, load, s, port)
            base = (s[CELL + int(jet[b, 0])], s[CELL + last])
        if moves and within % SHAPE_STEPS == 0:
            shape_within((within + 0.5 * SHAPE_STEPS) / block, b, area, volume, s)
            end_loads(dt, k0, immediate, ends, load, s, port)
        part = offset / hold
        hiss0 = noise[0, k] + part * (noise[0, k + 1] - noise[0, k])
        hiss1 = noise[1, k] + part * (noise[1, k + 1] - noise[1, k])
        if branch >= 0:
            join(branch, ends[0] + 1, k0, mass, stiff, s)
        flow, opening = given[0, n], 0.0
        if folds.size > 0:
            flow, opening = glottis(
                dt, air, folds, given[2, n], motion, w, given[1, n], hiss0, turbulence,
                known(0, k0, mass, stiff, s) * s[NODE], s[IV] * s[NODE], s[A],
            )  # fmt: skip
        s[PUSH] = flow * s[IV]
        for e in range(2):
            if ends[e] >= 0:
                s[PUSH + ends[e]] -= port[e, 2] * port[e, 0] * s[IV + ends[e]]
        p0 = s[P]
        before = (s[P + ends[0]], s[P + max(ends[1], 0)])
        node_step(M, dt, k0, mass, stiff, zw, decay, gain, s)
        for e in range(2):
            at = ends[e]
            if at >= 0:
                s[PUSH + at] = 0.0
            if at >= 0 and load[0] == 0.0:
                out[e, first + n] = s[A + at - 1] * s[U + at - 1]
            elif at >= 0:
                p = 0.5 * (before[e] + s[P + at])
                middle = port[e, 2] + 0.5 * dt * p
                out[e, first + n] = p * port[e, 1] + middle * port[e, 0]
                port[e, 2] += dt * p
        out[2, first + n], out[3, first + n], out[4, first + n] = flow, 0.5 * (p0 + s[P]), opening
        jets(dt, air, turbulence, jet[b], last, hiss1, base, s, w)
        cell_step(M, k1, decay, gain, s)
        within, offset = within + 1, offset + 1
        if within == block:
            b, within = b + 1, 0
        if offset == hold:
            k, offset = k + 1, 0


@kernel
def scatter(reflection, glottis, lips, inflow, out):
    """Kelly-Lochbaum: forward and backward waves of flow, delayed by one sample per section.

    `reflection` (sections - 1,) is (S_i - S_i+1)/(S_i + S_i+1), of waves of flow that travel forwards;
    `glottis` and `lips` reflect them at the ends. `inflow` (n,) is the flow into the tube, `out` (n,)
    that out of the lips, which is written.
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
