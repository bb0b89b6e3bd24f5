"""Import of the published jaw, hyoid and larynx model from the files of a user.

The files are those of Stavness, Hannam, Lloyd and Fels 2006 (folder `jaw/data` or `jaw_larynx`):
lists of bodies, muscles and groups, landmarks, surfaces. Their frame is x left, y posterior, z superior
in mm, landmarks in cm; the right side is the left mirrored.
"""

import os
from pathlib import Path
from typing import Literal

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.jaw import published_parameters as given
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import Floats, JawBody, JawJoint, JawLine, build_jaw
from emgface.anatomy.jaw.published_files import MM_TO_FRAME, PublishedJawFiles
from emgface.anatomy.jaw.thinning import thinned
from emgface.errors import JawError

Variant = Literal["fixed", "larynx"]
Condyle = Literal["planar", "curved"]
Values = Literal["text", "program"]

JAW_SOURCE = (
    "Stavness, Hannam, Lloyd and Fels 2006, An integrated, dynamic jaw and laryngeal model constructed "
    "from CT data"
)
_TURN = np.outer(np.sign(MM_TO_FRAME), np.sign(MM_TO_FRAME))
_MIRROR = np.array([-1.0, 1.0, 1.0])
_SIDES = (("_L", np.ones(3)), ("_R", _MIRROR))


def import_jaw(
    folder: str | os.PathLike[str],
    *,
    variant: Variant = "larynx",
    condyle: Condyle | None = None,
    values: Values = "text",
) -> xr.Dataset:
    """Import the published model.

    Parameters
    ----------
    folder : path-like
        Folder with ``muscleInfo.txt`` and ``landmarks``.
    variant : "larynx" or "fixed"
        Free hyoid, thyroid and cricoid with 20 pairs of muscles, membranes and a cricothyroid hinge; or
        a fixed hyoid with the 12 pairs of the mandible.
    condyle : "planar" or "curved", optional
        Condyles on planes, or below a curved surface that they may leave downwards; by default, as
        published, planar with the fixed and curved with the free hyoid.
    values : "text" or "program"
        Masses of thyroid and cricoid and inertia of mandible and hyoid: those of the text and of the
        surfaces at uniform density, or those of the published program.

    Returns
    -------
    xarray.Dataset
        Of schema jaw_model.

    Raises
    ------
    JawError
        A file is absent or cannot be read, or an option is unknown.
    """
    for option, chosen, allowed in (
        ("variant", variant, ("fixed", "larynx")),
        ("condyle", condyle, (None, "planar", "curved")),
        ("values", values, ("text", "program")),
    ):
        if chosen not in allowed:
            raise JawError(f"{option} = {chosen!r}, expected one of {allowed}")
    files = PublishedJawFiles(Path(folder))
    free = variant == "larynx"
    condyle = condyle or ("curved" if free else "planar")
    points = _points(files)
    muscles = _muscles(files, free)
    return build_jaw(
        bodies=_bodies(files, free, values),
        muscles=muscles,
        springs=_springs(files) if free else [],
        joints=_joints(points, free, condyle),
        points=points if free else {k: v for k, v in points.items() if v[0] != "thyroid"},
        exciters=exciters_of([m.name for m in muscles], files.groups()),
        surfaces=_surfaces(files, free),
        name=f"published jaw, hyoid {'free' if free else 'fixed'}, condyles {condyle}",
        origin="published geometry, imported",
        source=JAW_SOURCE,
        attrs={"variant": variant, "condyle": condyle, "values": values},
    )


def _surfaces(files: PublishedJawFiles, free: bool) -> list[tuple[str, Floats, np.ndarray]]:
    """Surfaces of the bodies, thinned; those that are absent are left out."""
    names = {"skull": "maxilla.obj"} | {n: stated.surface for n, stated in given.BODIES.items()}
    return [
        (body, *thinned(*files.surface(name)))
        for body, name in names.items()
        if (files.folder / name).is_file() and (free or body not in ("thyroid", "cricoid"))
    ]


def _mm(point: tuple[float, float, float] | Floats) -> Floats:
    return np.asarray(point, dtype=np.float64) * MM_TO_FRAME


def _bodies(files: PublishedJawFiles, free: bool, values: Values) -> list[JawBody]:
    bodies = [JawBody("skull", moves=False), JawBody("sternum", moves=False)]
    for name, stated in given.BODIES.items():
        if not free and name in ("thyroid", "cricoid"):
            continue
        xx, yy, zz, xy, xz, yz = stated.inertia
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) * 1e-6 * _TURN
        mass = stated.mass
        centre = _mm(stated.centre)
        if values == "text":
            mass = given.LARYNX_MASS.get(name, mass)
            if name in given.LARYNX_MASS:
                inertia = inertia * mass / stated.mass
            else:
                # unit density gives volume and second moments, which are scaled to the mass
                unit = sim.body_of_surface(name, *files.surface(stated.surface), 1.0)
                assert unit.inertia is not None
                inertia, centre = unit.inertia * mass / unit.mass, np.asarray(unit.centre)
        size = 2.0 if free and name == "jaw" else 1.0
        bodies.append(
            JawBody(
                name,
                mass,
                centre,
                inertia,
                (10.0 * size, 1e-4 * size),
                np.zeros(3),  # the program damps the origin of its frame
                moves=free or name == "jaw",
            )
        )
    return bodies


def _points(files: PublishedJawFiles) -> dict[str, tuple[str, Floats]]:
    jaw = files.landmarks("jawFixedMarkers")
    middle = np.array([0.0, 1.0, 1.0])
    condyle = jaw[np.argmax(jaw[:, 2])] - [0.0, 0.0, 1e-3 * given.CONDYLE_DROP]
    incisor = jaw[0] * middle + [0.0, 1e-3 * given.INCISOR_FORWARD, 0.0]
    bite = _mm(given.BITE_POINT)
    return {
        "lower_incisor": ("jaw", incisor),
        "upper_incisor": ("skull", files.landmarks("maxillaFixedMarkers")[0] * middle),
        "condyle_L": ("jaw", condyle),
        "condyle_R": ("jaw", condyle * _MIRROR),
        "bite_L": ("jaw", bite),
        "bite_R": ("jaw", bite * _MIRROR),
        "hyoid": ("hyoid", files.landmarks("lgh")[1] * middle),
        "thyroid": ("thyroid", files.landmarks("thyroidFixedMarkers")[0] * middle),
        "head_centre": ("skull", files.landmarks("c1RotationPoint")[0] * middle),
    }


def _muscles(files: PublishedJawFiles, free: bool) -> list[JawLine]:
    listed = [row[0] for row in files.lines("muscleListAll.txt" if free else "muscleList.txt")]
    info = {row[0]: row for row in files.lines("muscleInfo.txt")}
    fixed = {"cranium": "skull", "maxilla": "skull"}
    muscles = list[JawLine]()
    for name in listed:
        if name not in info or name not in given.PUBLISHED_MUSCLES:
            raise JawError(
                f"muscle {name!r} is listed without data, expected one of "
                f"{', '.join(given.PUBLISHED_MUSCLES)}"
            )
        ends = files.landmarks(f"l{name}")[:2]
        if ends[0, 2] < ends[1, 2]:
            ends = ends[::-1]
        stated = given.PUBLISHED_MUSCLES[name]
        values = stated._asdict() | {
            "passive_fraction": given.PASSIVE_FRACTION,
            "damping": 1.0 if free else 0.0,
        }
        a, b = (fixed.get(body, body) for body in info[name][1:3])
        muscles += [JawLine(name + side, (a, b), ends * mirror, values) for side, mirror in _SIDES]
    return muscles


def _springs(files: PublishedJawFiles) -> list[JawLine]:
    springs = list[JawLine]()
    for name, (a, b, raised) in given.MEMBRANES.items():
        ends = files.landmarks(f"l{name}").reshape(-1, 2, 3)
        ends[:, 1, 2] += 1e-3 * raised
        n = len(ends)
        # strand k joins its pair of landmarks; between neighbours there are both diagonals
        pairs = [(i, j) for i in range(n) for j in (i - 1, i, i + 1) if 0 <= j < n]
        for side, mirror in _SIDES:
            for k, (i, j) in enumerate(pairs):
                strand = np.array([ends[i, 0], ends[j, 1]]) * mirror
                springs.append(_spring(f"{name}{k}{side}", a, b, strand, given.MEMBRANE_STIFFNESS))
    on_hyoid, on_pharynx, stiffness, rest = given.PHARYNX
    for side, mirror in _SIDES:
        strand = np.array([_mm(on_hyoid), _mm(on_pharynx)]) * mirror
        springs.append(
            _spring(f"pharynx{side}", "hyoid", "sternum", strand, stiffness, 1e-3 * rest)
        )
    return springs


def _spring(
    name: str, a: str, b: str, ends: Floats, stiffness: float, rest: float | None = None
) -> JawLine:
    length = float(np.linalg.norm(ends[1] - ends[0])) if rest is None else rest
    values = {"stiffness": stiffness, "rest_length": length, "damping": given.SPRING_DAMPING}
    return JawLine(name, (a, b), ends, values)


def _joints(points: dict[str, tuple[str, Floats]], free: bool, condyle: Condyle) -> list[JawJoint]:
    def tilted(degrees: float) -> Floats:
        angle = np.radians(degrees)
        return np.array([0.0, -np.sin(angle), -np.cos(angle)])

    slope, turn = given.CONDYLE_SLOPE, np.radians(given.WALL_TURN)
    joints = list[JawJoint]()
    forward = np.array([0.0, np.cos(np.radians(slope)), -np.sin(np.radians(slope))])
    for side, mirror in _SIDES:
        place = points[f"condyle{side}"][1]
        guide = {"body": "skull", "origin": place, "point": f"condyle{side}"}
        if condyle == "planar":
            joints.append(
                JawJoint(f"tmj{side}", "plane", normal=tilted(slope), one_sided=False, **guide)
            )
        else:
            joints.append(
                JawJoint(
                    f"tmj{side}",
                    "curve",
                    normal=(0.0, 0.0, -1.0),
                    coefficients=condylar_path(),
                    length=1e-3 * given.CURVE_LENGTH * (1.0 - 0.5 / given.CURVE_STRIPS),
                    **guide,
                )
            )
        joints.append(JawJoint(f"posterior{side}", "plane", normal=forward, **guide))
        inward = np.array([1.0, 0.0, 0.0]) * mirror  # the left is at negative x
        wall = np.cos(turn) * inward + np.sin(turn) * forward
        joints.append(JawJoint(f"lateral{side}", "plane", normal=wall, **guide))
        joints.append(
            JawJoint(
                f"bite{side}",
                "plane",
                "skull",
                points[f"bite{side}"][1],
                tilted(given.BITE_SLOPE),
                f"bite{side}",
            )
        )
    if free:
        axis = (1.0, 0.0, 0.0)
        joints.append(
            JawJoint("cricothyroid", "hinge", "thyroid", _mm(given.HINGE), axis, "cricoid")
        )
    return joints


def condylar_path() -> tuple[float, float, float, float]:
    """Coefficients of the depth of the condylar path as a polynomial of the anterior distance [m].

    z(0) = 0, z'(0) = -40 pi/180, z(12 mm) = -5 mm, z'(12 mm) = -10 pi/180: the program takes the angles
    in radians as slopes.
    """
    s, depth = 1e-3 * given.CURVE_LENGTH, 1e-3 * given.CURVE_DEPTH
    first, last = np.radians(given.CONDYLE_SLOPE), np.radians(given.CURVE_END_SLOPE)
    matrix = np.array([[s**2, s**3], [2.0 * s, 3.0 * s**2]])
    square, cube = np.linalg.solve(matrix, [depth - first * s, last - first])
    return 0.0, float(first), float(square), float(cube)
