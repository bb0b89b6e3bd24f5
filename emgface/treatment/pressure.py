"""Pressure in the mouth that closed lips hold before they part, by equilibria under its rise."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.contact import touching
from emgface.face.lip_shape import lip_rim
from emgface.face.motion import require_rest, settle_face
from emgface.face.parts import FREE, INNER
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.surface import faces_among

Floats = NDArray[np.float64]

CLOSING: Final = {"OOM": 0.5, "OOP": 0.5}  #: activations [1] that press the lips together
FIRST_PRESSURE_STEP: Final = 400.0
"""First step of the pressure [Pa], and width of the interval in which the lips part.

A pressure of 800 Pa is that of stop consonants in the published model.
"""
HIGHEST_PRESSURE: Final = 12000.0  #: pressure at which the search ends [Pa]
TURNS: Final = 2
"""Equilibria at a pressure: along the normals before the step, and along those of the first."""
PRESSURE_FAILURES: Final = (
    sim.InvertedElement, sim.NotConverged, sim.SingularSystem, sim.ContactFailure,
)  # fmt: skip
LIP_PAIRING: Final = 0  #: index of the pairing of both lips in the contact of a face


@dataclass(frozen=True)
class LoadSteps:
    """Steps of a load that rises: the first, the longest, and that below which none is tried.

    A step doubles the next one; one without an equilibrium, or to another one, is divided by `DIVISOR`,
    and no later one is longer than half of it.
    """

    first: float
    longest: float
    shortest: float


DIVISOR: Final = 4.0
CLOSING_STEPS: Final = LoadSteps(0.1, 0.2, 0.002)  #: of the share of the activations `CLOSING` [1]
LONGEST_PRESSURE_STEP: Final = 4.0  #: longest step of the pressure, relative to the first
SLID: Final = 1.5  #: relative length of a step above which one with a rise of the force is divided
SLIDE: Final = 0.05
"""Rise of the force after a fall, relative to that without load, that is a slide of the lips."""
SHORTEST_PRESSURE_STEP: Final = 0.125  #: relative length below which no step is tried


@dataclass(frozen=True)
class PressureHeld:
    """Largest pressure [Pa] that lips hold, and the width of the interval in which they part [Pa].

    `force` [N] is that of the lips on each other without pressure. `closed` is False if it is 0 (the
    lips are apart, and the pressure is 0). `parted` is False if the lips still press on each other at
    this pressure, which is then a lower bound, and `reason` states why the search ended there.
    """

    pressure: float
    step: float
    force: float
    closed: bool
    parted: bool
    reason: str = ""

    @property
    def at_least(self) -> bool:
        """True if the lips hold this pressure or more."""
        return not self.parted


class _Lips:
    """Equilibria of a face with closed lips, under a share of `CLOSING` and a pressure."""

    def __init__(
        self, face: xr.Dataset, parameters: SimulationParameters, rest: xr.Dataset
    ) -> None:
        self._scene = replace(compose_scene(face, parameters), damping=None)
        self._faces = _lining(face)
        self._nodes = np.unique(self._faces)
        self._system = system = sim.compile_scene(self._scene)
        self._full = np.array(
            [CLOSING.get(str(name).rpartition("_")[0], 0.0) for name in system.muscles]
        )
        self.state = replace(system.rest_state(), q=rest["node_position"].values)

    def closed_to(self, share: float) -> None:
        """Equilibrium at a share of the activations, without pressure."""
        self._moved(self._system, share)

    def pressed_to(self, pressure: float) -> None:
        """Equilibrium under a pressure [Pa] whose normals follow the surface."""
        start = self.state
        try:
            for _ in range(TURNS):
                force = pressure_forces(self.state.q, self._faces, pressure)
                load = sim.NodeLoad(self._nodes, force[self._nodes])
                scene = replace(self._scene, terms=(*self._scene.terms, load))
                self._moved(sim.compile_scene(scene), 1.0)
        except PRESSURE_FAILURES:
            self.state = start
            raise

    def _moved(self, system: sim.System, share: float) -> None:
        before = replace(system.rest_state(), q=self.state.q, memory=self.state.memory)
        control, work = system.control(share * self._full), sim.Workspace(system)
        self.state, _ = sim.Static().step(system, before, control, 1.0, work)

    @property
    def force(self) -> float:
        """Normal force of the lips on each other [N]."""
        assert self._system.contact is not None  # `pressure_held` requires it
        return float(self._system.contact.normal_forces(self.state.memory)[LIP_PAIRING])


def pressure_held(
    face: xr.Dataset,
    parameters: SimulationParameters,
    *,
    settled: xr.Dataset | None = None,
    step: float = FIRST_PRESSURE_STEP,
    highest: float = HIGHEST_PRESSURE,
) -> PressureHeld:
    """Find the pressure in the mouth at which closed lips part.

    The lips are closed by `CLOSING` on both sides. The pressure acts on the free inner surface of lips
    and cheeks, along its current normals (`TURNS`); at every pressure the tissue is in equilibrium with
    contact. The lips part where they no longer press on each other: their contact force, which falls
    with the pressure, vanishes. Steps from `step` to `LONGEST_PRESSURE_STEP` times that bracket
    this pressure, and the interval is bisected, from the last equilibrium with a force, until it is
    as short as `step`. The line through the last two positive forces gives the pressure within it.
    A step in which the force rises is divided if it is longer than `SLID` times `step`, or if the
    force fell before and the rise is larger than `SLIDE` of that without pressure: it has passed to
    another equilibrium, with lips that have slid across each other, and not along those of the
    rising pressure.

    If no such equilibrium is found above a pressure, or at `highest`, it is a lower bound. Air escapes
    at the first place without contact, at a pressure that is not larger; a mesh whose elements are as
    long as the lips are high does not resolve this place. `settled` is the face at rest under gravity.

    Raises FaceError if the simulation is without contact of the lips, the face has no free inner surface
    or no mouth, or the lips find no equilibrium under the activations alone.
    """
    p = parameters
    if settled is not None:
        require_rest(settled, face, p)
    lip_rim(face)  # which refuses a face without a mouth
    if "lips" not in touching(face, p):
        raise FaceError(
            "the simulation is without contact of the lips, in which they hold no pressure: expected "
            "contact"
        )
    lips = _Lips(face, p, settle_face(face, p) if settled is None else settled)
    rise = _risen(lips, lips.closed_to, 1.0, CLOSING_STEPS, parting=False)
    if rise.failure is not None:
        raise FaceError(
            f"the closed lips find no equilibrium above {100 * rise.reached:.0f} % of the activation "
            f"({rise.failure}): choose a smaller sigma_max"
        ) from rise.failure
    force = lips.force
    if force == 0.0:
        return PressureHeld(0.0, 0.0, force, closed=False, parted=True)
    steps = LoadSteps(step, LONGEST_PRESSURE_STEP * step, SHORTEST_PRESSURE_STEP * step)
    rise = _risen(lips, lips.pressed_to, highest, steps, parting=True)
    course = ((0.0, force), *rise.course)
    if rise.parted < np.inf:
        width = rise.parted - rise.reached
        return PressureHeld(_vanishing(course, rise.parted), width, force, closed=True, parted=True)
    reason = (
        f"the lips were still closed at {highest:g} Pa, the highest pressure that was tried"
        if rise.failure is None
        else f"the lips were still closed at {rise.reached:g} Pa, and no equilibrium was found above "
        f"({rise.failure})"
    )
    return PressureHeld(rise.reached, 0.0, force, closed=True, parted=False, reason=reason)


@dataclass(frozen=True)
class Rise:
    """Loads with the forces between the lips [N] on the way, and how it ended.

    `reached` is the largest load with an equilibrium at which the lips had not parted, `parted` the
    smallest at which they had (infinite if none), and `failure` that of the shortest step, if any.
    """

    course: tuple[tuple[float, float], ...]
    reached: float
    parted: float
    failure: Exception | None


def _risen(
    lips: _Lips, to: Callable[[float], None], end: float, steps: LoadSteps, *, parting: bool
) -> Rise:
    """Raise a load from 0 to `end`; with `parting`, find where the force between the lips vanishes.

    `to` leaves the state of the lips as it was if it fails.
    """
    course: list[tuple[float, float]] = []
    reached, parted, failure, fell = 0.0, np.inf, None, False
    pressed = force = lips.force
    length, longest = steps.first, steps.longest
    while reached < end and parted - reached > steps.first:
        aim = min(reached + length, end)
        if aim >= parted:
            aim = 0.5 * (reached + parted)
        before = lips.state
        try:
            to(aim)
        except PRESSURE_FAILURES as error:
            length, longest = (aim - reached) / DIVISOR, min(longest, 0.5 * (aim - reached))
            if length < steps.shortest:
                failure = error
                break
            continue
        if parting and lips.force == 0.0:
            lips.state, parted, length = before, aim, 0.5 * (aim - reached)
            continue
        long = aim - reached > SLID * steps.first
        slid = fell and lips.force - force > SLIDE * pressed
        if parting and lips.force > force and (slid or long):
            least = steps.first if long else 0.0
            length = max((aim - reached) / DIVISOR, least)
            longest = min(longest, max(0.5 * (aim - reached), least))
            if length < steps.shortest:
                failure = FaceError(
                    f"the lips slide across each other, and their force rises from {force:.2f} to "
                    f"{lips.force:.2f} N"
                )
            lips.state = before
            if failure is not None:
                break
            continue
        fell, force = lips.force < force, lips.force
        course.append((aim, force))
        length = min(2.0 * (aim - reached), longest)
        reached = aim
    return Rise(tuple(course), reached, parted, failure)


def _vanishing(course: tuple[tuple[float, float], ...], end: float) -> float:
    """Pressure at which the force vanishes: the line through its last two values, up to `end`."""
    p1, f1 = course[-1]
    if len(course) < 2 or course[-2][1] <= f1:
        return 0.5 * (p1 + end)
    p0, f0 = course[-2]
    return min(p1 + f1 * (p1 - p0) / (f0 - f1), end)


def _lining(face: xr.Dataset) -> NDArray[np.int64]:
    """Faces (n, 4) of the inner surface whose nodes are free, in outward order."""
    faces, _ = faces_among(face["connectivity"].values, sheet_nodes(face, INNER))
    free = faces[(face["fixed"].values[faces] == FREE).all(axis=1)]
    if not len(free):
        raise FaceError("no face of the inner surface is free, expected some for a pressure")
    return free.astype(np.int64)


def pressure_forces(q: Floats, faces: NDArray[np.int64], pressure: float) -> Floats:
    """Forces (nodes, 3) [N] of a pressure [Pa] on quadrilaterals, -p A n, a quarter on every corner."""
    corners = q[faces]
    area = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    force = np.zeros_like(q)
    for k in range(4):
        np.add.at(force, faces[:, k], -0.25 * pressure * area)
    return force
