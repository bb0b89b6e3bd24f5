"""Comparison of a face before and after a treatment: motions, outcomes and the page that shows them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd
import xarray as xr

from emgface.face.identity import treatments_between
from emgface.face.simulation_parameters import SimulationParameters
from emgface.run.runner import Workers
from emgface.run.store import Store
from emgface.treatment.cut_difference import other_cut, with_cut_difference
from emgface.treatment.dose import read_cases, with_intervals
from emgface.treatment.motions import (
    MOVEMENTS,
    ComparedMotions,
    Progress,
    compared_motions,
    gestures,
    recorded,
)
from emgface.treatment.outcomes import movement_table, outcome_table
from emgface.treatment.pages import compare_page
from emgface.treatment.plan import NOT_VALIDATED
from emgface.treatment.reduced_pair import reduced_pair


@dataclass(frozen=True, eq=False, repr=False)
class FaceComparison:
    """Two faces under the same activations, simulated.

    `motions` are those of both faces (`emgface.treatment.motions.ComparedMotions`), `activations` their
    drives by movement, `outcomes` the clinical measures before and after the treatment, with their
    units, and `movement` rho [1] and the amplitude ratio [1] of the movements after it.
    """

    intact: xr.Dataset
    treated: xr.Dataset
    motions: ComparedMotions
    activations: dict[str, xr.DataArray]
    outcomes: pd.DataFrame
    movement: pd.DataFrame

    def __repr__(self) -> str:
        """Return the outcomes, with what they are of."""
        names = [str(face.attrs["name"]) for face in (self.intact, self.treated)]
        heading = f"{names[0]} and {names[1]}, simulated; {NOT_VALIDATED}"
        return f"{heading}\n{self.outcomes.round(3).to_string(index=False)}"

    def page(self, *, plain: bool = False) -> str:
        """Return the page with both faces (HTML); `plain` omits the terms of the field."""
        tables = self.outcomes, self.movement
        return compare_page(
            self.intact, self.treated, self.motions, self.activations, tables, plain=plain
        )


def compare_faces(
    intact: xr.Dataset,
    treated: xr.Dataset,
    parameters: SimulationParameters,
    *,
    recordings: Path | None = None,
    mapping: Path | None = None,
    reduced: Sequence[Path] = (),
    both_cuts: bool = False,
    spread: Path | None = None,
    store: Path | None = None,
    workers: int | Workers = 1,
    stopping: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
    report: Callable[[str], None] = print,
) -> FaceComparison:
    """Simulate two faces under the same activations, and measure what the treatment changed.

    The activations are those of the `recordings` of the instructions in a folder, or their gestures.
    `reduced` are the files of the reduced faces of both, `both_cuts` cuts also by the other method, and
    `spread` is the table of `emgface dose --plan`, of which the
    outcomes get their intervals. Complete motions are kept in the folder `store`, and `report` receives
    a sentence on damaged ones. Raises DataError if
    `treated` is neither `intact` nor a treatment of it, and errors as `reduced_pair`, `recorded`,
    `read_cases` and `compared_motions`.
    """
    entries = treatments_between(intact, treated)
    pair = reduced_pair(reduced, intact, treated, parameters) if reduced else None
    cases = None if spread is None else read_cases(spread, entries)
    activations, source = gestures(intact), "The activations are gestures of the instructions."
    notes: tuple[str, ...] = ()
    if recordings is not None:
        recorded_activations, notes = recorded(recordings, mapping)
        activations = recorded_activations | gestures(intact, tuple(MOVEMENTS))
        source = f"The activations are those of the recordings in {recordings.name}."
    kept = None if store is None else Store(store, report)

    def simulated(face: xr.Dataset, files: tuple[Path, Path] | None = None) -> ComparedMotions:
        return compared_motions(
            intact, face, activations, parameters, source=source, progress=progress, store=kept,
            workers=workers, stopping=stopping, reduced=files,
        )  # fmt: skip

    motions = simulated(treated, pair)
    motions = replace(motions, notes=(*notes, *motions.notes))
    outcomes = outcome_table(intact, treated, motions)
    if both_cuts:
        other = other_cut(intact, treated, parameters)
        outcomes = with_cut_difference(outcomes, outcome_table(intact, other, simulated(other)))
    if cases is not None:
        outcomes = with_intervals(outcomes, cases)
    return FaceComparison(intact, treated, motions, activations, outcomes, movement_table(motions))
