"""The skin of a face as a light triangle mesh, and its motion in a trial."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.drawing import skin_faces
from emgface.face.motion import simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.surface import triangles
from emgface.study.mechanics import MECHANICS
from emgface.study.stages import Laboratory, activation_digest
from emgface.study.store import Result, Stage
from sim import State, StepReport, System
from sim.probes import AXES, Variable
from sim.state import Control

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_NODES: Final = 3000
"""Nodes of the skin that are drawn; more are merged along the shortest edges."""

SKIN: Final = Stage("skin", (*MECHANICS, "emgface.report.skin"))


@dataclass(frozen=True, eq=False)
class Skin:
    """Triangles of the skin.

    Attributes
    ----------
    node : ndarray of int, shape (n,)
        Index of each node in the face model.
    triangle : ndarray of int, shape (m, 3)
        Corners as indices into `node`, counter-clockwise from outside.
    """

    node: Indices
    triangle: Indices


def skin_of(face: xr.Dataset, *, most: int = MOST_NODES) -> Skin:
    """Take the visible surface of a face, thinned where it has too many nodes.

    Parameters
    ----------
    face : Dataset
        Face model.
    most : int
        Nodes that may stay.

    Returns
    -------
    Skin
    """
    position = face["position"].values
    corners = triangles(skin_faces(face)[0], position)
    thinned = decimated(position, corners, most)
    node, index = np.unique(thinned, return_inverse=True)
    return Skin(node, index.reshape(-1, 3).astype(np.int64))


def decimated(position: Floats, corners: Indices, most: int) -> Indices:
    """Merge neighbouring nodes along the shortest edges until few enough are left.

    Only nodes that share an edge are merged, so that lips that lie against each other stay two.

    Parameters
    ----------
    position : ndarray, shape (nodes, 3)
    corners : ndarray of int, shape (triangles, 3)
    most : int
        Nodes that may stay.

    Returns
    -------
    ndarray of int, shape (fewer triangles, 3)
        Corners among the nodes that stay, each where it was.
    """
    excess = len(np.unique(corners)) - most
    while excess > 0:
        edges = np.sort(
            np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        )
        edges = np.unique(edges, axis=0)
        length = np.linalg.norm(position[edges[:, 0]] - position[edges[:, 1]], axis=1)
        target = np.arange(len(position))
        touched = np.zeros(len(position), dtype=bool)
        merged = 0
        for a, b in edges[np.argsort(length, kind="stable")]:
            if touched[a] or touched[b]:
                continue
            touched[[a, b]] = True
            target[b] = a
            merged += 1
            if merged == excess:
                break
        corners = target[corners]
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (c != a)]
        left = len(np.unique(corners)) - most
        if left >= excess:
            break
        excess = left
    return corners


@dataclass(frozen=True, eq=False)
class _SkinProbe:
    """Positions of the nodes of the skin, (skin_node, axis) [m]."""

    node: Indices

    def variables(self) -> tuple[Variable, ...]:
        return (Variable("skin_position", "m", ("skin_node", "axis"), {"axis": AXES}),)

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Floats, ...]:
        return (state.q[self.node],)


def skin_motion(
    laboratory: Laboratory, activation: xr.DataArray, motion: xr.Dataset, skin: Skin, label: str
) -> Result:
    """Simulate a trial once more and keep the whole skin, at about 25 frames per second.

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
        ``skin_position(time, skin_node, axis)`` [m] in single precision and
        ``position(time, marker, axis)`` [m]. Stored; a second report finds it there.

    Raises
    ------
    SimulationError
        The trial cannot be simulated, which it could before.
    """
    parameters = laboratory.study.simulation.model_copy(
        update={"sigma_max": float(motion.attrs["sigma_max"])}
    )
    every = frame_stride(parameters)

    def compute() -> xr.Dataset:
        moved = simulate_face(
            laboratory.face,
            activation,
            parameters,
            settled=laboratory.rest(parameters).dataset,
            further=(_SkinProbe(skin.node),),
        )
        frames = moved[["skin_position", "position"]].isel(time=slice(None, None, every))
        frames = frames.transpose("time", "skin_node", "marker", "axis")
        frames["skin_position"] = frames["skin_position"].astype(np.float32)
        return frames.assign_attrs(origin="simulated", sigma_max=parameters.sigma_max)

    return laboratory.store.get_or_compute(
        SKIN,
        {"face": laboratory.face_digest, "activation": activation_digest(activation)},
        {**parameters.model_dump(mode="json"), "nodes": len(skin.node), "every": every},
        compute,
        label=label,
    )


def frame_stride(parameters: SimulationParameters) -> int:
    """Outputs between frames, for about 25 frames per second."""
    return max(1, round(1.0 / (25.0 * parameters.output)))
