"""Motion of the skin of a face in a trial, stored when the trial is simulated."""

from typing import Final

import xarray as xr

from emgface.face.motion import simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.body import skin_of
from emgface.pictures.surface import SurfaceProbe, frame_stride
from emgface.run.mechanics import HEAD_MECHANICS, MECHANICS
from emgface.run.store import Result, Stage
from emgface.study.laboratory import Setup

SKIN_STAGE: Final = Stage("skin", (*MECHANICS, __name__), without=("emgface.anatomy",))
SKIN_OF_HEAD: Final = Stage("skin", (*HEAD_MECHANICS, __name__))


class SkinMotions:
    """Simulations of a laboratory, which store the motions of skin and markers."""

    def __init__(self, laboratory: Setup) -> None:
        self._laboratory, self._probe = laboratory, SurfaceProbe(skin_of(laboratory.face).node)

    def simulate(
        self, activation: xr.DataArray, parameters: SimulationParameters, digest: str, label: str
    ) -> xr.Dataset:
        """Simulate a trial, store the motion of its skin and return that of its markers.

        `digest` is that of the activation; `label` identifies the trial in the index of the store.
        """
        moved = self._moved(activation, parameters)
        self._kept(parameters, digest, label, moved, self._stage(activation))
        return moved.drop_vars("surface_position")

    def motion(self, activation: xr.DataArray, sigma_max: float, digest: str, label: str) -> Result:
        """Return the motion of the skin at about 25 frames per second, simulated if not stored.

        `sigma_max` [Pa] is the value with which the trial was simulated. The result contains
        ``surface_position(time, surface_node, axis)`` [m] in single precision, stored to 0.01 mm,
        and ``position(time, marker, axis)`` [m].
        """
        study = self._laboratory.study.simulation
        return self._kept(
            study.model_copy(update={"sigma_max": sigma_max}),
            digest,
            label,
            activation,
            self._stage(activation),
        )

    def _stage(self, activation: xr.DataArray) -> Stage:
        return SKIN_STAGE if self._laboratory.head_of(activation) is None else SKIN_OF_HEAD

    def _moved(self, activation: xr.DataArray, parameters: SimulationParameters) -> xr.Dataset:
        head = self._laboratory.head_of(activation)
        if head is not None:
            from emgface.anatomy.head.recorded import trajectory_of_head

            return trajectory_of_head(head, activation, parameters, self._probe.node)
        return simulate_face(
            self._laboratory.face,
            activation,
            parameters,
            settled=self._laboratory.rest(parameters).dataset,
            further=(self._probe,),
        )

    def _kept(
        self,
        parameters: SimulationParameters,
        digest: str,
        label: str,
        given: xr.Dataset | xr.DataArray,
        stage: Stage,
    ) -> Result:
        """Store the skin of a motion, or of the motion caused by an activation."""
        every = frame_stride(parameters.output)

        def frames() -> xr.Dataset:
            moved = given
            if isinstance(moved, xr.DataArray):
                moved = self._moved(moved, parameters)
            chosen = moved[["surface_position", "position"]].isel(time=slice(None, None, every))
            chosen = chosen.transpose("time", "surface_node", "marker", "axis")
            chosen["surface_position"] = chosen["surface_position"].astype("f4")
            chosen["surface_position"].encoding = {"zlib": True, "least_significant_digit": 5}
            chosen.attrs = {"origin": "simulated", "sigma_max": parameters.sigma_max}
            return chosen

        return self._laboratory.store.get_or_compute(
            stage,
            {**self._laboratory.moved, "activation": digest},
            {
                **parameters.model_dump(mode="json"),
                "nodes": len(self._probe.node),
                "every": every,
            },
            frames,
            label=label,
        )
