"""Files of the states of simulations."""

from os import PathLike
from pathlib import Path

import numpy as np
import xarray as xr

from sim.errors import SceneError
from sim.state import State

_KIND = "state of a simulation"


def save_state(state: State, path: str | PathLike[str]) -> None:
    """Write a state, as returned by `sim.simulate`, to a netCDF file without loss of precision."""
    blocks = {
        "position": (("node", "axis"), state.q, {"units": "m"}),
        "velocity": (("node", "axis"), state.v, {"units": "m s-1"}),
        "time": ((), state.t, {"units": "s"}),
    }
    if len(state.frames):
        frames, twists = state.frames, state.twists
        blocks |= {
            "body_position": (("body", "axis"), frames[:, :3], {"units": "m"}),
            "body_quaternion": (("body", "quaternion"), frames[:, 3:], {"units": "1"}),
            "body_velocity": (("body", "axis"), twists[:, :3], {"units": "m s-1"}),
            "body_angular_velocity": (("body", "axis"), twists[:, 3:], {"units": "rad s-1"}),
        }
    data = xr.Dataset(blocks, attrs={"kind": _KIND, "memory": list(state.memory) or ""})
    for i, array in enumerate(state.memory.values()):
        data[f"memory_{i}"] = tuple(f"memory_{i}_{k}" for k in range(array.ndim)), array
    data.to_netcdf(  # pyright: ignore[reportUnknownMemberType]
        path, encoding={name: {"_FillValue": None} for name in data.variables}
    )


def read_state(path: str | PathLike[str]) -> State:
    """Read a state written by `save_state`.

    Raises
    ------
    SceneError
        The file is absent or contains no state.
    """
    if not Path(path).is_file():
        raise SceneError(f"{path} is not a file, expected a state written by sim.save_state")
    try:
        with xr.open_dataset(  # pyright: ignore[reportUnknownMemberType]
            path, decode_cf=False
        ) as data:
            if data.attrs.get("kind") != _KIND:
                raise ValueError(f"its attribute 'kind' is {data.attrs.get('kind')!r}")
            names = np.atleast_1d(data.attrs["memory"]).tolist()
            arrays = [data[f"memory_{i}"].values for i in range(len(names) if names != [""] else 0)]
            q, v = data["position"].values, data["velocity"].values
            memory = dict(zip(names, arrays, strict=False))
            if "body_position" not in data:
                return State(float(data["time"]), q, v, memory)
            frames, twists = (
                np.concatenate([data[f"body_{name}"].values for name in pair], axis=1)
                for pair in (("position", "quaternion"), ("velocity", "angular_velocity"))
            )
            return State(float(data["time"]), q, v, memory, frames, twists)
    except (OSError, ValueError, KeyError) as error:
        raise SceneError(
            f"{path} contains no state of a simulation ({error}), expected a file of sim.save_state"
        ) from error
