"""Prescribed displacement of fixed nodes to a target, with equilibrium of the free nodes."""

import numpy as np

from sim.errors import InvertedElement, NotConverged, SceneError, SingularSystem
from sim.integrators import Static, Workspace
from sim.state import Array, Control, State
from sim.system import System


def displace_held(
    system: System,
    state: State,
    target: Array,
    *,
    steps: int = 10,
    max_halvings: int = 6,
    integrator: Static | None = None,
    work: Workspace | None = None,
) -> State:
    """Displace the fixed unknowns in equal steps, with equilibrium of the free ones after each.

    Parameters
    ----------
    system : System
    state : State
        Initial state; the reductions of the scene specify the fixed unknowns.
    target : (n_nodes, 3)
        Positions [m]; only those of fixed unknowns are used.
    steps : int
        Number of steps.
    max_halvings : int
        Largest number of halvings of a step that fails.
    integrator : Static, optional
    work : Workspace, optional
        Solver memory to be reused.

    Returns
    -------
    State
        At the same time as `state`, at rest, with every fixed unknown at its target.

    Raises
    ------
    SceneError
        The target has another shape or is not finite.
    InvertedElement, NotConverged, SingularSystem
        A step fails after the largest number of halvings.

    Notes
    -----
    Source: the pre-stress of Stavness et al., Facial expression simulations: nodes are displaced to
    their reference positions during the first step.
    """
    if target.shape != state.q.shape or not np.isfinite(target).all():
        raise SceneError(
            f"the target of held nodes has shape {target.shape} or contains NaN, expected finite "
            f"{state.q.shape}"
        )
    if system.kinematics.matrix_varies:
        raise SceneError(
            "nodes of a scene with bodies or attachments cannot be displaced: prescribe their motion"
        )
    integrator = integrator or Static()
    work = work or Workspace(system)
    silent = Control(np.zeros(len(system.muscles)))
    start = state.q
    end = _holding(system, start, target)
    q = start
    drift = np.zeros_like(start)  # displacement of the free nodes per unit of the path
    done, size, smallest = 0.0, 1.0 / steps, 1.0 / (steps << max_halvings)
    while done < 1.0 - 1e-12:
        size = min(size, 1.0 - done)
        fixed = start + (done + size) * (end - start)
        try:
            new = _equilibrium(
                integrator, system, State(state.t, q + size * drift, state.v), fixed, silent, work
            )
        except (InvertedElement, NotConverged, SingularSystem):
            if size <= smallest * (1.0 + 1e-9):
                raise
            size *= 0.5
            drift = np.zeros_like(drift)
            continue
        drift = (new - q) / size
        q, done = new, done + size
    q = _holding(system, q, end)
    return State(state.t, q, np.zeros_like(q))  # history-dependent terms are fully relaxed


def _holding(system: System, q: Array, fixed: Array) -> Array:
    """Positions q with the fixed components of others."""
    out = fixed.copy()
    out.reshape(-1)[system.free] = q.reshape(-1)[system.free]
    return out


def _equilibrium(
    integrator: Static, system: System, guess: State, fixed: Array, silent: Control, work: Workspace
) -> Array:
    """Equilibrium positions with the fixed unknowns at those of `fixed`."""
    q = _holding(system, guess.q, fixed)
    end, _ = integrator.step(system, State(guess.t, q, guess.v), silent, 1.0, work)
    return end.q
