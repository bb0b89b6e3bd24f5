"""Trajectories of the reference face against those recorded with another simulator.

    python -m benchmarks other_simulator --out FOLDER
    python -m benchmarks other_simulator --table    # that of docs/verification.md, without contact

Same mesh, muscles, laws, scheme and step; per case and time the rms and the largest distance of a
node. The excitation rises linearly to its end value within 0.1 s and is then held; h = 5 ms.
"""

import json
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

import sim
from benchmarks.report import finish, markdown, say
from emgface.face.artisynth import import_artisynth
from emgface.face.contact import contact_terms
from emgface.face.parts import FREE, arches_of
from emgface.face.penetration import depths
from emgface.face.simulation_parameters import SimulationParameters
from sim.linear import linear_solver

RAMP = 0.1  # s
SHARED = Path(os.environ.get("EMGFACE_SHARED", "../shared"))
THEIR_HEX = [3, 2, 1, 0, 7, 6, 5, 4]  # the other program orders the faces oppositely


@dataclass(frozen=True)
class Case:
    """One recorded run.

    With `contact` the lips touch each other and the bones. The other program holds every node that
    is inside at the start of a step; here, initial depths are kept.
    """

    name: str  #: file name without ending
    volume: str  #: "nodal", "element" or "hard"
    group: str  #: muscle of both sides, or "" for none
    level: float  #: final excitation
    integrator: sim.integrators.TimeIntegrator
    fibre: sim.Blemker | sim.Generic  #: law of the fibres
    gravity: bool = False
    contact: bool = False


# The other program solves directly; the error of an iterative solution is up to 1e-6 mm per step.
EULER = sim.LinearlyImplicitEuler(tolerance=1e-9)
TRAPEZOIDAL = sim.LinearlyImplicitTrapezoidal(tolerance=1e-9)
BLEMKER = sim.Blemker(100e3)
CASES = (
    Case("B_demo_hardelem_generic_trap_ZYG", "hard", "ZYG", 0.5, TRAPEZOIDAL, sim.Generic(100e3)),
    Case("C_softelem_blemker_ZYG", "element", "ZYG", 0.5, EULER, BLEMKER),
    Case("C_softelem_blemker_LLSAN", "element", "LLSAN", 0.5, EULER, BLEMKER),
    Case("A_softnodal_blemker_ZYG", "nodal", "ZYG", 0.5, EULER, BLEMKER),
    Case("A_softnodal_blemker_OOP_amax0.2", "nodal", "OOP", 0.2, EULER, BLEMKER),
    Case("G_gravity_softnodal", "nodal", "", 0.0, EULER, BLEMKER, gravity=True),
)
LIPS = "X_contact_demo_gravity_nomuscle"
CONTACT = (
    Case(LIPS, "hard", "", 0.0, TRAPEZOIDAL, sim.Generic(100e3), gravity=True),
    Case(LIPS, "hard", "", 0.0, TRAPEZOIDAL, sim.Generic(100e3), gravity=True, contact=True),
)
"""The recorded run with contact, compared with simulations without and with contact.

The other program moves the nodes that are initially inside the bones out of them in the first
steps; here they may stay. The columns `..._far` therefore omit the nodes near them.
"""
ROUNDING = 1e-9  #: distances below this are due to rounding, which depends on the processor [mm]

FAR = 15e-3
"""Distance from the nodes initially inside a bone beyond which nodes are undisturbed [m]."""


def their_face(folder: Path, case: Case, model: dict[str, Any] | None = None) -> sim.System:
    """Scene of a case on the recorded mesh, or a model like it; muscles contain both sides."""
    model = model or json.loads((folder / "refmodel_model.json").read_text())
    blocks: dict[str, list[list[int]]] = {"hex8": [], "wedge6": []}
    place: list[tuple[str, int]] = []
    for element in model["elements"]:
        kind = "hex8" if element["type"] == "HexElement" else "wedge6"
        order = THEIR_HEX if kind == "hex8" else range(6)
        place.append((kind, len(blocks[kind])))
        blocks[kind].append([element["nodes"][i] for i in order])
    index = np.array([i if kind == "hex8" else len(blocks["hex8"]) + i for kind, i in place])
    mesh = sim.mesh_from_arrays(np.array(model["rest_positions"]), **blocks)
    bundles = {k: b for k, b in model["muscles"].items() if b["element_indices"]}
    rows = [index[b["element_indices"]] for b in bundles.values()]
    muscles = sim.Muscles(
        tuple(bundles),
        np.concatenate(rows),
        np.repeat(np.arange(len(rows)), [len(r) for r in rows]),
        np.concatenate([b["directions"] for b in bundles.values()]),
        case.fibre,
    )
    solid = sim.Solid((sim.Material(bulk=sim.QuadraticBulk(0.0)),), muscles=muscles)
    # With hard volumes the other program keeps its soft pressure, whose geometric stiffness remains.
    soft = sim.NodalVolume(25e3) if case.volume == "nodal" else sim.ElementVolume(25e3)
    gravity = (sim.Gravity(),) if case.gravity else ()
    touching: tuple[sim.scene.Term, ...] = ()
    if case.contact:
        published = import_artisynth(folder.parent / "artisynth_models")
        touching = contact_terms(published, SimulationParameters())
    return sim.compile_scene(
        sim.Scene(
            mesh,
            (solid, soft, *gravity, *touching),
            (sim.Fixed(np.array(model["fixed_node_indices"])),),
            sim.Rayleigh(19.0, 0.055),
            (sim.HardElementVolume(),) if case.volume == "hard" else (),
        )
    )


def compare(folder: Path, case: Case, until: float, h: float = 5e-3) -> list[dict[str, object]]:
    """One row per recorded time up to `until` [s]."""
    system = their_face(folder, case)
    peak = np.array(
        [case.level if name.startswith(case.group or "-") else 0.0 for name in system.muscles]
    )
    activation = sim.Activation(np.array([0.0, RAMP]), np.stack([0.0 * peak, peak]))
    recorded = np.load(folder / f"{case.name}.npz")
    times = sorted(float(k.removeprefix("pos_t")) for k in recorded if k.startswith("pos_t"))
    # an iteration with an older factor would leave 1e-7 mm of hard volumes
    direct = case.volume == "hard" and not case.contact
    work = sim.Workspace(system, linear_solver().name if direct else "auto")
    state, rows = system.rest_state(), list[dict[str, object]]()
    start = time.perf_counter()
    for t in [t for t in times if 0.0 < t <= until + 1e-9]:
        _, state = sim.simulate(
            system,
            activation,
            duration=t - state.t,
            integrator=case.integrator,
            steps=sim.FixedStep(h),
            initial=state,
            work=work,
        )
        key = next(k for k in recorded if k.startswith("pos_t") and float(k[5:]) == t)
        distance = np.linalg.norm(state.q - recorded[key], axis=1) * 1e3
        moved = np.linalg.norm(state.q - system.scene.mesh.X, axis=1) * 1e3
        far = distance[_undisturbed(folder, system)] if case.name == LIPS else distance
        rows.append(
            {
                "case": case.name,
                "our_contact": case.contact,
                "time_s": t,
                "rms_mm": float(np.sqrt((distance**2).mean())),
                "max_mm": float(distance.max()),
                "rms_mm_far": float(np.sqrt((far**2).mean())),
                "max_mm_far": float(far.max()),
                "largest_displacement_mm": float(moved.max()),
                "run_time_s": time.perf_counter() - start,
            }
        )
    return rows


def _undisturbed(folder: Path, system: sim.System) -> NDArray[np.bool_]:
    """Nodes far from those that are initially inside a bone."""
    face = import_artisynth(folder.parent / "artisynth_models")
    X, free = system.scene.mesh.X, face["fixed"].values == FREE
    inside = np.zeros(len(X), dtype=bool)
    for arch in arches_of(face):
        inside |= free & (depths(X, arch.points[arch.triangles]) > 0.0)
    return KDTree(X[inside]).query(X)[0] > FAR


def main(out: Path | None = None, table: bool = False) -> None:
    """Compare, print and store; with --table as in docs, without contact."""
    rows: list[dict[str, object]] = []
    for one in CASES if table else (*CASES, *CONTACT):
        say(f"{one.name}, contact {one.contact}")
        rows += compare(SHARED / "artisynth_reference", one, 1.0)
    if table:
        print(markdown(pd.DataFrame(table_of(rows))))
    else:
        finish("other-simulator", pd.DataFrame(rows), out)


def table_of(rows: list[dict[str, Any]]) -> list[dict[str, str]]:
    """Distances [mm]; those below `ROUNDING` are printed as such."""
    names = {
        c.name: f"{c.volume} volumes, {type(c.fibre).__name__} muscle, "
        f"{'trapezoidal rule' if c.integrator is TRAPEZOIDAL else 'backward Euler'}, "
        + (f"{c.group} to {c.level:g}" if c.group else "gravity alone")
        for c in CASES
    }
    return [
        {
            "case": names[str(row["case"])],
            "time s": f"{row['time_s']:g}",
            **{
                name: f"{row[key]:.1e}" if row[key] >= ROUNDING else f"< {ROUNDING:.0e}"
                for name, key in (("rms", "rms_mm"), ("largest", "max_mm"))
            },
            "largest displacement": f"{row['largest_displacement_mm']:.3f}",
        }
        for row in rows
    ]
