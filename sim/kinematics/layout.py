"""Layout of members and bodies of a scene as its kinematics."""

from collections.abc import Sequence

import numpy as np

from sim.bodies import Body
from sim.errors import SceneError
from sim.kinematics.articulated import Articulated
from sim.kinematics.chains import Chains, resolve
from sim.kinematics.contract import Kinematics
from sim.kinematics.members import Attachment, Member
from sim.kinematics.paths import Path
from sim.mesh import Mesh
from sim.pattern import Index, SymmetricPattern, symmetric_pattern
from sim.state import Array


def lay_out_kinematics(
    mesh: Mesh, node_mass: Array, keys: Index, bodies: Sequence[Body], members: Sequence[Member]
) -> tuple[SymmetricPattern, Kinematics]:
    """Sparsity over the points that move, and the kinematics of a scene.

    Raises SceneError if two bodies have the same name, a body has two motions, nothing is free, a free
    node has no mass, or attachments are contradictory.

    The mesh has all points, last the centres of the bodies with their mass in `node_mass` (n_points,)
    [kg]; `keys` are node pairs coupled by terms.
    """
    number = {body.name: b for b, body in enumerate(bodies)}
    if len(number) < len(bodies):
        raise SceneError(f"two of the bodies {[b.name for b in bodies]} share a name")
    attachments = [member.attach(mesh, number) for member in members]
    centres = mesh.n_nodes - len(bodies) + np.arange(len(bodies))
    attachments += [
        Attachment(f"centre of {body.name}", centres[[b]], body=b) for b, body in enumerate(bodies)
    ]
    motions = _motions(bodies, attachments)
    still = np.array([path is not None and path.motion is None for path in motions], dtype=bool)
    chains = resolve(mesh, bodies, attachments, still)
    pattern = symmetric_pattern(mesh.n_nodes, keys, np.flatnonzero(chains.fixed))
    _require_mass(chains, node_mass)
    if not bodies and not len(chains.dependent) and not chains.paths:
        _require_free(pattern.n)
        return pattern, Kinematics(pattern, node_mass)
    kinematics = Articulated(pattern, node_mass, bodies, motions, chains)
    _require_free(kinematics.pattern.n)
    return pattern, kinematics


def _motions(bodies: Sequence[Body], attachments: Sequence[Attachment]) -> list[Path | None]:
    """Prescribed motion of every body; a body without mass and without motion is fixed."""
    motions = [None if body.mass > 0.0 else Path(None) for body in bodies]
    given: set[int] = set()
    for attachment in attachments:
        if attachment.motion is not None:
            b, motion = attachment.motion
            if b in given:
                raise SceneError(f"body {bodies[b].name} has two prescribed motions: remove one")
            given.add(b)
            motions[b] = Path(motion)
    return motions


def _require_mass(chains: Chains, node_mass: Array) -> None:
    needed = ~chains.fixed.all(axis=1) & ~(node_mass > 0.0)
    needed[chains.dependent] = False
    for nodes, _ in chains.paths:
        needed[nodes] = False
    if needed.any():
        node = int(np.argmax(needed))
        raise SceneError(
            f"free node {node} has no mass: add a solid, fix the node, or attach it to a body"
        )


def _require_free(n: int) -> None:
    if n == 0:
        raise SceneError("every node is fixed, expected at least one free unknown")
