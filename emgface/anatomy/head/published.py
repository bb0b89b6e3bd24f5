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
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.anatomy.head.build import moving
from emgface.anatomy.head.model import CONTACTS, LINES, PARTS, Head, build_lists
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import Floats, JawBody, JawJoint, JawLine, build_jaw
from emgface.anatomy.jaw.published import condylar_path
from emgface.anatomy.jaw.published_parameters import CURVE_LENGTH, CURVE_STRIPS
from emgface.anatomy.jaw.template.muscles import GROUPS
from emgface.anatomy.jaw.thinning import thinned
from emgface.anatomy.tongue.model import attached_nodes
from emgface.anatomy.tongue.published import SHIFT, TURN, import_tongue
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
from emgface.schema.rules import one_line

SOURCE: Final = (
    "Stavness et al., Coupled biomechanical modeling of the face, jaw, skull, tongue, and hyoid bone; "
    "Nazari et al. 2010; Buchaillard et al. 2009; artisynth_models, jaw_tongue_face"
)
RADIUS: Final = 6e-3  #: distance from a fibre within which an element belongs to a muscle [m]
OOP_LISTS: Final = ("7Mu", "5Ml")
"""Elements of the peripheral orbicularis oris of the coupled model: ring, layer and lip."""
FREED: Final = ("lip", "cheek", "nose", "submental", "zygomatic")
"""Lists of inner nodes that are free in the coupled model."""
FLOOR: Final = ("face-tongue", "face-hyoid")
DENSITY: Final = {"jaw": 3470.1, "hyoid": 4574.7}  #: [kg/m^3]
DAMPING: Final = {"jaw": (20.0, 2e-4), "hyoid": (10.0, 1e-4)}  #: [kg/s], [kg m^2/s]
HYOID_SPRING: Final = (1760.0, 4.123152e-2)
"""Stiffness of the spring that holds the hyoid, translation [N/m] and rotation [N m/rad]."""
_FAR: Final = 1.0  #: length of the axial springs that represent it [m]
_NAMES: Final = {"MENT": "MEN"}
_BONES: Final = {"cranium": "skull", "maxilla": "skull"}
_SURFACES: Final = {
    "jaw": "ubcjaw_symmetric_teethsmoothed.obj",
    "hyoid": "ubchyoid_symmetric.obj",
    "skull": "ubcmaxilla_symmetric_teethsmoothed.obj",
}
_POINTS: Final = {
    "lowerincisor": "lower_incisor",
    "upperincisor": "upper_incisor",
    "ltmj": "condyle_L",
    "rtmj": "condyle_R",
    "lbite": "bite_L",
    "rbite": "bite_R",
    "hyoidRef": "hyoid",
}
_BITING: Final = {"ltmj", "rtmj", "lbite", "rbite"}
_CENTRE: Final = np.array([97.2100345, -0.0488366, 87.2787771])
_CLOSED: Final = np.array([93.7687, 0.0, 92.2142]), np.radians(8.2694)
"""Centre of the mandible in its mesh [mm], and in the pose of closed teeth, with the rotation about y.
The published program places condyles and bite points where they are in that pose."""
_CANT, _SLOPE, _WALL = np.radians([8.0, 40.0, 1.0])


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
    found = dict[str, xr.Dataset]()
    attachments = dict[str, Integers]()
    shells = dict[str, Arch]()
    if "face" in named or "tongue" in named:
        bones = _teeth(place / "face_badin")
        shells = {"mandible": bones[1], "maxilla": bones[0]}
    if "face" in named:
        found["face"] = _face(place, [shells["maxilla"], shells["mandible"]])
        for bone, name in ((MANDIBLE, "face-jaw"), (SKULL, "face-skull")):
            attachments[name] = np.flatnonzero(found["face"]["fixed"].values == bone)
        if floor:
            for name in (p for p in FLOOR if p.removeprefix("face-") in named):
                path = place / "face_badin" / f"{name.replace('-', '_')}_attachments.txt"
                attachments[name] = _numbers(path)
    if "jaw" in named or "hyoid" in named:
        without = LINES if "tongue" in named else ()
        found["jaw"] = moving(_jaw(place / "jaw_tongue_face"), named, without=without)
    if "tongue" in named:
        found["tongue"] = _tongue(place)
        for body, nodes in attached_nodes(found["tongue"]).items():
            attachments[f"tongue-{body}"] = nodes
        shells["palate"] = shells["maxilla"]
    wanted = [pair for pair, needs in CONTACTS.items() if set(needs) <= set(named)]
    return build_lists(
        parts=found,
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
        name: (tongue[name].dims, tongue[name].values + TURN @ SHIFT, tongue[name].attrs)
        for name in ("position", "fibre_position")
    }
    return tongue.assign(moved)


def _teeth(place: Path) -> tuple[Arch, Arch]:
    """Maxilla and mandible, with their teeth."""
    found = list[Arch]()
    for bone, name in ((SKULL, "badinmaxilla.obj"), (MANDIBLE, "badinjaw.obj")):
        points, triangles = read_obj(_file(place / name))
        found.append(Arch(bone, points @ TURN.T, triangles))
    return found[0], found[1]


def _face(place: Path, bones: list[Arch]) -> xr.Dataset:
    own = place / "face_badin"
    listed = read_nodes(_file(own / "badinface_oop_csa_midsagittal.node"))
    elements = read_elements(path := _file(own / "badinface_oop_csa_midsagittal.elem"))
    position = listed.position @ TURN.T
    solid = solid_nodes(elements, path)
    connectivity = np.where(solid > 0, solid - 1, -1)  # nodes are counted from 1 without gaps
    hexahedra = (connectivity >= 0).all(axis=1)  # in the file they are mirrored
    connectivity[hexahedra] = connectivity[hexahedra][:, [3, 2, 1, 0, 7, 6, 5, 4]]
    inner, outer = (
        read_nodes(_file(place / "face_reference" / f"atlas_{sheet}.node")).id - 1
        for sheet in ("internal", "external")
    )
    layer = np.full(len(connectivity), CENTRE, dtype=np.int64)
    for sheet, number in ((inner, INNER), (outer, OUTER)):
        layer[np.isin(connectivity, sheet).any(axis=1)] = number
    fixed = np.zeros(len(position), dtype=np.int64)
    free = [_numbers(own / f"{name}_free_nodes.nodenum") - 1 for name in FREED]
    fixed[np.setdiff1d(inner, np.concatenate(free))] = SKULL
    fixed[_numbers(own / "face_jaw_attachments.txt")] = MANDIBLE
    fibres = _face_fibres(own)
    listed_oop = [read_ids(_file(own / "oop" / f"{n}_elements.txt"), base=1) for n in OOP_LISTS]
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
        source=SOURCE,
        node_id=listed.id,
        element_id=elements.id,
        attrs={"muscle_radius": RADIUS},
    )


def _face_fibres(place: Path) -> list[Fibre]:
    """Fibres of both sides; those of the right mirror those of the left."""
    table = _table(
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
    found = list[Bundle]()
    for muscle in MODELLED:
        both = [f.position for f in fibres if f.muscle[:-2] == muscle]
        for side in SIDES:
            own = [f.position for f in fibres if f.muscle == f"{muscle}_{side}"]
            element = (
                oop[(centres[oop, 0] < 0.0) == (side == "L")]
                if muscle == "OOP"
                else elements_within(centres, own, RADIUS)
            )
            direction = symmetric_directions(centres[element], both)
            found.append(Bundle(f"{muscle}_{side}", element, direction))
    return found


def _jaw(place: Path) -> xr.Dataset:
    """Mandible and hyoid with 14 pairs of muscles."""
    surfaces = {body: _surface(place / name) for body, name in _SURFACES.items()}
    marked = _table(place / "derived" / "markers.csv", ["name", "body", "x_mm", "y_mm", "z_mm"])
    at = {str(name): rows for name, rows in marked.set_index("name").iterrows()}
    points = {
        name: (
            _bone(at[given]["body"]),
            _biting(_mm(at[given], "")) if given in _BITING else _mm(at[given], ""),
        )
        for given, name in _POINTS.items()
    }
    muscles = _muscles(place)
    hyoid = sim.body_of_surface("hyoid", *surfaces["hyoid"], DENSITY["hyoid"])
    bodies = [JawBody("skull", moves=False)]
    for name, density in DENSITY.items():
        body = hyoid if name == "hyoid" else sim.body_of_surface(name, *surfaces[name], density)
        bodies.append(
            JawBody(name, body.mass, np.asarray(body.centre), body.inertia, DAMPING[name])
        )
    return build_jaw(
        bodies=bodies,
        muscles=muscles,
        springs=_hyoid_springs(np.asarray(hyoid.centre)),
        joints=_joints({name: x for name, (_, x) in points.items()}),
        points=points,
        exciters=exciters_of([m.name for m in muscles], GROUPS),
        surfaces=[(body, *thinned(*surface)) for body, surface in surfaces.items()],
        name="published coupled jaw and hyoid",
        origin="published geometry, imported",
        source=SOURCE,
    )


def _muscles(place: Path) -> list[JawLine]:
    ends = [f"{end}{axis}_mm" for end in "oi" for axis in "xyz"]
    columns = ["name", "origin_body", "insertion_body", *ends, "max_force_N", "opt_length_mm"]
    columns += ["max_length_mm", "tendon_ratio", "passive_fraction"]
    found = list[JawLine]()
    for _, row in _table(place / "derived" / "muscles.csv", columns).iterrows():
        line = np.array([_mm(row, "o"), _mm(row, "i")])
        length = 1e3 * float(np.linalg.norm(line[1] - line[0]))
        side = {"l": "_L", "r": "_R"}[str(row["name"])[0]]
        values = {
            "force_max": float(row["max_force_N"]),
            "stretch_opt": float(row["opt_length_mm"]) / length,
            "stretch_max": float(row["max_length_mm"] / row["opt_length_mm"]),
            "tendon_ratio": float(row["tendon_ratio"]),
            "passive_fraction": float(row["passive_fraction"]),
            "damping": 1.0,
        }
        a, b = (_bone(row[f"{end}_body"]) for end in ("origin", "insertion"))
        found.append(JawLine(str(row["name"])[1:] + side, (a, b), line, values))
    return found


def _hyoid_springs(centre: Floats) -> list[JawLine]:
    """Two long springs along each axis, r apart on both sides of the centre.

    Stiffness k/2 each adds up to k for translations, and to k r^2 for rotations about each axis.
    """
    k, turning = HYOID_SPRING
    r = float(np.sqrt(turning / k))
    found = list[JawLine]()
    for axis in range(3):
        along, beside = np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
        for sign in (1.0, -1.0):
            near = centre + sign * r * beside
            values = {"stiffness": 0.5 * k, "rest_length": _FAR, "damping": 0.0}
            found.append(
                JawLine(
                    f"hyoid {'xyz'[axis]}{'+-'[sign < 0.0]}",
                    ("hyoid", "skull"),
                    np.array([near, near + _FAR * along]),
                    values,
                )
            )
    return found


def _joints(points: dict[str, Floats]) -> list[JawJoint]:
    """Condylar paths, walls behind and beside the condyles, and bite planes."""
    forward = np.array([0.0, np.cos(_SLOPE), -np.sin(_SLOPE)])
    found = list[JawJoint]()
    for side, sign in (("_L", -1.0), ("_R", 1.0)):
        condyle, bite = points[f"condyle{side}"], points[f"bite{side}"]
        guide = {"body": "skull", "origin": condyle, "point": f"condyle{side}"}
        found.append(
            JawJoint(
                f"tmj{side}",
                "curve",
                normal=(0.0, 0.0, -1.0),
                coefficients=condylar_path(),
                length=1e-3 * CURVE_LENGTH * (1.0 - 0.5 / CURVE_STRIPS),
                one_sided=False,
                **guide,
            )
        )
        found.append(JawJoint(f"posterior{side}", "plane", normal=forward, **guide))
        inward = np.array([-sign, 0.0, 0.0])
        wall = np.cos(_WALL) * inward + np.sin(_WALL) * forward
        found.append(JawJoint(f"lateral{side}", "plane", normal=wall, **guide))
        tilted = np.array([sign * np.sin(_CANT), 0.0, -np.cos(_CANT)])
        found.append(JawJoint(f"bite{side}", "plane", "skull", bite, tilted, f"bite{side}"))
    return found


def _bone(name: object) -> str:
    return _BONES.get(str(name), str(name))


def _biting(point: Floats) -> Floats:
    """Place of a point of the mandible with closed teeth [m]."""
    at, angle = _CLOSED
    c, s = np.cos(angle), np.sin(angle)
    about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return 1e-3 * TURN @ (about_y @ (1e3 * TURN.T @ point - _CENTRE) + at)


def _mm(row: pd.Series, prefix: str) -> Floats:
    """Point of a table in the frame of the package [m]."""
    return 1e-3 * TURN @ np.array([float(row[f"{prefix}{axis}_mm"]) for axis in "xyz"])


def _surface(path: Path) -> tuple[Floats, NDArray[np.int64]]:
    points, triangles = read_obj(_file(path))
    return points @ TURN.T, np.concatenate([triangles, _holes(triangles)]).astype(np.int64)


def _holes(triangles: Integers) -> NDArray[np.int64]:
    """Triangles (k, 3) that close the triangular holes of a surface; the hyoid has two."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()
    known = {(a, b) for a, b in edges}
    after = {b: a for a, b in known if (b, a) not in known}
    found = {
        tuple(sorted((a, b, after.get(b, -1)))): (a, b, after.get(b, -1)) for a, b in after.items()
    }
    closed = [row for row in found.values() if after.get(row[2]) == row[0]]
    return np.array(closed, dtype=np.int64).reshape(-1, 3)


def _numbers(path: Path) -> Integers:
    """Numbers of a list with any number of them in a line."""
    words = _file(path).read_text(encoding="utf-8").split()
    try:
        return np.array([int(word) for word in words], dtype=np.int64)
    except ValueError as error:
        raise HeadError(f"{path}: {one_line(error)}, expected whole numbers") from error


def _table(path: Path, columns: list[str]) -> pd.DataFrame:
    try:
        return pd.read_csv(_file(path))[columns]
    except (KeyError, ValueError) as error:
        raise HeadError(
            f"{path} cannot be read ({one_line(error)}): expected a table with the columns "
            f"{', '.join(columns)}"
        ) from error


def _file(path: Path) -> Path:
    if not path.is_file():
        raise HeadError(
            f"{path} not found: specify the folder of the published models with jaw_tongue_face, "
            "face_badin, face_reference and tongue"
        )
    return path
