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
from sim.kinematics import Kinematics, Selection
from sim.matrix import Matrix, Product, merged
from sim.pattern import Sparsity, SymmetricPattern, symmetric_pattern
from sim.scene import (
    CompiledDamping,
    CompiledTerm,
    Contribution,
    Deforms,
    HasMass,
    HasMuscles,
    HasProduct,
    HasSparse,
    Index,
    Layout,
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
    node_mass : (n_points,) [kg]
    point_pattern : SymmetricPattern
        Sparsity of the tangents that terms add to, over the components of points that move.
    kinematics : Kinematics
        Maps between points and independent velocities.
    terms : compiled terms
    muscles : names, the order of every activation
    constraints : Constraints or None
        All conditions of the scene on its free unknowns.
    sparse : System or None
        The same mechanics with a part of the tangents as `products`, if a term can leave them so.
    """

    scene: Scene
    node_mass: Array
    point_pattern: SymmetricPattern
    kinematics: Kinematics
    terms: tuple[CompiledTerm, ...]
    muscles: tuple[str, ...]
    constraints: Constraints | None = None
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

    def rest_state(self) -> State:
        """Rest positions, no velocity, t = 0."""
        X = self.scene.mesh.X
        return State(0.0, X.copy(), np.zeros_like(X))

    def during(self, state: State, h: float) -> "System":
        """System over a step of length h [s] (infinite: to static equilibrium) from a state.

        Its forces, tangents and energies are those at the end of the step; without terms that
        remember it is this system itself. The energy is then the part of the step's potential that the
        terms contribute, which differs from the stored energy by what they dissipate.
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

        Not with friction (each row has three directions, and what slides turns), conditions or products.
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

        Those of the state, unless something rigid moves into them meanwhile.

        Raises
        ------
        NotConverged
            It moves too far within the step.
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
                f"{integrator} does not support contact constraints: use ConvergedEuler or "
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

    def damping(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Values of the damping matrix -df/dv of the points [N s/m]; K is the stiffness, if computed."""
        if self._damping is None:
            return np.zeros(self.point_pattern.nnz)
        # a matrix of the step depends on its length; damping takes the relaxed stiffness always
        return self._damping(q, control, None if self._in_step else K)

    def products(self, q: Array) -> tuple[Product, ...]:
        """Matrix-free products of the stiffness at q, in addition to `tangent`."""
        return tuple(term.product(q) for term in self.terms if isinstance(term, HasProduct))

    @property
    def has_products(self) -> bool:
        """True if the stiffness has matrix-free products."""
        return any(isinstance(term, HasProduct) for term in self.terms)

    def stand_in(self, q: Array) -> Array:
        """Approximation of the products at q, for the preconditioner."""
        K = np.zeros(self.point_pattern.nnz)
        for term in self.terms:
            if isinstance(term, HasProduct):
                term.add_stand_in(q, K)
        return K

    def damping_matrix(self, pose: Pose, control: Control, K: Array | None = None) -> Matrix:
        """The generalised damping matrix with its products; K is that of the points, if computed."""
        q, law = pose.q, self._damping
        values = self.damping(q, control, K)
        if law is None:
            return Matrix(self.pattern, np.zeros(self.pattern.nnz))
        values = self.kinematics.generalised_matrix(values, None, pose)
        products = self.products(q) if law.rest is None else self._products_at_rest
        return Matrix(self.pattern, values, tuple(part.scaled(law.beta) for part in products))

    @cached_property
    def _products_at_rest(self) -> tuple[Product, ...]:
        return self.products(self.scene.mesh.X)

    def stiffness_matrix(self, pose: Pose, K: Array, f: Array) -> Matrix:
        """The generalised stiffness with its products, from forces and stiffness of the points."""
        values, q = self.kinematics.generalised_matrix(K, f, pose), pose.q
        products = self.products(q)
        stand_in = (lambda: self.stand_in(q)) if products else None
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
        """M + by_damping D + by_stiffness R'KR; the values K of the points' stiffness are used up.

        Parameters
        ----------
        pose : Pose
            Of forces `here` and stiffness K.
        inertia : Pose, optional
            Of the mass, by default the same.
        """
        q, kinematics = pose.q, self.kinematics
        values = by_damping * D.values
        stiffness = kinematics.generalised_matrix(K, here.f, pose)
        np.multiply(stiffness, by_stiffness, out=stiffness)
        np.add(values, stiffness, out=values)
        kinematics.add_mass(values, pose if inertia is None else inertia)
        products = self.products(q)
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
            lambda: share * self.stand_in(q),
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
    mesh = scene.mesh
    mass = np.zeros(mesh.n_nodes)
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
    held = np.unique(np.concatenate(empty + [r.held(mesh) for r in scene.reductions]))
    keys = np.concatenate(
        empty + [part.pair_keys(mesh) for part in (*scene.terms, *scene.constraints)]
    )
    pattern = symmetric_pattern(mesh.n_nodes, keys, held)
    if pattern.n == 0:
        raise SceneError("every node is fixed, expected at least one free unknown")
    if not (mass[pattern.free // 3] > 0.0).all():
        node = int(pattern.free[np.argmin(mass[pattern.free // 3] > 0.0)] // 3)
        raise SceneError(f"free node {node} has no mass: add a solid or fix the node")
    layout = Layout(mesh, mass, pattern, tuple(names))
    terms = tuple(term.compile(layout) for term in scene.terms)
    conditions = unite([c.compile(layout) for c in scene.constraints], pattern)
    sparse = _sparse(scene, terms)
    kinematics = Selection(pattern, mass[pattern.free // 3])
    system = System(scene, mass, pattern, kinematics, terms, layout.muscles, conditions, sparse)
    if scene.damping is None:
        return system
    # a barrier is stiff only where it is touched: a damping by it would hold surfaces together
    tissue = replace(system, terms=tuple(t for t in terms if not isinstance(t, StopsMoves)))
    damping = scene.damping.compile(layout, lambda q, control: tissue.tangent(q, control)[1])
    return replace(system, _damping=damping)


def _sparse(scene: Scene, compiled: tuple[CompiledTerm, ...]) -> System | None:
    """Compile the scene with matrix-free products where possible.

    Not with a barrier, which must not be searched twice, nor with conditions, which are solved whole.
    """
    alone = scene.constraints or any(isinstance(term, StopsMoves) for term in compiled)
    if alone or not any(isinstance(term, HasSparse) for term in scene.terms):
        return None
    terms = tuple(t.sparse() if isinstance(t, HasSparse) else t for t in scene.terms)
    return compile_scene(replace(scene, terms=terms))
