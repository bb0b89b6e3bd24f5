"""Lower incisor of the trials in which a head moved: path and scores beside the recording."""

from dataclasses import dataclass

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from analysis.figures import marker_traces
from analysis.tables import Column, Table
from emgface.anatomy.jaw.compared import compared
from emgface.anatomy.jaw.recorded import INCISOR, aligned, score_motion
from emgface.recordings.head import in_head_frame
from emgface.report.results import FAILURES, Results, Trial, representative


@dataclass(frozen=True, eq=False)
class Incisors:
    """Scores of the incisor in the representative trials, and the path of the first one."""

    table: Table
    label: str  #: trial of the figure
    figure: Figure


def incisors(results: Results) -> Incisors | None:
    """Score the incisor of the trials that represent their instructions; None without any.

    Recording and motion are compared as `emgface jaw score` does, the recording in the frame of the head
    as for the lips. A trial that cannot be compared is noted in `results`.
    """
    laboratory = results.laboratory
    if laboratory is None or laboratory.head is None:
        return None
    rows, origin, notes, first = list[tuple[object, ...]](), "", list[str](), None
    columns: tuple[Column, ...] = ()
    strategies = [str(s) for s in results.base["strategy"].values]
    for place in representative(results.base).values():
        for strategy in strategies:
            try:
                pair = _pair(results, results.trial(place, strategy))
                if pair is None:
                    continue
                found = compared(*pair)
            except FAILURES as error:
                label = " ".join(map(str, (*place, strategy)))
                results.notes.append(f"The incisor of {label} is omitted: {error}")
                continue
            label = " ".join(map(str, (*place, strategy)))
            first = first or (label, pair)
            columns, origin = found.columns, found.origin
            rows += [(label, *row) for row in found.rows]
            notes.append(f"{label}: {found.note}")
    if first is None:
        return None
    label, (recording, motion) = first
    title = f"scores of the lower incisor, {origin} recordings"
    table = Table(title, (Column("trial"), *columns), tuple(rows), origin, " ".join(notes))
    return Incisors(
        table, label, marker_traces(*aligned(recording, motion), score_motion(*first[1]))
    )


def _pair(results: Results, trial: Trial) -> tuple[xr.Dataset, xr.Dataset] | None:
    """Recorded incisor in the frame of the head, and the simulated one; None without both."""
    assert results.laboratory is not None and results.study is not None
    recording, motion = trial.recording.dataset, trial.motion
    if "incisor" not in motion or INCISOR not in recording["marker"].values:
        return None
    reference = results.laboratory.face["face_marker_position"]
    place = in_head_frame(recording["position"], results.study.signals.head_frame, reference)
    path = motion["incisor"].transpose("axis", "time").expand_dims(marker=[INCISOR])
    attrs = {name: motion.attrs[name] for name in ("recorded_start", "origin")}
    attrs["numerical_error"] = motion.attrs["incisor_error"]
    body = {"body": np.array([], dtype="U1")}  # the skull rests
    found = xr.Dataset({"position": path}, coords=body, attrs=attrs)
    given = xr.Dataset({"position": place.sel(marker=[INCISOR])}, attrs=recording.attrs)
    return given, found
