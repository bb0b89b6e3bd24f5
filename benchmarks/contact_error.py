"""Error of contact against run time, over method, thickness and tolerance.

All settings advance alternately, a few steps each, so that changes of the machine's speed affect all of
them. Errors are those of the markers against constraints with a tenth of the default tolerance, in the
same steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from analysis.scores import correlation_3d
from benchmarks.contact import CHUNK, Run, drive
from benchmarks.report import face_of, finish, say
from emgface.face.accuracy import accuracy_settings
from emgface.face.contact_parameters import ContactParameters
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
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
            if isinstance(term, sim.ConstraintContact):
                terms[i] = replace(term, approach=self.thickness, tolerance=self.tolerance)
        return replace(made, terms=tuple(terms))


REFERENCE: Final = Setting("constraint", 5e-4, 2e-4)
SETTINGS: Final = (
    Setting("none"),
    *(Setting("constraint", 5e-4, tolerance) for tolerance in (2e-3, 1e-2, 5e-2, 1e-1)),
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
    markers = sim.Markers(face["marker_node"].values.astype(np.int64), names)
    for case in cases:
        say(case)
        levels = {name: LEVEL * value for name, value in drive(CASES[case]).items()}
        tried = (REFERENCE, *settings)
        runs = [
            Run(sim.compile_scene(s.scene(face, base)), base, levels, (markers,)) for s in tried
        ]
        depths = np.zeros((len(runs), 2))
        for _ in range(round(duration / (CHUNK * base.step))):
            for run, depth in zip(runs, depths, strict=True):
                run.advance(CHUNK)
                q = run.state.q
                np.maximum(depth, (penetration.lips(q), penetration.teeth(q)), out=depth)
        positions = [
            xr.concat([part["position"] for part in run.parts], "time").transpose(..., "axis")
            for run in runs
        ]
        exact = positions[0]
        seconds = {s.method: run.seconds for s, run in zip(tried, runs, strict=True)}
        for setting, run, position, depth in zip(tried, runs, positions, depths, strict=True):
            ended = not run.failure
            error = (
                np.linalg.norm((position - exact).values, axis=-1) if ended else np.array(np.nan)
            )
            rho = correlation_3d(exact, position) if ended else xr.DataArray(np.nan)
            rows.append(
                {
                    "case": case,
                    "contact": setting.name + (" (reference)" if run is runs[0] else ""),
                    "marker error mm": 1e3 * float(error.max()),
                    "1 - rho": 1.0 - float(rho.min()),
                    "lips in lips mm": 1e3 * depth[0],
                    "lips in teeth mm": 1e3 * depth[1],
                    "ms of processor": 1e3 * run.seconds / (duration / base.step),
                    "time over none": run.seconds / seconds.get("none", np.nan),
                    "status": run.failure or "ok",
                }
            )
    return pd.DataFrame(rows)


def main(out: Path | None = None, face: Path | None = None) -> None:
    """Measure, print and store."""
    finish("contact-error", measure(face_of(face)), out)
