"""Compiled scene: sums of forces and tangents of all terms, and matrices over independent velocities."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np

from sim.constraints.union import Constraints
from sim.contact.compiled import CompiledContact
from sim.described import Described
from sim.errors import ControlError
from sim.joints.compiled import CompiledJoints
from sim.kinematics import Kinematics
from sim.linear.contract import LowRankTerm, Matrix, merged, symmetric_product
from sim.mesh import Mesh
from sim.multibody import Multibody, lay_out_multibody
from sim.pattern import Sparsity, SymmetricPattern
from sim.recipe import digest_of, names_of
from sim.scene import (
    CompiledDamping,
    CompiledTerm,
    Contribution,
    Index,
    Scene,
    having,
)
from sim.state import Array, Control, Evaluation, Pose, State


class CompiledOnUse(Protocol):
    """A system that is compiled when it is first used."""

    @property
    def system(self) -> "System":
        """The compiled system."""
        ...


@dataclass(frozen=True, eq=False, repr=False)
class System(Described):
    """Compiled scene."""

    scene: Scene
    mesh: Mesh  #: that of the scene with its points
    node_mass: Array  #: (n_points,) [kg]
    #: sparsity of the tangents that terms add to, over the components of points that move
    point_pattern: SymmetricPattern
    kinematics: Kinematics  #: maps between points and independent velocities
    terms: tuple[CompiledTerm, ...]  #: compiled terms
    muscles: tuple[str, ...]  #: names, the order of every activation
    constraints: Constraints | None = None  #: all conditions of the scene on its free unknowns
    rows: CompiledJoints | None = None  #: those of all joints
    #: the same mechanics with a part of the tangents as products, if a term supports them
    sparse: "System | None" = None
    damping_law: CompiledDamping | None = None
    #: the same mechanics with entries for contact rows in the matrix, if there is contact of tissue
    with_rows: "CompiledOnUse | None" = None
    _in_step: bool = False

    @property
    def pattern(self) -> Sparsity:
        """Sparsity of the matrices of a step, over independent velocities."""
        return self.kinematics.pattern

    @property
    def free(self) -> Index:
        """Components that move, indices among 3 n_points."""
        return self.point_pattern.free

    @property
    def mass(self) -> Array:
        """Scale of the mass of each independent velocity (n,) [kg, kg m^2]."""
        return self.kinematics.mass

    def facts(self) -> dict[str, str]:
        """Facts of the scene, with its mass, muscles and size of the matrix."""
        return {
            **self.scene.facts(),
            "mass": f"{1e3 * float(self.node_mass.sum()):.4g} g",
            "muscles": str(len(self.muscles)),
            "unknowns": f"{len(self.free)}, matrix of {len(self.pattern.indices)} entries",
            **({"steps not fused": self.not_fused} if self.not_fused else {}),
        }

    @property
    def multibody(self) -> Multibody | None:
        """Tables for the fused steps of a scene of rigid bodies without tissue, otherwise None."""
        return self._fused[0]

    @property
    def not_fused(self) -> str:
        """Reason for which the steps of a scene of bodies without tissue are not fused, or no text."""
        return self._fused[1]

    @cached_property
    def _fused(self) -> tuple[Multibody | None, str]:
        scene = self.scene
        if scene.constraints or self.damping_law is not None:
            only_bodies = scene.bodies and not scene.mesh.n_nodes  # reduced tissue has none
            return None, "the scene has damping of tissue, but no tissue" if only_bodies else ""
        names = self._memory_names
        return lay_out_multibody(
            self.kinematics, self.mesh.X, scene.bodies, self.terms, self.rows, names
        )

    def rest_state(self) -> State:
        """Rest positions at t = 0, with prescribed velocities only."""
        still, kinematics = np.zeros(self.pattern.n), self.kinematics
        start = Pose(self.mesh.X, kinematics.rest_frames, 0.0)
        return kinematics.state(kinematics.advance(start, still, 0.0), still, {})

    def during(self, state: State, h: float) -> "System":
        """System over a step of length h [s] (infinite: to static equilibrium) from a state.

        Its forces, tangents and energies are those at the end of the step; without history-dependent
        terms it is this system itself. The energy is the contribution of the terms to the potential of
        the step, which differs from the stored energy by the dissipation.
        """
        if not self._history:
            return self
        rows = zip(self.terms, self._memory_names, strict=True)
        terms = tuple(term.during(state.q, state.memory.get(name), h) for term, name in rows)
        return replace(self, terms=terms, sparse=None, _in_step=True)

    # Which terms have a method is tested once, because tests take longer than a small force.

    @cached_property
    def _acting(self) -> tuple[CompiledTerm, ...]:
        """Terms with forces: contact acts by the rows of a step instead."""
        return having(self.terms, "add")

    @cached_property
    def _history(self) -> bool:
        """True if any term depends on the start of a step."""
        return bool(having(self.terms, "during"))

    @cached_property
    def contact(self) -> CompiledContact | None:
        """Contact by constraints, enforced by integrators."""
        return next((term for term in self.terms if isinstance(term, CompiledContact)), None)

    @property
    def holds_at_ends(self) -> bool:
        """True if contact or constraints hold only at the ends of steps."""
        return self.contact is not None or self.constraints is not None

    def remember(self, q: Array) -> Mapping[str, Array]:
        """Memory of all terms after a step that ends at positions q; of a system `during` a step."""
        return {name: term.remember(q) for name, term in self._remembering}

    @cached_property
    def _remembering(self) -> tuple[tuple[str, CompiledTerm], ...]:
        rows = zip(self._memory_names, self.terms, strict=True)
        return tuple((name, term) for name, term in rows if having([term], "remember"))

    @cached_property
    def _memory_names(self) -> list[str]:
        """Names of the memories of terms, which do not depend on their order."""
        return names_of(self.scene.terms)

    @cached_property
    def digest(self) -> bytes:
        """Digest of the recipe, to which states belong (`sim.recipe.digest_of`)."""
        return digest_of(self.scene)

    def force(self, q: Array, control: Control) -> Evaluation:
        """Forces and energy at positions q (n_nodes, 3) [m]."""
        f = np.zeros_like(q)
        return _total(f, [term.add(q, control, f) for term in self._acting])

    def tangent(self, q: Array, control: Control) -> tuple[Evaluation, Array]:
        """Forces and stiffness at positions q.

        Returns
        -------
        evaluation : Evaluation
        K : (point_pattern.nnz,) values of the upper triangle of -df/dq [N/m].
        """
        f, K = np.zeros_like(q), np.zeros(self.point_pattern.nnz)
        return _total(f, [term.add(q, control, f, K) for term in self._acting]), K

    @property
    def is_damped(self) -> bool:
        """Return True if any force depends on velocities."""
        bodies = any(max(b.damping) > 0.0 for b in self.scene.bodies)
        terms = self._damped_terms or self.rate_terms
        return self.damping_law is not None or bodies or bool(terms)

    @cached_property
    def rate_terms(self) -> tuple[CompiledTerm, ...]:
        """Terms with forces that are a nonlinear function of the velocities."""
        return having(self.terms, "add_rate_force")

    @cached_property
    def _damped_terms(self) -> tuple[CompiledTerm, ...]:
        return having(self.terms, "add_damping")

    def damping(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Values of the damping matrix -df/dv of the points [N s/m]; K is the stiffness, if computed."""
        if self.damping_law is None:
            values = np.zeros(self.point_pattern.nnz)
        else:
            # the stiffness of a step depends on its length; damping always uses the relaxed one
            values = self.damping_law(q, control, None if self._in_step else K)
        if self._damped_terms:
            values = values.copy()  # the matrix at rest is computed once
            for term in self._damped_terms:
                term.add_damping(q, control, values)
        return values

    def products_of_points(self, q: Array) -> tuple[LowRankTerm, ...]:
        """Matrix-free products of the points' stiffness, in addition to `tangent`."""
        return tuple(term.product(q) for term in self._with_product)

    @cached_property
    def _with_product(self) -> tuple[CompiledTerm, ...]:
        return having(self.terms, "product")

    @cached_property
    def products_at_rest(self) -> tuple[LowRankTerm, ...]:
        """The same at rest."""
        return self.products_of_points(self.mesh.X)

    @property
    def has_products(self) -> bool:
        """True if the stiffness has matrix-free products."""
        return bool(self._with_product)

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F over all terms that deform (inf if none does), and its element."""
        least = [term.smallest_J(q) for term in self._deforming]
        return min(least, key=_nan_is_worst, default=(float("inf"), -1))

    @cached_property
    def _deforming(self) -> tuple[CompiledTerm, ...]:
        return having(self.terms, "smallest_J")

    def control(self, activation: Array, t: float = 0.0) -> Control:
        """Checked control at time t [s].

        Raises
        ------
        ControlError
            Wrong length, not finite, or outside 0-1.
        """
        a = np.ascontiguousarray(activation, dtype=np.float64)
        if a.shape != (len(self.muscles),):
            raise ControlError(
                f"activation has shape {a.shape}, expected ({len(self.muscles)},), one per muscle"
            )
        bad = ~((a >= 0.0) & (a <= 1.0))
        if bad.any():
            i = int(np.argmax(bad))
            raise ControlError(
                f"activation of {self.muscles[i]} is {a[i]:g}, expected a value in 0-1: normalise it"
            )
        return Control(a, t)


def _nan_is_worst(item: tuple[float, int]) -> float:
    return item[0] if item[0] == item[0] else -np.inf


def _total(f: Array, parts: list[Contribution]) -> Evaluation:
    worst = min(((p.smallest_J, p.element) for p in parts), key=_nan_is_worst, default=(np.inf, -1))
    return Evaluation(f, sum(p.energy for p in parts), *worst)


def products(system: System, pose: Pose) -> tuple[LowRankTerm, ...]:
    """Matrix-free products of the generalised stiffness, in addition to `System.tangent`."""
    parts = system.products_of_points(pose.q)
    return tuple(system.kinematics.product(part, pose) for part in parts)


def preconditioner_values(system: System, pose: Pose) -> Array:
    """Approximation of the products, for the preconditioner."""
    K = np.zeros(system.point_pattern.nnz)
    for term in system.terms:
        term.add_preconditioner_values(pose.q, K)
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
    scaled: tuple[LowRankTerm, ...] = ()
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
    system: System, of_points: Array, products: tuple[LowRankTerm, ...], drift: Array, pose: Pose
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
    approximation = (lambda: preconditioner_values(system, pose)) if parts else None
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
        lambda: share * preconditioner_values(system, pose),
    )
