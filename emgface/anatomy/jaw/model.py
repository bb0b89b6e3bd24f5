"""Model of jaw, hyoid and larynx as one Dataset: bodies, line muscles, springs, joints and points."""

from collections.abc import Iterable, Mapping, Sequence
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
    """A bone or cartilage of a mass [kg], 0 if it is fixed, with its centre (3,) [m].

    ``inertia`` (3, 3) is about the centre [kg m^2], ``damping`` (2,) of the translation [kg/s] and
    of the rotation [kg m^2/s], at the point ``damped_at`` (3,) [m].
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
    """A muscle or spring from one body to another, between ``ends`` (2, 3) [m].

    ``values`` are parameters by name (`MUSCLE_VALUES`, `SPRING_VALUES`).
    """

    name: str
    bodies: tuple[str, str]
    ends: Floats
    values: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class JawJoint:
    """A joint of one of `KINDS`; see `sim.joints.PointOnPlane`, `PointOnCurve` and `Revolute`.

    ``body`` has the plane or curve and guides ``point``; for a hinge they are both bodies, and
    ``normal`` [1] is its axis. A one-sided joint lets the point move away to the side of the
    normal. The height of a curve at the distance x along ``forward`` is sum_k c_k x^k, with
    ``coefficients`` (4,) [m^(1 - k)], up to ``length`` [m]; beyond, it is straight.
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
OPTIONAL_VALUES = {"stretch_opt": "1", "one_sided": "1"}
"""Parameters that a model may state for all of its muscles or springs."""
SPRING_VALUES = {"stiffness": "N/m", "rest_length": "m", "damping": "N s/m"}

_Variables = dict[str, tuple[Any, Any, dict[str, str]]]


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
    surfaces: Sequence[tuple[str, Floats, NDArray[np.integer]]] = (),
    attrs: Mapping[str, str | int | float] | None = None,
) -> xr.Dataset:
    """Assemble a jaw_model Dataset, in the frame x right, y anterior, z superior, and check it.

    `points` are bodies and rest positions [m] by name, `exciters` the muscles that each drives,
    with gains, and `surfaces` (body, vertices (n, 3) [m], triangles (m, 3)) are to be drawn. Raises
    JawError if a part names a body, point or muscle that does not exist, and SchemaError or
    UnitsError if the Dataset does not follow its declaration.
    """
    of_body = _numbered([body.name for body in bodies])
    of_point = _numbered(points)
    of_muscle = _numbered([muscle.name for muscle in muscles])
    variables = _body_variables(bodies) | {
        "point_body": (
            "point",
            _numbers([_number(of_body, b, f"point {p}") for p, (b, _) in points.items()]),
            {"units": "1"},
        ),
        "point_position": (
            ("point", "axis"),
            _rows([x for _, x in points.values()]),
            {"units": "m"},
        ),
    }
    variables |= _line_variables("muscle", muscles, MUSCLE_VALUES, of_body)
    variables |= _line_variables("spring", springs, SPRING_VALUES, of_body)
    variables |= _joint_variables(joints, of_body, of_point)
    if surfaces:
        variables |= _surface_variables(surfaces, of_body)
    gain = np.zeros((len(exciters), len(muscles)))
    for k, (exciter, driven) in enumerate(exciters.items()):
        for muscle, factor in driven.items():
            gain[k, _number(of_muscle, muscle, f"exciter {exciter}")] = factor
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


def _body_variables(bodies: Sequence[JawBody]) -> _Variables:
    return {
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
    }


def _line_variables(
    kind: str, lines: Sequence[JawLine], values: dict[str, str], of_body: Mapping[str, int]
) -> _Variables:
    held = [[_number(of_body, b, f"{kind} {x.name}") for b in x.bodies] for x in lines]
    ends = np.array([x.ends for x in lines], dtype=np.float64).reshape(-1, 2, 3)
    found: _Variables = {
        f"{kind}_body": ((kind, "end"), _numbers(held).reshape(-1, 2), {"units": "1"}),
        f"{kind}_position": ((kind, "end", "axis"), ends, {"units": "m"}),
    }
    further = {k: unit for k, unit in OPTIONAL_VALUES.items() if lines and k in lines[0].values}
    for value, unit in (values | further).items():
        column = np.array([x.values[value] for x in lines], dtype=np.float64)
        found[f"{kind}_{value}"] = (kind, column, {"units": unit})
    return found


def _joint_variables(
    joints: Sequence[JawJoint], of_body: Mapping[str, int], of_point: Mapping[str, int]
) -> _Variables:
    hinge = [joint.kind == "hinge" for joint in joints]
    guided = [
        _number(of_body if h else of_point, joint.point, f"joint {joint.name}")
        for joint, h in zip(joints, hinge, strict=True)
    ]
    one = {"units": "1"}
    return {
        "joint_kind": ("joint", _numbers([KINDS.index(j.kind) for j in joints]), one),
        "joint_body": (
            "joint",
            _numbers([_number(of_body, j.body, f"joint {j.name}") for j in joints]),
            one,
        ),
        "joint_point": ("joint", _numbers(np.where(hinge, -1, guided)), one),
        "joint_body_b": ("joint", _numbers(np.where(hinge, guided, -1)), one),
        "joint_origin": (("joint", "axis"), _rows([j.origin for j in joints]), {"units": "m"}),
        "joint_normal": (("joint", "axis"), _rows([j.normal for j in joints]), one),
        "joint_forward": (("joint", "axis"), _rows([j.forward for j in joints]), one),
        "joint_one_sided": ("joint", np.array([j.one_sided for j in joints], dtype=np.int8), one),
        "joint_curve": (
            ("joint", "power"),
            np.array([j.coefficients for j in joints], dtype=np.float64).reshape(-1, 4),
            one,
        ),
        "joint_length": ("joint", [j.length for j in joints], {"units": "m"}),
    }


def _surface_variables(
    surfaces: Sequence[tuple[str, Floats, NDArray[np.integer]]], of_body: Mapping[str, int]
) -> _Variables:
    sizes = [len(points) for _, points, _ in surfaces]
    first = np.cumsum([0, *sizes[:-1]])
    bodies = [_number(of_body, body, "a surface") for body, _, _ in surfaces]
    triangles = [t + k for (_, _, t), k in zip(surfaces, first, strict=True)]
    return {
        "surface_body": ("vertex", _numbers(np.repeat(bodies, sizes)), {"units": "1"}),
        "surface_position": (
            ("vertex", "axis"),
            np.concatenate([points for _, points, _ in surfaces]),
            {"units": "m"},
        ),
        "surface_triangle": (
            ("triangle", "corner"),
            _numbers(np.concatenate(triangles)),
            {"units": "1"},
        ),
    }


def _numbered(names: Iterable[str]) -> dict[str, int]:
    return {name: k for k, name in enumerate(names)}


def _number(found: Mapping[str, int], wanted: str, where: str) -> int:
    if wanted not in found:
        raise JawError(f"{where} refers to {wanted!r}, expected one of {', '.join(found)}")
    return found[wanted]


def _rows(values: Sequence[Vector]) -> Floats:
    return np.array(values, dtype=np.float64).reshape(-1, 3)


def _numbers(values: Any) -> NDArray[np.int32]:
    return np.asarray(values, dtype=np.int32)
