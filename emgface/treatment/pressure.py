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
RISE: Final = 0.2  #: largest step of the share of these activations [1]
STEP: Final = 200.0
"""Largest step of the pressure [Pa]. A pressure of 800 Pa is that of stop consonants in the published
model."""
HIGHEST: Final = 12000.0  #: pressure at which the search ends [Pa]
TURNS: Final = 2
"""Equilibria at a pressure: along the normals before the step, and along those of the first."""
HALVINGS: Final = 6  #: largest number of successive halvings of a step without an equilibrium
FAILED: Final = (
    sim.InvertedElement, sim.NotConverged, sim.SingularSystem, sim.ContactFailure,
)  # fmt: skip
LIPS: Final = 0  #: index of the pairing of both lips in the contact of a face


@dataclass(frozen=True)
class PressureHeld:
    """Largest pressure [Pa] that lips hold, and the step with which it was sought [Pa].

    `force` [N] is that of the lips on each other without pressure. `closed` is False if it is 0 (the
    lips are apart, and the pressure is 0), and `parted` is False if the lips still press on each other
    at the highest pressure, which is then a lower bound.
    """

    pressure: float
    step: float
    force: float
    closed: bool
    parted: bool


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
        except FAILED:
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
        return float(self._system.contact.pressed(self.state.memory)[LIPS])


def pressure_held(
    face: xr.Dataset,
    parameters: SimulationParameters,
    *,
    settled: xr.Dataset | None = None,
    step: float = STEP,
    highest: float = HIGHEST,
) -> PressureHeld:
    """Find the pressure in the mouth at which closed lips part.

    The lips are closed by `CLOSING` on both sides. The pressure acts on the free inner surface of lips
    and cheeks, along its current normals (`TURNS`), and rises by `step`; after every step the tissue is
    in equilibrium with contact. The lips part where they no longer press on each other: their contact
    force, which falls with the pressure, vanishes. The line through its last two positive values gives
    the pressure within the step. A step without an equilibrium is halved, up to `HALVINGS` times.

    Air escapes at the first place without contact, at a pressure that is not larger; a mesh whose
    elements are as long as the lips are high does not resolve this place. `settled` is the face at rest
    under gravity.

    Raises FaceError if the simulation is without contact of the lips, the face has no free inner surface
    or no mouth, or an equilibrium is not found, with the pressure that was reached.
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
    share = 0.0
    while share < 1.0:
        share, _, error = _risen(lips, lips.closed_to, share, min(share + RISE, 1.0))
        if error is not None:
            raise FaceError(
                f"the closed lips find no equilibrium above {100 * share:.0f} % of the activation "
                f"({error}): choose a smaller sigma_max"
            ) from error
    force = lips.force
    if force == 0.0:
        return PressureHeld(0.0, step, force, closed=False, parted=True)
    course = [(0.0, force)]
    while course[-1][0] < highest:
        reached = course[-1][0]
        _, more, error = _risen(lips, lips.pressed_to, reached, min(reached + step, highest))
        course += more
        if course[-1][1] == 0.0:
            return PressureHeld(_vanishing(course), step, force, closed=True, parted=True)
        if error is not None:
            raise FaceError(
                f"the lips hold {course[-1][0]:g} Pa, and no equilibrium was found above ({error}): "
                "choose a smaller sigma_max or another face"
            ) from error
    return PressureHeld(highest, step, force, closed=True, parted=False)


def _risen(
    lips: _Lips, to: Callable[[float], None], start: float, end: float
) -> tuple[float, list[tuple[float, float]], Exception | None]:
    """Raise a load from `start` to `end`, in steps that are halved without an equilibrium.

    Returns the load that was reached, the loads on the way with the forces between the lips [N], and
    the failure of the shortest step, if any. It ends where the lips part.
    """
    course: list[tuple[float, float]] = []
    reached, length = start, end - start
    while reached < end:
        aim = min(reached + length, end)
        try:
            to(aim)
        except FAILED as error:
            length *= 0.5
            if length < 0.99 * (end - start) / 2**HALVINGS:
                return reached, course, error
            continue
        reached = aim
        course.append((aim, lips.force))
    return reached, course, None


def _vanishing(course: list[tuple[float, float]]) -> float:
    """Pressure at which the force vanishes, from the last two pressures with one.

    The line through them is extended up to the first pressure without a force.
    """
    (p1, f1), (end, _) = course[-2], course[-1]
    if len(course) < 3 or course[-3][1] <= f1:
        return 0.5 * (p1 + end)
    p0, f0 = course[-3]
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
