"""Import of the published coupled head from the files of a user.

The files are those of the model of Stavness et al., Coupled biomechanical modeling of the face, jaw,
skull, tongue, and hyoid bone, as distributed with ArtiSynth Models: folders `jaw_tongue_face`,
`face_badin`, `face_reference` (lists of the nodes of its sheets) and `tongue`, of which the first two
hold tables of muscles in a folder `derived`. Their frame is x posterior, y right, z superior, in metres.
"""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.head.build import moving
from emgface.anatomy.head.model import CONTACTS, FLOOR_LINES, PARTS, Head, build_lists
from emgface.anatomy.head.published_jaw import published_jaw
from emgface.anatomy.head.published_tables import HEAD_SOURCE, file_of, numbers_of, table_of
from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.published import COUPLED_DISPLACEMENT, TURN, import_tongue
from emgface.errors import HeadError
from emgface.face import landmarks
from emgface.face.ansys import read_elements, read_ids, read_nodes, solid_nodes
from emgface.face.artisynth import LIP_OPENING_IDS, MARKER_IDS
from emgface.face.artisynth_contact import read_obj
from emgface.face.bundles import elements_within, symmetric_directions
from emgface.face.model import build_face
from emgface.face.parts import (
    CENTRE,
    INNER,
    MANDIBLE,
    OUTER,
    SKULL,
    Arch,
    Bundle,
    Fibre,
    Integers,
)
from emgface.face.quality import element_centres
from emgface.muscles import MODELLED, SIDES

#: distance from a fibre within which an element belongs to a muscle [m]
ELEMENT_RADIUS: Final = 6e-3
OOP_LISTS: Final = ("7Mu", "5Ml")
"""Elements of the peripheral orbicularis oris of the coupled model: ring, layer and lip."""
FREED: Final = ("lip", "cheek", "nose", "submental", "zygomatic")
"""Lists of inner nodes that are free in the coupled model."""
FLOOR_ATTACHMENTS: Final = ("face-tongue", "face-hyoid")
_NAMES: Final = {"MENT": "MEN"}


def import_head(
    folder: str | os.PathLike[str],
    parts: Sequence[str] = PARTS,
    *,
    contacts: Sequence[str] | None = None,
    floor: bool = False,
) -> Head:
    """Import the published coupled head, in the pose of its meshes.

    Parameters
    ----------
    folder : path-like
        Folder with `jaw_tongue_face`, `face_badin`, `face_reference` and `tongue`.
    parts : of "face", "jaw", "tongue" and "hyoid". Bodies that are not named stay.
    contacts : pairs of `emgface.anatomy.head.model.CONTACTS`, by default all of the named parts.
    floor : bool
        Attach 20 nodes below the mouth to the tongue and 18 to the hyoid. The publication describes this
        and the files contain the lists, but the program does not use them.

    Returns
    -------
    Head
        Laws are those of the parameters of a simulation. Levator labii superioris (LLS), which the faces
        of this package do not have, is left out. The six-axis spring of the hyoid is represented by six
        axial springs of the same stiffness.

    Raises
    ------
    HeadError
        A part or contact is unknown, or a table cannot be read.
    FaceError, JawError, TongueError
        A file is absent or cannot be read.
    """
    named = [part for part in PARTS if part in parts]
    if not named or len(named) < len(parts):
        raise HeadError(f"parts {','.join(parts)!r}, expected names of {', '.join(PARTS)}")
    place = Path(folder)
    models = dict[str, xr.Dataset]()
    attachments = dict[str, Integers]()
    shells = dict[str, Arch]()
    if "face" in named or "tongue" in named:
        bones = _teeth(place / "face_badin")
        shells = {"mandible": bones[1], "maxilla": bones[0]}
    if "face" in named:
        models["face"] = _face(place, [shells["maxilla"], shells["mandible"]])
        for bone, name in ((MANDIBLE, "face-jaw"), (SKULL, "face-skull")):
            attachments[name] = np.flatnonzero(models["face"]["fixed"].values == bone)
        if floor:
            for name in (p for p in FLOOR_ATTACHMENTS if p.removeprefix("face-") in named):
                path = place / "face_badin" / f"{name.replace('-', '_')}_attachments.txt"
                attachments[name] = numbers_of(path)
    if "jaw" in named or "hyoid" in named:
        without = FLOOR_LINES if "tongue" in named else ()
        models["jaw"] = moving(published_jaw(place / "jaw_tongue_face"), named, without=without)
    if "tongue" in named:
        models["tongue"] = _tongue(place)
        for body, nodes in attached_nodes(models["tongue"]).items():
            attachments[f"tongue-{body}"] = nodes
        shells["palate"] = shells["maxilla"]
    wanted = [pair for pair, needs in CONTACTS.items() if set(needs) <= set(named)]
    return build_lists(
        parts=models,
        named=named,
        attachments=attachments,
        contacts=wanted if contacts is None else contacts,
        shells=shells,
        name=f"published coupled head ({', '.join(named)})",
        origin="published geometry, imported",
    )


def _tongue(place: Path) -> xr.Dataset:
    """The mesh as it is, 2 mm further back than alone."""
    tongue = import_tongue(place / "tongue")
    moved = {
        name: (
            tongue[name].dims,
            tongue[name].values + TURN @ COUPLED_DISPLACEMENT,
            tongue[name].attrs,
        )
        for name in ("position", "fibre_position")
    }
    return tongue.assign(moved)


def _teeth(place: Path) -> tuple[Arch, Arch]:
    """Maxilla and mandible, with their teeth."""
    arches = list[Arch]()
    for bone, name in ((SKULL, "badinmaxilla.obj"), (MANDIBLE, "badinjaw.obj")):
        points, triangles = read_obj(file_of(place / name))
        arches.append(Arch(bone, points @ TURN.T, triangles))
    return arches[0], arches[1]


def _face(place: Path, bones: list[Arch]) -> xr.Dataset:
    own = place / "face_badin"
    listed = read_nodes(file_of(own / "badinface_oop_csa_midsagittal.node"))
    elements = read_elements(path := file_of(own / "badinface_oop_csa_midsagittal.elem"))
    position = listed.position @ TURN.T
    solid = solid_nodes(elements, path)
    connectivity = np.where(solid > 0, solid - 1, -1)  # nodes are counted from 1 without gaps
    hexahedra = (connectivity >= 0).all(axis=1)  # in the file they are mirrored
    connectivity[hexahedra] = connectivity[hexahedra][:, [3, 2, 1, 0, 7, 6, 5, 4]]
    inner, outer = (
        read_nodes(file_of(place / "face_reference" / f"atlas_{sheet}.node")).id - 1
        for sheet in ("internal", "external")
    )
    layer = np.full(len(connectivity), CENTRE, dtype=np.int64)
    for sheet, number in ((inner, INNER), (outer, OUTER)):
        layer[np.isin(connectivity, sheet).any(axis=1)] = number
    fixed = np.zeros(len(position), dtype=np.int64)
    free = [numbers_of(own / f"{name}_free_nodes.nodenum") - 1 for name in FREED]
    fixed[np.setdiff1d(inner, np.concatenate(free))] = SKULL
    fixed[numbers_of(own / "face_jaw_attachments.txt")] = MANDIBLE
    fibres = _face_fibres(own)
    listed_oop = [read_ids(file_of(own / "oop" / f"{n}_elements.txt"), base=1) for n in OOP_LISTS]
    oop = np.flatnonzero(np.isin(elements.id, np.concatenate(listed_oop)))
    markers, opening = (np.array(ids) - 1 for ids in (MARKER_IDS, LIP_OPENING_IDS))
    return build_face(
        position=position,
        connectivity=connectivity,
        layer=layer,
        fixed=fixed,
        fibres=fibres,
        bundles=_face_bundles(fibres, element_centres(position, connectivity), oop),
        marker_node=markers,
        face_marker_position=landmarks.face_markers(position, fixed, inner, outer),
        lip_opening_node=opening,
        arches=bones,
        name="published coupled face",
        origin="published geometry, imported",
        source=HEAD_SOURCE,
        node_id=listed.id,
        element_id=elements.id,
        attrs={"muscle_radius": ELEMENT_RADIUS},
    )


def _face_fibres(place: Path) -> list[Fibre]:
    """Fibres of both sides; those of the right mirror those of the left."""
    table = table_of(
        place / "derived" / "fibres_left.csv", ["muscle", "fibre", "seq", "x_m", "y_m", "z_m"]
    )
    left = list[Fibre]()
    for (muscle, _), rows in table.groupby(["muscle", "fibre"], sort=False):
        name = _NAMES.get(str(muscle), str(muscle))
        points = rows.sort_values("seq")[["x_m", "y_m", "z_m"]].to_numpy(dtype=np.float64)
        if name in MODELLED:
            left.append(Fibre(name, points @ TURN.T))
    mirror = {"L": np.ones(3), "R": np.array([-1.0, 1.0, 1.0])}
    return [Fibre(f"{f.muscle}_{s}", f.position * mirror[s]) for s in SIDES for f in left]


def _face_bundles(fibres: list[Fibre], centres: Floats, oop: Integers) -> list[Bundle]:
    bundles = list[Bundle]()
    for muscle in MODELLED:
        both = [f.position for f in fibres if f.muscle[:-2] == muscle]
        for side in SIDES:
            own = [f.position for f in fibres if f.muscle == f"{muscle}_{side}"]
            element = (
                oop[(centres[oop, 0] < 0.0) == (side == "L")]
                if muscle == "OOP"
                else elements_within(centres, own, ELEMENT_RADIUS)
            )
            direction = symmetric_directions(centres[element], both)
            bundles.append(Bundle(f"{muscle}_{side}", element, direction))
    return bundles
