"""Mandible and hyoid of the published coupled head, from the tables of its muscles and points."""

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.anatomy.head.published_tables import HEAD_SOURCE, file_of, table_of
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import Floats, JawBody, JawJoint, JawLine, build_jaw
from emgface.anatomy.jaw.published import condylar_path
from emgface.anatomy.jaw.published_parameters import CURVE_LENGTH, CURVE_STRIPS
from emgface.anatomy.jaw.template.muscles import MUSCLE_GROUPS
from emgface.anatomy.jaw.thinning import thinned
from emgface.anatomy.tongue.published import TURN
from emgface.face.artisynth_contact import read_obj
from emgface.face.parts import Integers

BODY_DENSITY: Final = {"jaw": 3470.1, "hyoid": 4574.7}  #: [kg/m^3]
PUBLISHED_DAMPING: Final = {"jaw": (20.0, 2e-4), "hyoid": (10.0, 1e-4)}  #: [kg/s], [kg m^2/s]
HYOID_SPRING: Final = (1760.0, 4.123152e-2)
"""Stiffness of the spring that holds the hyoid, translation [N/m] and rotation [N m/rad]."""
_FAR: Final = 1.0  #: length of the axial springs that represent it [m]
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


def published_jaw(place: Path) -> xr.Dataset:
    """Mandible and hyoid with 14 pairs of muscles."""
    surfaces = {body: _surface(place / name) for body, name in _SURFACES.items()}
    marked = table_of(place / "derived" / "markers.csv", ["name", "body", "x_mm", "y_mm", "z_mm"])
    at = {str(name): rows for name, rows in marked.set_index("name").iterrows()}
    points = {
        name: (
            _bone(at[given]["body"]),
            _biting(_mm(at[given], "")) if given in _BITING else _mm(at[given], ""),
        )
        for given, name in _POINTS.items()
    }
    muscles = _muscles(place)
    hyoid = sim.body_of_surface("hyoid", *surfaces["hyoid"], BODY_DENSITY["hyoid"])
    bodies = [JawBody("skull", moves=False)]
    for name, density in BODY_DENSITY.items():
        body = hyoid if name == "hyoid" else sim.body_of_surface(name, *surfaces[name], density)
        bodies.append(
            JawBody(name, body.mass, np.asarray(body.centre), body.inertia, PUBLISHED_DAMPING[name])
        )
    return build_jaw(
        bodies=bodies,
        muscles=muscles,
        springs=_hyoid_springs(np.asarray(hyoid.centre)),
        joints=_joints({name: x for name, (_, x) in points.items()}),
        points=points,
        exciters=exciters_of([m.name for m in muscles], MUSCLE_GROUPS),
        surfaces=[(body, *thinned(*surface)) for body, surface in surfaces.items()],
        name="published coupled jaw and hyoid",
        origin="published geometry, imported",
        source=HEAD_SOURCE,
    )


def _muscles(place: Path) -> list[JawLine]:
    ends = [f"{end}{axis}_mm" for end in "oi" for axis in "xyz"]
    columns = ["name", "origin_body", "insertion_body", *ends, "max_force_N", "opt_length_mm"]
    columns += ["max_length_mm", "tendon_ratio", "passive_fraction"]
    muscles = list[JawLine]()
    for _, row in table_of(place / "derived" / "muscles.csv", columns).iterrows():
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
        muscles.append(JawLine(str(row["name"])[1:] + side, (a, b), line, values))
    return muscles


def _hyoid_springs(centre: Floats) -> list[JawLine]:
    """Two long springs along each axis, r apart on both sides of the centre.

    Stiffness k/2 each adds up to k for translations, and to k r^2 for rotations about each axis.
    """
    k, turning = HYOID_SPRING
    r = float(np.sqrt(turning / k))
    springs = list[JawLine]()
    for axis in range(3):
        along, across = np.eye(3)[axis], np.eye(3)[(axis + 1) % 3]
        for sign in (1.0, -1.0):
            near = centre + sign * r * across
            values = {"stiffness": 0.5 * k, "rest_length": _FAR, "damping": 0.0}
            springs.append(
                JawLine(
                    f"hyoid {'xyz'[axis]}{'+-'[sign < 0.0]}",
                    ("hyoid", "skull"),
                    np.array([near, near + _FAR * along]),
                    values,
                )
            )
    return springs


def _joints(points: dict[str, Floats]) -> list[JawJoint]:
    """Condylar paths, walls behind the condyles and lateral to them, and bite planes."""
    forward = np.array([0.0, np.cos(_SLOPE), -np.sin(_SLOPE)])
    joints = list[JawJoint]()
    for side, sign in (("_L", -1.0), ("_R", 1.0)):
        condyle, bite = points[f"condyle{side}"], points[f"bite{side}"]
        guide = {"body": "skull", "origin": condyle, "point": f"condyle{side}"}
        joints.append(
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
        joints.append(JawJoint(f"posterior{side}", "plane", normal=forward, **guide))
        inward = np.array([-sign, 0.0, 0.0])
        wall = np.cos(_WALL) * inward + np.sin(_WALL) * forward
        joints.append(JawJoint(f"lateral{side}", "plane", normal=wall, **guide))
        tilted = np.array([sign * np.sin(_CANT), 0.0, -np.cos(_CANT)])
        joints.append(JawJoint(f"bite{side}", "plane", "skull", bite, tilted, f"bite{side}"))
    return joints


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
    points, triangles = read_obj(file_of(path))
    return points @ TURN.T, np.concatenate([triangles, _holes(triangles)]).astype(np.int64)


def _holes(triangles: Integers) -> NDArray[np.int64]:
    """Triangles (k, 3) that close the triangular holes of a surface; the hyoid has two."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).tolist()
    known = {(a, b) for a, b in edges}
    after = {b: a for a, b in known if (b, a) not in known}
    corners = {
        tuple(sorted((a, b, after.get(b, -1)))): (a, b, after.get(b, -1)) for a, b in after.items()
    }
    closed = [row for row in corners.values() if after.get(row[2]) == row[0]]
    return np.array(closed, dtype=np.int64).reshape(-1, 3)
