"""Faces that advance step by step for a view: reduced, or at full order at their own pace."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.face.integration import integrator_of, steps_of
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.body import Skin
from emgface.reduced.live import LiveFace
from emgface.reduced.model import ReducedFace

Floats = NDArray[np.float64]

SMALLEST_J = "smallest_J"


@dataclass(frozen=True)
class Moved:
    """State of a face after a step.

    Attributes
    ----------
    skin, markers : arrays (n, 3) [m]
    bound : float
        Bound of the error of the reduction [m]; NaN at full order.
    distance : float
        Distance of the activation from those of the training [1]; NaN at full order.
    trusted : bool
        False if the activation, or its change, is outside the range of the training, or a step
        failed and the face was returned to rest.
    smallest_J : float
        Smallest volume ratio [1]; NaN for a reduced face.
    note : str
        Description of a failed step, otherwise empty.
    """

    skin: Floats
    markers: Floats
    bound: float
    distance: float
    trusted: bool
    smallest_J: float
    note: str = ""


class Moving(Protocol):
    """A face that takes steps of `step` seconds."""

    step: float
    muscles: tuple[str, ...]
    real_time: bool  #: True if a step takes less time than it simulates

    def __call__(self, activation: Floats) -> Moved:
        """Advance by one step with an activation (n_muscles,) [1]."""
        ...

    def reset(self) -> None:
        """Return to rest."""
        ...


class ReducedMoving:
    """Reduced face; a step that fails returns it to rest."""

    real_time = True

    def __init__(self, reduced: ReducedFace, skin: Skin, step: float) -> None:
        self.step, self.muscles = step, tuple(reduced.model.system.muscles)
        self._reduced, r = reduced, reduced.moving
        self._rest = reduced.rest[skin.node]
        modes = reduced.modes[skin.node][..., :r].reshape(-1, r)
        self._modes = np.ascontiguousarray(modes, dtype=np.float32)
        self.reset()

    def reset(self) -> None:
        """Return to rest."""
        self._face = LiveFace(self._reduced, self.step)

    def __call__(self, activation: Floats) -> Moved:
        """Advance by one step."""
        note = ""
        try:
            markers, bound, distance, trusted = self._face(activation)
        except (sim.InvertedElement, sim.SingularSystem, sim.NotConverged) as error:
            note = f"A step failed ({error}). The face was returned to rest."
            self.reset()
            markers, bound, distance, trusted = self._face(np.zeros(len(self.muscles)))
        y = self._face.coordinates.astype(np.float32)
        skin = self._rest + (self._modes @ y).reshape(-1, 3)
        return Moved(skin, markers, bound, distance, trusted and not note, np.nan, note)


class FullMoving:
    """Face at full order with the step control and solver of its parameters."""

    real_time = False

    def __init__(
        self, face: xr.Dataset, parameters: SimulationParameters, skin: Skin, step: float
    ) -> None:
        self.step = step
        self._face, self._parameters, self._skin = face, parameters, skin
        self._system = sim.compile_scene(compose_scene(face, parameters))
        self.muscles = tuple(self._system.muscles)
        self._markers = face["marker_node"].values.astype(np.int64)
        self._settled = settle_face(face, parameters)["node_position"].values
        self._work = sim.Workspace(self._system, parameters.linear_solver)
        self.reset()

    def reset(self) -> None:
        """Return to rest."""
        rest = self._system.rest_state()
        self._state = sim.State(0.0, np.ascontiguousarray(self._settled), rest.v, rest.memory)
        self._before = np.zeros(len(self.muscles))

    def __call__(self, activation: Floats) -> Moved:
        """Advance by one step; the activation rises linearly to the given one."""
        t, note, smallest = self._state.t, "", np.nan
        drive = sim.Activation(
            np.array([t, t + self.step]), np.stack([self._before, np.asarray(activation)])
        )
        try:
            with named_elements(self._face):
                outputs, self._state = sim.simulate(
                    self._system,
                    drive,
                    duration=self.step,
                    integrator=integrator_of(self._parameters),
                    steps=steps_of(self._face, self._parameters),
                    every=self.step,
                    probes=(sim.SmallestJ(),),
                    initial=self._state,
                    work=self._work,
                )
            smallest = float(outputs[SMALLEST_J].min())
            self._before = np.asarray(activation, dtype=np.float64)
        except sim.SimulationError as error:
            note = f"A step failed ({error}). The face was returned to rest."
            self.reset()
        q = self._state.q
        return Moved(q[self._skin.node], q[self._markers], np.nan, np.nan, not note, smallest, note)
