"""Coupled jaw, hyoid and tongue against the recorded motions of another simulator, without contact.

    python -m benchmarks tongue_coupled --out FOLDER    # table of docs/tongue.md; needs the recordings

The model is that recorded: bodies, muscles, springs and joints in millimetres, in the frame x
posterior, y right, z superior. Condyles that stay on the first of the 20 strips of their paths slide on
its plane, others on the cubic. The tongue is the published one with the rest shape of the coupled
model and the recorded fibre directions.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import Rotation

import sim
from benchmarks.report import finish, say
from benchmarks.tongue import SHARED, distances, published, recorded
from emgface.anatomy.jaw.published import condylar_path
from emgface.anatomy.jaw.published_parameters import CURVE_LENGTH, CURVE_STRIPS
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.published import TURN
from emgface.anatomy.tongue.scene import LINE, tongue_part
from sim.joints import Bushing, Joint, PointOnCurve, PointOnPlane
from sim.linear import linear_solver
from sim.scene import Term

CASES = (
    "jh_rest_gravity",
    "jh_open_ad_ip_0.2",
    "jht_element_GGP_0.2_nocontact",
    "jht_element_open_ad_ip_0.2_nocontact",
    "jht_line_GGP_0.2_nocontact",
)
VARIANTS = {"jht_element": variant("elements", stiffening=1.0), "jht_line": variant("lines")}
"""Tongues of the recorded models; that of elements does not stiffen there."""
INTEGRATORS = {
    "Trapezoidal": sim.LinearlyImplicitTrapezoidal(tolerance=1e-9),
    "ConstrainedBackwardEuler": sim.LinearlyImplicitEuler(tolerance=1e-9),
}
TO_M = 1e-3 * TURN
"""From recorded positions [mm] to those of the package."""
BITING, TURNED = np.array([93.7687, 0.0, 92.2142]), np.radians(8.2694)
"""Position of the jaw [mm] and its rotation about y with teeth in contact, in which that program places
the surfaces of joints; the recorded origins of their frames are those of the points at rest."""
STRAIGHT = 1e-3 * CURVE_LENGTH * (1.0 - 0.5 / CURVE_STRIPS)
"""Distance from which the condylar path is straight [m]."""


@dataclass(frozen=True)
class Coupled:
    """Scene of a recorded model, and the numbers of its named points."""

    scene: sim.Scene
    points: Mapping[str, int]


def coupled_scene(name: str, at_rest: bool = False, one_strip: bool = False) -> Coupled:
    """Jaw and hyoid of a recorded model, with its variant of the published tongue if it has one.

    The nodes of the tongue are attached where they begin in the recorded motions, up to 0.7 mm from
    where they are without stress, or `at_rest`. With `one_strip` the condyles slide on the first strip
    of their recorded paths, otherwise on the cubic.
    """
    files = SHARED / "artisynth_reference" / "coupled"
    model = json.loads((files / f"model_{name}.json").read_text())
    part = None
    if name in VARIANTS:
        whole = published(SHARED, f"coupled/model_{name}", rest="rest_il01")
        part = tongue_part(whole, VARIANTS[name])
    rigid = model["rigid"]
    moving = {b["name"]: _body(b) for b in rigid["bodies"] if b["dynamic"]}
    first = 0 if part is None else part.mesh.n_nodes
    positions = [] if part is None else list(part.points)
    held: dict[str, list[int]] = {name: [] for name in (*moving, "")}

    def add(body: str, position: Any) -> int:
        number = first + len(positions)
        positions.append(np.asarray(position) @ TO_M.T)
        held[body if body in moving else ""].append(number)
        return number

    markers = {m["name"]: m for m in rigid["markers"]}
    points = {n: add(m["body"], m["position_world_mm"]) for n, m in markers.items()}
    for c in rigid["connectors"]:
        points[c["name"]] = add(c["body"], c["point_world_mm"])
    terms: list[Term] = [_muscle(m, points) for m in rigid["muscles"] if m["enabled"]]
    if part is not None:
        terms += part.terms
        for body, nodes in part.held.items():
            held[body if body in moving else ""] += nodes.tolist()
    start = np.array(positions)
    if part is not None:
        # the rest shape is replaced after nodes are attached, which therefore begin elsewhere
        with np.load(files / f"model_{name}.npz") as arrays:
            tissue = arrays["tongue_position_at_start"][: part.mesh.n_nodes] @ TO_M.T
        start = np.concatenate([part.mesh.X if at_rest else tissue, start])
    members = [
        sim.OnBody(body, np.array(nodes), start[nodes])
        for body, nodes in held.items()
        if body and nodes
    ]
    scene = sim.Scene(
        sim.NO_TISSUE if part is None else part.mesh,
        (*terms, sim.Gravity((0.0, 0.0, -9.8))),
        (*members, sim.Fixed(np.array(held[""]))),
        None if part is None else part.damping,
        () if part is None else part.constraints,
        bodies=tuple(moving.values()),
        points=np.array(positions),
        joints=_joints(rigid, points, one_strip),
    )
    return Coupled(scene, points)


def _body(b: dict[str, Any]) -> sim.Body:
    R = TURN @ np.array(b["pose_R"])
    centre = np.array(b["pose_R"]) @ b["com_body_mm"] + b["pose_p"]
    inertia = R @ (1e-6 * np.array(b["inertia_about_com_kgmm2"])) @ R.T
    damping = b["frame_damping_kg_s"], 1e-6 * b["rotary_damping_kgmm2_s"]
    return sim.Body(b["name"], b["mass_kg"], 0.5 * (inertia + inertia.T), TO_M @ centre, damping)


def _muscle(m: dict[str, Any], points: Mapping[str, int]) -> sim.LineMuscles:
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


def _joints(rigid: dict[str, Any], points: Mapping[str, int], one_strip: bool) -> tuple[Joint, ...]:
    found: list[Joint] = []
    biting = Rotation.from_rotvec([0.0, TURNED, 0.0]).as_matrix()
    for c in rigid["connectors"]:
        if not c["enabled"]:
            continue
        place, name = TO_M @ (biting @ c["point_in_body_mm"] + BITING), c["name"]
        if c["type"] == "PlanarConnector":
            normal = TURN @ np.array(c["normal_world_D_z"])
            depth = float((place - TO_M @ np.array(c["point_world_mm"])) @ normal)
            if (
                c["unilateral"] and depth > 0.0
            ):  # that program corrects only what exceeds a tolerance
                place = place - min(depth, 1e-3 * c["penetration_tol"]) * normal
            found.append(
                PointOnPlane(name, points[name], None, place, normal, bool(c["unilateral"]))
            )
        else:
            down, forward = np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0])
            path = np.array(condylar_path())
            guided = name, points[name], None, place
            one_sided = bool(c["unilateral"])
            if one_strip:
                normal = TURN @ np.array(c["planes"][0]["normal_world"])
                found.append(PointOnPlane(*guided, normal, one_sided))
            else:
                curve = down, forward, path, (0.0, STRAIGHT)
                found.append(PointOnCurve(*guided, *curve, one_sided))
    for s in rigid["frame_springs"]:
        p = s["material_properties"]
        stiffness = (*p["stiffness"], *(3 * [1e-6 * p["rotaryStiffness"]]))
        place = TO_M @ np.array(s["attach_B_p"])
        found.append(Bushing(s["name"], None, s["A"], place, stiffness=stiffness))
    return tuple(found)


def repeated(
    name: str, step: float | None = None, at_rest: bool = False, until: float | None = None
) -> dict[str, Any]:
    """Distances of points and nodes from a recorded motion [mm]; the step is the recorded one [s]."""
    case, arrays = recorded(name, "coupled")
    duration = case["t_end_s"] if until is None else until
    condyles = [k for k, m in enumerate(case["markers"]) if m in ("ltmj", "rtmj")]
    moved = np.abs(
        arrays["marker_pos_mm"][:, condyles, 0] - arrays["marker_pos_mm"][0, condyles, 0]
    )
    coupled = coupled_scene(case["variant"], at_rest, moved.max() < CURVE_LENGTH / CURVE_STRIPS)
    system = sim.compile_scene(coupled.scene)
    target = {"bi_ad": ("lad", "rad"), "bi_ip": ("lip", "rip")}
    peak = np.zeros(len(system.muscles))
    for e in case["excitations"]:
        own = target.get(e["target"], ()) or [
            f"{e['target'].removeprefix('tongue/')}{s}" for s in ("_L", "_R")
        ]
        peak += [e["amax"] * (m.removesuffix(LINE) in own) for m in system.muscles]
    ramp = case["excitations"][0]["ramp_s"] if case["excitations"] else 1.0
    known = [(k, coupled.points[m]) for k, m in enumerate(case["markers"]) if m in coupled.points]
    names = tuple(case["markers"][k] for k, _ in known)
    probes = [sim.Markers(np.array([n for _, n in known]), names), sim.Frames(("jaw", "hyoid"))]
    began = time.process_time()
    motion, _ = sim.simulate(
        system,
        sim.Activation(np.array([0.0, ramp]), np.stack([0.0 * peak, peak])),
        duration=duration,
        steps=sim.FixedStep(case["h_s"] if step is None else step),
        every=case["output_interval_s"],
        integrator=INTEGRATORS[case["integrator"]],
        probes=(*probes, *((sim.Positions(),) if case["fems"] else ())),
        work=sim.Workspace(system, linear_solver().name),  # a factor of every matrix, as there
    )
    spent = time.process_time() - began
    ours = motion["position"].transpose("time", "marker", "axis").values @ TURN * 1e3
    theirs = arrays["marker_pos_mm"][: len(ours), [k for k, _ in known]]
    apart = np.linalg.norm(ours - theirs, axis=2)
    centre = motion["body_position"].transpose("time", "body", "axis").values @ TURN * 1e3
    hyoid = np.linalg.norm(centre[:, 1] - arrays["body_pose"][: len(ours), 1, :3], axis=1)
    incisor = names.index("lowerincisor")
    steps = duration / (case["h_s"] if step is None else step)
    row = {
        "case": name,
        "our step ms": 1e3 * (case["h_s"] if step is None else step),
        "incisor moved": round(float(np.linalg.norm(theirs[-1] - theirs[0], axis=1)[incisor]), 2),
        "points": f"{apart.max():.2g}",
        "points at the end": f"{apart[-1].max():.2g}",
        "hyoid": f"{hyoid.max():.2g}",
        "cpu ms per step": round(1e3 * spent / steps, 1),
        "theirs": round(case["cpu_ms_per_step_median"], 1),
    }
    if case["fems"]:
        nodes = distances(motion.isel(node=slice(0, 946)), 1e-3 * arrays["pos_tongue"][: len(ours)])
        row |= {"tongue": f"{nodes.max():.2g}", "tongue at the end": f"{nodes[-1].max():.2g}"}
    return row


def main(
    out: Path | None = None,
    case: list[str] | None = None,
    step: float | None = None,
    at_rest: bool = False,
) -> None:
    """Repeat the cases without contact, print the table and store it."""
    rows = list[dict[str, Any]]()
    for name in case or CASES:
        say(name)
        try:
            rows.append(repeated(name, step, at_rest))
        except sim.SimulationError as error:
            rows.append({"case": name, "ends": str(error)})
    finish("tongue-coupled", pd.DataFrame(rows), out)
