"""Compilation of a scene: masses, free unknowns, sparsity, muscles."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sim.constraints.union import unite
from sim.errors import SceneError
from sim.joints.compiled import CompiledJoints
from sim.kinematics import Kinematics, lay_out_kinematics
from sim.mesh import Mesh
from sim.scene import CompiledTerm, Layout, Scene, Term, having
from sim.state import Array, Control, Pose
from sim.system import System


def compile_scene(scene: Scene) -> System:
    """Combine the parts of a scene: masses, free unknowns, sparsity, muscles.

    Raises
    ------
    SceneError
        A free node has no mass, two muscles share a name, no node is free, or contact is declared twice.
    """
    for term in scene.terms:
        _require(term, Term)
    if len(having(scene.terms, "without_contact_entries")) > 1:
        raise SceneError("a scene has two ConstraintContact, expected one with all pairings")
    system = _compile(scene, tuple(term.without_contact_entries() for term in scene.terms))
    # the matrix of points of bodies and joints has no entries for rows of contact
    if not having(scene.terms, "without_contact_entries") or scene.bodies or scene.joints:
        return system
    return replace(system, with_rows=_WithRows(scene))


@dataclass(frozen=True, eq=False)
class _WithRows:
    """A scene whose matrix has entries for the rows of contact, compiled when it is first used."""

    scene: Scene

    @cached_property
    def system(self) -> System:
        """The compiled scene."""
        return _compile(self.scene, self.scene.terms)


def _compile(scene: Scene, declared: tuple[Term, ...]) -> System:
    """Compile a scene with its terms as `declared`, with or without entries for rows of contact."""
    mesh = scene.whole
    mass = np.zeros(mesh.n_nodes)
    mass[scene.first_centre :] = [body.mass for body in scene.bodies]
    names: list[str] = []
    for term in declared:
        mass += term.node_mass(mesh)
        names.extend(term.muscle_names())
    repeated = {name for name in names if names.count(name) > 1}
    if repeated:
        raise SceneError(f"muscle name {sorted(repeated)[0]!r} occurs twice, expected unique names")
    empty = [np.empty(0, dtype=np.int64)]
    keys = np.concatenate(
        empty + [part.pair_keys(mesh) for part in (*declared, *scene.constraints)]
    )
    pattern, kinematics = lay_out_kinematics(mesh, mass, keys, scene.bodies, scene.reductions)
    layout = Layout(mesh, mass, pattern, tuple(names), kinematics.carriers())
    terms = tuple(term.compile(layout) for term in declared)
    for term in terms:
        _require(term, CompiledTerm)
    conditions = None
    if scene.constraints:
        parts = [c.compile(layout) for c in scene.constraints]
        conditions = unite(parts, kinematics, _rest(kinematics, mesh))
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
        _sparse(scene, declared),
    )
    if scene.damping is None:
        return system
    # lines and bodies have a damping of their own
    of_bodies = having(terms, "add_to")
    pairs = zip(declared, terms, strict=True)
    lines = tuple(t for own, t in pairs if t in of_bodies and own.pair_keys(mesh).size)
    of_tissue = tuple(t for t in terms if t not in of_bodies)
    tissue, along = replace(system, terms=of_tissue), replace(system, terms=lines)

    def stiffness(q: Array, control: Control, K: Array | None = None) -> Array:
        if K is None:
            return tissue.tangent(q, control)[1]
        return K - along.tangent(q, control)[1] if lines else K

    mass = mass.copy()
    mass[scene.first_centre :] = 0.0
    damping = scene.damping.compile(replace(layout, node_mass=mass), stiffness)
    return replace(system, damping_law=damping)


def _require(term: object, base: type) -> None:
    if not isinstance(term, base):
        raise SceneError(
            f"{type(term).__name__} is no term: make it a subclass of sim.scene.{base.__name__}"
        )


def _rest(kinematics: Kinematics, mesh: Mesh) -> Pose:
    start = Pose(mesh.X, kinematics.rest_frames, 0.0)
    return kinematics.advance(start, np.zeros(kinematics.pattern.n), 0.0)


def _rows(scene: Scene, kinematics: Kinematics, mesh: Mesh) -> CompiledJoints | None:
    if not scene.joints:
        return None
    rest = _rest(kinematics, mesh)
    numbers = {body.name: b for b, body in enumerate(scene.bodies)}
    return CompiledJoints(scene.joints, numbers, kinematics, rest)


def _sparse(scene: Scene, declared: tuple[Term, ...]) -> System | None:
    """Compile the scene with matrix-free products where possible.

    Not with constraints, which require the assembled matrix.
    """
    if scene.constraints or not having(declared, "sparse"):
        return None
    terms = tuple(term.sparse() for term in declared)
    return _compile(replace(scene, terms=terms), terms)
