"""Surface of a face as part of a trajectory, for drawing a motion without the face model."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError
from emgface.face.parts import arches_of
from emgface.pictures.body import Body, Skin, make_body
from sim import State, StepReport, System
from sim.probes import AXES, Variable
from sim.state import Control

Floats = NDArray[np.float64]

ARCHES: Final = ("arch_position", "arch_triangle", "arch_bone")
PAGE_VARIABLES: Final = ("surface_position", "frame_time", "surface_corner", "surface_part", *ARCHES,
                "muscle_force", "contact_force")  # fmt: skip
"""Variables of a trajectory that are for pages."""

SURFACE_FRAME_RATE: Final = 25.0  #: approximate number of frames of a surface per second


@dataclass(frozen=True, eq=False)
class SurfaceProbe:
    """Positions of some nodes, (surface_node, axis) [m]."""

    node: NDArray[np.int64]

    def variables(self) -> tuple[Variable, ...]:
        """Name, unit and dims of the recorded variable."""
        return (Variable("surface_position", "m", ("surface_node", "axis"), {"axis": AXES}),)

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Floats, ...]:
        """Return the positions of a state."""
        return (state.q[self.node],)


def frame_stride(output: float) -> int:
    """Return the number of outputs of `output` seconds per frame."""
    return max(1, round(1.0 / (SURFACE_FRAME_RATE * output)))


def with_surface(trajectory: xr.Dataset, face: xr.Dataset, skin: Skin) -> xr.Dataset:
    """Complete a trajectory that contains the nodes of a skin, so that it can be drawn.

    `trajectory` is the result of `emgface.face.motion.simulate_face` with a `SurfaceProbe` of
    `skin.node`. The result contains ``surface_position(frame, surface_node, axis)`` [m] in single
    precision and ``frame_time(frame)`` [s], about 25 frames a second, ``surface_corner``,
    ``surface_part`` and the dental arches of the face.
    """
    every = frame_stride(float(trajectory.attrs["output"]))
    frames = trajectory["surface_position"].transpose("time", "surface_node", "axis")
    frames = frames.isel(time=slice(None, None, every))
    completed = trajectory.drop_vars("surface_position").assign(
        surface_position=(
            ("frame", "surface_node", "axis"), frames.values.astype(np.float32), {"units": "m"},
        ),
        frame_time=("frame", frames["time"].values, {"units": "s"}),
        surface_corner=(("surface_facet", "corner"), skin.facet, {"units": "1"}),
        surface_part=("surface_facet", skin.part, {"units": "1"}),
    )  # fmt: skip
    arches = [name for name in ARCHES if name in face]
    return completed.assign({name: face[name].variable for name in arches})


def without_surface(trajectory: xr.Dataset) -> xr.Dataset:
    """A trajectory without what is for pages."""
    return trajectory.drop_dims(["muscle"], errors="ignore").drop_vars(
        PAGE_VARIABLES, errors="ignore"
    )


def drawn_surface(trajectory: xr.Dataset) -> tuple[Body, Skin, NDArray[np.floating]]:
    """Return the surface of a trajectory: body, skin, and nodes (frames, n, 3) [m] of the skin.

    Raises DataError if the trajectory has no surface.
    """
    if "surface_position" not in trajectory:
        raise DataError(
            "the trajectory contains markers only, expected one with the surface of the face: "
            "simulate it with --surface"
        )
    frames = trajectory["surface_position"].transpose("frame", "surface_node", "axis").values
    facet = trajectory["surface_corner"].transpose("surface_facet", "corner").values
    skin = Skin(np.arange(frames.shape[1]), facet.astype(np.int64),
                trajectory["surface_part"].values.astype(np.int64))  # fmt: skip
    return make_body(frames[0], skin, arches_of(trajectory)), skin, frames
