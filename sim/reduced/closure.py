"""Linear correction of the positions of nodes, fitted to what a reduced model misses in its training.

A Galerkin projection is systematically too stiff, and forces on the omitted modes are known but do not
move. The difference of nodal positions at full order from those of the reduced model is therefore
regressed on its coordinates, the omitted coordinates and the activation.
"""

from dataclasses import dataclass

import numpy as np

from sim.reduced.fused import OMITTED
from sim.state import Array, Outputs

RIDGE = 1e-2  #: penalty on the coefficients of features of unit variance


@dataclass(frozen=True, eq=False)
class Closure:
    """Correction weights @ features + offset of the positions of k nodes [m]."""

    weights: Array  #: (3 k, n_features)
    offset: Array  #: (3 k,) [m]

    def __call__(self, features: Array) -> Array:
        """Corrections (t, k, 3) [m] for features (t, n_features)."""
        values = each_product(self.weights, features) + self.offset
        return values.reshape(len(features), -1, 3)


def each_product(matrix: Array, vectors: Array) -> Array:
    """Products (t, k) of one matrix (k, n) with each vector (t, n), not influenced by their number."""
    product: Array = np.matmul(matrix, vectors[..., None])[..., 0]
    return product


def features_of(outputs: Outputs, activation: Array, n: int) -> Array:
    """Coordinates, omitted coordinates (zero at the start) and activations, (t, n)."""
    y = outputs.q.reshape(len(outputs.t), -1)
    none = np.zeros((len(y), 1, n - y.shape[1] - activation.shape[1]))
    omitted = outputs.memory.get(OMITTED, none)[:, 0]
    return np.concatenate([y, omitted, activation], axis=1)


def fitted_closure(features: Array, missing: Array) -> Closure:
    """Ridge regression of missing displacements (t, k, 3) [m] on features (t, n)."""
    mean: Array = features.mean(axis=0)
    spread: Array = features.std(axis=0)
    size: Array = np.where(spread > 0.0, spread, 1.0)
    scaled: Array = (features - mean) / size
    target = missing.reshape(len(missing), -1)
    centre: Array = target.mean(axis=0)
    squares: Array = scaled.T @ scaled + RIDGE * len(scaled) * np.eye(scaled.shape[1])
    solved: Array = np.asarray(np.linalg.inv(squares) @ (scaled.T @ (target - centre)))
    weights: Array = np.ascontiguousarray((solved / size[:, None]).T)
    return Closure(weights, centre - weights @ mean)
