"""Newton's method on a potential under the rows of joints."""

import math
from functools import partial

import numpy as np

from sim.errors import NotConverged
from sim.integrators.incremental import PotentialOfMoves
from sim.integrators.joint_equations import (
    Conditions,
    Reduced,
    conditions,
    curvature,
    factorise,
    reduced,
)
from sim.integrators.newton import (
    Iteration,
    Point,
    Tolerances,
    Trial,
    error_left,
    line_search,
    rounding_of,
)
from sim.integrators.newton_factor import Key
from sim.integrators.workspace import Workspace
from sim.linear import NotPositiveDefinite
from sim.state import Array
from sim.vectors import dot

NOISE = 1e-5
"""Share of the forces below which a change of the gradient contains no information on the stiffness."""

FARTHEST = 0.5
"""Largest motion of bodies in an iteration [m, rad], beyond which the model is not used."""


def minimise_joined(
    potential: PotentialOfMoves,
    point: Point,
    work: Workspace,
    key: Key,
    tolerances: Tolerances,
    until: float,
) -> tuple[Point, Iteration]:
    """Minimum of a potential under the rows of joints, from a start with det F > 0.

    Each iteration solves A dx = -g + G'f, G dx + r + C f = 0 for the motion and the forces of rows. Rows
    act on a few velocities only, to which the factor of A reduces the equations; a multiple of the unit
    matrix, added there before A is factorised, is subtracted again from the reduced matrix, so that A
    may be singular for motions that joints prevent. The forces between iterates are those that leave
    least of the gradient (Nocedal and Wright, Numerical Optimization, equation 18.21).

    Raises NotConverged if the tolerances were not met, or no step lowers the Lagrangian; SingularSystem
    if the matrix could not be factorised.
    """
    rows = potential.system.rows
    assert rows is not None  # Callers check that the scene has joints.
    columns, residuals, last, shortest = rows.columns, list[float](), np.inf, 1.0
    factorisations = shifts = age = 0
    now = conditions(potential, point.d)
    active, new = now.r < 0.0, np.zeros(len(now.r))

    def renew() -> None:
        nonlocal factorisations, shifts, age
        try:
            more = factorise(potential, point, columns, key, work)
        except NotPositiveDefinite as error:
            reason = "the matrix remains indefinite for any shift"
            raise NotConverged(tuple(residuals), until, reason) from error
        factorisations, shifts, age = factorisations + 1 + more, shifts + more, 0

    # an older factor of an equilibrium has an unknown multiple of the unit matrix
    made_here = potential.duration == math.inf or not work.newton.belongs_to(key)
    if made_here:
        renew()
    closed = potential.point(point.d + reduced(potential, columns, work).restored(now))
    if closed.here.smallest_J > 0.0:  # the Lagrangian decreases from where rows are closed
        point, now = closed, conditions(potential, closed.d)
    for iteration in range(1, tolerances.max_iterations + 1):
        solver, start = reduced(potential, columns, work), potential.at(point)
        if potential.duration == math.inf:
            solver = solver.bent(curvature(potential, point.d, now, start.g[columns]))
        f = solver.multipliers(now, point.g, active)
        before = now.lagrangian(point.g, f)
        move, new = solver.step(now, before, f)
        found = _search(potential, start, now, f, move, solver)
        contraction, age = np.inf, age + 1
        if found is None and made_here:
            if not (residuals and tolerances.met(float(np.abs(move).max()), residuals[-1])):
                raise NotConverged(tuple(residuals), until, "no step lowers the potential")
            found = 0.0, point, now
        if found is not None:
            (length, end, after), active = found, new > 0.0
            f = solver.multipliers(after, end.g, active)
            left_over = after.lagrangian(end.g, f)
            told = float(np.abs(before).max()) > NOISE * float(np.abs(point.g).max())
            if (
                told and potential.sigma == 0.0
            ):  # else updates would not be of the factorised matrix
                work.newton.secants.learn(end.d - point.d, left_over - before)
            residuals.append(float(np.abs(left_over).max()))
            if length == 1.0 and len(residuals) > 1:
                contraction = residuals[-1] / residuals[-2]
            moved, shortest = length * float(np.abs(move).max()), min(shortest, length or 1.0)
            left, last = error_left(moved, last), moved
            point, now = end, after
            shut = float(now.broken.max(initial=0.0)) <= tolerances.tolerance
            if shut and tolerances.met(left, residuals[-1]):
                potential.reaction, potential.held = f, partial(solver.held, now, f)
                went = Iteration(iteration, factorisations, residuals[-1], left, shortest, shifts)
                return point, went
        slow = np.inf > contraction > tolerances.keep_factor and age >= potential.patience
        made_here = found is None or slow or found[0] < 1.0
        if made_here:
            renew()
    raise NotConverged(tuple(residuals), until, f"limit of {tolerances.max_iterations} iterations")


def _search(
    potential: PotentialOfMoves,
    start: Point,
    now: Conditions,
    f: Array,
    move: Array,
    solver: Reduced,
) -> tuple[float, Point, Conditions] | None:
    """Longest tried step with det F > 0 and sufficient decrease of the Lagrangian, with its rows closed.

    Rows of velocities have no potential; the Lagrangian phi - f . G d with the forces and derivatives of
    this iterate has the exact gradient there, as the quadratic of `VaryingInertia`. Yielding rows add
    (G d)^2/(2 C).
    """
    columns, soft = now.rows.columns, now.compliance > 0.0

    def borne(d: Array) -> tuple[float, float]:
        along, way = now.G @ (d - start.d)[columns], now.G @ move[columns]
        yielding = along[soft] / now.compliance[soft]
        energy = 0.5 * float(yielding @ along[soft]) - float(f @ along)
        return energy, float(yielding @ way[soft]) - float(f @ way)

    slope = dot(now.lagrangian(start.g, f), move)
    force = float(np.abs(f[~soft]).max(initial=0.0))
    rounding = rounding_of(start.phi, start.here.energy)

    def trial(length: float) -> Trial[tuple[Point, Conditions]]:
        d = start.d + length * move
        end = potential.point(d + solver.restored(conditions(potential, d)))
        there, (energy, pull) = conditions(potential, end.d), borne(end.d)
        # rows that are still open change the Lagrangian by their forces times the openings
        closing = force * float(there.broken.sum() + now.broken.sum())
        change = end.phi - start.phi + energy
        change -= min(max(change, 0.0), closing)
        return Trial((end, there), end.here.smallest_J, change, dot(end.g, move) + pull)

    farthest = float(np.abs(move[columns]).max())
    found = line_search(trial, slope, rounding, FARTHEST / max(farthest, FARTHEST))
    return None if found is None else (found[0], *found[1])
