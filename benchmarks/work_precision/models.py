"""Models that are solved: a mesh with a treatment of its volume."""

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from benchmarks.refine import refine_face
from emgface.errors import ConfigurationError
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import State, System, compile_scene

VOLUMES: Final = ("pointwise", "element", "nodal", "hard")


@dataclass(frozen=True, order=True)
class Model:
    """Discretisation: number of divisions of every element into eight, and treatment of the volume."""

    refinements: int = 0
    volume: str = "pointwise"

    @property
    def name(self) -> str:
        """Name in the command's options."""
        return f"{'refined:' * self.refinements}{self.volume}"

    @classmethod
    def named(cls, name: str) -> "Model":
        """Parse a name such as "nodal" or "refined:element", or raise `ConfigurationError`."""
        *divisions, volume = name.split(":")
        if volume not in VOLUMES or set(divisions) - {"refined"}:
            raise ConfigurationError(
                f"model {name!r}, expected one of {', '.join(VOLUMES)}, or refined: before it"
            )
        return cls(len(divisions), volume)


MODELS: Final = tuple(
    Model(refinements, volume)
    for refinements, volumes in ((0, VOLUMES), (1, ("pointwise", "element")))
    for volume in volumes
)
"""Default models of a run."""


def finest(models: tuple[Model, ...]) -> Model:
    """Reference model for the discretisation error: the most refined one with the least locking.

    A hard volume is a different tissue and not a better discretisation; it is chosen only without
    others.
    """
    rank = {"hard": 0, "pointwise": 1, "element": 2, "nodal": 3}
    return max(models, key=lambda m: (m.volume != "hard", m.refinements, rank[m.volume]))


@dataclass(frozen=True, eq=False)
class Case:
    """A compiled model with its rest state under the loads, the nodes and names of the lip markers."""

    system: System
    start: State
    nodes: NDArray[np.int64]
    names: tuple[str, ...]
    elements: int


def parameters_for(parameters: SimulationParameters, volume: str) -> SimulationParameters:
    """Parameters with another treatment of the volume."""
    changes: dict[str, Any] = {"incompressibility": volume}
    if volume != "pointwise":
        changes["bulk_potential"] = "quadratic"
    return SimulationParameters.model_validate(parameters.model_dump() | changes)


def compiled(face: xr.Dataset, parameters: SimulationParameters, model: Model) -> Case:
    """Compile a model of a face and let it settle."""
    for _ in range(model.refinements):
        face = refine_face(face)
    chosen = parameters_for(parameters, model.volume)
    system = compile_scene(compose_scene(face, chosen))
    rest = system.rest_state()
    if chosen.gravity:
        settled = settle_face(face, chosen)["node_position"].values
        rest = replace(rest, q=np.ascontiguousarray(settled))
    names = tuple(map(str, face["marker"].values))
    nodes = face["marker_node"].values.astype(np.int64)
    return Case(system, rest, nodes, names, face.sizes["element"])
