"""Pressure in the mouth that closed lips hold before they part, by equilibria under its rise."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.motion import require_rest, settle_face
from emgface.face.mouth import Mouth
from emgface.face.parts import FREE, INNER
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.surface import faces_among

Floats = NDArray[np.float64]

CLOSING: Final = {"OOM": 0.5, "OOP": 0.5}  #: activations [1] that press the lips together
RISE: Final = 5  #: equilibria on the way to these activations
STEP: Final = 200.0
"""Step of the pressure [Pa]. A pressure of 800 Pa is that of stop consonants in the published model."""
HIGHEST: Final = 6000.0  #: pressure at which the search ends [Pa]
SEALED: Final = 2e-6
"""Opening without pressure up to which the lips count as closed [m^2]; small openings remain at the
corners, where the surfaces of both lips end."""
PARTED: Final = 1e-6  #: growth of the opening that counts as parting [m^2]
FAILED: Final = (sim.InvertedElement, sim.NotConverged, sim.SingularSystem)


@dataclass(frozen=True)
class PressureHeld:
    """Largest pressure [Pa] that lips hold, and the step with which it was sought [Pa].

    `closed` is False if the lips are open without pressure (the pressure is 0), and `parted` is False
    if they are still closed at `HIGHEST`, which is then a lower bound.
    """

    pressure: float
    step: float
    closed: bool
    parted: bool


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
    and cheeks, along its current normals, and rises by `step`; after every step the tissue is in
    equilibrium with contact. The normals are those before the step, so that the error is of the order
    of the step. The lips part where the opening (`emgface.face.mouth.Mouth`) has grown by `PARTED`;
    the pressure is interpolated within the last step. `settled` is the face at rest under gravity.

    Raises FaceError if the simulation has no contact, the face no free inner surface or no mouth, or an
    equilibrium is not found, with the pressure that was reached.
    """
    if parameters.contact.method == "none":
        raise FaceError(
            "the simulation is without contact, in which lips hold no pressure: expected contact"
        )
    p = parameters
    if settled is not None:
        require_rest(settled, face, p)
    mouth, faces = Mouth.of(face), _lining(face)
    rest = settle_face(face, p) if settled is None else settled
    scene = replace(compose_scene(face, p), damping=None)
    system = sim.compile_scene(scene)
    full = np.array([CLOSING.get(str(name).rpartition("_")[0], 0.0) for name in system.muscles])
    state = replace(system.rest_state(), q=rest["node_position"].values)
    work = sim.Workspace(system)
    for k in range(1, RISE + 1):
        try:
            control = system.control(k / RISE * full)
            state, _ = sim.Static().step(system, state, control, 1.0, work)
        except FAILED as error:
            raise FaceError(
                f"the closed lips find no equilibrium at {100 * k / RISE:.0f} % of the activation "
                f"({error}): choose a smaller sigma_max"
            ) from error
    q = state.q
    closed = mouth.measure(q)[0]
    if closed > SEALED:
        return PressureHeld(0.0, step, closed=False, parted=True)
    before = closed
    for pressure in np.arange(1, round(highest / step) + 1) * step:
        force = pressure_forces(q, faces, float(pressure))
        nodes = np.unique(faces)
        loaded = sim.compile_scene(
            replace(scene, terms=(*scene.terms, sim.NodeLoad(nodes, force[nodes])))
        )
        try:
            found, _ = sim.Static().step(
                loaded, replace(loaded.rest_state(), q=q), loaded.control(full), 1.0,
                sim.Workspace(loaded),
            )  # fmt: skip
        except FAILED as error:
            raise FaceError(
                f"the lips hold {pressure - step:g} Pa, and no equilibrium was found at {pressure:g} Pa "
                f"({error}): choose a smaller step or another face"
            ) from error
        q = found.q
        area = mouth.measure(q)[0]
        if area - closed >= PARTED:
            share = (closed + PARTED - before) / (area - before)
            return PressureHeld(
                float(pressure - step + share * step), step, closed=True, parted=True
            )
        before = area
    return PressureHeld(highest, step, closed=True, parted=False)


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
