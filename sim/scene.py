"""Scene: a sum of frozen parts, compiled to a `sim.system.System`.

This module contains the interfaces of the parts. A new term, damping or reduction is a new class in
a new file, without changes elsewhere. Arguments outside their range, or that do not fit each other
or, on compiling, the mesh, raise `SceneError`.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from sim.bodies import Body
from sim.described import Described, listed
from sim.joints.contract import Joint
from sim.kinematics.members import Member
from sim.matrix import Product
from sim.mesh import Mesh
from sim.pattern import Index, SymmetricPattern
from sim.state import Array, Control, State


@dataclass(frozen=True)
class Layout:
    """Properties of the scene that are available to terms on compilation."""

    mesh: Mesh
    node_mass: Array  #: (n_nodes,) lumped mass of all terms [kg]
    pattern: SymmetricPattern
    #: names of all muscles of the scene, the order of `Control.activation`
    muscles: tuple[str, ...]
    carriers: Index  #: (n_nodes,) body that carries each node rigidly, -1 for others


@dataclass(frozen=True)
class Contribution:
    """Energy [J] and smallest det F (with its element) of one term."""

    energy: float
    smallest_J: float = float("inf")
    element: int = -1


class CompiledTerm(Protocol):
    """Compiled term."""

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """F += force [N] at positions q, both (n_nodes, 3) [m], and K += -df/dq [N/m], if given.

        K are values of the pattern.
        """
        ...


class Term(Protocol):
    """Interface of terms, the sources of force."""

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs ``a * n_nodes + b``, a <= b, coupled by the stiffness (may be empty)."""
        ...

    def compile(self, layout: Layout) -> CompiledTerm:
        """Compile the term for a scene."""
        ...


@runtime_checkable
class HasMass(Protocol):
    """A term that has mass."""

    def node_mass(self, mesh: Mesh) -> Array:
        """Lumped mass (n_nodes,) [kg]."""
        ...


@runtime_checkable
class HasMuscles(Protocol):
    """A term with muscles that an activation drives."""

    def muscle_names(self) -> tuple[str, ...]:
        """Names of the muscles, unique within the scene."""
        ...


@runtime_checkable
class HasSparse(Protocol):
    """Term with low-rank products that can be applied matrix-free."""

    def sparse(self) -> Term:
        """Term with the same forces that is a `HasProduct` when compiled."""
        ...


@runtime_checkable
class HasProduct(CompiledTerm, Protocol):
    """Compiled term whose stiffness is that of `add` plus a matrix-free product."""

    def product(self, q: Array) -> Product:
        """The product at positions q."""
        ...

    def add_stand_in(self, q: Array, K: Array) -> None:
        """Add an approximation of the product on the pattern, for the preconditioner."""
        ...


@runtime_checkable
class Damps(Protocol):
    """A compiled term with forces -D(q) v in addition to those of its potential."""

    def add_damping(self, q: Array, control: Control, D: Array) -> None:
        """D += -df/dv [N s/m] in the values of the pattern."""
        ...


@runtime_checkable
class RateDependent(Protocol):
    """A compiled term with forces that are a nonlinear function of the velocities."""

    def add_rate_force(self, q: Array, v: Array, control: Control, f: Array, D: Array) -> None:
        """Add the forces that velocities cause.

        F += force [N] at velocities v (n_nodes, 3) [m/s], and D += -df/dv [N s/m] in the values of the
        pattern, positive semi-definite; the force is zero for v = 0.
        """
        ...


@runtime_checkable
class ActsLocally(Protocol):
    """A compiled term that knows the nodes of each muscle."""

    def nodes_of_muscle(self, muscle: int) -> Index:
        """Nodes on which the activation of a muscle of the scene has an effect."""
        ...


@runtime_checkable
class Stiffens(Protocol):
    """A compiled term whose passive moduli depend on the activation.

    The end of a step is then not affine in the activation, even with a constant matrix.
    """

    def weights(self, control: Control) -> Array:
        """Added multiples of the passive moduli, by element [1]."""
        ...


@runtime_checkable
class Deforms(Protocol):
    """A compiled term with Gauss points that can invert."""

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F at positions q, and its element."""
        ...


@runtime_checkable
class Remembers(Protocol):
    """History-dependent compiled term, whose force outside a step is the relaxed one."""

    def during(self, q: Array, memory: Array | None, h: float) -> "Remembering":
        """Term over one step.

        It starts at positions q (n_nodes, 3) [m] with the result of `Remembering.remember` for the
        previous step, or None for a fully relaxed term; its length h is infinite for a static
        equilibrium [s].
        """
        ...


@runtime_checkable
class Remembering(CompiledTerm, Protocol):
    """Term over one step, with the forces at the end of the step."""

    def remember(self, q: Array) -> Array:
        """Memory of a step that ends at positions q, as a new array."""
        ...


@runtime_checkable
class HasApart(Protocol):
    """Term whose rows may be solved apart, without entries in the matrix of points."""

    def apart(self) -> "Term":
        """Term without these entries."""
        ...


@runtime_checkable
class MeasuresContact(Protocol):
    """Compiled contact term that measures its contacts."""

    def measure(self, state: State, control: Control) -> tuple[Array, Array, Array]:
        """Number of contacts, smallest gap [m] (NaN: none) and normal force [N].

        Each of shape (n_pairings,).
        """
        ...


Stiffness = Callable[[Array, Control, Array | None], Array]
"""Values of K = -df/dq of the tissue on the pattern, at positions (n_nodes, 3) and a control.

The last argument is that of all terms, if already computed.
"""


class CompiledDamping(Protocol):
    """Compiled damping law."""

    @property
    def beta(self) -> float:
        """Coefficient of the stiffness [s]."""
        ...

    @property
    def rest(self) -> Array | None:
        """Positions (n_nodes, 3) of a constant stiffness; None if it is updated."""
        ...

    def __call__(self, q: Array, control: Control, K: Array | None = None) -> Array:
        """Values of D = -df/dv on the pattern [N s/m]; K is the stiffness there, if already computed."""
        ...


class Damping(Protocol):
    """Damping formed from the assembled mass and stiffness."""

    def compile(self, layout: Layout, stiffness: Stiffness) -> CompiledDamping:
        """Compile the law for a scene."""
        ...


class CompiledConstraint(Protocol):
    """Compiled bilateral constraints c(q) = 0."""

    #: rows of G = dc/dq: row i has the unknowns unknown[start[i]:start[i + 1]], indices among 3 n_nodes
    start: Index
    unknown: Index

    def evaluate(self, q: Array) -> tuple[Array, Array]:
        """Values c (n,) and the entries of G in the order of `unknown`."""
        ...

    def add_curvature(self, q: Array, multiplier: Array, K: Array) -> None:
        """K += sum_i multiplier_i d2c_i/dq2 in the values of the pattern; follows `evaluate(q)`."""
        ...


class Constraint(Protocol):
    """Interface of constraints, enforced by multipliers."""

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs, as of a term, coupled by the curvature of the constraint."""
        ...

    def compile(self, layout: Layout) -> CompiledConstraint:
        """Compile the constraint for a scene."""
        ...


@dataclass(frozen=True, repr=False)
class Scene(Described):
    """Scene to be simulated."""

    mesh: Mesh  #: tissue; `NO_TISSUE` for a scene without tissue
    terms: tuple[Term, ...]
    #: nodes and bodies that are fixed, attached, or have a prescribed motion
    reductions: tuple[Member, ...] = ()
    damping: Damping | None = None
    constraints: tuple[Constraint, ...] = ()
    bodies: tuple[Body, ...] = ()
    #: (k, 3) rest positions of points without mass [m], such as ends of muscles. Their numbers follow
    #: those of the nodes of the mesh and precede those of the centres of bodies; each belongs to a
    #: member
    points: Array = field(default_factory=lambda: np.empty((0, 3)))
    joints: tuple[Joint, ...] = ()

    @property
    def first_centre(self) -> int:
        """Number of the point that is the centre of the first body; the others follow."""
        return self.mesh.n_nodes + len(self.points)

    @property
    def whole(self) -> Mesh:
        """The mesh with all points and the centres of bodies."""
        if not len(self.points) and not self.bodies:
            return self.mesh
        return self.mesh.with_points(np.array([*self.points, *(b.centre for b in self.bodies)]))

    def facts(self) -> dict[str, str]:
        """Mesh, terms, fixed unknowns, damping, constraints, joints and bodies."""
        facts = {**self.mesh.facts(), "terms": listed(self.terms)}
        numbers = {body.name: b for b, body in enumerate(self.bodies)}
        members = [member.attach(self.whole, numbers) for member in self.reductions]
        held = len({(int(n), axis) for a in members for n in a.nodes for axis in a.axes})
        facts["held"] = f"{held} of {3 * self.mesh.n_nodes} unknowns"
        facts["damping"] = type(self.damping).__name__ if self.damping else "none"
        if self.constraints:
            facts["conditions"] = listed(self.constraints)
        if self.joints:
            facts["joints"] = listed(self.joints)
        if self.bodies:
            facts["bodies"] = ", ".join(body.name for body in self.bodies)
        return facts


NO_TISSUE = Mesh(np.empty((0, 3)), ())  #: mesh of a scene without tissue
