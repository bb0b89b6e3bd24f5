"""Model of jaw, hyoid and larynx as one Dataset: bodies, line muscles, springs, joints and points."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import JawError
from emgface.schema.validation import validate

Floats = NDArray[np.float64]
Vector = Floats | tuple[float, float, float]

FRAME = "x right, y anterior, z superior"
AXES = ("x", "y", "z")
KINDS = ("plane", "curve", "hinge")
"""Joints: a point on a plane, a point on a surface swept by a curve, a hinge of two bodies."""


@dataclass(frozen=True, eq=False)
class JawBody:
    """A bone or cartilage.

    Attributes
    ----------
    name : str
    mass : float
        [kg]; 0 where it stays.
    centre : (3,) [m]
    inertia : (3, 3) about the centre [kg m^2].
    damping : (2,) of the translation [kg/s] and of the rotation [kg m^2/s].
    damped_at : (3,) point whose velocity is damped [m].
    moves : bool
    """

    name: str
    mass: float = 0.0
    centre: Vector = (0.0, 0.0, 0.0)
    inertia: Floats | None = None
    damping: tuple[float, float] = (0.0, 0.0)
    damped_at: Vector | None = None
    moves: bool = True


@dataclass(frozen=True, eq=False)
class JawLine:
    """A muscle or spring between two bodies.

    Attributes
    ----------
    name : str
    bodies : (2,) names of the bodies of both ends.
    ends : (2, 3) [m]
    values : parameters by name (`MUSCLE_VALUES`, `SPRING_VALUES`).
    """

    name: str
    bodies: tuple[str, str]
    ends: Floats
    values: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class JawJoint:
    """A joint; see `sim.joints.PointOnPlane`, `PointOnCurve` and `Revolute`.

    Attributes
    ----------
    name : str
    kind : str
        One of `KINDS`.
    body : str
        Body of the plane or curve, or first body of a hinge.
    origin, normal : (3,) [m], [1]; the normal of a hinge is its axis.
    point : str
        Guided point; for a hinge, the name of the second body.
    one_sided : bool
        Whether the point may leave to the side of the normal.
    forward : (3,) direction along the curve.
    coefficients : (4,) of the height over the way x along the curve, sum_k c_k x^k [m^(1 - k)].
    length : float
        Way over which the polynomial applies [m]; it goes straight on beyond.
    """

    name: str
    kind: str
    body: str
    origin: Vector
    normal: Vector
    point: str
    one_sided: bool = True
    forward: Vector = (0.0, 1.0, 0.0)
    coefficients: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    length: float = 0.0


MUSCLE_VALUES = {
    "force_max": "N",
    "stretch_max": "1",
    "tendon_ratio": "1",
    "passive_fraction": "1",
    "damping": "N s/m",
}
SPRING_VALUES = {"stiffness": "N/m", "rest_length": "m", "damping": "N s/m"}


def build_jaw(
    *,
    bodies: Sequence[JawBody],
    muscles: Sequence[JawLine],
    springs: Sequence[JawLine],
    joints: Sequence[JawJoint],
    points: Mapping[str, tuple[str, Vector]],
    exciters: Mapping[str, Mapping[str, float]],
    name: str,
    origin: str,
    source: str,
    attrs: Mapping[str, str | int | float] | None = None,
) -> xr.Dataset:
    """Assemble a jaw_model Dataset and check it.

    Parameters
    ----------
    bodies, muscles, springs, joints : sequence
    points : mapping
        Body and rest position [m] of every named point.
    exciters : mapping
        Muscles that every exciter drives, with gains.
    name, origin, source : str
    attrs : mapping, optional

    Returns
    -------
    xarray.Dataset
        Of schema jaw_model, in the frame x right, y anterior, z superior.

    Raises
    ------
    JawError
        A part names a body, point or muscle that does not exist.
    SchemaError, UnitsError
        The Dataset does not follow its declaration.
    """
    of_body = {body.name: k for k, body in enumerate(bodies)}
    of_point = {point: k for k, point in enumerate(points)}
    of_muscle = {muscle.name: k for k, muscle in enumerate(muscles)}

    def number(found: Mapping[str, int], wanted: str, where: str) -> int:
        if wanted not in found:
            raise JawError(f"{where} names {wanted!r}, expected one of {', '.join(found)}")
        return found[wanted]

    variables: dict[str, tuple[Any, Any, dict[str, str]]] = {
        "body_mass": ("body", [b.mass for b in bodies], {"units": "kg"}),
        "body_centre": (("body", "axis"), _rows([b.centre for b in bodies]), {"units": "m"}),
        "body_inertia": (
            ("body", "axis", "axis_of"),
            np.array([np.zeros((3, 3)) if b.inertia is None else b.inertia for b in bodies]),
            {"units": "kg m^2"},
        ),
        "body_damping": ("body", [b.damping[0] for b in bodies], {"units": "kg/s"}),
        "body_turn_damping": ("body", [b.damping[1] for b in bodies], {"units": "kg m^2/s"}),
        "body_damped_at": (
            ("body", "axis"),
            _rows([b.centre if b.damped_at is None else b.damped_at for b in bodies]),
            {"units": "m"},
        ),
        "body_moves": ("body", np.array([b.moves for b in bodies], dtype=np.int8), {"units": "1"}),
        "point_body": (
            "point",
            _numbers([number(of_body, b, f"point {p}") for p, (b, _) in points.items()]),
            {"units": "1"},
        ),
        "point_position": (
            ("point", "axis"),
            _rows([x for _, x in points.values()]),
            {"units": "m"},
        ),
    }
    for kind, lines, values in (
        ("muscle", muscles, MUSCLE_VALUES),
        ("spring", springs, SPRING_VALUES),
    ):
        held = [[number(of_body, b, f"{kind} {x.name}") for b in x.bodies] for x in lines]
        ends = np.array([x.ends for x in lines], dtype=np.float64).reshape(-1, 2, 3)
        variables[f"{kind}_body"] = ((kind, "end"), _numbers(held).reshape(-1, 2), {"units": "1"})
        variables[f"{kind}_position"] = ((kind, "end", "axis"), ends, {"units": "m"})
        for value, unit in values.items():
            column = np.array([x.values[value] for x in lines], dtype=np.float64)
            variables[f"{kind}_{value}"] = (kind, column, {"units": unit})
    hinge = [joint.kind == "hinge" for joint in joints]
    guided = [
        number(of_body if h else of_point, joint.point, f"joint {joint.name}")
        for joint, h in zip(joints, hinge, strict=True)
    ]
    variables |= {
        "joint_kind": ("joint", _numbers([KINDS.index(j.kind) for j in joints]), {"units": "1"}),
        "joint_body": (
            "joint",
            _numbers([number(of_body, j.body, f"joint {j.name}") for j in joints]),
            {"units": "1"},
        ),
        "joint_point": ("joint", _numbers(np.where(hinge, -1, guided)), {"units": "1"}),
        "joint_body_b": ("joint", _numbers(np.where(hinge, guided, -1)), {"units": "1"}),
        "joint_origin": (("joint", "axis"), _rows([j.origin for j in joints]), {"units": "m"}),
        "joint_normal": (("joint", "axis"), _rows([j.normal for j in joints]), {"units": "1"}),
        "joint_forward": (("joint", "axis"), _rows([j.forward for j in joints]), {"units": "1"}),
        "joint_one_sided": (
            "joint",
            np.array([j.one_sided for j in joints], dtype=np.int8),
            {"units": "1"},
        ),
        "joint_curve": (
            ("joint", "power"),
            np.array([j.coefficients for j in joints], dtype=np.float64).reshape(-1, 4),
            {"units": "1"},
        ),
        "joint_length": ("joint", [j.length for j in joints], {"units": "m"}),
    }
    gain = np.zeros((len(exciters), len(muscles)))
    for k, (exciter, driven) in enumerate(exciters.items()):
        for muscle, factor in driven.items():
            gain[k, number(of_muscle, muscle, f"exciter {exciter}")] = factor
    variables["exciter_gain"] = (("exciter", "muscle"), gain, {"units": "1"})
    dataset = xr.Dataset(
        variables,
        coords={
            "axis": list(AXES),
            "body": list(of_body),
            "muscle": list(of_muscle),
            "spring": np.array([s.name for s in springs], dtype="U32"),
            "point": list(points),
            "joint": [j.name for j in joints],
            "exciter": list(exciters),
        },
        attrs={"name": name, "origin": origin, "source": source, "frame": FRAME, **(attrs or {})},
    )
    return validate(dataset, "jaw_model")


def _rows(values: Sequence[Vector]) -> Floats:
    return np.array(values, dtype=np.float64).reshape(-1, 3)


def _numbers(values: Any) -> NDArray[np.int32]:
    return np.asarray(values, dtype=np.int32)
