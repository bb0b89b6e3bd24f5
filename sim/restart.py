"""Files of the states of simulations."""

from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from os import PathLike
from pathlib import Path

import numpy as np
import xarray as xr

from sim.errors import SceneError
from sim.state import Array, State
from sim.system import System

_KIND = "state of a simulation"
_DIGEST = "digest"  # attribute: of all values; absent in files of earlier versions
SCENE = "scene"
"""Name of the digest of the scene in `State.memory`; other names belong to terms, rows and contact."""


def with_scene(state: State, system: System) -> State:
    """State with the digest of its scene."""
    return replace(state, memory={**state.memory, SCENE: _numbers(system.digest)})


def _numbers(digest: bytes) -> Array:
    """Bytes as an array, which every format stores exactly."""
    return np.frombuffer(digest, dtype=np.uint8).astype(np.float64)


def require_own(state: State, system: System) -> None:
    """Raise SceneError for a state of another scene, or of other numbers of points and bodies.

    A state without memory, of positions and velocities alone, fits every scene of its size.
    """
    n, bodies = system.mesh.n_nodes, len(system.kinematics.rest_frames)
    shapes = {"q": (n, 3), "v": (n, 3), "frames": (bodies, 7), "twists": (bodies, 6)}
    for name, wanted in shapes.items():
        shape = getattr(state, name).shape
        if shape != wanted:
            raise SceneError(
                f"the initial state has {name} of shape {shape}, expected {wanted} for this scene"
            )
    own = _numbers(system.digest)
    if SCENE in state.memory and not np.array_equal(state.memory[SCENE], own):
        raise SceneError(
            "the initial state belongs to another scene, whose parts or parameters differ, and contains "
            "its forces and history: expected a state of this scene; sim.State(t, q, v, frames=..., "
            "twists=...) takes its positions and velocities alone"
        )


def _digest(names: list[str], arrays: Mapping[str, Array]) -> str:
    """Digest of the values of a state by variable, and of the names of its memory."""
    parts = [
        repr((name, a.dtype.str, a.shape)).encode() + a.tobytes() for name, a in arrays.items()
    ]
    return sha256(repr(names).encode() + b"".join(parts)).hexdigest()


def save_state(state: State, path: str | PathLike[str]) -> None:
    """Write a state, as returned by `sim.simulate`, to a netCDF file without loss of precision.

    The file contains a digest of all values, so that a damaged one is not mistaken for a state.
    """
    import netCDF4

    blocks: dict[str, tuple[tuple[str, ...], Array | float, dict[str, str]]] = {
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
    for i, array in enumerate(state.memory.values()):
        dims = tuple(f"memory_{i}_{k}" for k in range(array.ndim))
        blocks[f"memory_{i}"] = (dims, array, {})
    arrays = {name: np.asarray(blocks[name][1]) for name in sorted(blocks)}
    # Written directly, because a labelled dataset takes twice the time of a small file.
    with netCDF4.Dataset(path, "w") as file:
        file.setncattr("kind", _KIND)
        file.setncattr("memory", list(state.memory) or "")
        file.setncattr(_DIGEST, _digest(list(state.memory), arrays))
        for name, (dims, _, attrs) in blocks.items():
            array = arrays[name]
            for dim, n in zip(dims, array.shape, strict=True):
                if dim not in file.dimensions:
                    file.createDimension(dim, n)
            variable = file.createVariable(  # pyright: ignore[reportUnknownMemberType]
                name, array.dtype, dims, fill_value=False
            )
            variable.setncatts(attrs)
            variable[...] = array


def read_state(path: str | PathLike[str]) -> State:
    """Read a state written by `save_state`.

    Raises
    ------
    SceneError
        The file is absent, contains no state, or was changed after it was written.
    """
    if not Path(path).is_file():
        raise SceneError(f"{path} is not a file, expected a state written by sim.save_state")
    try:
        with xr.open_dataset(  # pyright: ignore[reportUnknownMemberType]
            path, decode_cf=False
        ) as data:
            if data.attrs.get("kind") != _KIND:
                raise ValueError(f"its attribute 'kind' is {data.attrs.get('kind')!r}")
            names = [name for name in np.atleast_1d(data.attrs["memory"]).tolist() if name]
            arrays = {str(name): data[name].values for name in sorted(map(str, data.variables))}
            if data.attrs.get(_DIGEST, own := _digest(names, arrays)) != own:
                raise ValueError("its values are not those that were written")
            q, v = data["position"].values, data["velocity"].values
            memory = {name: arrays[f"memory_{i}"] for i, name in enumerate(names)}
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
