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
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.netcdf import read_netcdf
from emgface.study.digest import canonical_json, dataset_digest
from sim import compile_scene
from sim.reduced import ReducedModel, reduce_system

Floats = NDArray[np.float64]

NOT_MECHANICS: Final = frozenset(
    {
        "accuracy", "solver", "step", "output", "iteration_tolerance", "error_tolerance", "timing",
        "linear_solver", "sigma_max", "sigma_max_policy", "contact", "reduced",
    }
)  # fmt: skip
"""Parameters that a reduced face is not bound to; sigma_max may be lower, contact must be absent."""


RIDGE: Final = 0.01
"""Activation below which a combination of muscles that was never trained is not recognised [1]."""


def mechanics_of(parameters: SimulationParameters) -> str:
    """Parameters to which a reduced face is bound, as JSON."""
    return canonical_json(parameters.model_dump(mode="json", exclude=set(NOT_MECHANICS)))


def parameters_of(dataset: xr.Dataset) -> SimulationParameters:
    """Simulation parameters with which a reduced face was trained, without contact."""
    sigma_max = json.loads(dataset.attrs["training"])["sigma_max"]
    values = {**json.loads(dataset.attrs["mechanics"]), "sigma_max": sigma_max}
    more = {"accuracy": "published", "contact": {"method": "none"}}
    return SimulationParameters.model_validate(values | more)


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
    def of(
        cls, given: xr.Dataset | Path, face: xr.Dataset, parameters: SimulationParameters
    ) -> "ReducedFace":
        """Check that a reduced face belongs to a face and to parameters.

        Raises
        ------
        DataError
            The file is absent or damaged.
        FaceError
            It was trained for another face, other parameters, a lower sigma_max, or without the
            contact that the parameters request.
        """
        dataset = read_netcdf(given, "reduced_face") if isinstance(given, Path) else given
        own = dataset.attrs["face_digest"]
        if own != (found := dataset_digest(face)):
            raise FaceError(
                f"the reduced face belongs to the face with digest {own[:8]}, found one with digest "
                f"{found[:8]}: reduce this face (emgface face reduce)"
            )
        trained = json.loads(dataset.attrs["mechanics"])
        given_here = json.loads(mechanics_of(parameters))
        differing = [n for n in given_here if given_here[n] != trained.get(n)]
        if differing:
            name = differing[0]
            raise FaceError(
                f"the reduced face was trained with {name} = {trained.get(name)}, found "
                f"{given_here[name]}: reduce the face with these parameters"
            )
        if parameters.contact.method != "none":
            raise FaceError(
                "a reduced face has no contact of lips and teeth, found contact.method = "
                f"'{parameters.contact.method}': set it to 'none', or simulate at full order"
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
        """Reduced model with the chosen points."""
        system = compile_scene(compose_scene(self.face, self.parameters))
        sample = self.dataset["point_place"].values, self.dataset["point_weight"].values
        modes = self.modes.reshape(-1, self.modes.shape[2])
        return reduce_system(system, self.rest, modes, self.moving, sample)

    def distances(self, activation: Floats) -> Floats:
        """Size (n,) of activations (n, muscle) in units of those of the training, 0 at rest."""
        return whitened_size(activation, self.dataset["activation_whitening"].values)


def whitening(activations: Floats) -> Floats:
    """Inverse root of the mean of a a' over activations (n, muscle), for `whitened_size`."""
    squares = activations.T @ activations / len(activations)
    values, vectors = np.linalg.eigh(squares + RIDGE**2 * np.eye(len(squares)))
    return vectors / np.sqrt(values) @ vectors.T


def whitened_size(activations: Floats, root: Floats) -> Floats:
    """sqrt(a' (mean of a a')^-1 a / n_muscles) of activations (n, muscle): 1 on average, 0 at rest."""
    return np.sqrt(((activations @ root) ** 2).mean(axis=1))


def training_text(parameters: Any, sigma_max: float) -> str:
    """Parameters of the training as JSON."""
    return canonical_json({**parameters.model_dump(mode="json"), "sigma_max": sigma_max})
