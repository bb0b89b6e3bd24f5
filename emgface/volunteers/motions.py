"""Motions of the face of a simulated volunteer, kept in a store."""

from collections.abc import Callable

import xarray as xr

from emgface.face.motion import of_rest, settle_face, simulate_face
from emgface.face.sigma_max import lower_sigma_max
from emgface.face.simulation_parameters import SimulationParameters
from emgface.run.digest import dataset_digest
from emgface.run.mechanics import MECHANICS
from emgface.run.store import Stage, Store

VOLUNTEER_REST = Stage("volunteer_rest", MECHANICS)
VOLUNTEER_MOTION = Stage("volunteer_motion", (*MECHANICS, "emgface.face.sigma_max"))


class Mover:
    """Simulator of the motions of one face, which are stored."""

    def __init__(
        self,
        store: Store,
        face: xr.Dataset,
        parameters: SimulationParameters,
        report: Callable[[str], None],
    ) -> None:
        self.face, self.parameters = face, parameters
        self._store, self._report, self._digest = store, report, dataset_digest(face)

    def rest(self, parameters: SimulationParameters) -> xr.Dataset:
        """Return the face at its equilibrium under gravity."""
        return self._store.get_or_compute(
            VOLUNTEER_REST,
            {"face": self._digest},
            of_rest(parameters),
            lambda: settle_face(self.face, parameters),
            label="rest",
        ).dataset

    def motion(self, activation: xr.DataArray, label: str) -> xr.Dataset:
        """Return the motion of the lip markers under an activation."""

        def once(parameters: SimulationParameters) -> xr.Dataset:
            rest = self.rest(parameters)
            return simulate_face(self.face, activation, parameters, settled=rest)

        def compute() -> xr.Dataset:
            return lower_sigma_max(once, self.parameters, report=self._report)

        inputs = {
            "face": self._digest,
            "activation": dataset_digest(activation.to_dataset(name="activation")),
        }
        parameters = self.parameters.model_dump(mode="json")
        return self._store.get_or_compute(
            VOLUNTEER_MOTION, inputs, parameters, compute, label=label
        ).dataset
