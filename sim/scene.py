"""Scene: a sum of frozen parts, compiled to a `sim.system.System`.

This module contains the interfaces of the parts. A new term, damping or reduction is a new class in
a new file, without changes elsewhere. Arguments outside their range, or that do not fit each other
or, on compiling, the mesh, raise `SceneError`.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from sim.bodies import Body
from sim.checks import real_numbers
from sim.described import Described, listed
from sim.joints.contract import Joint
from sim.kinematics.members import Member
from sim.linear.contract import LowRankTerm
from sim.mesh import Mesh
from sim.pattern import Index, SymmetricPattern
from sim.state import Array, Control

if TYPE_CHECKING:
    from sim.multibody import PointForces


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


class CompiledTerm:
    """Base class of compiled terms: forces at positions q, and what else a term may have.

    A subclass defines `add`, and those of the other methods that it needs. A method that no term of a
    scene defines is never called (`having`).
    """

    def add(self, q: Array, control: Control, f: Array, K: Array | None = None) -> Contribution:
        """F += force [N] at positions q, both (n_nodes, 3) [m], and K += -df/dq [N/m], if given.

        K are values of the pattern.
        """
        return Contribution(0.0)

    def smallest_J(self, q: Array) -> tuple[float, int]:
        """Smallest det F at the Gauss points of the term, and its element."""
        return float("inf"), -1

    def add_damping(self, q: Array, control: Control, D: Array) -> None:
        """D += -df/dv [N s/m] of forces -D(q) v, in the values of the pattern."""

    def add_rate_force(self, q: Array, v: Array, control: Control, f: Array, D: Array) -> None:
        """Add forces that are a nonlinear function of the velocities.

        F += force [N] at velocities v (n_nodes, 3) [m/s], and D += -df/dv [N s/m] in the values of the
        pattern, positive semi-definite; the force is zero for v = 0.
        """

    def product(self, q: Array) -> LowRankTerm:
        """Matrix-free product that the stiffness has in addition to that of `add`."""
        raise NotImplementedError

    def add_preconditioner_values(self, q: Array, K: Array) -> None:
        """Add an approximation of the product on the pattern, for the preconditioner."""

    def nodes_of_muscle(self, muscle: int) -> Index:
        """Nodes on which the activation of a muscle of the scene has an effect."""
        raise NotImplementedError

    def weights(self, control: Control) -> Array:
        """Multiples of the passive moduli, by element, that the activation adds [1].

        The end of a step is then not affine in the activation, even with a constant matrix.
        """
        raise NotImplementedError

    def during(self, q: Array, memory: Array | None, h: float) -> "CompiledTerm":
        """Term over one step, if its force depends on the history; outside a step it is relaxed.

        The step starts at positions q (n_nodes, 3) [m] with the result of `remember` for the previous
        step, or None for a fully relaxed term; its length h is infinite for a static equilibrium [s].
        """
        return self

    def remember(self, q: Array) -> Array:
        """Memory of a step that ends at positions q, as a new array, of a term `during` a step."""
        raise NotImplementedError

    def add_to(self, forces: "PointForces") -> None:
        """Add the forces of the term to the tables of fused steps of bodies."""
        raise NotImplementedError


class Term:
    """Base class of terms, the sources of force; a subclass defines `compile`."""

    def compile(self, layout: Layout) -> CompiledTerm:
        """Compile the term for a scene."""
        raise NotImplementedError

    def pair_keys(self, mesh: Mesh) -> Index:
        """Node pairs ``a * n_nodes + b``, a <= b, coupled by the stiffness; none by default."""
        return np.empty(0, dtype=np.int64)

    def node_mass(self, mesh: Mesh) -> Array:
        """Lumped mass (n_nodes,) [kg]; none by default."""
        return np.zeros(mesh.n_nodes)

    def muscle_names(self) -> tuple[str, ...]:
        """Names of muscles that an activation drives, unique within the scene."""
        return ()

    def sparse(self) -> "Term":
        """Term with the same forces that has a `product` when compiled, or the term itself."""
        return self

    def without_contact_entries(self) -> "Term":
        """Contact without entries for its rows in the matrix of points; other terms themselves."""
        return self


AnyTerm = TypeVar("AnyTerm", Term, CompiledTerm)


def having(terms: Iterable[AnyTerm], method: str) -> tuple[AnyTerm, ...]:
    """Those terms whose class defines a method of its base class."""
    base = (getattr(Term, method, None), getattr(CompiledTerm, method, None))
    return tuple(term for term in terms if getattr(type(term), method) not in base)


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
@real_numbers
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
        fixed = len({(int(n), axis) for a in members for n in a.nodes for axis in a.axes})
        facts["fixed"] = f"{fixed} of {3 * self.mesh.n_nodes} unknowns"
        facts["damping"] = type(self.damping).__name__ if self.damping else "none"
        if self.constraints:
            facts["conditions"] = listed(self.constraints)
        if self.joints:
            facts["joints"] = listed(self.joints)
        if self.bodies:
            facts["bodies"] = ", ".join(body.name for body in self.bodies)
        return facts


NO_TISSUE = Mesh(np.empty((0, 3)), ())  #: mesh of a scene without tissue
