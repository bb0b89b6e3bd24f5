"""Motion of the skin of a face in a trial."""

from typing import Final

import numpy as np
import xarray as xr

from emgface.face.motion import simulate_face
from emgface.pictures.body import Skin
from emgface.pictures.surface import SurfaceProbe, frame_stride
from emgface.study.mechanics import MECHANICS
from emgface.study.stages import Laboratory, activation_digest
from emgface.study.store import Result, Stage

SKIN: Final = Stage("skin", (*MECHANICS, "emgface.pictures.body", "emgface.report.skin"))


def skin_motion(
    laboratory: Laboratory, activation: xr.DataArray, motion: xr.Dataset, skin: Skin, label: str
) -> Result:
    """Simulate a trial again and return the motion of the skin, at about 25 frames per second.

    Parameters
    ----------
    laboratory : Laboratory
        Store, face and configuration of the study.
    activation : DataArray
        What drove the trial.
    motion : Dataset
        Motion of its markers; its sigma_max is the one that could be simulated.
    skin : Skin
        Which nodes.
    label : str
        Names the trial in the store.

    Returns
    -------
    Result
        ``surface_position(time, surface_node, axis)`` [m] in single precision and
        ``position(time, marker, axis)`` [m]. Stored; a second report finds it there.

    Raises
    ------
    SimulationError
        The trial cannot be simulated, which it could before.
    """
    parameters = laboratory.study.simulation.model_copy(
        update={"sigma_max": float(motion.attrs["sigma_max"])}
    )
    every = frame_stride(parameters.output)

    def compute() -> xr.Dataset:
        moved = simulate_face(
            laboratory.face,
            activation,
            parameters,
            settled=laboratory.rest(parameters).dataset,
            further=(SurfaceProbe(skin.node),),
        )
        frames = moved[["surface_position", "position"]].isel(time=slice(None, None, every))
        frames = frames.transpose("time", "surface_node", "marker", "axis")
        frames["surface_position"] = frames["surface_position"].astype(np.float32)
        return frames.assign_attrs(origin="simulated", sigma_max=parameters.sigma_max)

    return laboratory.store.get_or_compute(
        SKIN,
        {"face": laboratory.face_digest, "activation": activation_digest(activation)},
        {**parameters.model_dump(mode="json"), "nodes": len(skin.node), "every": every},
        compute,
        label=label,
    )
