"""Modes of motions: proper orthogonal decomposition in the norm of the mass, and static responses."""

import numpy as np

from sim.errors import SceneError
from sim.linear import linear_solver
from sim.state import Array
from sim.system import System


def mass_modes(
    displacements: Array, node_mass: Array, n: int, node_weight: Array | None = None
) -> tuple[Array, Array]:
    """Modes Phi with Phi' M Phi = 1 that contain most of given displacements.

    Parameters
    ----------
    displacements : (k, n_nodes, 3) of snapshots from a common reference [m].
    node_mass : (n_nodes,) [kg].
    n : int
        Number of modes.
    node_weight : (n_nodes,), optional
        Weights of the norm in which they contain most, the mass by default; zero at fixed nodes alone.

    Returns
    -------
    modes : (3 n_nodes, n) [kg^-1/2], in the order of their share in the snapshots.
    values : (k,) singular values of the snapshots weighted by the root of these weights, descending.

    Raises
    ------
    SceneError
        The snapshots have fewer than n independent displacements.

    Notes
    -----
    The modes are the left singular vectors of the weighted snapshots, from the Gram matrix of the
    smaller dimension (Sirovich, Quarterly of Applied Mathematics 45, 1987).
    """
    weight = node_mass if node_weight is None else node_weight
    root = np.sqrt(np.repeat(weight, 3))
    S = displacements.reshape(len(displacements), -1) * root
    if len(S) <= S.shape[1]:
        squares, left = np.linalg.eigh(S @ S.T)
        vectors = S.T @ left[:, ::-1]
    else:
        squares, right = np.linalg.eigh(S.T @ S)
        vectors = right[:, ::-1]
    values = np.sqrt(np.maximum(squares[::-1], 0.0))
    if n > len(values) or not values[n - 1] > 1e-7 * values[0]:
        rank = int((values > 1e-7 * values[0]).sum())
        raise SceneError(
            f"the snapshots contain {rank} independent displacements, expected at least {n}: add "
            "snapshots or request fewer modes"
        )
    modes, _ = np.linalg.qr(vectors[:, :n])
    modes /= np.where(root > 0.0, root, np.inf)[:, None]
    if node_weight is None:
        return modes, values
    # the same spans of the first modes, orthonormal in the mass
    factor = np.linalg.cholesky(modes.T @ (np.repeat(node_mass, 3)[:, None] * modes))
    own = np.linalg.solve(factor, modes.T).T.astype(np.float64)
    return own, values


def projected(displacements: Array, node_mass: Array, modes: Array) -> Array:
    """Coordinates (k, n) of displacements (k, n_nodes, 3), closest in the norm of the mass."""
    weighted = np.repeat(node_mass, 3)[:, None] * modes
    return displacements.reshape(len(displacements), -1) @ weighted


def static_responses(system: System, q: Array, level: float = 0.1) -> Array:
    """Linear static displacements (n_muscles, n_nodes, 3) [m] of each muscle at a small activation.

    They are K^-1 (f(a) - f(0)) with the stiffness K at positions q without activation.
    """
    n = len(system.muscles)
    passive = system.control(np.zeros(n))
    at_rest, K = system.tangent(q, passive)
    solver = linear_solver()
    solver.analyse(system.pattern)
    solver.factorise(K)
    responses = np.zeros((n, q.size))
    for muscle in range(n):
        active = system.control(level * (np.arange(n) == muscle))
        change = system.force(q, active).f - at_rest.f
        responses[muscle, system.free] = solver.solve(change.reshape(-1)[system.free])
    return responses.reshape(n, *q.shape)
