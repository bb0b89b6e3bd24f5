"""Motions of a face at full order, from which a reduced face is trained."""

import time
from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr

from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.reduced.model import Floats, free_of_contact
from emgface.reduced.plan import TrainingDrive
from emgface.run.digest import dataset_digest, text_digest
from emgface.run.mechanics import MECHANICS
from emgface.run.store import Stage, Store
from sim import (
    Activation,
    ContactFailure,
    FixedStep,
    InvertedElement,
    LinearlyImplicitEuler,
    NotConverged,
    Positions,
    SingularSystem,
    State,
    System,
    Workspace,
    compile_scene,
    simulate,
)

SNAPSHOTS: Final = Stage(
    "snapshots", MECHANICS, without=("emgface.reduced", "sim.reduced", "sim._kernels.reduced")
)
"""Motions at full order do not depend on reduced models."""
TRAINING_STEP: Final = 0.01
"""Time step of training and reduced motions [s]."""
MECHANICAL: Final = (InvertedElement, NotConverged, SingularSystem, ContactFailure)
"""Failures that a weaker activation avoids."""
WEAKER_DRIVE: Final = 0.8
"""Factor on a drive of the plan after such a failure."""


def with_steps(parameters: SimulationParameters) -> SimulationParameters:
    """The same tissue, muscles and contact with the steps of the training, without renewals."""
    contact = parameters.contact.model_copy(update={"renewals": None})
    parameters = parameters.model_copy(update={"contact": contact})
    steps = {"step": TRAINING_STEP, "output": TRAINING_STEP}
    return parameters.as_accurate("published").model_copy(update=steps)


@dataclass(frozen=True, eq=False)
class FullOrder:
    """Full-order motions of a face at rest under gravity, for training and comparison.

    `tissue` is the system without contact.
    """

    face: xr.Dataset
    parameters: SimulationParameters
    system: System
    tissue: System
    rest: Floats

    @classmethod
    def from_face(
        cls, face: xr.Dataset, parameters: SimulationParameters, rest: Floats | None = None
    ) -> "FullOrder":
        """Compile the face and find its rest, unless it is given."""
        parameters = with_steps(parameters)
        system = compile_scene(compose_scene(face, parameters))
        tissue = compile_scene(compose_scene(face, free_of_contact(parameters)))
        if rest is not None:
            return cls(face, parameters, system, tissue, rest)
        start = settle_face(face, parameters)["node_position"].values
        return cls(face, parameters, system, tissue, start)

    def motion(self, drive: TrainingDrive, every: float) -> xr.Dataset:
        """Positions of nodes [m] at every snapshot, and of markers at every step, of one drive.

        A drive that inverts an element, or brings lips into contact whose distance at rest exceeds the
        reach of the contact, is repeated with a weaker activation; the attribute ``scale`` is its
        factor, and the result is empty (scale 0) if none of five succeeds.
        """
        scale = 1.0
        for _ in range(5):
            try:
                return self._motion(drive.scaled(scale), every).assign_attrs(scale=scale)
            except MECHANICAL:
                scale *= WEAKER_DRIVE
        return xr.Dataset(attrs={"scale": 0.0})

    def _motion(self, drive: TrainingDrive, every: float) -> xr.Dataset:
        stride = max(1, round(every / TRAINING_STEP))
        activation = Activation(drive.time, drive.values)
        work = Workspace(self.system, self.parameters.linear_solver)
        begun = time.process_time()
        moved, _ = simulate(
            self.system,
            activation,
            duration=float(drive.time[-1]),
            integrator=LinearlyImplicitEuler(),
            steps=FixedStep(TRAINING_STEP),
            probes=(Positions(),),
            initial=State(0.0, self.rest, np.zeros_like(self.rest)),
            work=work,
        )
        spent = time.process_time() - begun
        nodes = moved["node_position"].transpose("time", "node", "axis").values
        markers = nodes[:, self.face["marker_node"].values.astype(np.int64)]
        at = slice(stride, None, stride)
        levels = np.array([activation.at(t) for t in moved["time"].values[at]])
        return xr.Dataset(
            {
                "node_position": (("snapshot", "node", "axis"), nodes[at].astype(np.float32)),
                "activation": (("snapshot", "muscle"), levels),
                "marker_position": (("time", "marker", "axis"), markers),
            },
            attrs={"cost_s": spent},
        )


def stored_motion(
    store: Store, full: FullOrder, drive: TrainingDrive, every: float
) -> tuple[xr.Dataset, str]:
    """Motion of a drive and its digest, from the store if it is there."""
    parameters = full.parameters.model_dump(mode="json")
    values = text_digest(drive.values.tobytes().hex() + drive.time.tobytes().hex())
    result = store.get_or_compute(
        SNAPSHOTS,
        {"face": dataset_digest(full.face), "drive": values},
        {"simulation": parameters, "every": every},
        lambda: full.motion(drive, every),
        label=drive.label,
    )
    return result.dataset, result.digest
