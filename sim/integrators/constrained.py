"""Newton's method on a potential with constraints c = 0, (12) of docs/step.md, with a line search."""

import numpy as np

from sim.dense import dot
from sim.errors import NotConverged
from sim.integrators.contact_potential import SchurContactUnderConstraints
from sim.integrators.newton import (
    Iteration,
    Point,
    Potential,
    Tolerances,
    Trial,
    error_left,
    line_search,
    rounding_of,
)
from sim.integrators.workspace import Workspace
from sim.state import Array

CONSTRAINED_SHIFTS = 12

DIRECTION_ERROR = 0.1  #: error of a direction, relative to the tolerance of positions


def minimise_constrained(
    potential: Potential, point: Point, work: Workspace, tolerances: Tolerances, until: float
) -> tuple[Point, Iteration]:
    """Minimum of a potential on c = 0 from a start with det F > 0.

    Each iteration solves the saddle system of the Lagrangian phi + lambda . c for the step and the
    new multipliers. The matrix is shifted until it has as many negative eigenvalues as constraints,
    so that the step is a descent direction of the merit function phi + rho |c|_1, with rho above
    every multiplier; the line search requires det F > 0 and a decrease of the merit function
    (Nocedal and Wright, Numerical Optimization, 18.4).

    Raises NotConverged if the tolerances were not met, or no step length lowers the merit function;
    SingularSystem if the saddle matrix could not be factorised, because the constraints are redundant.
    """
    conditions = potential.system.constraints
    assert conditions is not None  # Callers check that the scene has constraints.
    c, slopes = conditions.evaluate(point.pose)
    multiplier = (
        work.constraints.multipliers
        if work.constraints.multipliers is not None
        else np.zeros(conditions.n)
    )
    rows = potential if isinstance(potential, SchurContactUnderConstraints) else None
    residuals: list[float] = []
    rho, shortest, factorisations, shifts, last = 0.0, 1.0, 0, 0, np.inf
    for iteration in range(1, tolerances.max_iterations + 1):
        with work.timed("tangent"):
            A = _lagrangian_matrix(potential, point, multiplier)
        error = DIRECTION_ERROR * tolerances.tolerance
        g = point.g if rows is None else rows.gradient(point)
        step, multiplier, made, more = _newton_step(potential, A, slopes, g, c, error, work)
        factorisations, shifts = factorisations + made, shifts + more
        if rows is not None:
            point, step, further = rows.under_rows(point, step, error, work)
            multiplier = multiplier + further
        rho = max(rho, 1.5 * float(np.abs(multiplier).max()))
        accepted = _search(potential, point, c, step, rho)
        if accepted is None:
            if potential.refused(work):
                continue
            raise NotConverged(tuple(residuals), until, "no step lowers the constrained potential")
        length, end = accepted
        point = end if rows is None else rows.accepted(point, end, length, work)
        shortest = min(shortest, length)
        c, slopes = conditions.evaluate(point.pose)
        G = conditions.matrix(slopes)
        residuals.append(float(np.abs(point.g + G.T @ multiplier).max()))
        size = np.sqrt(np.asarray(G.multiply(G).sum(axis=1)).ravel())
        violation = float((np.abs(c) / np.where(size > 0.0, size, 1.0)).max())
        moved = length * float(np.abs(step).max())
        left, last = error_left(moved, last), moved
        if tolerances.met(left, residuals[-1]) and violation <= tolerances.tolerance:
            work.constraints.multipliers = multiplier
            went = Iteration(iteration, factorisations, residuals[-1], left, shortest, shifts)
            return point, went
    raise NotConverged(tuple(residuals), until, f"limit of {tolerances.max_iterations} iterations")


def _lagrangian_matrix(potential: Potential, point: Point, multiplier: Array) -> Array:
    """Values of scale times the second derivative of phi + lambda . c."""
    conditions = potential.system.constraints
    assert conditions is not None
    curvature, pose = np.zeros(potential.system.point_pattern.nnz), point.pose
    conditions.evaluate(pose)
    conditions.add_curvature(pose.q, multiplier, curvature)
    return potential.matrix(point).values + potential.scale * curvature


def _newton_step(
    potential: Potential, A: Array, G: Array, g: Array, c: Array, error: float, work: Workspace
) -> tuple[Array, Array, int, int]:
    """Step, multipliers, numbers of factorisations and of shifts of the saddle system.

    The inertia of the matrix is correct; `error` [m] is the remaining error of an iterative
    solution.
    """
    scale, shifted, tau, made, saddle = potential.scale, A, 1.0, 0, work.constraints.saddle
    diagonal = potential.system.pattern.diagonal
    for shifts in range(CONSTRAINED_SHIFTS + 1):
        saddle.factorise(shifted, G)
        step, y = saddle.solve(-scale * g, -c, np.zeros(len(g)), error)
        made, convex = made + saddle.factorisations, saddle.definite
        if convex is None:
            # Without a count of negative pivots the curvature along the step decides, up to its
            # error.
            unknown = error * float(np.abs(g).sum())
            convex = dot(step, g) <= dot(y, c) / scale + unknown
        if convex or shifts == CONSTRAINED_SHIFTS:
            return step, y / scale, made, shifts
        shifted = A.copy()
        shifted[diagonal] += tau * potential.shift
        tau *= 4.0
        saddle.forget()  # only a factor of the shifted matrix yields its inertia
    raise AssertionError("unreachable: the loop returns")


def _search(
    potential: Potential, start: Point, c: Array, step: Array, rho: float
) -> tuple[float, Point] | None:
    """Longest tried step with det F > 0 and sufficient decrease of phi + rho |c|_1."""
    conditions = potential.system.constraints
    assert conditions is not None
    broken = rho * float(np.abs(c).sum())
    slope = dot(start.g, step) - broken

    def trial(length: float) -> Trial[Point]:
        end = potential.point(start.d + length * step)
        now = rho * float(np.abs(conditions.evaluate(end.pose)[0]).sum())
        return Trial(end, end.here.smallest_J, end.phi - start.phi + now - broken, None)

    rounding = rounding_of(start.phi, start.here.energy, broken)
    return line_search(trial, slope, rounding)
