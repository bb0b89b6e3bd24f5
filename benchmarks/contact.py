"""Contact of the lips on a face: depths, oscillations and cost, compared with the face without contact.

All scenes advance alternately, a few steps each, so that changes of the machine's speed affect all
of them. Cases are "closing", "protrusion" and the instructions A to F; methods are none and
constraint; surfaces are lips and teeth.
"""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from benchmarks.lip_probe import LipProbe, to_and_fro
from benchmarks.report import face_of, finish, say
from emgface.face.accuracy import accuracy_settings
from emgface.face.contact_parameters import ContactParameters
from emgface.face.integration import integrator_of
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.gestures import GESTURES, gesture_activation
from sim.probes import Probe
from sim.system import System

Floats = NDArray[np.float64]

CLOSING: Final = "closing"
FULL: Final = {CLOSING: ("OOP", "OOM"), "protrusion": ("OOP",)}
"""Muscles of both sides that are fully active: parts of orbicularis oris."""
RISE, HOLD, TAIL = 0.2, 1.0, 0.5
"""Rise of the activation, time for which it is held, and last part of it that is evaluated [s]."""
CHUNK: Final = 5
"""Number of steps by which each scene advances at a time, and between two measurements of depths."""
STEPPING: Final = accuracy_settings("study") | {"solver": "converged"}
"""Solver, step and tolerances of all methods: those of a study, with implicit Euler."""
METHODS: Final[tuple[str, ...]] = get_args(ContactParameters.model_fields["method"].annotation)
"""Kinds of contact, "none" first."""


def drive(name: str) -> dict[str, float]:
    """Activation of a case: one of `FULL`, or the gesture of an instruction, A to F."""
    if name in FULL:
        return {f"{muscle}_{side}": 1.0 for muscle in FULL[name] for side in "LR"}
    return gesture_activation(name)


class Run:
    """A face that is moved by an activation, a few outputs at a time, until a step fails.

    The `levels` of the muscles are reached within `RISE` and held. `seconds` is the processor time
    of all steps [s], and `failure` the error that ended the run.
    """

    def __init__(
        self,
        system: System,
        base: SimulationParameters,
        levels: Mapping[str, float],
        probes: tuple[Probe, ...],
    ) -> None:
        peak = np.array([levels.get(name, 0.0) for name in system.muscles])
        self.system, self.probes = system, probes
        self.activation = sim.Activation(np.array([0.0, RISE]), np.stack([0.0 * peak, peak]))
        self.steps, self.integrator = sim.HalvingStep(base.step), integrator_of(base)
        self.state, self.work = system.rest_state(), sim.Workspace(system, base.linear_solver)
        if isinstance(self.integrator, sim.ConvergedEuler):
            # Preparations that are made once are not part of the measured steps.
            self.work.form(system, self.state)
        self.parts: list[xr.Dataset] = []
        self.seconds, self.failure = 0.0, ""

    def advance(self, outputs: int) -> None:
        """Advance by a number of outputs, and store a failure."""
        if self.failure:
            return
        before = time.process_time()
        try:
            part, self.state = sim.simulate(
                self.system,
                self.activation,
                duration=outputs * self.steps.h,
                integrator=self.integrator,
                steps=self.steps,
                probes=self.probes,
                initial=self.state,
                work=self.work,
            )
            self.parts.append(part if not self.parts else part.isel(time=slice(1, None)))
        except sim.SimulationError as error:
            self.failure = f"{type(error).__name__}: {error}"
        self.seconds += time.process_time() - before


def measure(
    face: xr.Dataset,
    *,
    methods: Sequence[str] = METHODS,
    cases: Sequence[str] = (CLOSING, *GESTURES),
    between: Sequence[str] = ("lips", "teeth"),
    friction: float = 0.0,
    hold: float = HOLD,
    parameters: SimulationParameters | None = None,
) -> xr.Dataset:
    """Run cases with and without contact alternately.

    `face` has `lip_opening_node`. `methods` are of `METHODS`; the run times of the others are
    compared with that of the first. `cases` are of `FULL`, and instructions A to F; `between` and
    `friction` are those of `emgface.face.contact_parameters.ContactParameters`, and `hold` is the
    time for which the activation is held [s]. By default of `parameters`, sigma_max is 100 kPa,
    without gravity and with `STEPPING`; its contact is replaced.

    The result contains, over (case, contact): ``status``, ``opening_rest``, ``opening_end`` in the
    midline along z [m], the shape at the end (`lip_shape`), the largest depths ``depth_lips`` and
    ``depth_teeth`` (beyond that at rest) of every `CHUNK`-th output, ``gap``, the smallest of all
    outputs as computed by contact [m]; over the last `TAIL`, or half of `hold`: ``speed`` of the
    fastest lip node [m/s], ``ripple``, range of the opening, and ``chatter`` (`to_and_fro`) [m];
    ``iterations``, ``factorisations`` and processor ``seconds`` per step, ``ratio`` of the latter
    to the first method; over (case, contact, time): ``opening`` [m]; over (case, contact, node,
    axis): ``node_position`` [m].

    Raises FaceError, ContactFailure or SceneError if the surfaces of the face are unsuitable; a
    failure during a run is its ``status``.
    """
    base = parameters or SimulationParameters(sigma_max=SIGMA_MAX, gravity=False, **STEPPING)
    penetration, rim = Penetration(face), lip_rim(face)
    outputs = round((RISE + hold) / base.step)
    systems = {m: _compiled(face, base, m, between, friction) for m in methods}
    rows: list[list[dict[str, Any]]] = []
    for case in cases:
        say(f"{case}: {', '.join(methods)}")
        probes = [LipProbe(face, penetration, CHUNK * base.step) for _ in methods]
        runs = [
            Run(system, base, drive(case), (probe, sim.Iterations()))
            for system, probe in zip(systems.values(), probes, strict=True)
        ]
        for at in range(0, outputs, CHUNK):
            for run in runs:
                run.advance(min(CHUNK, outputs - at))
        tail = round(min(TAIL, 0.5 * hold) / base.step)
        rows.append(
            [
                _judged(face, rim, penetration, run, probe, outputs, tail)
                for run, probe in zip(runs, probes, strict=True)
            ]
        )
    names = [name for name in rows[0][0] if name not in ("opening", "node_position")]
    table = {name: [[cell[name] for cell in row] for row in rows] for name in names}
    dims, time_axis = ("case", "contact"), base.step * np.arange(outputs + 1)
    results = xr.Dataset(
        {name: (dims, np.array(values), {"units": UNITS[name]}) for name, values in table.items()},
        coords={"case": list(cases), "contact": list(methods), "time": time_axis},
        attrs={
            "origin": "simulated",
            "face": str(face.attrs.get("name", "")),
            "between": " ".join(between),
            "friction": friction,
            "sigma_max": base.sigma_max,
            "step": base.step,
        },
    )
    results["ratio"] = (dims, (results["seconds"] / results["seconds"].isel(contact=0)).values)
    for name, inner in (("opening", ("time",)), ("node_position", ("node", "axis"))):
        stacked = np.stack([np.stack([cell[name] for cell in row]) for row in rows])
        results[name] = ((*dims, *inner), stacked, {"units": "m"})
    return results


def contact_table(results: xr.Dataset) -> pd.DataFrame:
    """One row per case and kind of contact, in mm, mm/s and ms."""
    scale = {"m": 1e3, "m/s": 1e3, "m^2": 1e6, "s": 1e3, "1": 1.0}
    unit = {"m": " mm", "m/s": " mm/s", "m^2": " mm2", "s": " ms of processor", "1": ""}
    names = [name for name in (*UNITS, "ratio") if name != "status"]
    flat = results[["status", *names]].to_dataframe().reset_index()
    table = flat[["case", "contact"]].copy()
    for name in names:
        dimension = UNITS.get(name, "1")
        table[f"{SAID[name]}{unit[dimension]}"] = flat[name] * scale[dimension]
    return table.assign(status=flat["status"])


SAID: Final[Mapping[str, str]] = {
    "opening_rest": "opening at rest",
    "opening_end": "opening",
    "gap_end": "widest gap in the middle",
    "area_end": "area seen",
    "width": "width",
    "roundness": "roundness",
    "protrusion": "protrusion",
    "depth_lips": "lips in lips",
    "depth_teeth": "lips in teeth",
    "gap": "smallest gap",
    "speed": "speed when held",
    "ripple": "range of opening when held",
    "chatter": "to and fro when held",
    "iterations": "iterations a step",
    "factorisations": "factorisations a step",
    "seconds": "step",
    "ratio": "step over that without",
}

UNITS: Final[Mapping[str, str]] = {
    "status": "1",
    **dict.fromkeys(("opening_rest", "opening_end", "gap_end"), "m"),
    "area_end": "m^2",
    "width": "m",
    "roundness": "1",
    **dict.fromkeys(("protrusion", "depth_lips", "depth_teeth", "gap"), "m"),
    "speed": "m/s",
    **dict.fromkeys(("ripple", "chatter"), "m"),
    **dict.fromkeys(("iterations", "factorisations"), "1"),
    "seconds": "s",
}
"""Quantities of a run and their units."""


def _compiled(
    face: xr.Dataset,
    base: SimulationParameters,
    method: str,
    between: Sequence[str],
    friction: float,
) -> System:
    contact = ContactParameters.model_validate(
        {"method": method, "between": tuple(between), "friction": friction}
    )
    return sim.compile_scene(compose_scene(face, base.model_copy(update={"contact": contact})))


def _judged(
    face: xr.Dataset,
    rim: Any,
    penetration: Penetration,
    run: Run,
    probe: LipProbe,
    outputs: int,
    tail: int,
) -> dict[str, Any]:
    """Quantities of one run, as far as it was completed."""
    every = xr.concat(run.parts, "time") if run.parts else None
    shape = lip_shape(face, rim, run.state.q)
    opening = np.full(outputs + 1, np.nan)
    if every is None:
        return {
            **dict.fromkeys(UNITS, np.nan),
            "status": run.failure,
            "opening": opening,
            "node_position": run.state.q,
        }
    opening[: every.sizes["time"]] = every["opening"].values
    path, ended = np.stack(list(probe.path.values())), not run.failure
    return {
        "status": run.failure or "ok",
        "opening_rest": opening[0],
        "opening_end": shape["height"],
        "gap_end": penetration.gap(run.state.q),
        "area_end": shape["area"],
        **{name: shape[name] for name in ("width", "roundness", "protrusion")},
        "depth_lips": float(every["depth_lips"].max()),
        "depth_teeth": float(every["depth_teeth"].max()),
        "gap": float(every["gap"].min()),
        "speed": float(every["speed"].values[-tail:].max()) if ended else np.nan,
        "ripple": float(np.ptp(opening[-tail:])) if ended else np.nan,
        "chatter": to_and_fro(path[-tail - 1 :]) if ended else np.nan,
        "iterations": float(every["iterations"].values[1:].mean()),
        "factorisations": float(every["factorisations"].values[1:].mean()),
        "seconds": (run.seconds - probe.seconds) / (every.sizes["time"] - 1),
        "opening": opening,
        "node_position": run.state.q,
    }


def main(
    out: Path = Path("bench"),
    face: Path | None = None,
    resolution: str = "medium",
    case: list[str] = [CLOSING, *GESTURES],  # noqa: B006
    between: list[str] = ["lips", "teeth"],  # noqa: B006
    hold: float = HOLD,
) -> None:
    """Measure, print and store."""
    results = measure(
        face_of(face, resolution),
        cases=case,
        between=between,
        hold=hold,
        parameters=SimulationParameters(sigma_max=SIGMA_MAX, gravity=False, **STEPPING),
    )
    finish("contact", contact_table(results), out)
