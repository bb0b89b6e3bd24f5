"""Error of contact against run time, over method, thickness and tolerance.

All settings advance alternately, a few steps each, so that changes of the machine's speed affect all of
them. Errors are those of the markers against constraints with a tenth of the default tolerance, in the
same steps; a barrier also differs by the gap that it keeps.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from analysis.scores import correlation_3d
from benchmarks.contact import CHUNK, RISE, drive
from benchmarks.report import Chart, face_of, finish, say
from emgface.face.accuracy import accuracy_settings
from emgface.face.contact_parameters import ContactParameters
from emgface.face.integration import integrator_of
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim import (
    Activation,
    BarrierContact,
    ConstraintContact,
    HalvingStep,
    Markers,
    SimulationError,
    Workspace,
    compile_scene,
    simulate,
)
from sim.scene import Scene


@dataclass(frozen=True)
class Setting:
    """A method with its thickness [m], and the tolerance of constraints relative to it."""

    method: str
    thickness: float = 0.0
    tolerance: float = 0.0

    @property
    def name(self) -> str:
        """Name for the table."""
        if self.method == "none":
            return "none"
        more = f", to {1e6 * self.thickness * self.tolerance:g} um" if self.tolerance else ""
        return f"{self.method} {1e3 * self.thickness:g} mm{more}"

    def scene(self, face: xr.Dataset, base: SimulationParameters) -> Scene:
        """Scene with the contact of this setting."""
        contact = ContactParameters.model_validate({"method": self.method})
        made = compose_scene(face, base.model_copy(update={"contact": contact}))
        terms = list(made.terms)
        for i, term in enumerate(terms):
            if isinstance(term, ConstraintContact):
                terms[i] = replace(term, approach=self.thickness, tolerance=self.tolerance)
            elif isinstance(term, BarrierContact):
                terms[i] = replace(term, distance=self.thickness)
        return replace(made, terms=tuple(terms))


REFERENCE: Final = Setting("constraint", 5e-4, 2e-4)
SETTINGS: Final = (
    Setting("none"),
    *(Setting("constraint", 5e-4, tolerance) for tolerance in (2e-3, 1e-2, 5e-2, 1e-1)),
    *(Setting("barrier", thickness) for thickness in (1e-4, 2e-4, 5e-4)),
)
CASES: Final = {"purse": "A", "smile": "D"}  #: instruction whose gesture each case is
LEVEL: Final = 0.5  #: factor on the activation of the gestures


def measure(
    face: xr.Dataset,
    *,
    settings: Sequence[Setting] = SETTINGS,
    cases: Sequence[str] = tuple(CASES),
    duration: float = 0.3,
) -> pd.DataFrame:
    """One row per case and setting.

    Columns: largest error of a marker [mm], 1 - rho of the marker with the lowest rho, depth of the
    lips in each other and in teeth beyond that at rest [mm], processor time per output [ms], and its
    ratio to that without contact.
    """
    base = SimulationParameters(sigma_max=SIGMA_MAX, gravity=False, **accuracy_settings("study"))
    penetration, rows = Penetration(face), list[dict[str, object]]()
    names = tuple(str(name) for name in face["marker"].values)
    markers = Markers(face["marker_node"].values.astype(np.int64), names)
    for case in cases:
        say(case)
        runs = [_Run(s, face, base, CASES[case]) for s in (REFERENCE, *settings)]
        for _ in range(round(duration / (CHUNK * base.step))):
            for run in runs:
                run.advance(markers, penetration)
        exact = runs[0].positions()
        plain = next((r.seconds for r in runs if r.setting.method == "none"), np.nan)
        for run in runs:
            found = run.positions()
            ended = not run.failure
            error = np.linalg.norm((found - exact).values, axis=-1) if ended else np.array(np.nan)
            rho = correlation_3d(exact, found) if ended else xr.DataArray(np.nan)
            rows.append(
                {
                    "case": case,
                    "contact": run.setting.name + (" (reference)" if run is runs[0] else ""),
                    "marker error mm": 1e3 * float(error.max()),
                    "1 - rho": 1.0 - float(rho.min()),
                    "lips in lips mm": 1e3 * run.depths[0],
                    "lips in teeth mm": 1e3 * run.depths[1],
                    "ms of processor": 1e3 * run.seconds / (duration / base.step),
                    "time over none": run.seconds / plain,
                    "status": run.failure or "ok",
                }
            )
    return pd.DataFrame(rows)


class _Run:
    """State of one setting."""

    def __init__(
        self, setting: Setting, face: xr.Dataset, base: SimulationParameters, gesture: str
    ) -> None:
        self.setting, self.step, self.integrator = setting, base.step, integrator_of(base)
        self.system = compile_scene(setting.scene(face, base))
        levels = drive(gesture)
        peak = LEVEL * np.array([levels.get(name, 0.0) for name in self.system.muscles])
        self.activation = Activation(np.array([0.0, RISE]), np.stack([0.0 * peak, peak]))
        self.work, self.state = Workspace(self.system), self.system.rest_state()
        self.parts: list[xr.Dataset] = []
        self.seconds, self.depths, self.failure = 0.0, [0.0, 0.0], ""

    def advance(self, markers: Markers, penetration: Penetration) -> None:
        """Advance by `CHUNK` outputs, and store a failure."""
        if self.failure:
            return
        before = time.process_time()
        try:
            part, self.state = simulate(
                self.system,
                self.activation,
                duration=CHUNK * self.step,
                integrator=self.integrator,
                steps=HalvingStep(self.step),
                probes=(markers,),
                initial=self.state,
                work=self.work,
            )
        except SimulationError as error:
            self.failure = f"{type(error).__name__}: {error}"
            return
        self.seconds += time.process_time() - before
        self.parts.append(part if not self.parts else part.isel(time=slice(1, None)))
        q = self.state.q
        for k, depth in enumerate((penetration.lips(q), penetration.teeth(q))):
            self.depths[k] = max(self.depths[k], depth)

    def positions(self) -> xr.DataArray:
        """Positions of the markers [m]."""
        return xr.concat([part["position"] for part in self.parts], "time").transpose(..., "axis")


CHART = Chart(
    "marker error mm", ("ms of processor",), "time of an output [ms]", by="contact", panel="case"
)


def main(
    out: Path | None = None,
    face: Path | None = None,
    case: list[str] = list(CASES),  # noqa: B006
    duration: float = 0.3,
) -> None:
    """Measure, print and store."""
    table = measure(face_of(face), cases=case, duration=duration)
    finish("contact-error", table, out, CHART)
