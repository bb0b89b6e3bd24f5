"""The eleven rows of the battery, and the table that they make."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import fields

import numpy as np
import xarray as xr

import sim
from emgface.bench.stability.bodies import SIZE, Block, held_at
from emgface.bench.stability.face_rows import face_trials
from emgface.bench.stability.trial import (
    CONVERGED,
    EXPLICIT,
    IMPLICIT,
    Outcome,
    Trial,
    run,
)

Progress = Callable[[int, int], None]

MODERATE, FULL = (0.5, 0.2), (1.0, 1.0)
STEP = sim.HalvingStep(0.01)
FREE_FALL = 1e-4
"""Velocity that an iteration to 1e-6 m in steps of 10 ms may miss [m/s]."""
STRAIN = 3.0 * 1e-6 / (SIZE / 3.0)
"""Change of volume that an error of 1e-6 m in the length of an edge may mean [1]."""


def _driven(levels: tuple[float, float], ramp: float) -> Callable[[sim.System], sim.Activation]:
    return lambda system: held_at(levels, ramp)


def _block(block: Block) -> Callable[[], sim.System]:
    return block.system


def bulk_moduli() -> Iterator[Trial]:
    """Row 1: bulk modulus from 25 kPa to 250 MPa, with every volumetric part."""
    for volume in ("pointwise", "element", "nodal"):
        for factor in (1, 10, 100, 1000, 10000):
            block = Block(kappa=25e3 * factor, volume=volume, damped=True)
            title = "bulk modulus x 1 ... 1e4"
            yield Trial(
                1, title, f"{volume} x {factor}", block.system, _driven(MODERATE, 0.1), 0.2, STEP
            )
    yield Trial(1, title, "hard", Block(volume="hard").system, _driven(MODERATE, 0.1), 0.2, STEP)


def stiff_layers() -> Iterator[Trial]:
    """Row 2: one layer stiffer by up to 1e4, and softer."""
    for factor in (0.1, 10, 100, 1000, 10000):
        block = Block(stiff=factor)
        title = "one layer stiffer by 0.1 ... 1e4"
        yield Trial(2, title, f"x {factor:g}", block.system, _driven(MODERATE, 0.1), 0.2, STEP)


def time_steps() -> Iterator[Trial]:
    """Row 3: steps from 0.1 to 100 ms, explicit integrators too."""
    for milli in (0.1, 1, 10, 100):
        h = milli * 1e-3
        duration = 0.02 if milli < 1 else 0.2
        yield Trial(
            3,
            "time step 0.1 ... 100 ms",
            f"{milli:g} ms",
            Block().system,
            _driven(MODERATE, 0.1),
            duration,
            sim.HalvingStep(h),
            IMPLICIT | EXPLICIT,
        )
    undamped = Block(damped=False)
    for milli in (0.05, 0.1):
        yield Trial(
            3,
            "time step 0.1 ... 100 ms",
            f"{milli:g} ms, no damping",
            undamped.system,
            _driven(MODERATE, 0.1),
            0.01,
            sim.HalvingStep(milli * 1e-3),
            dict(EXPLICIT),
        )


def jumps() -> Iterator[Trial]:
    """Row 4: all muscles from 0 to 1 in a single step."""
    for kilo in (100, 300, 600, 1000):
        block = Block(sigma_max=kilo * 1e3)
        title = "all muscles 0 to 1 in one step"
        yield Trial(4, title, f"block, {kilo} kPa", block.system, _driven(FULL, 0.01), 0.2, STEP)


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
        yield Trial(
            5,
            "start from a distorted or inverted configuration",
            f"nodes moved by {amplitude:g} edges" + (", inverted" if inverted else ""),
            Block().system,
            _driven((0.0, 0.0), 0.1),
            0.2,
            STEP,
            start=noisy(amplitude),
            refusal="InvertedElement" if inverted else "",
        )


def gravity_and_rotation() -> Iterator[Trial]:
    """Row 6: gravity x 10 and reversed, free fall, 1000 turns of a rigid rotation."""
    title = "gravity x 10, reversed; free fall; rigid rotation"
    for name, g in (("x 10", -98.0), ("reversed", 9.8), ("x 10, reversed", 98.0)):
        yield Trial(6, title, name, Block(gravity=g).system, _driven((0.0, 0.0), 0.1), 0.5, STEP)

    def falling(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        momentum = (system.node_mass @ end.v)[2] / system.node_mass.sum()
        if abs(momentum + 9.8 * end.t) > FREE_FALL:
            return f"velocity {momentum:.9g} m/s, expected {-9.8 * end.t:.9g}"
        least = system.smallest_J(end.q)[0]
        return "" if abs(least - 1.0) < STRAIN else f"it is strained: smallest J {least:.9g}"

    free = Block(held=False, damped=False)
    yield Trial(
        6, title, "free fall", free.system, _driven((0.0, 0.0), 0.1), 0.2, STEP, judge=falling
    )
    yield Trial(
        6,
        title,
        "free fall, explicit",
        free.system,
        _driven((0.0, 0.0), 0.1),
        0.01,
        sim.FixedStep(1e-4),
        dict(EXPLICIT),
        judge=falling,
    )


def turned(turns: int) -> str:
    """Turn a body in steps of a degree; what is wrong with its forces, or "".

    The element loop sees only positions, so that a thousand turns are one rotation after the other.
    """
    system = Block(held=False, gravity=0.0).system()
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


def slivers() -> Iterator[Trial]:
    """Row 7: flat elements, scaled height down to 0.001."""
    for factor in (0.1, 0.02, 0.007, 0.001):
        block = Block(squeezed=factor)
        yield Trial(
            7,
            "sliver elements",
            f"height x {factor:g}",
            block.system,
            _driven(MODERATE, 0.1),
            0.2,
            STEP,
        )


def masses() -> Iterator[Trial]:
    """Row 8: mass ratio of the uppermost layer 1e-6 ... 1e6, without the load of its weight."""
    for factor in (1e-6, 1e-3, 1e3, 1e6):
        block = Block(dense=factor, gravity=0.0)
        yield Trial(
            8,
            "mass ratio 1e-6 ... 1e6",
            f"{factor:g}",
            block.system,
            _driven(MODERATE, 0.1),
            0.2,
            STEP,
        )


def bad_input() -> Iterator[Trial]:
    """Row 10: activations and muscles that cannot be."""
    title = "bad activation or muscle"
    for name, value in (
        ("NaN", np.nan),
        ("infinite", np.inf),
        ("negative", -0.1),
        ("above 1", 1.1),
    ):
        yield Trial(
            10,
            title,
            f"{name} activation",
            Block().system,
            _driven((value, 0.0), 0.1),
            0.1,
            STEP,
            {"Euler": IMPLICIT["Euler"]},
            refusal="ControlError",
        )

    def empty_muscle() -> sim.System:
        sim.Muscles(("none",), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)))
        raise AssertionError("a muscle without elements was accepted")

    def outside() -> sim.System:
        scene = Block().scene()
        line = sim.LineMuscles(
            ("out",), (sim.LineFibre(0, np.array([[1.0, 1.0, 1.0], [1.1, 1.0, 1.0]])),)
        )
        return sim.compile_scene(sim.Scene(scene.mesh, (*scene.terms, line), scene.reductions))

    for name, make, refusal in (
        ("muscle without elements", empty_muscle, "SceneError"),
        ("fibre outside the mesh", outside, "MeshError"),
    ):
        yield Trial(
            10, title, name, make, _driven((0.0, 0.0), 0.1), 0.1, STEP,
            {"Euler": IMPLICIT["Euler"]}, refusal=refusal,
        )  # fmt: skip


def quiet() -> Iterator[Trial]:
    """Row 11: nothing drives; ten seconds at equilibrium, and energy that never grows."""
    title = "10 s without activation"

    def settled(system: sim.System) -> sim.State:
        rest = system.rest_state()
        control = system.control(np.zeros(2))
        static = sim.Static(tolerance=1e-12, residual_tolerance=1e-11)
        state, _ = static.step(system, rest, control, 1.0, sim.Workspace(system))
        return sim.State(0.0, state.q, rest.v)

    def stays(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        moved = float(np.abs(end.q - start.q).max())
        return "" if moved < 1e-8 else f"it has moved by {moved:.1e} m"

    def decays(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        growth = float(np.diff(energy).max() / np.abs(energy).max())
        return "" if growth < 1e-9 else f"energy grew by {growth:.1e} of its size in one step"

    yield Trial(11, title, "stays at equilibrium", Block().system, _driven((0.0, 0.0), 0.1), 10.0,
                sim.HalvingStep(0.05), start=settled, judge=stays)  # fmt: skip
    yield Trial(11, title, "energy never grows", Block().system, _driven((0.0, 0.0), 0.1), 10.0,
                sim.HalvingStep(0.05), judge=decays)  # fmt: skip


BLOCK_ROWS = (
    bulk_moduli, stiff_layers, time_steps, jumps, bad_starts, gravity_and_rotation, slivers, masses,
    bad_input, quiet,
)  # fmt: skip
"""Rows on small bodies; a new one is a function here. Row 9 needs a face."""


def run_battery(
    face: xr.Dataset | None = None,
    *,
    rows: Sequence[int] | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run the battery.

    Parameters
    ----------
    face : Dataset, optional
        Face model for the rows on a whole face (4, 9 and 11); left out if absent.
    rows : sequence of int, optional
        Rows to run, all by default.
    progress : callable, optional
        Called as ``progress(done, total)``.

    Returns
    -------
    Dataset
        Dim ``run``: ``row``, ``title``, ``case``, ``integrator``, ``outcome`` ("ok",
        "refused: <error>" or "WRONG: <what>"), ``smallest_J``, ``iterations`` per output interval,
        ``rejected`` steps and ``energy_drift``, the largest growth of the energy in one interval over
        its size.
    """
    trials = [trial for make in BLOCK_ROWS for trial in make()]
    if face is not None:
        trials += face_trials(face)
    chosen = [t for t in trials if rows is None or t.row in rows]
    plan = [(trial, name) for trial in chosen for name in trial.integrators]
    outcomes: list[Outcome] = []
    for i, (trial, name) in enumerate(plan):
        outcomes.append(run(trial, name))
        if progress is not None:
            progress(i + 1, len(plan))
    if rows is None or 6 in rows:
        wrong = turned(1000)
        outcomes.append(
            Outcome(
                6,
                "gravity x 10, reversed; free fall; rigid rotation",
                "1000 turns",
                "-",
                f"WRONG: {wrong}" if wrong else "ok",
            )  # fmt: skip
        )
    outcomes.sort(key=lambda o: o.row)
    columns = {f.name: [getattr(o, f.name) for o in outcomes] for f in fields(Outcome)}
    return xr.Dataset(
        {
            name: ("run", np.array(values, dtype=object if isinstance(values[0], str) else None))
            for name, values in columns.items()
        },
        attrs={
            "origin": "simulated",
            "face": "" if face is None else str(face.attrs.get("name", "")),
            "converged": ", ".join(CONVERGED),
        },
    )
