"""Rows of extreme motions: time steps, jumps, invalid initial states, gravity and rotation, rest."""

from collections.abc import Callable, Iterator

import numpy as np

import sim
from benchmarks.integrators import EXPLICIT, IMPLICIT, STATIC
from benchmarks.stability.bodies import MODERATE, SIZE, Block, driven
from benchmarks.stability.material_rows import STEP, both
from benchmarks.stability.trial import Judge, Trial, stays

FREE_FALL = 1e-4  #: error of the velocity for a tolerance of 1e-6 m in steps of 10 ms [m/s]
STRAIN = 3.0 * 1e-6 / (SIZE / 3.0)
"""Change of volume for an error of 1e-6 m in the length of an edge [1]."""
KICK = 0.05  #: initial speed of the free end of an oscillating block [m/s]
TURNING = "gravity x 10, reversed; free fall; rigid rotation"
NOTHING = driven((0.0, 0.0), 0.1)


def time_steps() -> Iterator[Trial]:
    """Row 3: steps from 0.1 to 100 ms, explicit integrators too."""
    title = "time step 0.1 ... 100 ms"
    for milli in (0.1, 1, 10, 100):
        yield Trial(
            3, title, f"{milli:g} ms", Block().system, driven(MODERATE, 0.1),
            0.02 if milli < 1 else 0.2, sim.HalvingStep(milli * 1e-3), IMPLICIT | EXPLICIT,
            "time step [ms]", milli,
        )  # fmt: skip
    undamped = Block(damped=False)
    for milli in (0.05, 0.1, 0.2, 0.5, 1.0):
        yield Trial(
            3, title, f"{milli:g} ms, no damping", undamped.system, driven(MODERATE, 0.1), 0.05,
            sim.HalvingStep(milli * 1e-3), dict(EXPLICIT), "time step [ms], undamped", milli,
        )  # fmt: skip


def jumps() -> Iterator[Trial]:
    """Row 4: all muscles from 0 to 1 in a single step."""
    title = "all muscles 0 to 1 in one step"
    for kilo in (100, 300, 600, 1000):
        block = Block(sigma_max=kilo * 1e3)
        case, parameter = f"block, {kilo} kPa", "sigma_max [kPa], block"
        yield from both(4, title, case, block, parameter, kilo, full=True)


def bad_starts() -> Iterator[Trial]:
    """Row 5: start from a distorted, then from an inverted configuration."""

    def noisy(amplitude: float) -> Callable[[sim.System], sim.State]:
        def start(system: sim.System) -> sim.State:
            rest = system.rest_state()
            q = rest.q.copy()
            moved = np.random.default_rng(0).normal(size=q.shape) * amplitude * SIZE / 3.0
            q.reshape(-1)[system.free] += moved.reshape(-1)[system.free]
            return sim.State(0.0, q, rest.v)

        return start

    for amplitude in (0.1, 0.15, 1.0):
        inverted = amplitude == 1.0
        case = f"nodes moved by {amplitude:g} edges" + (", inverted" if inverted else "")
        yield Trial(
            5, "start from a distorted or inverted configuration", case, Block().system, NOTHING,
            0.2, STEP, IMPLICIT | STATIC, "noise of the start [edges]", amplitude,
            noisy(amplitude), refusal="InvertedElement" if inverted else "",
        )  # fmt: skip


def gravity_and_rotation() -> Iterator[Trial]:
    """Row 6: gravity x 10 and reversed, and free fall; the 1000 turns are computed by `turned`."""
    for name, g in (("x 10", -98.0), ("reversed", 9.8), ("x 10, reversed", 98.0)):
        system = Block(gravity=g).system
        yield Trial(
            6, TURNING, name, system, NOTHING, 0.5, STEP, IMPLICIT | STATIC,
            "gravity [m/s^2]", g,
        )  # fmt: skip

    def falling(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        momentum = (system.node_mass @ end.v)[2] / system.node_mass.sum()
        if abs(momentum + 9.8 * end.t) > FREE_FALL:
            return f"velocity {momentum:.9g} m/s, expected {-9.8 * end.t:.9g}"
        least = system.smallest_J(end.q)[0]
        return "" if abs(least - 1.0) < STRAIN else f"it is strained: smallest J {least:.9g}"

    free = Block(fixed=False, damped=False)
    yield Trial(6, TURNING, "free fall", free.system, NOTHING, 0.2, STEP, judge=falling)
    yield Trial(
        6, TURNING, "free fall, explicit", free.system, NOTHING, 0.01, sim.FixedStep(1e-4),
        dict(EXPLICIT), judge=falling,
    )  # fmt: skip


def turned(turns: int) -> str:
    """Error of the forces of a body rotated in steps of a degree, or "".

    The element loop depends only on positions, so that a thousand turns are successive rotations.
    """
    system = Block(fixed=False, gravity=0.0).system()
    X, angle = system.scene.mesh.X, np.deg2rad(1.0)
    c, s = np.cos(angle), np.sin(angle)
    step = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    control, q, worst = system.control(np.zeros(2)), X - X.mean(axis=0), 0.0
    scale = float(np.abs(system.tangent(X, control)[1]).max()) * SIZE
    for k in range(360 * turns):
        q = q @ step.T
        if k % 3600 == 0 or k == 360 * turns - 1:
            worst = max(worst, float(np.abs(system.force(q, control).f).max()) / scale)
    return "" if worst < 1e-9 else f"force {worst:.1e} of that of a strain of 1"


def quiet() -> Iterator[Trial]:
    """Row 11: ten seconds without activation, at equilibrium and with energy that must not increase."""
    title = "10 s without activation"

    def settled(system: sim.System) -> sim.State:
        rest = system.rest_state()
        control = system.control(np.zeros(2))
        static = sim.Static(tolerance=1e-12, residual_tolerance=1e-11)
        state, _ = static.step(system, rest, control, 1.0, sim.Workspace(system))
        return sim.State(0.0, state.q, rest.v)

    def decays(most: float) -> Judge:
        def judge(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
            growth = float((energy - energy[0]).max() / np.abs(energy).max())
            return "" if growth < most else f"energy grew by {growth:.1e} of its size"

        return judge

    slow = sim.HalvingStep(0.05)
    yield Trial(11, title, "stays at equilibrium", Block().system, NOTHING, 10.0, slow,
                IMPLICIT | STATIC, start=settled, judge=stays)  # fmt: skip
    yield Trial(11, title, "energy never grows", Block().system, NOTHING, 10.0, slow,
                judge=decays(1e-9))  # fmt: skip
    # Without damping, the energy of a symplectic scheme oscillates about a constant.
    swinging = Block(damped=False, gravity=0.0)

    def kicked(system: sim.System) -> sim.State:
        rest = system.rest_state()
        v = np.zeros_like(rest.v)
        v[:, 0] = KICK * rest.q[:, 2] / SIZE
        return sim.State(0.0, rest.q, v)

    yield Trial(11, title, "undamped, 1 s in steps of 0.1 ms", swinging.system, NOTHING, 1.0,
                sim.FixedStep(1e-4), dict(EXPLICIT), start=kicked, judge=decays(0.05))  # fmt: skip
