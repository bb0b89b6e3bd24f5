"""Model of jaw, hyoid and larynx as one Dataset: bodies, line muscles, springs, joints and points."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.anatomy.frame import check_frame, to_the_right
from emgface.errors import JawError
from emgface.muscles import AXES
from emgface.schema.validation import declared_variables, validate

Floats = NDArray[np.float64]
Vector = Floats | tuple[float, float, float]

JAW_FRAME = "x right, y anterior, z superior"
JOINT_KINDS = ("plane", "curve", "hinge")
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
    """A joint of one of `JOINT_KINDS`; see `sim.joints.PointOnPlane`, `PointOnCurve` and `Revolute`.

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


MUSCLE_VALUES = ("force_max", "stretch_max", "tendon_ratio", "passive_fraction", "damping")
OPTIONAL_VALUES = ("stretch_opt", "one_sided")
"""Parameters that a model may state for all of its muscles or springs."""
SPRING_VALUES = ("stiffness", "rest_length", "damping")
"""Parameters of muscles and springs; units are those of the variables of a jaw_model."""


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
    gain = np.zeros((len(exciters), len(muscles)))
    for k, (exciter, driven) in enumerate(exciters.items()):
        for muscle, factor in driven.items():
            gain[k, _number(of_muscle, muscle, f"exciter {exciter}")] = factor
    variables = declared_variables(
        "jaw_model",
        axis=AXES,
        body=list(of_body),
        muscle=list(of_muscle),
        spring=[s.name for s in springs],
        point=list(points),
        joint=[j.name for j in joints],
        exciter=list(exciters),
        body_mass=[b.mass for b in bodies],
        body_centre=_rows([b.centre for b in bodies]),
        body_inertia=[np.zeros((3, 3)) if b.inertia is None else b.inertia for b in bodies],
        body_damping=[b.damping[0] for b in bodies],
        body_turn_damping=[b.damping[1] for b in bodies],
        body_damped_at=_rows([b.centre if b.damped_at is None else b.damped_at for b in bodies]),
        body_moves=np.array([b.moves for b in bodies], dtype=np.int8),
        point_body=[_number(of_body, b, f"point {p}") for p, (b, _) in points.items()],
        point_position=_rows([x for _, x in points.values()]),
        **_line_arrays("muscle", muscles, MUSCLE_VALUES, of_body),
        **_line_arrays("spring", springs, SPRING_VALUES, of_body),
        **_joint_arrays(joints, of_body, of_point),
        **(_surface_arrays(surfaces, of_body) if surfaces else {}),
        exciter_gain=gain,
    )
    described = {"name": name, "origin": origin, "source": source, "frame": JAW_FRAME}
    return check_jaw(xr.Dataset(variables, attrs=described | dict(attrs or {})))


def check_jaw(ds: xr.Dataset) -> xr.Dataset:
    """Check a jaw against its schema and the directions of its frame, and return it.

    Raises SchemaError or UnitsError as the schema does, and JawError if the jaw is turned or
    mirrored: its muscles with sides determine the right, and the bite points and the lower incisor,
    where they are named, the anterior direction.
    """
    ds = validate(ds, "jaw_model")
    place = dict(zip(map(str, ds["point"].values), ds["point_position"].values, strict=True))
    named = {"bite_L", "bite_R", "lower_incisor"} <= place.keys()
    directions = {
        "right": to_the_right(
            [str(name) for name in ds["muscle"].values], ds["muscle_position"].values.mean(axis=1)
        ),
        "anterior": place["lower_incisor"] - (place["bite_L"] + place["bite_R"]) / 2
        if named
        else None,
    }
    check_frame("jaw", directions, JawError)
    return ds


def _line_arrays(
    kind: str, lines: Sequence[JawLine], values: Sequence[str], of_body: Mapping[str, int]
) -> dict[str, Any]:
    bodies = [[_number(of_body, b, f"{kind} {x.name}") for b in x.bodies] for x in lines]
    ends = np.array([x.ends for x in lines], dtype=np.float64).reshape(-1, 2, 3)
    further = [value for value in OPTIONAL_VALUES if lines and value in lines[0].values]
    return {
        f"{kind}_body": _numbers(bodies).reshape(-1, 2),
        f"{kind}_position": ends,
        **{
            f"{kind}_{value}": np.array([x.values[value] for x in lines], dtype=np.float64)
            for value in (*values, *further)
        },
    }


def _joint_arrays(
    joints: Sequence[JawJoint], of_body: Mapping[str, int], of_point: Mapping[str, int]
) -> dict[str, Any]:
    hinge = [joint.kind == "hinge" for joint in joints]
    guided = [
        _number(of_body if h else of_point, joint.point, f"joint {joint.name}")
        for joint, h in zip(joints, hinge, strict=True)
    ]
    curves = np.array([j.coefficients for j in joints], dtype=np.float64)
    return {
        "joint_kind": _numbers([JOINT_KINDS.index(j.kind) for j in joints]),
        "joint_body": _numbers([_number(of_body, j.body, f"joint {j.name}") for j in joints]),
        "joint_point": _numbers(np.where(hinge, -1, guided)),
        "joint_body_b": _numbers(np.where(hinge, guided, -1)),
        "joint_origin": _rows([j.origin for j in joints]),
        "joint_normal": _rows([j.normal for j in joints]),
        "joint_forward": _rows([j.forward for j in joints]),
        "joint_one_sided": np.array([j.one_sided for j in joints], dtype=np.int8),
        "joint_curve": curves.reshape(-1, 4),
        "joint_length": np.array([j.length for j in joints], dtype=np.float64),
    }


def _surface_arrays(
    surfaces: Sequence[tuple[str, Floats, NDArray[np.integer]]], of_body: Mapping[str, int]
) -> dict[str, Any]:
    sizes = [len(points) for _, points, _ in surfaces]
    first = np.cumsum([0, *sizes[:-1]])
    bodies = [_number(of_body, body, "a surface") for body, _, _ in surfaces]
    triangles = [t + k for (_, _, t), k in zip(surfaces, first, strict=True)]
    return {
        "surface_body": _numbers(np.repeat(bodies, sizes)),
        "surface_position": np.concatenate([points for _, points, _ in surfaces]),
        "surface_triangle": _numbers(np.concatenate(triangles)),
    }


def _numbered(names: Iterable[str]) -> dict[str, int]:
    return {name: k for k, name in enumerate(names)}


def _number(numbers: Mapping[str, int], wanted: str, where: str) -> int:
    if wanted not in numbers:
        raise JawError(f"{where} refers to {wanted!r}, expected one of {', '.join(numbers)}")
    return numbers[wanted]


def _rows(values: Sequence[Vector]) -> Floats:
    return np.array(values, dtype=np.float64).reshape(-1, 3)


def _numbers(values: Any) -> NDArray[np.int32]:
    return np.asarray(values, dtype=np.int32)
