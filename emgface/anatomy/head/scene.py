"""Scene of a head: the scenes of its parts joined, with attachments and contact pairs."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial import KDTree

import sim
from emgface.anatomy.head.model import Head
from emgface.anatomy.head.tissues import HeadTissue, joined_tissues
from emgface.anatomy.jaw.scene import JawScene, jaw_scene
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.anatomy.tongue.scene import TonguePart, tongue_part
from emgface.errors import HeadError
from emgface.face.contact import contact_pairings, declared_contact
from emgface.face.lips import lining
from emgface.face.parts import MANDIBLE, Floats, Integers, facets_of
from emgface.face.recipe import DAMPING_BY_STIFFNESS, GRAVITY, compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.surface import triangles
from sim.contact import NodeSurface, Pairing, RigidShell
from sim.contact.surfaces import body_surfaces
from sim.embedding import Embedding
from sim.kinematics.members import Member
from sim.scene import Term

TONGUE = TongueParameters(sigma_max=100e3, damping_tangent="rest")
"""Tongue of a generated head: the published law with the active stress of the chapter (11.2.2.3), and
the damping of the face, whose matrix stays positive with active muscles."""
ATTACHMENT_DISTANCE, HOLDERS = 5e-3, 12
"""Largest distance of a node from the tissue that it follows [m], and number of nodes there."""
FREE_SIDES = ("dorsum", "left", "right", "front")
"""Sides of a tongue that may touch teeth and palate."""


@dataclass(frozen=True, eq=False)
class HeadScene:
    """A head in `sim`, with the number of the ``first`` node of each tissue.

    ``jaw`` is the scene of the jaw, whose points are numbered as in this one; None without moving
    bodies.
    """

    scene: sim.Scene
    first: Mapping[str, int]
    jaw: JawScene | None

    @cached_property
    def system(self) -> sim.System:
        """The compiled scene."""
        return sim.compile_scene(self.scene)


def head_scene(
    head: Head,
    *,
    face: SimulationParameters | None = None,
    tongue: TongueParameters = TONGUE,
    law: str = "peck",
    gravity: bool = True,
) -> HeadScene:
    """Join the parts of a head.

    Nodes of the face precede those of the tongue; points outside the mesh follow: those of tongue, jaw
    and teeth. A head of one part has exactly the scene of that part.

    Parameters
    ----------
    head : Head
    face : SimulationParameters, optional
        Tissue, muscles, damping and contact of the face.
    tongue : TongueParameters
    law : muscle law of the jaw, as of `jaw_scene`.
    gravity : bool

    Raises
    ------
    HeadError
        A contact needs a surface that the head does not have.
    FaceError, TongueError, JawError, SceneError, ContactFailure
        As of the parts.
    """
    p = (face or SimulationParameters()).model_copy(update={"gravity": False})
    own = p.model_copy(update={"contact": p.contact.model_copy(update={"method": "none"})})
    parts, first, n = head.parts, dict[str, int](), 0
    tissues = list[HeadTissue]()
    if "face" in parts:
        scene = compose_scene(parts["face"], own)
        tissues.append(HeadTissue(scene.mesh, scene.terms, scene.damping, scene.constraints))
        first["face"], n = n, n + scene.mesh.n_nodes
    part: TonguePart | None = None
    if "tongue" in parts:
        part = tongue_part(parts["tongue"], tongue, before=n)
        tissues.append(HeadTissue(part.mesh, part.terms, part.damping, part.constraints))
        first["tongue"], n = n, n + part.mesh.n_nodes
    points = [np.empty((0, 3)) if part is None else part.points]
    n += len(points[0])
    jaw = None
    if "jaw" in parts:
        pull = GRAVITY if gravity else (0.0, 0.0, 0.0)
        jaw = jaw_scene(parts["jaw"], law=law, gravity=pull, first=n)
        points.append(jaw.scene.points)
        n += len(jaw.scene.points)
    bodies = () if jaw is None else jaw.bodies
    teeth, surfaces = _teeth(head, bodies, n)
    members: list[Member] = [*_attached(head, part, first, bodies), *teeth[1]]
    points.append(teeth[0])
    whole = joined_tissues(tissues, DAMPING_BY_STIFFNESS[p.damping_tangent])
    terms: list[Term] = list(whole.terms)
    pairings = _pairings(head, first, surfaces)
    if pairings and p.contact.method != "none":
        terms.append(declared_contact(pairings, p))
    if jaw is not None:
        terms += jaw.scene.terms if gravity else jaw.scene.terms[1:]
        members += jaw.scene.reductions
    elif gravity:
        terms.append(sim.Gravity(GRAVITY))
    scene = sim.Scene(
        whole.mesh,
        tuple(terms),
        tuple(members),
        whole.damping,
        whole.constraints,
        bodies=() if jaw is None else jaw.scene.bodies,
        points=np.concatenate(points),
        joints=() if jaw is None else jaw.scene.joints,
    )
    return HeadScene(scene, first, jaw)


def _attached(
    head: Head, part: TonguePart | None, first: Mapping[str, int], bodies: tuple[str, ...]
) -> list[Member]:
    """Attachments of the lists, and points outside the tongue; fixed on bodies that stay."""
    attached: dict[str, list[Integers]] = {}
    members = list[Member]()
    for pair in map(str, head.lists["pair"].values):
        tissue, _, body = pair.partition("-")
        if part is not None and body == "tongue":
            members.append(_in_tissue(head, pair, first, part.mesh))
        else:
            attached.setdefault(body, []).append(head.attached(pair) + first[tissue])
    if part is not None:
        last = first["tongue"] + part.mesh.n_nodes
        for body, nodes in part.attached.items():
            attached.setdefault(body, []).append(nodes[nodes >= last])
    still = [nodes for body, own in attached.items() if body not in bodies for nodes in own]
    if still:
        members.append(sim.Fixed(np.sort(np.concatenate(still)).astype(np.int64)))
    for body, own in attached.items():
        if body in bodies:
            members.append(sim.OnBody(body, np.concatenate(own).astype(np.int64)))
    return members


def _in_tissue(head: Head, pair: str, first: Mapping[str, int], carrier: sim.Mesh) -> sim.InElement:
    """Nodes of a tissue that follow the nearest nodes of another, x = sum_a w_a x_a.

    The weights are the smallest with sum_a w_a = 1 and sum_a w_a X_a = X, so that the nodes keep their
    places at rest and follow every affine motion.
    """
    tissue, _, other = pair.partition("-")
    nodes = head.attached(pair)
    points = head.parts[tissue]["position"].values[nodes]
    neighbours = KDTree(carrier.X).query(points, HOLDERS)
    away, near = (
        np.asarray(neighbours[0], dtype=np.float64),
        np.asarray(neighbours[1], dtype=np.int64),
    )
    if (away[:, 0] > ATTACHMENT_DISTANCE).any():
        k = int(np.argmax(away[:, 0]))
        raise HeadError(
            f"attachment {pair}: node {nodes[k]} is {1e3 * away[k, 0]:.3g} mm from the {other}, "
            f"expected at most {1e3 * ATTACHMENT_DISTANCE:g} mm"
        )
    scale = away[:, -1, None, None]
    lines = np.concatenate(
        [np.ones((len(nodes), 1, HOLDERS)), np.zeros((len(nodes), 3, HOLDERS))], 1
    )
    lines[:, 1:] = ((carrier.X[near] - points[:, None]) / scale).transpose(0, 2, 1)
    weights = np.linalg.pinv(lines)[:, :, 0].astype(np.float64)
    embedding = Embedding(np.full(len(nodes), -1), near + first[other], weights)
    return sim.InElement((nodes + first[tissue]).astype(np.int64), embedding)


_Carried = tuple[Floats, tuple[sim.OnBody, ...]]


def _teeth(
    head: Head, bodies: tuple[str, ...], n: int
) -> tuple[_Carried, dict[str, NodeSurface | RigidShell]]:
    """Rigid surfaces that may touch: shells where the bone stays, otherwise points of the moving jaw."""
    used = {
        "lips-teeth": ("maxilla", "mandible"),
        "tongue-teeth": ("maxilla", "mandible"),
        "tongue-palate": ("palate",),
    }
    wanted = [s for pair in map(str, head.lists["contact"].values) for s in used.get(pair, ())]
    carried: _Carried = np.empty((0, 3)), ()
    surfaces = dict[str, NodeSurface | RigidShell]()
    for name in dict.fromkeys(wanted):
        shell = head.shell(name)
        corners = shell.triangles.astype(np.int64)
        if shell.bone == MANDIBLE and "jaw" in bodies:
            points, members, own = body_surfaces({"jaw": (shell.points, corners)}, n)
            carried = points, members
            surfaces[name] = replace(own["jaw"], name=name)
        else:
            surfaces[name] = RigidShell(shell.points, corners, name)
    return carried, surfaces


def _pairings(
    head: Head, first: Mapping[str, int], rigid: Mapping[str, NodeSurface | RigidShell]
) -> tuple[Pairing, ...]:
    contacts = [str(pair) for pair in head.lists["contact"].values]
    pairings = list[Pairing]()
    if "lip-lip" in contacts:
        pairings += contact_pairings(head.parts["face"], ("lips",))
    if "lips-teeth" in contacts:
        soft = NodeSurface(lining(head.parts["face"]), "lining of the mouth")
        pairings += [Pairing(soft, rigid[name]) for name in ("maxilla", "mandible")]
    names = [name for pair, name in _OF_TONGUE if pair in contacts]
    if names:
        own = head.parts["tongue"]
        quads = np.concatenate([facets_of(own, side) for side in FREE_SIDES])
        corners = triangles(quads, own["position"].values) + first["tongue"]
        soft = NodeSurface(corners.astype(np.int64), "tongue")
        pairings += [Pairing(soft, rigid[name]) for name in names]
    return tuple(pairings)


_OF_TONGUE = (
    ("tongue-teeth", "maxilla"),
    ("tongue-teeth", "mandible"),
    ("tongue-palate", "palate"),
)
"""Contact pairs of the tongue with the rigid surfaces of each."""
