"""Tongue and head: required and measured values of the specification (``--table`` prints them).

1 attachments; 2 elimination; 3 rigid motion and a pendulum; 4
stored shapes of the published tongue; 5 actions of the muscles of a tongue; 6 closing with an open jaw,
from the table of `studies.coupled`; 7 labials, from its table and on the published face; 8 tongue
against the palate.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import pytest

import sim
from benchmarks.tongue import postures
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.outcomes import outcomes
from emgface.anatomy.head.published import import_head
from emgface.anatomy.head.run import raised, scene_activation, simulate_head
from emgface.anatomy.head.scene import TONGUE, head_scene
from emgface.anatomy.tongue.actions import action_table
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.published import TURN, import_tongue
from emgface.face.ansys import read_nodes
from emgface.face.mouth import Mouth
from emgface.face.simulation_parameters import SimulationParameters
from studies.coupled.__main__ import HERE
from studies.coupled.experiments import LABIALS, LAW
from studies.coupled.findings import findings
from tests.kinematics import test_joints, test_maps, test_motion, test_volumes
from tests.specification import Result, limited

SIGNS: Final = {
    "GGP": {"tip_forward": 1.0},
    "STY": {"back_forward": -1.0, "back_up": 1.0},
    "HG": {"back_up": -1.0},
    "SL": {"tip_up": 1.0},
    "TRANS": {"longer": 1.0, "wider": -1.0},
}
"""Published directions of the actions of muscles."""
Results = Iterator[Result]


def _off(computed: np.ndarray, exact: np.ndarray) -> float:
    return float(np.abs(computed - exact).max() / np.abs(exact).max())


def attachments() -> Results:
    """Check 1."""
    start, free, led = test_motion.attached_and_led()
    moved = float(np.abs(free - start).max())
    yield limited(
        "1 tissue on a body, and on its motion prescribed",
        float(np.abs(led - free).max()) / moved,
        1e-10,
    )
    work, loads, d = test_maps.work_of_an_attached_node()
    yield limited(
        "1 work of a node in an element on a body", abs(float(loads @ d) / work - 1.0), 1e-12
    )
    on_body = bool(np.abs(loads[test_maps.MAPS.first :]).max() > 0.1)
    yield Result(
        "1 chain node, element, body", "loads the body", "does" if on_body else "does not", on_body
    )


def elimination() -> Results:
    """Check 2."""
    (w, exact), (f, forces) = test_volumes.rows_and_saddle()
    yield limited("2 velocities, against the full saddle system with joints", _off(w, exact), 1e-9)
    yield limited("2 forces of the joints, likewise", _off(f, forces), 1e-9)
    for cls in (sim.ConvergedEuler, sim.Trapezoidal, sim.Sdirk2):
        before, after = test_motion.momentum_of_a_free_compound(cls)
        yield limited(f"2 change of momentum, {cls.__name__}", _off(after, before), 1e-10)


def rigid() -> Results:
    """Check 3."""
    head = build_head(preset="man", resolution=400, tongue_resolution=150, contacts=[])
    system = head_scene(head, gravity=False).system
    X, control = system.rest_state().q, system.control(np.zeros(len(system.muscles)))
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    f = np.zeros_like(X)
    for term in system.terms:
        if hasattr(term, "smallest_J"):
            term.add(np.ascontiguousarray(X @ R.T + [0.1, 0.0, 0.2]), control, f)
    yield limited(
        "3 largest force of the tissue of a head that is moved rigidly",
        float(np.abs(f).max()),
        1e-9,
        " N",
    )
    angle, momentum = test_joints.bar_after_half_a_period()
    yield limited(
        "3 bar on a hinged body after half a period: angle over its amplitude", abs(angle), 2e-3
    )
    yield limited("3 and momentum over its reverse at the start, less 1", abs(momentum + 1.0), 2e-3)


def shapes(models: Path) -> Results:
    """4 stored shapes of the published tongue."""
    del models  # those stored with the recordings, as of `benchmarks tongue`
    table = postures(("elements", "elements, no gravity"))
    for _, row in table.iterrows():
        name = f"4 shape {row['shape']}, {row['model']}"
        yield limited(f"{name}: median", float(row["median"]), 1.0, " mm")
        yield limited(f"{name}: tip", float(row["tip apart"]), 1.5, " mm")
        signs = [
            [np.sign(float(v)) for v in str(row[k]).split(",")] for k in ("tip x, z", "stored")
        ]
        yield Result(
            f"{name}: signs of the tip",
            f"of {row['stored']}",
            str(row["tip x, z"]),
            signs[0] == signs[1],
        )


def _actions(name: str, table: pd.DataFrame, full: pd.DataFrame, soft: float) -> Results:
    by = {str(row["muscle"]): row for row in table.to_dict("records")}
    volume = {muscle: float(row["volume_percent"]) for muscle, row in by.items()}
    above = [muscle for muscle, change in volume.items() if change > soft]
    yield Result(
        f"5 {name}: volume of every muscle",
        f"within {soft:g} %",
        f"{max(volume.values()):.2g} %" + (f" ({', '.join(above)})" if above else ""),
        not above,
    )
    for muscle, wanted in SIGNS.items():
        displacements = {k: float(by[muscle][k]) for k in wanted}
        yield Result(
            f"5 {name}: {muscle}",
            ", ".join(
                f"{k.replace('_', ' ')} {'> 0' if s > 0 else '< 0'}" for k, s in wanted.items()
            ),
            ", ".join(f"{v:.1f} mm" for v in displacements.values()),
            all(displacements[k] * s > 0.0 for k, s in wanted.items()),
        )
    failed = "fails" in full and bool(full["fails"].notna().any())
    yield Result(
        f"5 {name}: smallest det F at 1.0", "above 0", f"{full['smallest_J'].min():.2g}", not failed
    )


def generated_tongue() -> Results:
    """Check 5 with the generated tongue."""
    tongue = build_head(["tongue"], preset="man", resolution="coarse").parts["tongue"]
    tables = [
        action_table(tongue, TONGUE, level=level, step=2e-2, check=False) for level in (0.3, 1.0)
    ]
    yield from _actions("generated", tables[0], tables[1], 1.0)


def published_tongue(models: Path) -> Results:
    """5 actions of the published tongue."""
    tongue = import_tongue(models / "tongue")
    p = variant("elements", damping_tangent="passive")
    tables = [action_table(tongue, p, level=level, step=2e-2, check=False) for level in (0.3, 1.0)]
    yield from _actions("published", tables[0], tables[1], 1.0)


def closing() -> Results:
    """Check 6."""
    for one in findings("closing", pd.read_csv(HERE / "closing.csv")):
        yield Result(f"6 {one.statement}", "", one.computed, one.holds)


def labials() -> Results:
    """Check 7 on the generated face."""
    for one in findings("labials", pd.read_csv(HERE / "labials.csv")):
        yield Result(f"7 generated: {one.statement}", "", one.computed, one.holds)


def approximant(models: Path) -> Results:
    """7 area of the mouth of the published face."""
    head = import_head(models, ["face"])
    scene = head_scene(head, face=SimulationParameters.model_validate(LAW))
    drive = raised({f"bi_{m}": level for m, level in LABIALS["approximant"].items()}, jaw=False)
    motion = simulate_head(
        head, drive, duration=0.4, step=2e-2, output=4e-2, scene=scene, check=False
    )
    area = 1e6 * motion["mouth_area"].values
    last = float(outcomes(motion, head)["area_mm2"])
    yield Result(
        "7 published face, at rest", "40 mm2 within 15 %", f"{area[0]:.1f} mm2",
        abs(area[0] / 40.0 - 1.0) < 0.15,
    )  # fmt: skip
    other = read_nodes(models / "face_badin" / "badinface_adjusted.node").position @ TURN.T
    seen, _ = Mouth.from_face(head.parts["face"]).measure(other)
    yield Result("7 other mesh of that face, at rest", "", f"{1e6 * seen:.1f} mm2", None)
    falls = bool((np.diff(area) < 0.1).all())
    yield Result(
        "7 published face, OOP 0.3", "falls to 16 mm2 within 30 %",
        f"{last:.1f} mm2, {'falling' if falls else 'not always falling'}",
        falls and abs(last / 16.0 - 1.0) < 0.3,
    )  # fmt: skip
    yield Result(
        "7 published face, OOP 0.3 over rest", "0.40 within 30 %", f"{last / area[0]:.2f}",
        abs(last / area[0] / 0.4 - 1.0) < 0.3,
    )  # fmt: skip


def palate() -> Results:
    """Check 8, with a tenth of superior longitudinal, which draws the tongue away, and styloglossus."""
    head = build_head(["tongue"], preset="man", resolution="coarse")
    system = head_scene(head).system
    free = np.unique(system.free // 3)
    for muscle, level in (("SL", 1.0), ("SL", 0.1), ("STY", 1.0)):
        levels = {"bi_GGP": 1.0, f"bi_{muscle}": level}
        drive, _, _ = scene_activation(head, system, raised(levels, jaw=False))
        motion, end = sim.simulate(
            system, drive, duration=0.6, steps=sim.HalvingStep(1e-2), every=2e-2,
            integrator=sim.LinearlyImplicitEuler(), probes=(sim.Contacts(PAIRINGS),),
        )  # fmt: skip
        name = f"8 GGP at 1.0 and {muscle} at {level:.1f}"
        gap = float(np.nanmin(motion["contact_gap"].values))
        yield limited(f"{name}: penetration", max(0.0, -1e3 * gap), 0.01, " mm")
        pressing = float(motion["contact_force"].isel(time=-1).sum())
        yield Result(
            f"{name}: force at the end", "above 0.1 N", f"{pressing:.2f} N", pressing > 0.1
        )
        if pressing > 0.1:
            f = system.force(end.q, system.control(drive.values[-1])).f[free]
            carried = float(np.linalg.norm(f, axis=1).sum())
            off = abs(carried / pressing - 1.0)
            yield limited(f"{name}: force of contact against that of the nodes", off, 0.05)


PAIRINGS: Final = ("maxilla", "mandible", "palate")


KNOWN = (
    "4 shape jaw_open, elements, no gravity: median",  # 1.1 mm
    "4 shape *: tip", "4 shape *: signs of the tip", "5 *: volume of every muscle", "7 generated: *",
    "7 published face, at rest", "7 published face, OOP 0.3",
    "8 GGP at 1.0 and SL at 1.0: force at the end",
)  # fmt: skip
"""Lines that are not met; `docs/head.md` explains each."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "check", [attachments, elimination, rigid, generated_tongue, closing, labials, palate]
)
def test_required_values_are_met(check, specified) -> None:
    specified(check(), KNOWN)


@pytest.mark.slow
@pytest.mark.parametrize("check", [shapes, published_tongue, approximant])
def test_values_of_the_published_models_are_met(check, shared, specified) -> None:
    specified(check(shared / "artisynth_models"), KNOWN)
