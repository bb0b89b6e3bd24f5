"""Bodies, muscles, joints and exciters of the coupled models that another simulator has recorded.

The surfaces of joints are at their recorded places. The points that slide on them are not the recorded
ones: that program places them such that they are on the surface while the teeth are closed, and the
recorded motions of `constraint_point_mm` confirm it to 1e-5 mm. Condyles slide on 20 plane strips.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

import sim
from emgface.anatomy.tongue.published import TURN
from sim.joints import Bushing, Joint, PointOnPlane

Floats = np.ndarray
CONDYLES = ("LTMJ", "RTMJ")
TO_M = 1e-3 * TURN
"""From recorded positions [mm] to those of the package."""
BITING, TURNED = np.array([93.7687, 0.0, 92.2142]), np.radians(8.2694)
"""Position of the jaw [mm] and its rotation about y with teeth in contact."""


def body_of(b: dict[str, Any]) -> sim.Body:
    """Body with its mass, inertia and damping in SI units."""
    R = TURN @ np.array(b["pose_R"])
    centre = np.array(b["pose_R"]) @ b["com_body_mm"] + b["pose_p"]
    inertia = R @ (1e-6 * np.array(b["inertia_about_com_kgmm2"])) @ R.T
    damping = b["frame_damping_kg_s"], 1e-6 * b["rotary_damping_kgmm2_s"]
    return sim.Body(b["name"], b["mass_kg"], 0.5 * (inertia + inertia.T), TO_M @ centre, damping)


def muscle_of(m: dict[str, Any], points: Mapping[str, int]) -> sim.LineMuscles:
    """Muscle between two points, whose optimal length is the recorded one."""
    p, length = m["material_properties"], m["length_mm"]
    law = sim.Peck(
        1e-3 * p["maxForce"],
        p["optLength"] / length,
        p["maxLength"] / p["optLength"],
        p["tendonRatio"],
        p["passiveFraction"],
    )
    line = sim.LineFibre(0, np.array([points[m["first"]], points[m["second"]]]))
    return sim.LineMuscles((m["name"],), [line], law, damping=p["damping"])


def connector(model: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Recorded joint by its name."""
    return next(c for c in model["rigid"]["connectors"] if c["name"] == name)


def sliding_point(model: Mapping[str, Any], name: str) -> Floats:
    """Point of a joint in the frame of the jaw, on its surface while the teeth are closed [mm]."""
    biting = Rotation.from_rotvec([0.0, TURNED, 0.0]).as_matrix()
    return biting.T @ (np.array(connector(model, name)["frame_D_origin_world_mm"]) - BITING)


def start_of(model: Mapping[str, Any], c: Mapping[str, Any]) -> Floats:
    """Place of that point at the start [mm]."""
    (jaw,) = (b for b in model["rigid"]["bodies"] if b["name"] == c["body"])
    return np.array(jaw["pose_R"]) @ sliding_point(model, c["name"]) + jaw["pose_p"]


def strip_plane(model: Mapping[str, Any], name: str, point: int, k: int) -> PointOnPlane:
    """Condyle on the plane of a strip."""
    c = connector(model, name)
    place = TO_M @ np.array(c["segment_points"][k]["world"])
    normal = TURN @ np.array(c["planes"][k]["normal_world"])
    return PointOnPlane(name, point, None, place, normal, bool(c["unilateral"]))


def joints_of(model: Mapping[str, Any], points: Mapping[str, int]) -> tuple[Joint, ...]:
    """Walls, bite planes and the spring of the hyoid.

    That program corrects the position of a one-sided constraint only beyond a tolerance.
    """
    joints: list[Joint] = []
    for c in model["rigid"]["connectors"]:
        if not c["enabled"] or c["name"] in CONDYLES:
            continue
        origin, normal = np.array(c["frame_D_origin_world_mm"]), np.array(c["normal_world_D_z"])
        depth = float((origin - start_of(model, c)) @ normal)
        origin = origin - np.clip(depth, 0.0, c["penetration_tol"]) * normal
        row = c["name"], points[c["name"]], None, TO_M @ origin, TURN @ normal
        joints.append(PointOnPlane(*row, bool(c["unilateral"])))
    for s in model["rigid"]["frame_springs"]:
        p = s["material_properties"]
        stiffness = (*p["stiffness"], *(3 * [1e-6 * p["rotaryStiffness"]]))
        place = TO_M @ np.array(s["attach_B_p"])
        joints.append(Bushing(s["name"], None, s["A"], place, stiffness=stiffness))
    return tuple(joints)


def exciters_of(model: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Muscles and gains of every exciter, and every muscle of its own; those of tissue as FEM/name."""
    rigid = model["rigid"]
    targets_of: dict[str, dict[str, float]] = {
        m["name"]: {m["name"]: 1.0} for m in rigid["muscles"]
    }

    def resolved(name: str, given: Mapping[str, Mapping[str, float]]) -> dict[str, float]:
        if name not in given:
            return {name: 1.0}
        total: dict[str, float] = {}
        for target, gain in given[name].items():
            for muscle, own in resolved(target, given).items():
                total[muscle] = total.get(muscle, 0.0) + gain * own
        return total

    for name in rigid["exciters"]:
        targets_of[name] = resolved(name, rigid["exciters"])
    for fem in model.get("fems") or []:
        bundles = {b["name"] for b in fem["bundles"]}
        targets_of |= {f"{fem['name']}/{b}": {b: 1.0} for b in bundles}
        for name, targets in (fem["exciters"] or {}).items():
            if set(targets) <= bundles:  # the others are single elements of bundles
                targets_of[f"{fem['name']}/{name}"] = dict(targets)
    return targets_of
