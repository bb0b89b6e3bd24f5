"""Activations that the training of a reduced face contains: their size, and their change in a step."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from sim import Activation

Floats = NDArray[np.float64]

RIDGE: Final = 0.01
"""Activation below which a combination of muscles that was never trained is not recognised [1]."""
SAME_STEP: Final = 1e-6
"""Relative difference of equal steps [1]."""


@dataclass(frozen=True, eq=False)
class Trained:
    """Range of the training.

    ``whitening`` (muscle, muscle) is the inverse root of the mean of a a' over the activations a,
    ``response`` (muscle, muscle) the root of the squares of the static displacements [m] per
    activation, and ``distance`` the largest distance of an activation from rest in units of the
    training [1]. ``change`` is the largest displacement at rest [m] by the change of an activation
    in one step [s], of the sequences of the calibration that stayed within the bound of their
    error.
    """

    whitening: Floats
    response: Floats
    distance: float
    change: float
    step: float

    @classmethod
    def from_dataset(cls, dataset: xr.Dataset) -> "Trained":
        """Range of a dataset of schema reduced_face."""
        roots = dataset["activation_whitening"].values, dataset["activation_response"].values
        return cls(
            *roots, *(dataset.attrs[k] for k in ("largest_distance", "largest_change", "step"))
        )

    def distances(self, activation: Floats) -> Floats:
        """Size (n,) of activations (n, muscle) in units of those of the training, 0 at rest."""
        return whitened_size(activation, self.whitening)

    def doubt(self, times: Floats, activation: Floats) -> str:
        """Reason not to trust steps that end at times (n,) [s] with activations (n, muscle), or "".

        Before the first step, the face is at rest.
        """
        distance = self.distances(activation)
        at = int(distance.argmax())
        if not distance[at] <= self.distance:
            return (
                f"the activation at {times[at]:.3g} s is {distance[at]:.3g} from rest in units of the "
                f"training, farther than any of it ({self.distance:.3g})"
            )
        change = response_size(changes(times, activation, self.step), self.response)
        at = int(change.argmax())
        if not change[at] <= self.change:
            return (
                f"the activation jumps at {times[at]:.3g} s: its change within {self.step:g} s would "
                f"move the face at rest by {1e3 * change[at]:.3g} mm, more than in any calibration "
                f"within the bound ({1e3 * self.change:.3g} mm)"
            )
        longest = float(np.diff(times, prepend=0.0).max())
        if longest > (1.0 + SAME_STEP) * self.step:
            return f"the steps of {longest:g} s are longer than those of the training ({self.step:g} s)"
        return ""


def whitening_of(activations: Floats) -> Floats:
    """Inverse root of the mean of a a' over activations (n, muscle), for `whitened_size`."""
    squares = activations.T @ activations / len(activations)
    values, vectors = np.linalg.eigh(squares + RIDGE**2 * np.eye(len(squares)))
    return vectors / np.sqrt(values) @ vectors.T


def whitened_size(activations: Floats, root: Floats) -> Floats:
    """sqrt(a' (mean of a a')^-1 a / n_muscles) of activations (n, muscle): 1 on average, 0 at rest."""
    return np.sqrt(((activations @ root) ** 2).mean(axis=1))


def response_root(responses: Floats, weight: Floats) -> Floats:
    """Root of the mean squares of the displacements of nodes (muscle, node, axis) [m] with weights."""
    flat = (responses * np.sqrt(weight / weight.sum())[:, None]).reshape(len(responses), -1)
    values, vectors = np.linalg.eigh(flat @ flat.T)
    return vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T


def response_size(changes: Floats, root: Floats) -> Floats:
    """Weighted root mean square displacement (n,) [m] by changes of activation (n, muscle) at rest."""
    return np.sqrt(((changes @ root) ** 2).sum(axis=1))


def changes(times: Floats, activation: Floats, step: float) -> Floats:
    """Changes (n, muscle) within `step` before times (n,) [s] > 0, of a face at rest at time 0."""
    rest = np.zeros((1, activation.shape[1]))
    whole = Activation(np.append(0.0, times), np.concatenate([rest, activation]))
    return activation - whole.at_all(times - step)
