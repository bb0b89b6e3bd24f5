"""Reduced face of a dataset, bound to its face and parameters."""

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.reduced.trained import Trained
from emgface.run.digest import canonical_json, dataset_digest
from emgface.schema.netcdf import read_netcdf
from sim import State, Workspace, compile_scene
from sim.reduced import (
    Closure,
    FusedEuler,
    ReducedContact,
    ReducedMarkers,
    ReducedModel,
    reduce_system,
)
from sim.reduced.contact import IMPULSES
from sim.reduced.fused import OMITTED

Floats = NDArray[np.float64]

NOT_MECHANICS: Final = frozenset(
    {
        "accuracy", "solver", "step", "output", "iteration_tolerance", "error_tolerance", "timing",
        "linear_solver", "sigma_max", "sigma_max_policy", "reduced",
    }
)  # fmt: skip
"""Parameters that a reduced face is not bound to; sigma_max may be lower."""


SETTLING_STEPS, LONGEST_STEP, AT_REST = 60, 1.0, 1e-12
"""Largest number of steps to the equilibrium, their length [s], and change at which they end [1]."""
UPPER, LOWER = "lip opening, upper", "lip opening, lower"


def mechanics_of(parameters: SimulationParameters) -> str:
    """Parameters to which a reduced face is bound, as JSON."""
    left_out: dict[str, Any] = dict.fromkeys(NOT_MECHANICS, True) | {"contact": {"renewals"}}
    return canonical_json(parameters.model_dump(mode="json", exclude=left_out))


def parameters_of(dataset: xr.Dataset) -> SimulationParameters:
    """Simulation parameters with which a reduced face was trained."""
    sigma_max = json.loads(dataset.attrs["training"])["sigma_max"]
    values = {**_mechanics(dataset), "sigma_max": sigma_max}
    return SimulationParameters.model_validate(values | {"accuracy": "published"})


def contact_of(path: Path) -> dict[str, Any]:
    """Parameters of the contact of the training of a file; errors as of `read_netcdf`."""
    return _mechanics(read_netcdf(path, "reduced_face"))["contact"]


def _mechanics(dataset: xr.Dataset) -> dict[str, Any]:
    """Parameters to which a reduced face is bound; earlier files, without contact, do not state it."""
    absent = {"contact": NO_CONTACT.model_dump(mode="json", exclude={"renewals"})}
    return absent | json.loads(dataset.attrs["mechanics"])


def free_of_contact(parameters: SimulationParameters) -> SimulationParameters:
    """The same parameters without contact."""
    return parameters.model_copy(update={"contact": NO_CONTACT})


@dataclass(frozen=True, eq=False)
class ReducedFace:
    """Reduced face, ready for simulations.

    Attributes
    ----------
    dataset : Dataset
        Of schema reduced_face.
    face : Dataset
    parameters : SimulationParameters
    """

    dataset: xr.Dataset
    face: xr.Dataset
    parameters: SimulationParameters

    @classmethod
    def for_face(
        cls, given: xr.Dataset | Path, face: xr.Dataset, parameters: SimulationParameters
    ) -> "ReducedFace":
        """Check that a reduced face belongs to a face and to parameters.

        Raises
        ------
        DataError
            The file is absent or damaged.
        FaceError
            It was trained for another face, other parameters or contact, or a lower sigma_max.
        """
        dataset = read_netcdf(given, "reduced_face") if isinstance(given, Path) else given
        own = dataset.attrs["face_digest"]
        if own != (face_digest := dataset_digest(face)):
            raise FaceError(
                f"the reduced face belongs to the face with digest {own[:8]}, found one with digest "
                f"{face_digest[:8]}: reduce this face (emgface reduce)"
            )
        trained = _mechanics(dataset)
        given_here = json.loads(mechanics_of(parameters))
        own_contact, contact = trained["contact"]["method"], given_here["contact"]["method"]
        if own_contact != contact:
            raise FaceError(
                f"the reduced face was trained with contact.method = '{own_contact}', found "
                f"'{contact}': choose the former, or reduce the face with the latter"
            )
        differing = [n for n in given_here if given_here[n] != trained.get(n)]
        if differing:
            name = differing[0]
            raise FaceError(
                f"the reduced face was trained with {name} = {trained.get(name)}, found "
                f"{given_here[name]}: reduce the face with these parameters"
            )
        highest = float(json.loads(dataset.attrs["training"])["sigma_max"])
        if parameters.sigma_max > highest:
            raise FaceError(
                f"the reduced face was trained with sigma_max = {highest:g} Pa, found "
                f"{parameters.sigma_max:g} Pa: lower it, or reduce the face with this value"
            )
        return cls(dataset, face, parameters)

    @property
    def moving(self) -> int:
        """Number of modes that move."""
        return int(self.dataset.attrs["moving"])

    @cached_property
    def modes(self) -> Floats:
        """All modes (node, axis, mode)."""
        return np.ascontiguousarray(self.dataset["modes"].values)

    @cached_property
    def rest(self) -> Floats:
        """Positions (node, axis) where the coordinates are zero [m]."""
        return np.ascontiguousarray(self.dataset["node_rest"].values)

    @cached_property
    def model(self) -> ReducedModel:
        """Reduced model with the chosen elements."""
        system = compile_scene(compose_scene(self.face, free_of_contact(self.parameters)))
        sample = self.dataset["sampled_element"].values, self.dataset["sampled_weight"].values
        modes = self.modes.reshape(-1, self.modes.shape[2])
        return reduce_system(system, self.rest, modes, self.moving, sample)

    @cached_property
    def nodes(self) -> tuple[list[str], NDArray[np.int64]]:
        """Names and nodes of the markers, and of the two points of the lip opening, if there is one."""
        names = list(map(str, self.face["marker"].values))
        nodes = self.face["marker_node"].values.astype(np.int64)
        if "lip_opening_node" not in self.face:
            return names, nodes
        return [*names, UPPER, LOWER], np.append(nodes, self.face["lip_opening_node"].values)

    @cached_property
    def closure(self) -> Closure | None:
        """Correction of the positions of `nodes`, once it is fitted."""
        if "closure_weight" not in self.dataset:
            return None
        values = self.dataset["closure_weight"].values, self.dataset["closure_offset"].values
        return Closure(*map(np.ascontiguousarray, values))

    @cached_property
    def markers(self) -> ReducedMarkers:
        """Probe of the positions of `nodes`."""
        names, nodes = self.nodes
        moving = self.modes[nodes][..., : self.moving].reshape(3 * len(nodes), -1)
        return ReducedMarkers(self.rest[nodes], np.ascontiguousarray(moving), names, self.closure)

    @cached_property
    def contact(self) -> ReducedContact | None:
        """Contact of the points that come close to a face in the training, if there is any."""
        full_contact = compile_scene(compose_scene(self.face, self.parameters)).contact
        if full_contact is None:
            return None
        modes = self.modes.reshape(-1, self.modes.shape[2])
        slots = self.dataset["contact_slot"].values.astype(np.int64)
        return ReducedContact(full_contact, self.rest, modes, slots)

    @cached_property
    def equilibrium(self) -> State:
        """State at rest under gravity and contact, also of the omitted coordinates."""
        system, integrator = self.model.system, FusedEuler(self.contact)
        work, silent = Workspace(system), system.control(np.zeros(len(system.muscles)))
        state = system.rest_state()
        for _ in range(SETTLING_STEPS):
            before = state
            state, _ = integrator.step(system, before, silent, LONGEST_STEP, work)
            if np.abs(state.q - before.q).max() <= AT_REST * np.abs(state.q).max():
                break
        omitted = state.memory[OMITTED] * np.array([[1.0], [0.0]])
        memory = {**state.memory, OMITTED: omitted}
        memory.pop(IMPULSES, None)  # those of a long step
        return State(0.0, state.q, 0.0 * state.v, memory)

    @cached_property
    def trained(self) -> Trained:
        """Range of the training."""
        return Trained.from_dataset(self.dataset)


def training_text(parameters: Any, sigma_max: float) -> str:
    """Parameters of the training as JSON."""
    return canonical_json({**parameters.model_dump(mode="json"), "sigma_max": sigma_max})
