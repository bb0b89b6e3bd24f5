"""Coupled jaw, hyoid, tongue and face against the recorded motions of another simulator.

    python -m benchmarks tongue_coupled --out FOLDER          # table of docs/tongue.md; all recordings
    python -m benchmarks tongue_coupled --case jh_rest_gravity  # one of them; repeat for more
    python -m benchmarks tongue_coupled --contact removed     # tissue inside bones is moved out at once

Needs the published models and the recordings. The step is the recorded one, or `--step` in s. With
`--at-rest` the nodes of the tongue on jaw and hyoid begin where they are without stress.
"""

import json
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

import sim
from benchmarks.recorded_head import RecordedHead, recorded_head
from benchmarks.report import finish, say
from benchmarks.tongue import SHARED, recorded, recorded_levels
from emgface.anatomy.tongue.published import TURN
from emgface.anatomy.tongue.scene import LINE_ENDING
from emgface.errors import HeadError
from sim.integrators import Integrator
from sim.linear import linear_solver
from sim.restart import SCENE

INTEGRATORS = {
    "Trapezoidal": sim.LinearlyImplicitTrapezoidal(tolerance=1e-9),
    "ConstrainedBackwardEuler": sim.LinearlyImplicitEuler(tolerance=1e-9),
}
KNOWN_CHANGES = {"all contact pairs switched off", "gravity off"}
Contact = Literal["kept", "removed", "none"]


def cases() -> list[str]:
    """Names of the recorded cases; HeadError if there are none."""
    folder = SHARED / "artisynth_reference" / "coupled"
    names = [p.stem for p in sorted(folder.glob("*.json")) if not p.stem.startswith("model_")]
    if not names:
        raise HeadError(
            f"{folder} contains no recorded case: set EMGFACE_SHARED to the folder that contains "
            "artisynth_reference and artisynth_models"
        )
    return names


def levels(case: Mapping[str, Any], head: RecordedHead, muscles: tuple[str, ...]) -> sim.Activation:
    """Activation of every muscle of the scene by the excitations of a case.

    Excitations of different exciters add, as in that program; HeadError for an unknown one.
    """
    time, by_target = recorded_levels(case)
    values = np.zeros((len(time), len(muscles)))
    column = {m: k for k, m in enumerate(muscles)}
    for target, u in by_target.items():
        if target not in head.exciters:
            whole = [e for e in head.exciters if "/" not in e or "_" not in e]
            raise HeadError(
                f"{case['name']}: no exciter {target!r} of whole muscles, expected one of "
                f"{', '.join(whole)}"
            )
        for muscle, gain in head.exciters[target].items():
            for name in {muscle, muscle + LINE_ENDING} & column.keys():
                values[:, column[name]] += gain * u
    return sim.Activation(time, values)


def recorded_motion(name: str) -> tuple[sim.System, sim.Activation]:
    """Scene of a recorded case, with the condyles on the planes of their start, and its activation."""
    case, _ = recorded(name, "coupled")
    contact = not any("contact" in c for c in case.get("changes_against_the_model_file") or ())
    gravity = 1e-3 * np.array(case["gravity"])
    head = recorded_head(case["variant"], contact=contact, gravity=gravity)
    system = head.system(head.strips(head.start))
    return system, levels(case, head, system.muscles)


def repeated(
    name: str,
    step: float | None = None,
    until: float | None = None,
    contact: Contact = "kept",
    at_rest: bool = False,
) -> dict[str, Any]:
    """Distances of points and nodes from a recorded motion [mm]; the step is the recorded one [s]."""
    case, arrays = recorded(name, "coupled")
    unknown = set(case.get("changes_against_the_model_file") or ()) - KNOWN_CHANGES
    if unknown or case["integrator"] not in INTEGRATORS:
        raise HeadError(
            f"{name}: {', '.join([*unknown, case['integrator']])} is not known, expected "
            f"{', '.join(INTEGRATORS)} and at most {', '.join(sorted(KNOWN_CHANGES))}"
        )
    off = any("contact" in change for change in case.get("changes_against_the_model_file") or ())
    with_contact = case["variant"] != "jh" and not off and contact != "none"
    head = recorded_head(
        case["variant"],
        contact=with_contact,
        removed=contact == "removed",
        at_rest=at_rest,
        gravity=1e-3 * np.array(case["gravity"]),
    )
    times = np.array([t for t in arrays["t"] if until is None or t <= until + 1e-9])
    h = case["h_s"] if step is None else step
    began = time.process_time()
    poses, ended = _motion(head, case, times, h, INTEGRATORS[case["integrator"]])
    n = len(poses)
    q = np.array([p.q for p in poses]) @ TURN * 1e3
    named = [m for m in case["markers"] if m in head.points]
    indices = [case["markers"].index(m) for m in named]
    theirs = arrays["marker_pos_mm"][:n, indices]
    apart = np.linalg.norm(q[:, [head.points[m] for m in named]] - theirs, axis=2)
    hyoid = apart[:, [k for k, m in enumerate(named) if m.startswith("hyoid")]]
    jaw = apart[:, [k for k, m in enumerate(named) if not m.startswith("hyoid")]]
    incisor = theirs[:, named.index("lowerincisor")]
    row: dict[str, Any] = {
        "case": name,
        "step ms": 1e3 * h,
        "until s": float(times[n - 1]),
        "incisor moved": round(float(np.linalg.norm(incisor[-1] - incisor[0])), 2),
        "jaw": f"{jaw.max():.2g}",
        "jaw at the end": f"{jaw[-1].max():.2g}",
        "hyoid": f"{hyoid.max():.2g}",
    }
    for tissue, fem, nodes in (("tongue", "tongue", 946), ("face", "badinface", 8720)):
        if f"pos_{fem}" not in arrays:
            continue
        own = head.first[tissue] + np.arange(nodes)
        theirs = arrays[f"pos_{fem}"][:n, :nodes]
        away = np.linalg.norm(q[:, own] - theirs, axis=2)
        moved = np.linalg.norm(theirs[-1] - theirs[0], axis=1).max()
        row |= {
            f"{tissue} moved": round(float(moved), 2),
            tissue: f"{away.max():.2g}",
            f"{tissue} at the end": f"{away[-1].max():.2g}",
            f"{tissue} median": f"{np.median(away[-1]):.2g}",
        }
    steps = max(float(times[n - 1]) / h, 1.0)
    row |= {
        "cpu ms per step": round(1e3 * (time.process_time() - began) / steps, 1),
        "theirs": round(case["cpu_ms_per_step_median"], 1),
        "ends": ended,
    }
    return row


def _motion(
    head: RecordedHead,
    case: Mapping[str, Any],
    times: np.ndarray,
    h: float,
    integrator: Integrator,
) -> tuple[list[sim.State], str]:
    """States at the recorded times, and why they end; strips are chosen at the start of each step."""
    strips = head.strips(head.start)
    system = head.system(strips)
    state = system.rest_state()
    drive = levels(case, head, system.muscles)
    work = sim.Workspace(system, linear_solver().name)  # a factor of every matrix, as there
    states = [state]
    for k in range(1, round(float(times[-1]) / h) + 1):
        now = head.strips(state.q)
        if now != strips:
            strips, system = now, head.system(now)
            # the scenes differ in the planes of the condyles alone: the memory of contact is kept
            own = {name: array for name, array in state.memory.items() if name != SCENE}
            state = replace(state, memory=own)
            work = sim.Workspace(system, linear_solver().name)
        try:
            _, state = sim.simulate(
                system,
                drive,
                duration=h,
                steps=sim.FixedStep(h),
                integrator=integrator,
                initial=replace(state, t=(k - 1) * h),
                probes=(),
                work=work,
            )
        except sim.SimulationError as error:
            return states, f"{type(error).__name__} after {1e3 * (k - 1) * h:g} ms"
        if len(states) < len(times) and abs(k * h - times[len(states)]) < 0.5 * h:
            states.append(state)
    return states, ""


def main(
    out: Path | None = None,
    case: list[str] | None = None,
    step: float | None = None,
    contact: Contact = "kept",
    at_rest: bool = False,
) -> None:
    """Repeat the recorded cases, print the table and store it."""
    rows, known = list[dict[str, Any]](), cases()
    if unknown := [name for name in case or () if name not in known]:
        raise HeadError(
            f"no recorded case {', '.join(unknown)}, expected some of {', '.join(known)}"
        )
    for name in case or known:
        say(name)
        rows.append(repeated(name, step, None, contact, at_rest))
        say(json.dumps(rows[-1]))
    finish("tongue-coupled", pd.DataFrame(rows), out)
