"""Scene of a jaw model: its bodies, line muscles, springs, joints and points as parts of `sim`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.jaw.laws import MUSCLE_LAWS, RELATIONS, MuscleLine
from emgface.anatomy.jaw.model import JOINT_KINDS, Floats
from emgface.errors import JawError
from emgface.muscles import AXES
from sim.bodies import Motion
from sim.joints import Joint, PointOnCurve, PointOnPlane, Revolute
from sim.scene import Term

DAMPER_LENGTH = 1e9
"""Distance of the fixed ends of dampers against space [m]."""


@dataclass(frozen=True, eq=False)
class JawScene:
    """A jaw in `sim`.

    Attributes
    ----------
    scene : sim.Scene
    bodies : bodies of the scene, in its order.
    points : number of every named point in the scene.
    muscles : every muscle by name.
    """

    scene: sim.Scene
    bodies: tuple[str, ...]
    points: Mapping[str, int]
    muscles: Mapping[str, MuscleLine]


def jaw_scene(
    jaw: xr.Dataset,
    *,
    law: str = "peck",
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.8),
    head: Motion | None = None,
    terms: Callable[[Mapping[str, int]], tuple[Term, ...]] = lambda points: (),
    first: int = 0,
) -> JawScene:
    """Scene of a jaw model.

    Parameters
    ----------
    jaw : xarray.Dataset
        A jaw_model.
    law : str
        Muscle law, one of `MUSCLE_LAWS`.
    gravity : (3,) [m/s^2]
    head : callable, optional
        Position (3,) and quaternion (4,) of the skull at a time [s], which starts at 0 and (1, 0, 0, 0);
        without it the skull stays.
    terms : callable, optional
        Further terms of the scene, from the numbers of the named points.
    first : int
        Number of nodes before the points, if the scene is to be joined with tissue.

    Returns
    -------
    JawScene

    Raises
    ------
    JawError
        The law is unknown.
    SceneError
        A parameter is out of range, or joints contradict each other.
    """
    if law not in MUSCLE_LAWS:
        raise JawError(f"muscle law {law!r}, expected one of {', '.join(MUSCLE_LAWS)}")
    parts = _Parts(jaw, head, first)
    lines, muscles = _muscles(jaw, parts, law)
    springs = _springs(jaw, parts)
    points = {
        str(name): parts.add(parts.names[b], x)
        for name, b, x in zip(
            jaw["point"].values,
            jaw["point_body"].values,
            jaw["point_position"].values,
            strict=True,
        )
    }
    dampers = _dampers(parts)
    further = terms(points)
    scene = sim.Scene(
        sim.NO_TISSUE,
        (sim.Gravity(gravity), *lines, *springs, *dampers, *further),
        tuple(parts.members()),
        bodies=tuple(parts.bodies.values()),
        points=np.array(parts.positions).reshape(-1, 3),
        joints=tuple(_joints(jaw, parts, points)),
    )
    return JawScene(scene, tuple(parts.bodies), points, muscles)


class _Parts:
    """Bodies and points of a scene while it is built."""

    def __init__(self, jaw: xr.Dataset, head: Motion | None, first: int) -> None:
        self._first = first
        self.names = [str(name) for name in jaw["body"].values]
        self.positions: list[Floats] = []
        self._points_of: dict[str, list[int]] = {}
        self._head = head
        moves = {
            n for n, moving in zip(self.names, jaw["body_moves"].values, strict=True) if moving
        }
        if head is not None:
            moves.add("skull")
        self.rows = {name: row for name, row in rows_of(jaw, "body") if name in moves}
        self.bodies = {name: _body(name, row) for name, row in self.rows.items()}

    def add(self, body: str, position: Floats) -> int:
        """Number of a new point on a body."""
        number = self._first + len(self.positions)
        self._points_of.setdefault(body, []).append(number)
        self.positions.append(position)
        return number

    def moving_body(self, body: str) -> str | None:
        """Body of the scene, None for one that stays."""
        return body if body in self.bodies else None

    def members(self) -> list[sim.Fixed | sim.OnBody | sim.PrescribedBody]:
        """Points on moving bodies, points on bodies that stay, prescribed motion of the skull."""
        still = [
            n for body, points in self._points_of.items() if body not in self.bodies for n in points
        ]
        conditions: list[sim.Fixed | sim.OnBody | sim.PrescribedBody] = [
            sim.OnBody(body, np.array(points))
            for body, points in self._points_of.items()
            if body in self.bodies
        ]
        if still:
            conditions.append(sim.Fixed(np.array(still)))
        if self._head is not None:
            conditions.append(sim.PrescribedBody("skull", self._head))
        return conditions


Row = Mapping[str, Any]
"""Values of one entry of a dimension, by variable."""


def rows_of(jaw: xr.Dataset, dim: str) -> list[tuple[str, Row]]:
    """Name and values of every entry of a dimension."""
    columns = {str(v): jaw[v].values for v in jaw.data_vars if jaw[v].dims[:1] == (dim,)}
    names = map(str, jaw[dim].values)
    return [(name, {v: x[k] for v, x in columns.items()}) for k, name in enumerate(names)]


def _body(name: str, row: Row) -> sim.Body:
    damping = float(row["body_damping"]) * _damped_at_centre(row)
    turning = float(row["body_turn_damping"])
    inertia, centre = row["body_inertia"], row["body_centre"]
    return sim.Body(name, float(row["body_mass"]), inertia, centre, (damping, turning))


def _damped_at_centre(row: Row) -> bool:
    return np.array_equal(row["body_damped_at"], row["body_centre"])


def _dampers(parts: _Parts) -> list[Term]:
    """Damping of the translation of bodies at another point than their centre.

    Three dampers to points at such distances that their directions remain those of the axes.
    """
    dampers = list[Term]()
    for name, row in parts.rows.items():
        damping, at = float(row["body_damping"]), row["body_damped_at"]
        if damping > 0.0 and not _damped_at_centre(row):
            near = parts.add(name, at)
            far = [parts.add("", at + DAMPER_LENGTH * axis) for axis in np.eye(3)]
            fibres = [sim.LineFibre(0, np.array([node, near])) for node in far]
            own = (f"damping of {name}",)
            dampers.append(sim.LineMuscles(own, fibres, sim.ConstantForce(0.0), damping=damping))
    return dampers


def _fibres(jaw: xr.Dataset, kind: str, parts: _Parts, chosen: list[int]) -> list[sim.LineFibre]:
    fibres = list[sim.LineFibre]()
    for k, i in enumerate(chosen):
        bodies, ends = jaw[f"{kind}_body"].values[i], jaw[f"{kind}_position"].values[i]
        nodes = [parts.add(parts.names[b], x) for b, x in zip(bodies, ends, strict=True)]
        fibres.append(sim.LineFibre(k, np.array(nodes)))
    return fibres


def _by_damping(damping: Floats) -> list[tuple[float, list[int]]]:
    return [(float(d), np.flatnonzero(damping == d).tolist()) for d in np.unique(damping)]


def _muscles(jaw: xr.Dataset, parts: _Parts, law: str) -> tuple[list[Term], dict[str, MuscleLine]]:
    names = [str(name) for name in jaw["muscle"].values]
    prefix = "muscle_"
    columns = {
        str(v).removeprefix(prefix): jaw[v].values
        for v in jaw.data_vars
        if str(v).startswith(prefix) and jaw[v].dims == ("muscle",)
    }
    terms, lines = list[Term](), dict[str, MuscleLine]()
    rest = np.linalg.norm(np.diff(jaw["muscle_position"].values, axis=1)[:, 0], axis=1)
    relation_of = RELATIONS.get(law)
    damped = jaw["muscle_damping"].values * (relation_of is None)
    for damping, chosen in _by_damping(damped):
        values = [{name: float(x[i]) for name, x in columns.items()} for i in chosen]
        laws = [MUSCLE_LAWS[law](own) for own in values]
        relations = None if relation_of is None else [relation_of(own) for own in values]
        fibres = _fibres(jaw, "muscle", parts, chosen)
        own = tuple(names[i] for i in chosen)
        terms.append(sim.LineMuscles(own, fibres, laws, damping=damping, relation=relations))
        for k, i in enumerate(chosen):
            a, b = (int(node) for node in fibres[k].points)
            relation = None if relations is None else relations[k]
            lines[names[i]] = MuscleLine((a, b), laws[k], damping, float(rest[i]), relation)
    return terms, {name: lines[name] for name in names}


def _springs(jaw: xr.Dataset, parts: _Parts) -> list[Term]:
    """Springs of equal values, as muscles that are never active: k (L - L_0) + k (L_0 - free length)."""
    length = np.linalg.norm(np.diff(jaw["spring_position"].values, axis=1)[:, 0], axis=1)
    k, d = jaw["spring_stiffness"].values, jaw["spring_damping"].values
    free = jaw["spring_rest_length"].values
    springs = list[Term]()
    ligaments = np.zeros(len(k), dtype=bool)
    if "spring_one_sided" in jaw:
        ligaments = jaw["spring_one_sided"].values > 0.0
        springs += _ligaments(jaw, parts, np.flatnonzero(ligaments).tolist(), length)
    slack = np.where(ligaments, 0.0, length - free)
    preload = np.where(np.abs(slack) < 1e-12, 0.0, k * slack).round(15)
    if (preload < 0.0).any():
        raise JawError("a spring is shorter at rest than without force, expected tension or none")
    rows, own = np.unique(np.column_stack([k, d, preload]), axis=0, return_inverse=True)
    for i, (stiffness, damping, tension) in enumerate(rows.tolist()):
        chosen = np.flatnonzero((own.ravel() == i) & ~ligaments).tolist()
        if not chosen:
            continue
        lines = [sim.LineFibre(0, f.points) for f in _fibres(jaw, "spring", parts, chosen)]
        law = sim.ConstantForce(1.0, tension)
        springs.append(sim.LineMuscles((f"springs {i}",), lines, law, stiffness, damping))
    return springs


def _ligaments(jaw: xr.Dataset, parts: _Parts, chosen: list[int], length: Floats) -> list[Term]:
    """Springs without force below their free length."""
    ligaments, rows = list[Term](), rows_of(jaw, "spring")
    for i in chosen:
        name, row = rows[i]
        free = float(row["spring_rest_length"])
        law = sim.LinearSpring(float(row["spring_stiffness"]) * free, 1.0, free / float(length[i]))
        (fibre,) = _fibres(jaw, "spring", parts, [i])
        damping = float(row["spring_damping"])
        ligaments.append(
            sim.LineMuscles((name,), [sim.LineFibre(0, fibre.points)], law, 0.0, damping)
        )
    return ligaments


def _joints(jaw: xr.Dataset, parts: _Parts, points: Mapping[str, int]) -> list[Joint]:
    numbers, joints = list(points.values()), list[Joint]()
    for name, row in rows_of(jaw, "joint"):
        kind, body = (
            JOINT_KINDS[int(row["joint_kind"])],
            parts.moving_body(parts.names[int(row["joint_body"])]),
        )
        origin, normal = row["joint_origin"], row["joint_normal"]
        if kind == "hinge":
            other = parts.moving_body(parts.names[int(row["joint_body_b"])])
            joints.append(Revolute(name, body, other, origin, normal))
            continue
        guided = {
            "point": numbers[int(row["joint_point"])],
            "body": body,
            "origin": origin,
            "normal": normal,
            "unilateral": bool(row["joint_one_sided"]),
        }
        if kind == "plane":
            joints.append(PointOnPlane(name, **guided))
        else:
            curve, reach = row["joint_curve"], (0.0, float(row["joint_length"]))
            forward = row["joint_forward"]
            joints.append(
                PointOnCurve(name, forward=forward, coefficients=curve, reach=reach, **guided)
            )
    return joints


__all__ = ["AXES", "MUSCLE_LAWS", "JawScene", "jaw_scene"]
