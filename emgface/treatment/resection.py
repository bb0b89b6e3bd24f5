"""Resection of one side of a mandible: muscles, teeth, bone and joint lost, scars, plate or graft.

Source: the resection models of the published collection; their stiffness of the scar, 800 N/m, is a
default of a demonstration and has no measured origin. As there, the mandible keeps its mass, which is
uniform in what remains of the bone; plate and graft have the shape of the bone that they replace.
"""

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.anatomy.jaw.model import Floats
from emgface.errors import JawError
from emgface.treatment.plan import Resection

Integers = NDArray[np.int64]

LOST_MUSCLES: Final = ("at", "mt", "pt", "ip", "sp", "dm", "sm", "am", "pm", "mp")
"""Muscles that are lost on the resected side; ad, gh, pd and sh remain."""
ATTACHED: Final = {"none": (), "plate": (), "graft": ("mt", "pt")}
"""Muscles of that side that are attached again; plate and graft also restore the joint."""
GUIDES: Final = ("tmj", "posterior", "lateral")  #: joints of one side
MOLAR_STOP: Final = "bite"  #: stop of the molars of one side, which are in the resected segment
LARYNX_BODIES: Final = ("hyoid", "thyroid", "cricoid")  #: bodies that ``hyoid = "fixed"`` holds
ANTERIOR_CUT: Final = 0.75
"""Place of the anterior cut, behind the canine: share of the distance of the molar from the midline."""
RAMUS: Final = (0.1, 0.4, 0.7)  #: scars on the line from molar to condyle: shares of the way
BORDER: Final = (0.0, 0.2, 0.4)  #: scars at the lower border: shares of that way,
LARYNX_OFFSETS: Final = (0.13, -0.16, -0.37)
"""and their distance from it, lateral, anterior and superior, over the distance of molar and condyle
(places of the published demonstration, rounded)."""
SCAR_SPRING_LENGTH: Final = 1.0
"""Distance of the ends of a scar spring [m], at which its direction is constant in practice."""


def resect(jaw: xr.Dataset, step: Resection) -> tuple[xr.Dataset, dict[str, Any]]:
    """Resect one side of a jaw model.

    Each scar is an isotropic translational spring between jaw and skull at rest, represented by three
    long perpendicular springs. Raises JawError if the jaw lacks the muscles or points of that side.
    """
    side = "L" if step.side == "left" else "R"
    lost = [f"{m}_{side}" for m in LOST_MUSCLES if m not in ATTACHED[step.reconstruction]]
    names = [str(m) for m in jaw["muscle"].values]
    absent = [m for m in lost if m not in names]
    needed = [f"bite_{side}", f"condyle_{side}"]
    points = [str(p) for p in jaw["point"].values]
    if absent or any(p not in points for p in needed):
        raise JawError(
            f"the jaw has no {', '.join(absent or needed)}, expected the muscles and points of the "
            "side to be resected: generate or import the jaw"
        )
    open_joint = step.reconstruction == "none"
    joints = [str(j) for j in jaw["joint"].values]
    lose = (*(GUIDES if open_joint else ()), MOLAR_STOP)
    gone = [f"{j}_{side}" for j in lose if f"{j}_{side}" in joints]
    fixed = [
        b for b in map(str, jaw["body"].values) if b in LARYNX_BODIES and step.hyoid == "fixed"
    ]
    if fixed and "cricothyroid" in joints:
        gone.append("cricothyroid")
    capsule = [s for s in map(str, jaw["spring"].values) if open_joint and s == f"capsule_{side}"]
    left = jaw.drop_sel(muscle=lost, joint=gone, spring=capsule)
    left = left.sel(exciter=(left["exciter_gain"] > 0.0).any("muscle"))
    if fixed:
        moves = left["body_moves"].copy()
        moves.loc[{"body": fixed}] = 0
        left = left.assign(body_moves=moves)
    bite, condyle = (
        jaw["point_position"].values[points.index(p)] for p in (f"bite_{side}", f"condyle_{side}")
    )
    shift = 0.0
    if open_joint and "surface_position" in jaw:
        left, shift = _without_segment(left, ANTERIOR_CUT * float(bite[0]))
    if step.scar_stiffness > 0.0:
        left = _with_scars(left, scar_places(bite, condyle, step.scar_place), step.scar_stiffness)
    left.attrs["name"] = f"{jaw.attrs['name']}, simulated resection of the {step.side} side"
    return left, {
        "lost_muscles": lost,
        "lost_joints": gone,
        "fixed_bodies": fixed,
        "scar_springs": 3.0 * (step.scar_stiffness > 0),
        "moved_centre_of_mass_mm": 1e3 * shift,
    }


def scar_places(bite: Floats, condyle: Floats, place: str) -> Floats:
    """Places (3, 3) [m] of the scars on the mandible, from its molar and its condyle of that side."""
    way = condyle - bite
    if place == "ramus":
        return bite + np.array(RAMUS)[:, None] * way
    away = np.array(LARYNX_OFFSETS) * [np.sign(bite[0]), 1.0, 1.0] * np.linalg.norm(way)
    return bite + np.array(BORDER)[:, None] * way + away


def clipped(points: Floats, triangles: Integers, limit: float) -> tuple[Floats, Integers]:
    """Part of a closed surface whose x is nearer to 0 than a limit (either sign), closed at the cut.

    Triangles across the plane are divided at it, and the cut is closed by triangles to one point of the
    plane, so that volume and moments are those of the clipped volume also if the cut has several parts.
    """
    depth = abs(limit) - np.sign(limit) * points[:, 0]  # positive in the part that is kept
    depth = np.where(depth == 0.0, 1e-12, depth)
    new, place = list(points), dict[tuple[int, int], int]()

    def crossing(a: int, b: int) -> int:
        key = (min(a, b), max(a, b))
        if key not in place:
            share = depth[a] / (depth[a] - depth[b])
            place[key] = len(new)
            new.append(points[a] + share * (points[b] - points[a]))
        return place[key]

    kept, rim = list[tuple[int, int, int]](), list[tuple[int, int]]()
    for row in triangles.tolist():
        inside = [bool(depth[k] > 0.0) for k in row]
        if all(inside):
            kept.append((row[0], row[1], row[2]))
        elif any(inside):
            one = inside.count(True) == 1
            at = inside.index(one)  # the corner that is alone on its side
            a, b, c = row[at], row[at - 2], row[at - 1]
            p, q = crossing(a, b), crossing(a, c)
            kept += [(a, p, q)] if one else [(p, b, c), (p, c, q)]
            rim.append((p, q) if one else (q, p))
    if rim:
        apex = len(new)
        new.append(np.mean([new[k] for pair in rim for k in pair], axis=0))
        kept += [(b, a, apex) for a, b in rim]
    used, number = np.unique(np.array(kept, dtype=np.int64).reshape(-1, 3), return_inverse=True)
    return np.array(new)[used], number.reshape(-1, 3).astype(np.int64)


def _without_segment(jaw: xr.Dataset, limit: float) -> tuple[xr.Dataset, float]:
    """Jaw without the bone beyond x = `limit` [m], and the way of its centre of mass [m].

    The change of centre and inertia is that of the volume of the surface with the mass of the body, so
    that also a jaw whose inertia is not that of its surface is the same where nothing is removed.
    """
    body = [str(b) for b in jaw["body"].values].index("jaw")
    owner, triangle = jaw["surface_body"].values, jaw["surface_triangle"].values.astype(np.int64)
    mine = owner[triangle[:, 0]] == body
    number = np.cumsum(owner == body) - 1
    points = jaw["surface_position"].values[owner == body]
    whole = number[triangle[mine]]
    mass = float(jaw["body_mass"].values[body])
    inertias: list[tuple[Floats, Floats]] = []
    part = clipped(points, whole, limit)
    for at, corners in ((points, whole), part):
        unit = sim.body_of_surface("jaw", at, corners, 1.0)
        scale = mass / unit.mass
        inertias.append((np.asarray(unit.centre), scale * np.asarray(unit.inertia)))
    shift = inertias[1][0] - inertias[0][0]
    inertia, centre = jaw["body_inertia"].copy(), jaw["body_centre"].copy()
    inertia.values[body] += inertias[1][1] - inertias[0][1]
    centre.values[body] += shift
    damped = jaw["body_damped_at"].copy()
    if np.array_equal(damped.values[body], jaw["body_centre"].values[body]):
        damped.values[body] += shift
    others = owner != body
    renumbered = np.cumsum(others) - 1
    at = np.concatenate([jaw["surface_position"].values[others], part[0]])
    corners = np.concatenate([renumbered[triangle[~mine]], part[1] + others.sum()])
    bodies = np.concatenate([owner[others], np.full(len(part[0]), body)])
    kept = jaw.drop_dims([d for d in ("vertex", "triangle") if d in jaw.dims])
    values = {"surface_body": bodies, "surface_position": at, "surface_triangle": corners}
    drawn: dict[str, Any] = {
        v: (jaw[v].dims, x.astype(jaw[v].dtype), jaw[v].attrs) for v, x in values.items()
    }
    kept = kept.assign(
        drawn | {"body_inertia": inertia, "body_centre": centre, "body_damped_at": damped}
    )
    return kept, float(np.linalg.norm(shift))


def _with_scars(jaw: xr.Dataset, places: Floats, stiffness: float) -> xr.Dataset:
    """Add springs along x, y and z at points of the jaw."""
    bodies = [str(b) for b in jaw["body"].values]
    start = np.repeat(places, 3, axis=0)
    along = np.tile(np.eye(3), (len(places), 1))
    n = len(start)
    own: dict[str, Any] = {
        "spring_body": np.tile([bodies.index("jaw"), bodies.index("skull")], (n, 1)),
        "spring_position": np.stack([start, start + SCAR_SPRING_LENGTH * along], axis=1),
        "spring_stiffness": np.full(n, stiffness),
        "spring_rest_length": np.full(n, SCAR_SPRING_LENGTH),
        "spring_damping": np.zeros(n),
        "spring_one_sided": np.zeros(n),
    }
    columns = [v for v in jaw.data_vars if jaw[v].dims[:1] == ("spring",)]
    added = xr.Dataset(
        {v: (jaw[v].dims, own[str(v)].astype(jaw[v].dtype), jaw[v].attrs) for v in columns},
        coords={"spring": [f"scar{k}_{axis}" for k in range(len(places)) for axis in "xyz"]},
    )
    springs = xr.concat([jaw[columns], added], dim="spring")
    kept = jaw.drop_dims("spring")
    return kept.assign({v: springs[v].assign_attrs(jaw[v].attrs) for v in columns})
