"""Scenes of the coupled models that another simulator has recorded: jaw, hyoid, tongue and face.

Bodies, muscles, springs, joints, meshes and attachments are those recorded, in millimetres and the frame
x posterior, y right, z superior; joints as of `recorded_bones`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr

import sim
from benchmarks.other_simulator import THEIR_HEX
from benchmarks.recorded_bones import (
    CONDYLES,
    TO_M,
    body_of,
    connector,
    exciters_of,
    joints_of,
    muscle_of,
    start_of,
    strip_plane,
)
from benchmarks.tongue import SHARED, published
from emgface.anatomy.head.published import import_head
from emgface.anatomy.head.tissues import HeadTissue, joined_tissues
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.published import COUPLED_DISPLACEMENT, TURN
from emgface.anatomy.tongue.scene import tongue_part
from emgface.errors import HeadError
from emgface.face.artisynth_contact import read_obj
from emgface.face.bundles import project_into_mesh
from emgface.face.contact import contact_pairings
from emgface.face.lips import lining
from emgface.face.surface import boundary_faces, triangles
from sim.contact import NodeSurface, Pairing, RigidShell
from sim.contact.surfaces import body_surfaces
from sim.scene import Term

Floats = np.ndarray
VARIANTS = {
    "jht_element": variant("elements", stiffening=1.0),
    "jht_line": variant("lines"),
    "jhtface": variant("elements", stiffening=1.0),
}
"""Tongues of the recorded models; that of elements does not stiffen there."""
CENTRE = np.array([97.2100345219, -0.0488365676447, 87.2787771481])
"""Origin of the frame of the jaw in its mesh [mm]."""
BONES = {
    "jht": ("jaw_tongue_face", "ubcjaw_symmetric_teethsmoothed", "ubcmaxilla_symmetric_teethsmoothed"),
    "jhtface": ("face_badin", "badinjaw", "badinmaxilla"),
}  # fmt: skip
"""Folder and surfaces of mandible and maxilla that touch tongue and face."""
GRAVITY = np.array([0.0, 0.0, -9.8])
Strips = tuple[int, int]


@dataclass(frozen=True, eq=False)
class RecordedHead:
    """A recorded model in `sim`.

    Attributes
    ----------
    scene : without the condylar joints.
    points : number of every marker and connector.
    start : (n, 3) positions of all nodes and points at the start [m].
    first : number of the first node of each tissue.
    exciters : muscles of the scene and their gains, by the name of an exciter or muscle.
    """

    model: Mapping[str, Any]
    scene: sim.Scene
    points: Mapping[str, int]
    start: Floats
    first: Mapping[str, int]
    exciters: Mapping[str, Mapping[str, float]]

    @cached_property
    def _compiled(self) -> dict[Strips, sim.System]:
        return {}

    def system(self, strips: Strips) -> sim.System:
        """System whose condyles are on the planes of two strips."""
        if strips not in self._compiled:
            guides = [
                strip_plane(self.model, name, self.points[name], k)
                for name, k in zip(CONDYLES, strips, strict=True)
            ]
            scene = replace(self.scene, joints=(*self.scene.joints, *guides))
            self._compiled[strips] = sim.compile_scene(scene)
        return self._compiled[strips]

    def strips(self, q: Floats) -> Strips:
        """Strip below each condyle at positions q (n, 3) [m]."""
        chosen = list[int]()
        for name in CONDYLES:
            c = connector(self.model, name)
            x = q[self.points[name]] @ TURN * 1e3 - c["frame_D_origin_world_mm"]
            edges = [-p["in_D"][0] for p in c["segment_points"]]
            k = int(np.searchsorted(edges, -x[0], side="right")) - 1
            chosen.append(min(max(k, 0), len(edges) - 2))
        return chosen[0], chosen[1]


def recorded_model(name: str) -> dict[str, Any]:
    """Description of a recorded model; HeadError if it is absent."""
    path = SHARED / "artisynth_reference" / "coupled" / f"model_{name}.json"
    if not path.is_file():
        raise HeadError(
            f"{path} not found: set EMGFACE_SHARED to the folder that contains artisynth_reference and "
            "artisynth_models"
        )
    return json.loads(path.read_text())


def recorded_head(
    name: str,
    *,
    contact: bool = False,
    removed: bool = False,
    at_rest: bool = False,
    gravity: Floats = GRAVITY,
) -> RecordedHead:
    """Scene of a recorded model, with `contact` of tongue and face with each other and both bones.

    Tissue that begins inside a bone keeps its depth, or is `removed` within the first steps. Nodes of
    the tongue on jaw and hyoid are attached where they begin in the recorded motions, up to 0.7 mm from
    where they are without stress, or `at_rest`.
    """
    model = recorded_model(name)
    files = SHARED / "artisynth_reference" / "coupled"
    tissues, first, attached, at_start = (
        list[HeadTissue](),
        dict[str, int](),
        dict[str, list[int]](),
        [],
    )
    arrays = dict(np.load(files / f"model_{name}.npz")) if model.get("fems") else {}
    outside, on_bone, n = np.empty((0, 3)), list[int](), 0
    rigid = model["rigid"]
    moving = {b["name"]: body_of(b) for b in rigid["bodies"] if b["dynamic"]}
    if "badinface_rest" in arrays:
        face = _face(model, arrays)
        tissues.append(face)
        first["face"], n = n, n + face.mesh.n_nodes
        at_start.append(face.mesh.X)
        attached["jaw"] = arrays["attach_badinface_to_jaw_nodes"].tolist()
        attached[""] = arrays["badinface_fixed"].tolist()
    if "tongue_rest" in arrays:
        tongue = _tongue(name)
        part = tongue_part(tongue, VARIANTS[name], before=n)
        tissues.append(HeadTissue(part.mesh, part.terms, part.damping, part.constraints))
        first["tongue"], n = n, n + part.mesh.n_nodes
        start = arrays["tongue_position_at_start"]
        at_start.append(
            start[: part.mesh.n_nodes] @ TO_M.T if len(start) and not at_rest else part.mesh.X
        )
        outside = part.points
        on_bone = [first["tongue"] + k for v in attached_nodes(tongue).values() for k in v.tolist()]
        for body, nodes in part.attached.items():
            key = body if body in moving else ""
            attached[key] = attached.get(key, []) + nodes.tolist()
    positions = list(outside)

    def add(body: str, place: Floats) -> int:
        positions.append(place @ TO_M.T)
        attached.setdefault(body if body in moving else "", []).append(n + len(positions) - 1)
        return n + len(positions) - 1

    points = {m["name"]: add(m["body"], np.array(m["position_world_mm"])) for m in rigid["markers"]}
    for c in rigid["connectors"]:
        points[c["name"]] = add(c["body"], start_of(model, c))
    terms: list[Term] = [muscle_of(m, points) for m in rigid["muscles"] if m["enabled"]]
    whole = joined_tissues(tissues)
    touching, carried = list[Pairing](), ()
    if contact:
        touching, bone, carried = _touching(
            name, model, whole.mesh, first, np.array(on_bone), n + len(positions)
        )
        positions += list(bone)
    q = np.concatenate([*at_start, np.reshape(positions, (-1, 3))])
    if touching:
        how = {"initial_penetration": "removed", "removal_speed": 1.0} if removed else {}
        terms.append(sim.ConstraintContact(tuple(touching), **how))
    members = [
        sim.OnBody(body, np.array(nodes), q[nodes]) for body, nodes in attached.items() if body
    ]
    scene = sim.Scene(
        whole.mesh,
        (*whole.terms, *terms, sim.Gravity(tuple(TURN @ gravity))),
        (*members, *carried, sim.Fixed(np.sort(np.array(attached[""])))),
        whole.damping,
        whole.constraints,
        bodies=tuple(moving.values()),
        points=np.reshape(positions, (-1, 3)),
        joints=joints_of(model, points),
    )
    return RecordedHead(model, scene, points, q, first, exciters_of(model))


def _tongue(name: str) -> xr.Dataset:
    """Published tongue with the recorded fibre directions and rest shape."""
    if name != "jhtface":
        return published(SHARED, f"coupled/model_{name}", rest="rest_il01")
    tongue = published(SHARED, f"coupled/model_{name}")
    moved = {
        v: (tongue[v].dims, tongue[v].values + TURN @ COUPLED_DISPLACEMENT)
        for v in ("position", "fibre_position")
    }
    return tongue.assign(moved)


def _face(model: Mapping[str, Any], arrays: Mapping[str, Floats]) -> HeadTissue:
    """Recorded face: constant element volumes, lines along all fibres, and OOP in elements."""
    (fem,) = (f for f in model["fems"] if f["name"] == "badinface")
    X, cells = arrays["badinface_rest"] @ TO_M.T, arrays["badinface_elements"].astype(np.int64)
    wedge = cells[:, 6] < 0
    hexahedra = cells[~wedge][:, THEIR_HEX]
    mesh = sim.mesh_from_arrays(X, hex8=hexahedra, wedge6=cells[wedge][:, :6])
    number = np.empty(len(cells), dtype=np.int64)
    number[~wedge] = np.arange((~wedge).sum())
    number[wedge] = (~wedge).sum() + np.arange(wedge.sum())
    material = fem["material"]["properties"]
    tissue = sim.Material(
        sim.MooneyRivlin(1e3 * material["C10"], 1e3 * material["C20"]),
        sim.QuadraticBulk(0.0),
        1e9 * fem["density"],
    )
    names = [b["name"] for b in fem["bundles"]]
    own = [n for n in names if len(arrays[f"badinface_bundle_{n}_elements"])]
    rows = [number[arrays[f"badinface_bundle_{n}_elements"]] for n in own]
    directions = [arrays[f"badinface_bundle_{n}_directions"] @ TURN.T for n in own]
    law = sim.Generic(1e3 * fem["muscle_material"]["properties"]["maxStress"])
    muscles = sim.Muscles(
        tuple(own), np.concatenate(rows), np.repeat(np.arange(len(own)), list(map(len, rows))),
        np.concatenate(directions), law,
    )  # fmt: skip
    padded = np.full((len(cells), 8), -1)
    padded[number[~wedge]], padded[number[wedge], :6] = hexahedra, cells[wedge][:, :6]
    fibres = list[sim.LineFibre]()
    for k, n in enumerate(names):
        ends = arrays[f"badinface_bundle_{n}_fibre_points"].reshape(-1, 3) @ TO_M.T
        ends = project_into_mesh(ends, X, padded)[0].reshape(-1, 2, 3)
        force = 1e-3 * arrays[f"badinface_bundle_{n}_fibre_max_force"]
        fibres += [
            sim.LineFibre(k, segment, float(share))
            for segment, share in zip(ends, force, strict=True)
        ]
    lines = tuple(f"{n}:line" if n in own else n for n in names)
    return HeadTissue(
        mesh,
        (
            sim.Solid((tissue,), muscles=muscles),
            sim.ElementVolume(1e3 * material["bulkModulus"]),
            sim.LineMuscles(lines, fibres, sim.ConstantForce(1.0), tolerance=0.02),
        ),
        sim.Rayleigh(fem["particle_damping"], fem["stiffness_damping"]),
        (sim.HardElementVolume(),),
    )


def _touching(
    name: str,
    model: Mapping[str, Any],
    mesh: sim.Mesh,
    first: Mapping[str, int],
    attached: Floats,
    n: int,
) -> tuple[list[Pairing], Floats, tuple[sim.OnBody, ...]]:
    """Pairings of the recorded model, and points and members of the surface of the mandible.

    Faces of the tissue with a node on a bone have no contact: nothing moves them away from it.
    """
    folder, mandible, maxilla = BONES["jhtface" if name == "jhtface" else "jht"]
    (jaw,) = (b for b in model["rigid"]["bodies"] if b["name"] == "jaw")
    models = SHARED / "artisynth_models"
    vertices, faces = read_obj(models / folder / f"{mandible}.obj")
    posed = (1e3 * vertices - CENTRE) @ np.array(jaw["pose_R"]).T + jaw["pose_p"]
    points, members, surfaces = body_surfaces({"jaw": (posed @ TO_M.T, faces.astype(np.int64))}, n)
    vertices, faces = read_obj(models / folder / f"{maxilla}.obj")
    bones = surfaces["jaw"], RigidShell(vertices @ TURN.T, faces.astype(np.int64), "maxilla")
    last = first["tongue"] + 946
    cells = np.concatenate([b.nodes for b in mesh.blocks if b.nodes.shape[1] == 8])
    own = cells[((cells >= first["tongue"]) & (cells < last)).all(axis=1)]
    quads, _ = boundary_faces(own)
    corners = triangles(quads, mesh.X)
    _, which, counts = np.unique(np.sort(corners), axis=0, return_inverse=True, return_counts=True)
    # where two elements share three nodes of a face, both halves are inside the tissue
    corners = corners[counts[which.ravel()] == 1].astype(np.int64)
    loose = corners[~np.isin(corners, attached).any(axis=1)]
    tongue = NodeSurface(loose, "tongue")
    pairings = [Pairing(tongue, bone) for bone in bones]
    if "face" in first:
        face = import_head(models, ["face"]).parts["face"]
        inside = lining(face)
        inside = inside[~np.isin(inside, np.flatnonzero(face["fixed"].values)).any(axis=1)]
        soft = NodeSurface(inside, "lining of the mouth")
        pairings += [*contact_pairings(face, ("lips",)), Pairing(soft, tongue)]
        pairings += [Pairing(soft, bone) for bone in bones]
    return pairings, points, members


__all__ = ["RecordedHead", "recorded_head", "recorded_model"]
