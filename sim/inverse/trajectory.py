"""Trajectory form of inverse tracking: most probable activations over a trial by Gauss-Newton."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim.errors import SimulationError
from sim.integrators import Workspace
from sim.inverse.linear_targets import Linearised, Quadratic
from sim.inverse.quadratic import minimise_in_box
from sim.inverse.sensitivities import linearise
from sim.inverse.splines import Splines
from sim.inverse.targets import Target
from sim.state import Array, State
from sim.system import System

SAME_DERIVATIVES = 0.5
"""Ratio of a decrease and its prediction above which the next iteration has the same derivatives."""
HALVINGS = 5
"""Largest number of halvings of a Gauss-Newton step."""


@dataclass(frozen=True)
class Fit:
    """Most probable activations of a trial.

    Attributes
    ----------
    linearised : Linearised
        At the coefficients found.
    objective : list of float
        Before and after every iteration.
    converged : bool
        False if the iterations were too few, or no part of the last change lowered the objective.
    """

    linearised: Linearised
    objective: list[float]
    converged: bool


def fit(
    system: System,
    targets: Sequence[Target],
    splines: Splines,
    start: Array | Linearised,
    before: Quadratic,
    *,
    precision: Array | float = 1.0,
    h: float = 0.01,
    initial: State | None = None,
    work: Workspace | None = None,
    iterations: int = 3,
    enough: float = 1e-3,
    after: Callable[[Linearised, int], None] | None = None,
) -> Fit:
    """Minimise half of the squared residuals plus a prior over the coefficients, within 0-1.

    Gauss-Newton: every iteration solves the linearised problem within the box and halves its change
    until the objective decreases. The derivatives of an iteration serve the next one as well if the
    decrease is at least `SAME_DERIVATIVES` times the predicted one. It ends with a relative decrease
    below `enough` in an iteration with its own derivatives.

    Parameters
    ----------
    start : (n_splines, n_muscles), or a linearisation
        Zero is a good start: the activations of single steps may be far from those over the trial.
    before : Quadratic
        The prior.
    precision : float or (m,)
        Inverse variances of the targets over their sizes.
    after : callable, optional
        Called as ``after(linearised, iterations done)`` after every iteration that computed its
        derivatives; all are done if the fit has converged.

    Raises
    ------
    SceneError, InvertedElement, SingularSystem
        As `linearise`, at the start.
    """
    work = work or Workspace(system)

    def at(c: Array, derivatives: bool = True) -> Linearised:
        return linearise(
            system, targets, splines, c, h=h, initial=initial, work=work, derivatives=derivatives
        )

    def value(one: Linearised) -> float:
        squares = np.where(np.isfinite(one.residual), one.residual, 0.0) ** 2 * precision
        return 0.5 * float(squares.sum()) + before.value(one.coefficients)

    here = start if isinstance(start, Linearised) else at(start)
    reached, converged = [value(here)], False
    for k in range(iterations):
        problem = here.normal(precision) + before
        flat = here.coefficients.ravel()
        wanted = minimise_in_box(problem.Q, problem.c, 0.0 * flat, 0.0 * flat + 1.0, flat).x
        predicted = problem.value(flat) - problem.value(wanted)
        share, accepted = 1.0, None
        for _ in range(HALVINGS):
            c = here.coefficients + share * (wanted - flat).reshape(here.coefficients.shape)
            try:
                accepted = at(c, derivatives=False)
            except SimulationError:
                accepted = None
            if accepted is not None and value(accepted) < reached[-1]:
                break
            share, accepted = 0.5 * share, None
        if accepted is None and here.exact:
            break
        if accepted is None:
            here = at(here.coefficients)
            continue
        reached.append(value(accepted))
        decrease = reached[-2] - reached[-1]
        little = decrease < enough * abs(reached[-2])
        converged = little and here.exact
        keep = converged or (not little and decrease > SAME_DERIVATIVES * predicted)
        here = replace(accepted, J=here.J, exact=False) if keep else at(accepted.coefficients)
        if after is not None and (converged or here.exact):
            after(here, iterations if converged else k + 1)
        if converged:
            break
    return Fit(here, reached, converged)
