"""Matrices and equation of a step over independent velocities: stiffness, damping, and mass."""

from dataclasses import dataclass, replace

import numpy as np

from sim.linear.contract import symmetric_product
from sim.matrix import Matrix, Product, merged
from sim.state import Array, Control, ControlAt, Evaluation, Line, Pose
from sim.system import System


@dataclass(frozen=True)
class Missed:
    """Data for the error estimate of a step, and for the test of its stability."""

    line: Line  #: activation over the step
    D: Matrix  #: damping [N s/m]
    here: Evaluation  #: forces at the start under the control of the end
    estimated: bool  #: True if the method has an estimate of its error
    control: ControlAt | None  #: activation at all times


@dataclass(frozen=True)
class LinearStep:
    """The equation of one step."""

    A: Matrix  #: for the velocities
    rhs: Array  #: (n_free,) right-hand side [N s]
    moves: float  #: share of the new velocity in the motion
    missed: Missed  #: what one linear solution leaves


def products(system: System, pose: Pose) -> tuple[Product, ...]:
    """Matrix-free products of the generalised stiffness, in addition to `System.tangent`."""
    parts = system.products_of_points(pose.q)
    return tuple(system.kinematics.product(part, pose) for part in parts)


def stand_in(system: System, pose: Pose) -> Array:
    """Approximation of the products, for the preconditioner."""
    K = np.zeros(system.point_pattern.nnz)
    for term in system.terms:
        term.add_stand_in(pose.q, K)
    return system.kinematics.generalised_matrix(K, None, pose)


def damping_matrix(
    system: System, pose: Pose, v: Array, control: Control, K: Array | None = None
) -> Matrix:
    """The generalised damping matrix with its products; K is that of the points, if computed.

    Forces f(v) that are nonlinear in the velocities are replaced by f(v0) + df/dv (v - v0) at given
    velocities v0 = v (n_points, 3) [m/s], with -f(v0) - D v0 in the offset. As v changes by O(h) in a
    step, the error of this force is O(h^2), and a method of second order keeps its order.
    """
    law, kinematics = system.damping_law, system.kinematics
    of_points = system.damping(pose.q, control, K)
    at_v0 = None
    if system.rate_terms:
        f, D = np.zeros_like(pose.q), np.zeros_like(of_points)
        for term in system.rate_terms:
            term.add_rate_force(pose.q, v, control, f, D)
        at_v0 = -_damped(system, D, (), v, pose) - kinematics.generalised_force(f, pose)
        of_points = of_points + D
    values = kinematics.generalised_matrix(of_points, None, pose)
    kinematics.add_damping(values)
    scaled: tuple[Product, ...] = ()
    if law is not None:
        moves = law.rest is None
        of_terms = system.products_of_points(pose.q) if moves else system.products_at_rest
        parts = (kinematics.product(part, pose) for part in of_terms)
        scaled = tuple(part.scaled(law.beta) for part in parts)
    offset, drift = None, kinematics.drift(pose, control.t)
    if drift is not None:
        offset = _damped(system, of_points, scaled, drift, pose)
    if at_v0 is not None:
        offset = at_v0 if offset is None else offset + at_v0
    return Matrix(system.pattern, values, scaled, offset=offset)


def _damped(
    system: System, of_points: Array, products: tuple[Product, ...], drift: Array, pose: Pose
) -> Array:
    """Generalised damping force (n,) of velocities of the points (n_points, 3)."""
    f, v = np.zeros(drift.size), drift.reshape(-1)[system.free]
    f[system.free] = symmetric_product(system.point_pattern, of_points, v)
    for part in products:
        f[system.free] += replace(part, R=None).times(v)
    return system.kinematics.generalised_force(f.reshape(-1, 3), pose)


def stiffness_matrix(system: System, pose: Pose, K: Array, f: Array) -> Matrix:
    """The generalised stiffness with its products, from forces and stiffness of the points."""
    values = system.kinematics.generalised_matrix(K, f, pose)
    parts = products(system, pose)
    approximation = (lambda: stand_in(system, pose)) if parts else None
    return Matrix(system.pattern, values, parts, approximation)


def implicit_matrix(
    system: System,
    pose: Pose,
    here: Evaluation,
    K: Array,
    D: Matrix,
    by_damping: float,
    by_stiffness: float,
    inertia: Pose | None = None,
) -> Matrix:
    """M + by_damping D + by_stiffness R'KR; the values K of the points' stiffness are overwritten.

    `pose` is that of the forces `here` and the stiffness K, and `inertia` that of the mass, by default
    the same.
    """
    kinematics = system.kinematics
    values = by_damping * D.values
    stiffness = kinematics.generalised_matrix(K, here.f, pose)
    np.multiply(stiffness, by_stiffness, out=stiffness)
    np.add(values, stiffness, out=values)
    kinematics.add_mass(values, pose if inertia is None else inertia)
    parts = products(system, pose)
    if not parts:
        return Matrix(system.pattern, values)
    beta = 0.0 if system.damping_law is None else system.damping_law.beta
    share = by_damping * beta + by_stiffness
    return Matrix(
        system.pattern,
        values,
        merged(
            [
                *(part.scaled(by_stiffness) for part in parts),
                *(part.scaled(by_damping) for part in D.products),
            ]
        ),
        lambda: share * stand_in(system, pose),
    )
