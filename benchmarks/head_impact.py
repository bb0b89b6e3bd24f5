"""Teeth of the recorded jaw that meet: effect of the step and of the rule of one-sided constraints.

    python -m benchmarks head_impact --out FOLDER   # table of docs/tongue.md; needs the recorded model

The closers of jaw and hyoid rise within 0.1 s. "ahead": a row acts in the step in which its point would
pass its plane (this package). "behind": a row acts from the step after, as where a program constrains
only points that lie behind their planes at the start of a step. Distances are those of the incisor from
steps of 0.125 ms, and of the two rules from each other; travel is the way of the incisor in the last
step before the teeth meet.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

import sim
from benchmarks.recorded_head import RecordedHead, recorded_head
from benchmarks.report import finish
from benchmarks.tongue import recorded
from benchmarks.tongue_coupled import levels
from sim.linear import linear_solver
from sim.restart import SCENE

LEVELS = (0.05, 0.1, 0.2)
STEPS = (5e-3, 2.5e-3, 1e-3)  # s
FINEST, UNTIL, OUTPUT = 1.25e-4, 0.3, 5e-3  # s
BITES = ("LBITE", "RBITE")
HELD = 1.75e-5
"""Distance within which a plane keeps a point that has met it, as recorded [m]."""


def closing(level: float) -> dict[str, Any]:
    """Description of a motion in which all closers of jaw and hyoid rise to a level."""
    case, _ = recorded("jh_rest_gravity", "coupled")
    drive = {"target": "bi_close", "amax": level, "ramp_s": 0.1, "start_s": 0.0}
    return {**case, "name": f"closers {level:g}", "excitations": [drive]}


class Closed:
    """Motions of the incisor of jaw and hyoid under one drive."""

    def __init__(self, head: RecordedHead, case: Mapping[str, Any]) -> None:
        self.head, self.case = head, case
        self.systems: dict[tuple[object, ...], sim.System] = {}

    def system(self, q: np.ndarray, behind: bool) -> sim.System:
        """System whose condyles are on the strips at q, and with the bite planes that act there."""
        strips = self.head.strips(q)
        left_out = tuple(
            joint.name
            for joint in self.head.scene.joints
            if behind and joint.name in BITES and self.gap(q, joint) > HELD
        )
        key = (strips, left_out)
        if key not in self.systems:
            whole = self.head.system(strips).scene
            joints = tuple(j for j in whole.joints if j.name not in left_out)
            self.systems[key] = sim.compile_scene(replace(whole, joints=joints))
        return self.systems[key]

    def gap(self, q: np.ndarray, joint: Any) -> float:
        """Distance of the point of a plane from it [m], negative behind it."""
        return float((q[joint.point] - np.asarray(joint.origin)) @ np.asarray(joint.normal))

    def motion(self, h: float, *, behind: bool) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) of the incisor [m] at the outputs, and smallest gap (n,) of the bites [m]."""
        bites = [j for j in self.head.scene.joints if j.name in BITES]
        system = self.system(self.head.start, behind)
        state, own = system.rest_state(), system
        drive = levels(self.case, self.head, system.muscles)
        work = sim.Workspace(system, linear_solver().name)
        every, place = round(OUTPUT / h), self.head.points["lowerincisor"]
        found, gaps = [state.q[place]], [min(self.gap(state.q, j) for j in bites)]
        for k in range(round(UNTIL / h)):
            own = self.system(state.q, behind)
            if own is not system:
                system, work = own, sim.Workspace(own, linear_solver().name)
                kept = {n: a for n, a in state.memory.items() if n not in (SCENE, "joints")}
                state = replace(state, memory=kept)
            _, state = sim.simulate(
                system, drive, duration=h, steps=sim.FixedStep(h),
                integrator=sim.LinearlyImplicitTrapezoidal(tolerance=1e-9),
                initial=replace(state, t=k * h), probes=(), work=work,
            )  # fmt: skip
            if (k + 1) % every == 0:
                found.append(state.q[place])
                gaps.append(min(self.gap(state.q, j) for j in bites))
        return np.array(found), np.array(gaps)


def main(out: Path | None = None) -> None:
    """Measure, print and store."""
    rows, head = list[dict[str, Any]](), recorded_head("jh")
    for level in LEVELS:
        of = Closed(head, closing(level))
        exact, gaps = of.motion(FINEST, behind=False)
        met = int(np.argmax(gaps < 1e-6))
        for h in STEPS:
            ahead, behind = (of.motion(h, behind=rule)[0] for rule in (False, True))
            apart = [np.linalg.norm(x - y, axis=1) * 1e3
                     for x, y in ((ahead, exact), (behind, exact), (ahead, behind))]  # fmt: skip
            moved = 1e3 * np.linalg.norm(exact[met - 1] - exact[met - 2]) * h / OUTPUT
            rows.append(
                {
                    "closers": level, "step ms": 1e3 * h, "teeth meet at s": met * OUTPUT,
                    "travel mm": round(float(moved), 3),
                    "ahead mm": f"{apart[0].max():.2g}", "behind mm": f"{apart[1].max():.2g}",
                    "rules apart mm": f"{apart[2].max():.2g}",
                    "apart at the end mm": f"{apart[2][-1]:.2g}",
                }
            )  # fmt: skip
    finish("head-impact", pd.DataFrame(rows), out)
