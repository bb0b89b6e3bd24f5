"""Rows of the battery on a whole face."""

from collections.abc import Callable, Iterator

import numpy as np
import xarray as xr

import sim
from benchmarks.integrators import IMPLICIT, STATIC
from benchmarks.stability.trial import Judge, Trial, stays
from emgface.errors import FaceError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.lips import lip_surface
from emgface.face.parts import LIPS, arches_of
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.support import WALL

STEP = sim.HalvingStep(0.01)
OVERLAP = 5e-4  #: initial depth of the inner nodes behind their walls [m]
TOUCHING = {name: IMPLICIT[name] for name in ("linearly implicit Euler", "Euler", "SDIRK2")}
"""Integrators that support contact."""
DEPTH = 1e-4  #: largest accepted depth of a node in a surface [m]


def _system(face: xr.Dataset, **changes: object) -> Callable[[], sim.System]:
    values = {"gravity": False, "contact": NO_CONTACT} | changes
    return lambda: sim.compile_scene(
        compose_scene(face, SimulationParameters.model_validate(values))
    )


def _all(
    level: float, ramp: float, group: tuple[str, ...] = ()
) -> Callable[[sim.System], sim.Activation]:
    def activation(system: sim.System) -> sim.Activation:
        peak = np.array(
            [level if not group or name.startswith(group) else 0.0 for name in system.muscles]
        )
        return sim.Activation(np.array([0.0, ramp]), np.stack([0.0 * peak, peak]))

    return activation


def face_trials(face: xr.Dataset) -> list[Trial]:
    """Rows 3, 4, 9 and 11 on a face."""
    return [*_steps(face), *_jumps(face), *_pressed(face), *_rest(face)]


def _steps(face: xr.Dataset) -> Iterator[Trial]:
    for milli in (5, 10, 20, 50, 100):
        yield Trial(
            3, "time step 0.1 ... 100 ms", f"face, all muscles to 0.3 in 0.1 s, {milli} ms",
            _system(face, sigma_max=100e3), _all(0.3, 0.1), 0.2, sim.HalvingStep(milli * 1e-3),
            parameter="time step [ms], face", value=milli,
        )  # fmt: skip


def _jumps(face: xr.Dataset) -> Iterator[Trial]:
    for kilo in (10, 30, 100, 300, 600, 1000):
        yield Trial(
            4, "all muscles 0 to 1 in one step", f"face, {kilo} kPa",
            _system(face, sigma_max=kilo * 1e3, sigma_max_policy={"minimum": 1e3}),
            _all(1.0, 0.01), 0.1, STEP, parameter="sigma_max [kPa], face", value=kilo,
        )  # fmt: skip


def _pressed(face: xr.Dataset) -> Iterator[Trial]:
    """Lips pressed together by both parts of the orbicularis oris, with and without teeth behind."""
    title, ring = "lips pressed together, walls, overlap", _all(1.0, 0.1, ("OOP", "OOM"))
    for support in (0.0, WALL, 100.0 * WALL):
        behind = f"walls of {support:g} N/m" if support else "free"
        for kilo in (30, 100, 300):
            yield Trial(
                9, title, f"OOP + OOM to 1 in 0.1 s, {kilo} kPa, {behind}",
                _system(face, sigma_max=kilo * 1e3, support=support), ring, 0.3, STEP,
                IMPLICIT | STATIC, f"sigma_max [kPa], {behind}", kilo,
            )  # fmt: skip
    between = _surfaces(face)
    said = f"contact between {' and '.join(between)}"
    for kilo in (30, 100, 300) if between else ():
        yield Trial(
            9, title, f"OOP + OOM to 1 in 0.1 s, {kilo} kPa, {said}",
            _system(face, sigma_max=kilo * 1e3, contact={"between": between}),
            ring, 0.3, STEP, TOUCHING, f"sigma_max [kPa], {said}", kilo,
            judge=_apart(face, between),
        )  # fmt: skip
    for support in (WALL, 100.0 * WALL):
        yield Trial(
            9, title, f"start {1e3 * OVERLAP:g} mm inside walls of {support:g} N/m",
            _system(face, support=support), _all(0.0, 0.1), 0.3, STEP, IMPLICIT | STATIC,
            "stiffness of walls [N/m], start inside", support, _inside,
        )  # fmt: skip


def _surfaces(face: xr.Dataset) -> tuple[str, ...]:
    """Contact surfaces of a face: its lips, and its teeth if it has them."""
    try:
        for lip in LIPS:
            lip_surface(face, lip)
    except FaceError:
        return ()
    return ("lips", "teeth") if arches_of(face) else ("lips",)


def _apart(face: xr.Dataset, between: tuple[str, ...]) -> Judge:
    """Judge that no node is inside another surface, or in teeth deeper than the deepest node at rest."""

    def judge(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
        into = Penetration(face)
        depth = into.lips(end.q)
        if "teeth" in between:
            dent = max((deepest for _, deepest in into.at_rest().values()), default=0.0)
            depth = max(depth, into.teeth(end.q) - dent)
        return "" if depth < DEPTH else f"surfaces pass by {1e3 * depth:.2g} mm"

    return judge


def _inside(system: sim.System) -> sim.State:
    """State with every supported node behind its wall by OVERLAP and the rest of the tissue at rest."""
    walls = next(t for t in system.scene.terms if isinstance(t, sim.Support))
    rest = system.rest_state()
    q = rest.q.copy()
    q[walls.nodes] -= OVERLAP * walls.normal
    return sim.State(0.0, q, rest.v)


def _rest(face: xr.Dataset) -> Iterator[Trial]:
    yield Trial(
        11, "10 s without activation", "face without gravity stays at rest", _system(face),
        _all(0.0, 0.1), 10.0, sim.HalvingStep(0.1), IMPLICIT | STATIC, judge=stays,
    )  # fmt: skip
