"""Compiled scene: layout, sparsity, mass, and sums of forces and tangents of all terms."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim.constraints.union import Constraints, unite
from sim.contact.compiled import CompiledContact
from sim.contact.constraint import ConstraintContact, RowsApart
from sim.described import Described
from sim.errors import ControlError, SceneError
from sim.joints.compiled import Rows
from sim.kinematics import Kinematics, lay_out_kinematics
from sim.linear.contract import symmetric_product
from sim.matrix import Matrix, Product, merged
from sim.mesh import Mesh
from sim.multibody import Multibody, lay_out_multibody
from sim.pattern import Sparsity, SymmetricPattern
from sim.scene import (
    CompiledDamping,
    CompiledTerm,
    Contribution,
    Damps,
    Deforms,
    HasMass,
    HasMuscles,
    HasProduct,
    HasSparse,
    Index,
    Layout,
    MeasuresContact,
    Remembering,
    Remembers,
    Scene,
    StopsMoves,
)
from sim.state import Array, Control, Evaluation, Pose, State


@dataclass(frozen=True, eq=False, repr=False)
class System(Described):
    """Compiled scene.

    Attributes
    ----------
    scene : Scene
    mesh : Mesh
        That of the scene with its points.
    node_mass : (n_points,) [kg]
    point_pattern : SymmetricPattern
        Sparsity of the tangents that terms add to, over the components of points that move.
    kinematics : Kinematics
        Maps between points and independent velocities.
    terms : compiled terms
    muscles : names, the order of every activation
    constraints : Constraints or None
        All conditions of the scene on its free unknowns.
    rows : Rows or None
        Those of all joints.
    sparse : System or None
        The same mechanics with a part of the tangents as `products`, if a term supports them.
    """

    scene: Scene
    mesh: Mesh
    node_mass: Array
    point_pattern: SymmetricPattern
    kinematics: Kinematics
    terms: tuple[CompiledTerm, ...]
    muscles: tuple[str, ...]
    constraints: Constraints | None = None
    rows: Rows | None = None
    sparse: "System | None" = None
    _damping: CompiledDamping | None = None
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
        }

    @cached_property
    def multibody(self) -> Multibody | None:
        """Tables for the fused steps of a scene of rigid bodies without tissue, otherwise None."""
        scene = self.scene
        if scene.constraints or self._damping is not None:
            return None
        return lay_out_multibody(self.kinematics, self.mesh.X, scene.bodies, self.terms, self.rows)

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
        if not any(isinstance(term, Remembers | StopsMoves) for term in self.terms):
            return self
        names = self._memory_names()
        terms = tuple(_over(*row, state, h) for row in zip(self.terms, names, strict=True))
        return replace(self, terms=terms, sparse=None, _in_step=True)

    @cached_property
    def stops(self) -> tuple[StopsMoves, ...]:
        """Terms that limit steps."""
        return tuple(term for term in self.terms if isinstance(term, StopsMoves))

    @cached_property
    def contact(self) -> CompiledContact | None:
        """Contact by constraints, enforced by integrators."""
        return next((term for term in self.terms if isinstance(term, CompiledContact)), None)

    @cached_property
    def apart(self) -> "System | None":
        """Same system without entries for contact rows, if they can be solved separately.

        Not with friction, because each row then has three directions and sliding directions change,
        nor with constraints or products.
        """
        contact = self.contact
        if contact is None or contact.rubs or self.scene.constraints or self.has_products:
            return None
        if not contact.in_matrix:
            return self
        terms = self.scene.terms
        alone = (RowsApart(contact) if isinstance(t, ConstraintContact) else t for t in terms)
        return compile_scene(replace(self.scene, terms=tuple(alone)))

    @property
    def holds_at_ends(self) -> bool:
        """True if contact or constraints hold only at the ends of steps."""
        return bool(self.stops) or self.contact is not None or self.constraints is not None

    def largest_step(self, q0: Array, q1: Array, control: Control) -> float:
        """Largest fraction in (0, 1] of the displacement from q0 to q1 allowed by all terms."""
        return min((term.largest_step(q0, q1, control) for term in self.stops), default=1.0)

    def carried(self, state: State, control: Control) -> Array:
        """Feasible start positions of a step for the control at its end.

        Those of the state, unless a rigid surface moves into them.

        Raises
        ------
        NotConverged
            The surface moves too far within the step.
        """
        q = state.q
        for term in self.stops:
            q = term.carried(q, state.t, control)
        return q

    def require_passable(self, integrator: str) -> None:
        """Refuse terms that limit steps.

        Raises
        ------
        SceneError
            There is one.
        """
        if self.stops:
            raise SceneError(
                f"{integrator} has no line search, which the barrier of the scene requires: "
                "use an iterative integrator (ConvergedEuler), or ConstraintContact"
            )

    def require_no_contact(self, integrator: str) -> None:
        """Refuse contact by constraints.

        Raises
        ------
        SceneError
            There is one.
        """
        if self.contact is not None:
            raise SceneError(
                f"{integrator} does not support contact constraints: use Sdirk2, ConvergedEuler or "
                "LinearlyImplicitEuler"
            )

    def remember(self, q: Array) -> Mapping[str, Array]:
        """Memory of all terms after a step that ends at positions q; of a system `during` a step."""
        return {
            name: term.remember(q)
            for name, term in zip(self._memory_names(), self.terms, strict=True)
            if isinstance(term, Remembering)
        }

    def _memory_names(self) -> list[str]:
        return [f"{type(term).__name__}[{i}]" for i, term in enumerate(self.scene.terms)]

    def force(self, q: Array, control: Control) -> Evaluation:
        """Forces and energy at positions q (n_nodes, 3) [m]."""
        f = np.zeros_like(q)
        return _total(f, [term.add_force(q, control, f) for term in self.terms])

    def tangent(self, q: Array, control: Control) -> tuple[Evaluation, Array]:
        """Forces and stiffness at positions q.

        Returns
        -------
        evaluation : Evaluation
        K : (point_pattern.nnz,) values of the upper triangle of -df/dq [N/m].
        """
        f, K = np.zeros_like(q), np.zeros(self.point_pattern.nnz)
        return _total(f, [term.add_tangent(q, control, f, K) for term in self.terms]), K

    @property
    def is_damped(self) -> bool:
        """Return True if any force depends on velocities."""
        bodies = any(max(b.damping) > 0.0 for b in self.scene.bodies)
        return self._damping is not None or bodies or bool(self._damped_terms)

    @cached_property
    def _damped_terms(self) -> tuple[Damps, ...]:
        return tuple(term for term in self.terms if isinstance(term, Damps))

    def damping(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Values of the damping matrix -df/dv of the points [N s/m]; K is the stiffness, if computed."""
        values = np.zeros(self.point_pattern.nnz)
        if self._damping is not None:
            # the stiffness of a step depends on its length; damping always uses the relaxed one
            values = self._damping(q, control, None if self._in_step else K)
        if self._damped_terms:
            values = values.copy()  # the matrix at rest is computed once
            for term in self._damped_terms:
                term.add_damping(q, control, values)
        return values

    def products(self, pose: Pose) -> tuple[Product, ...]:
        """Matrix-free products of the generalised stiffness, in addition to `tangent`."""
        return self._generalised(self._products_of_points(pose.q), pose)

    def _products_of_points(self, q: Array) -> tuple[Product, ...]:
        return tuple(term.product(q) for term in self.terms if isinstance(term, HasProduct))

    @cached_property
    def _products_at_rest(self) -> tuple[Product, ...]:
        return self._products_of_points(self.mesh.X)

    def _generalised(self, parts: tuple[Product, ...], pose: Pose) -> tuple[Product, ...]:
        return tuple(self.kinematics.product(part, pose) for part in parts)

    @property
    def has_products(self) -> bool:
        """True if the stiffness has matrix-free products."""
        return any(isinstance(term, HasProduct) for term in self.terms)

    def stand_in(self, pose: Pose) -> Array:
        """Approximation of the products, for the preconditioner."""
        K = np.zeros(self.point_pattern.nnz)
        for term in self.terms:
            if isinstance(term, HasProduct):
                term.add_stand_in(pose.q, K)
        return self.kinematics.generalised_matrix(K, None, pose)

    def damping_matrix(self, pose: Pose, control: Control, K: Array | None = None) -> Matrix:
        """The generalised damping matrix with its products; K is that of the points, if computed."""
        law, kinematics = self._damping, self.kinematics
        of_points = self.damping(pose.q, control, K)
        values = kinematics.generalised_matrix(of_points, None, pose)
        kinematics.add_damping(values)
        products: tuple[Product, ...] = ()
        if law is not None:
            rest = self._products_at_rest if law.rest is not None else None
            parts = self.products(pose) if rest is None else self._generalised(rest, pose)
            products = tuple(part.scaled(law.beta) for part in parts)
        offset, drift = None, kinematics.drift(pose, control.t)
        if drift is not None:
            offset = self._damped(of_points, products, drift, pose)
        return Matrix(self.pattern, values, products, offset=offset)

    def _damped(
        self, of_points: Array, products: tuple[Product, ...], drift: Array, pose: Pose
    ) -> Array:
        """Generalised damping force (n,) of velocities of the points (n_points, 3)."""
        f, v = np.zeros(drift.size), drift.reshape(-1)[self.free]
        f[self.free] = symmetric_product(self.point_pattern, of_points, v)
        for part in products:
            f[self.free] += replace(part, R=None).times(v)
        return self.kinematics.generalised_force(f.reshape(-1, 3), pose)

    def stiffness_matrix(self, pose: Pose, K: Array, f: Array) -> Matrix:
        """The generalised stiffness with its products, from forces and stiffness of the points."""
        values = self.kinematics.generalised_matrix(K, f, pose)
        products = self.products(pose)
        stand_in = (lambda: self.stand_in(pose)) if products else None
        return Matrix(self.pattern, values, products, stand_in)

    def implicit_matrix(
        self,
        pose: Pose,
        here: Evaluation,
        K: Array,
        D: Matrix,
        by_damping: float,
        by_stiffness: float,
        inertia: Pose | None = None,
    ) -> Matrix:
        """M + by_damping D + by_stiffness R'KR; the values K of the points' stiffness are overwritten.

        Parameters
        ----------
        pose : Pose
            Of forces `here` and stiffness K.
        inertia : Pose, optional
            Of the mass, by default the same.
        """
        kinematics = self.kinematics
        values = by_damping * D.values
        stiffness = kinematics.generalised_matrix(K, here.f, pose)
        np.multiply(stiffness, by_stiffness, out=stiffness)
        np.add(values, stiffness, out=values)
        kinematics.add_mass(values, pose if inertia is None else inertia)
        products = self.products(pose)
        if not products:
            return Matrix(self.pattern, values)
        beta = 0.0 if self._damping is None else self._damping.beta
        share = by_damping * beta + by_stiffness
        return Matrix(
            self.pattern,
            values,
            merged(
                [
                    *(part.scaled(by_stiffness) for part in products),
                    *(part.scaled(by_damping) for part in D.products),
                ]
            ),
            lambda: share * self.stand_in(pose),
        )

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F over all terms that deform (inf if none does), and its element."""
        found = [term.smallest_J(q) for term in self.terms if isinstance(term, Deforms)]
        return min(found, key=_nan_is_worst, default=(float("inf"), -1))

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


def _over(term: CompiledTerm, name: str, state: State, h: float) -> CompiledTerm:
    """A term over a step of length h from a state."""
    if isinstance(term, Remembers):
        return term.during(state.q, state.memory.get(name), h)
    return term.starting(state, h) if isinstance(term, StopsMoves) else term


def _nan_is_worst(item: tuple[float, int]) -> float:
    return item[0] if item[0] == item[0] else -np.inf


def _total(f: Array, parts: list[Contribution]) -> Evaluation:
    worst = min(((p.smallest_J, p.element) for p in parts), key=_nan_is_worst, default=(np.inf, -1))
    return Evaluation(f, sum(p.energy for p in parts), *worst)


def compile_scene(scene: Scene) -> System:
    """Combine the parts of a scene: masses, free unknowns, sparsity, muscles.

    Raises
    ------
    SceneError
        A free node has no mass, two muscles share a name, no node is free, or contact is declared twice.
    """
    mesh = scene.whole
    mass = np.zeros(mesh.n_nodes)
    mass[scene.first_centre :] = [body.mass for body in scene.bodies]
    names: list[str] = []
    for term in scene.terms:
        if isinstance(term, HasMass):
            mass += term.node_mass(mesh)
        if isinstance(term, HasMuscles):
            names.extend(term.muscle_names())
    if sum(isinstance(term, ConstraintContact) for term in scene.terms) > 1:
        raise SceneError("a scene has two ConstraintContact, expected one with all pairings")
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise SceneError(f"muscle name {sorted(repeated)[0]!r} occurs twice, expected unique names")
    empty = [np.empty(0, dtype=np.int64)]
    keys = np.concatenate(
        empty + [part.pair_keys(mesh) for part in (*scene.terms, *scene.constraints)]
    )
    pattern, kinematics = lay_out_kinematics(mesh, mass, keys, scene.bodies, scene.reductions)
    layout = Layout(mesh, mass, pattern, tuple(names))
    terms = tuple(term.compile(layout) for term in scene.terms)
    apart = scene.constraints or any(isinstance(term, MeasuresContact) for term in terms)
    if (kinematics.matrix_varies or scene.joints) and apart:
        raise SceneError(
            "contact and hard volumes are not implemented for scenes with bodies, joints or "
            "attachments: leave one of the two out"
        )
    conditions = unite([c.compile(layout) for c in scene.constraints], pattern)
    sparse = _sparse(scene, terms)
    system = System(
        scene,
        mesh,
        mass,
        pattern,
        kinematics,
        terms,
        layout.muscles,
        conditions,
        _rows(scene, kinematics, mesh),
        sparse,
    )
    if scene.damping is None:
        return system
    # a barrier is stiff only in contact; damping proportional to it would hold surfaces together
    tissue = replace(system, terms=tuple(t for t in terms if not isinstance(t, StopsMoves)))
    damping = scene.damping.compile(layout, lambda q, control: tissue.tangent(q, control)[1])
    return replace(system, _damping=damping)


def _rows(scene: Scene, kinematics: Kinematics, mesh: Mesh) -> Rows | None:
    if not scene.joints:
        return None
    start = Pose(mesh.X, kinematics.rest_frames, 0.0)
    rest = kinematics.advance(start, np.zeros(kinematics.pattern.n), 0.0)
    numbers = {body.name: b for b, body in enumerate(scene.bodies)}
    return Rows(scene.joints, numbers, kinematics, rest)


def _sparse(scene: Scene, compiled: tuple[CompiledTerm, ...]) -> System | None:
    """Compile the scene with matrix-free products where possible.

    Not with a barrier, which must not be searched twice, nor with constraints, which require the
    assembled matrix.
    """
    alone = scene.constraints or any(isinstance(term, StopsMoves) for term in compiled)
    if alone or not any(isinstance(term, HasSparse) for term in scene.terms):
        return None
    terms = tuple(t.sparse() if isinstance(t, HasSparse) else t for t in scene.terms)
    return compile_scene(replace(scene, terms=terms))
