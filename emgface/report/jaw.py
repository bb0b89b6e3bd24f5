"""Path and scores of the lower incisor in trials with a moving head, compared with the recording."""

from dataclasses import dataclass

from matplotlib.figure import Figure

from analysis.figures import marker_traces
from analysis.tables import Column, Table
from emgface.anatomy.head.incisor import incisor_pair
from emgface.anatomy.jaw.compared import compared_jaws
from emgface.anatomy.jaw.recorded import aligned, score_motion
from emgface.report.results import FAILURES, Results, representative


@dataclass(frozen=True, eq=False)
class Incisors:
    """Scores of the incisor in the representative trials, and the path of the first one."""

    table: Table
    label: str  #: trial of the figure
    figure: Figure


def incisors(results: Results) -> Incisors | None:
    """Score the incisor in the representative trial of each instruction; None if there is no score.

    Recording and motion are compared as by `emgface score`; the recording is in the frame of the
    head, as for the lips. A trial that cannot be compared is noted in `results`.
    """
    laboratory = results.laboratory
    if laboratory is None or laboratory.head is None:
        return None
    frame = laboratory.study.signals.head_frame
    rows, origin, notes, first = list[tuple[object, ...]](), "", list[str](), None
    columns: tuple[Column, ...] = ()
    strategies = [str(s) for s in results.base["strategy"].values]
    for place in representative(results.base).values():
        for strategy in strategies:
            try:
                trial = results.trial(place, strategy)
                recording, motion = trial.recording.dataset, trial.motion
                face = laboratory.for_volunteer(place[0]).face
                pair = incisor_pair(recording, motion, face, frame)
                if pair is None:
                    continue
                scored = compared_jaws(*pair)
            except FAILURES as error:
                label = " ".join(map(str, (*place, strategy)))
                results.notes.append(f"The incisor of {label} is omitted: {error}")
                continue
            label = " ".join(map(str, (*place, strategy)))
            first = first or (label, pair)
            columns, origin = scored.columns, scored.origin
            rows += [(label, *row) for row in scored.rows]
            notes.append(f"{label}: {scored.note}")
    if first is None:
        return None
    label, (recording, motion) = first
    title = f"scores of the lower incisor, {origin} recordings"
    table = Table(title, (Column("trial"), *columns), tuple(rows), origin, " ".join(notes))
    return Incisors(
        table, label, marker_traces(*aligned(recording, motion), score_motion(*first[1]))
    )
