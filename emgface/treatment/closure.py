"""Closure of a wound: its edges are drawn together, tied, and the tissue comes to rest.

Pairs of nodes are held and moved to their common middles along a load path, on which the gap
decreases to zero with equilibrium of the free tissue after every step. The nodes of a pair then become
one, which ties the edges, and the equilibrium without held nodes has the residual stress.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

import sim
from emgface.errors import TreatmentError
from sim.scene import having

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Progress = Callable[[int, int], None]

LOAD_STEPS: Final = 8  #: steps of the load path
MOST_LOAD_HALVINGS: Final = 4  #: largest number of halvings of a step that fails
CLOSURE_FAILURES: Final = (sim.InvertedElement, sim.NotConverged, sim.SingularSystem)


@dataclass(frozen=True, eq=False)
class Closed:
    """Closed wound: positions (nodes, 3) [m] of the tied mesh, and what closed it.

    `traction` (nodes, 3) [N] are the forces of the tissue on one side on the nodes of the suture, and
    `force` is the sum of their magnitudes; `imbalance` is the largest force on a free node [N].
    """

    position: Floats
    traction: Floats
    force: float
    imbalance: float
    smallest_J: float


def ties(pairs: Integers, n: int) -> Integers:
    """Node (n,) as which every node remains when the pairs (k, 2) become one: the smallest."""
    graph = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    _, group = connected_components(graph, directed=False)
    first = np.full(group.max() + 1, n, dtype=np.int64)
    np.minimum.at(first, group, np.arange(n))
    return first[group]


def drawn_together(
    scene: sim.Scene,
    same: Integers,
    aim: Floats | None = None,
    *,
    steps: int = LOAD_STEPS,
    progress: Progress | None = None,
) -> Floats:
    """Positions of an open mesh when the nodes that are the same have met.

    They meet at the mean of their `aim` (nodes, 3) [m], by default of their positions. Raises
    TreatmentError, with the share of the gap that could be closed, if a step of the path fails.
    """
    groups = np.bincount(same, minlength=len(same))
    prescribed = np.flatnonzero(groups[same] > 1)
    X = scene.mesh.X
    middle = np.zeros_like(X)
    np.add.at(middle, same, X if aim is None else aim)
    middle /= np.maximum(groups, 1)[:, None]
    target = X.copy()
    target[prescribed] = middle[same[prescribed]]
    if not len(prescribed) or np.array_equal(target, X):
        return X.copy()
    widest = 2.0 * float(np.linalg.norm(target - X, axis=1).max())
    system = sim.compile_scene(
        replace(scene, reductions=(*scene.reductions, sim.Fixed(prescribed)), damping=None)
    )
    state, work, done = system.rest_state(), sim.Workspace(system), 0
    for k in range(1, steps + 1):
        way = X + k / steps * (target - X)
        try:
            state = sim.displace_held(
                system, state, way, steps=1, max_halvings=MOST_LOAD_HALVINGS, work=work
            )
        except CLOSURE_FAILURES as error:
            raise TreatmentError(
                "too wide",
                f"the edges of the wound are up to {1e3 * widest:.1f} mm apart and could be brought "
                f"together by {100 * done / steps:.0f} % of that only ({type(error).__name__}): the "
                "excision is too wide for direct closure, where a flap is needed; choose a smaller "
                "width",
            ) from error
        done = k
        if progress is not None:
            progress(k, steps + 1)
    return state.q


def relaxed(scene: sim.Scene, start: Floats, side: NDArray[np.bool_], suture: Integers) -> Closed:
    """Equilibrium of the tied mesh from `start` (nodes, 3) [m], and the forces across the suture.

    `side` (elements,) is the mask of the elements on one side of the suture, in the order of the
    scene. Raises TreatmentError if the equilibrium is not found.
    """
    system = sim.compile_scene(replace(scene, damping=None))
    silent = system.control(np.zeros(len(system.muscles)))
    rest = system.rest_state()
    try:
        state, _ = sim.Static(tolerance=1e-9, residual_tolerance=1e-9).step(
            system, replace(rest, q=start), silent, 1.0, sim.Workspace(system)
        )
    except CLOSURE_FAILURES as error:
        raise TreatmentError(
            "too wide",
            f"the sutured tissue finds no equilibrium ({error}): the excision is too wide for direct "
            "closure; choose a smaller width",
        ) from error
    f = system.force(state.q, silent).f
    residual = np.zeros(f.size)
    residual[system.free] = f.reshape(-1)[system.free]
    traction = np.zeros_like(f)
    for term in having(system.terms, "nodes_of_muscle"):
        one = np.zeros_like(f)
        term.add(state.q, silent, one, None, side.astype(np.float64))  # pyright: ignore[reportCallIssue]
        traction[suture] += one[suture]
    return Closed(
        state.q,
        traction,
        float(np.linalg.norm(traction, axis=1).sum()),
        float(np.abs(residual).max()),
        system.smallest_J(state.q)[0],
    )
