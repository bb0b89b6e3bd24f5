"""Write the report of a study."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from analysis.alignment_tables import alignment_tables
from analysis.baseline_tables import comparison
from analysis.formants import formant_table
from analysis.incisor import incisor_table
from analysis.sensitivity import choices_table
from analysis.statistics.scope import LEAST_VOLUNTEERS
from analysis.tables import report_tables
from emgface.errors import listed
from emgface.face.identity import is_treated
from emgface.pictures.page import as_json, cells, environment, policy, style, viewer_script
from emgface.pictures.render import VIEWS
from emgface.pictures.stills import recording_label
from emgface.report import contents, figures, provenance
from emgface.report.jaw import incisors
from emgface.report.kept import KeptReport, Page, study_folder
from emgface.report.methods import methods, parameter_rows
from emgface.report.motion import moving_faces
from emgface.report.results import FAILURES, Results, open_results
from emgface.report.simulated import simulated_limits
from emgface.report.study_tables import Report
from emgface.run.store import store_text
from emgface.study.file import study_face
from emgface.treatment.plan import NOT_VALIDATED
from sim.threads import one_blas_thread


@one_blas_thread
def write_page(
    folder: Path,
    out: Path,
    *,
    faces: bool = True,
    known: Report | None = None,
    say: Callable[[str, int, int], None] | None = None,
) -> Page:
    """Write the report of a finished study as one page, and return its path, size and notes.

    `folder` is the folder of ``emgface study run --out``, or contains it. A page of the same cube,
    recordings and code is not written again: an existing file `out` (``*.html``) is unchanged, and
    a page in the store of the study is copied. `faces` includes moving and rendered faces, which
    require one simulation per instruction and strategy (stored); `known` are the tables of the
    study, if they have been computed, which saves a second; `say` receives description, completed
    number and total. A content security policy, which lists the digests of the scripts, forbids
    every request. Raises DataError if the folder has no cube or the cube cannot be read, and
    StoreError if the page cannot be written.
    """
    folder = study_folder(folder)
    kept = KeptReport(folder)
    if page := kept.page(out, faces=faces):
        return page
    results = open_results(folder)
    text = render_report(results, faces=faces, known=known, say=say)
    if not results.notes:
        text = kept.keep_page(text, faces=faces)
    store_text(out, text)
    return Page(out, out.stat().st_size, results.notes)


def render_report(
    results: Results,
    *,
    faces: bool = True,
    known: Report | None = None,
    say: Callable[[str, int, int], None] | None = None,
) -> str:
    """Render the page of opened results, as `write_page`."""
    cube = results.base
    empty = contents.is_empty(cube)
    scored = not empty and bool(np.isfinite(cube["rho"].values).any())
    moving = moving_faces(results, say) if faces and scored else None
    incisor = incisors(results) if scored else None
    tables = {} if empty else report_tables(cube)
    listed = tables.pop("trials", None)
    change = contents.varied(results.cube, results.notes)
    other_choices = known.other_choices if known else None
    if other_choices is None and not empty:
        other_choices = contents.other_choices(results.cube, results.notes)
    tested = contents.inference(cube, known=known.statistics if known else None)
    meaning, compared = (known.compared if known else comparison(cube)) if scored else ([], {})
    values = {
        "title": str(cube.attrs.get("name", "study")),
        "origin": str(cube.attrs["origin"]),
        "world": str(cube.attrs.get("world", "")),
        "limits": simulated_limits(cube),
        "verdict": [
            *contents.verdict(cube),
            *filter(None, [provenance.warning(results.cube)]),
            *provenance.repeated(cube),
            *filter(None, [_of_treatment(results)]),
        ],
        "sizes": {dim: cube.sizes[dim] for dim in contents.TRIAL_DIMS},
        "headline": _headline(cube) if scored else [],
        "scored": scored,
        "tables": {name: cells(table) for name, table in tables.items()} if scored else {},
        "trials": cells(listed) if listed is not None else None,
        "score_figures": figures.score_figures(results) if scored else [],
        "meaning": meaning,
        "baseline_tables": {name: cells(table) for name, table in compared.items()},
        "baseline_figure": figures.baseline_figure(results) if scored else [],
        "incisors": cells(incisor.table) if incisor else None,
        "incisor_scores": cells(table) if scored and (table := incisor_table(cube)) else None,
        "incisor_figure": figures.incisor_figure(results, incisor) if incisor else [],
        "formants": cells(table) if scored and (table := formant_table(cube)) else None,
        "formant_figure": figures.formant_figure(results) if scored else [],
        "face_figures": figures.scored_face_figure(results, *moving[:2]) if moving else [],
        "trial_figures": figures.trial_figures(results) if scored else [],
        "least_volunteers": LEAST_VOLUNTEERS,
        "choices": figures.choices_figure(results, change) if change is not None else [],
        "choices_table": cells(choices_table(change)) if change is not None else None,
        "choices_summary": str(change.attrs["summary"]) if change is not None else "",
        "other_choices": other_choices[0] if other_choices else [],
        "other_choices_table": cells(other_choices[1]) if other_choices else None,
        "tested": tested,
        "test_table": cells(tested.table) if tested.table else None,
        "exclusions": cells(contents.exclusions(results)),
        "alignment": {} if empty else {k: cells(t) for k, t in alignment_tables(cube).items()},
        "cost": cells(table) if (table := contents.cost(results)) else None,
        "methods": methods(results.study, cube) if results.study and not empty else "",
        "parameters": parameter_rows(results.study) if results.study else [],
        "sources": provenance.sources(results),
        "environments": provenance.environments(results.cube),
        "mixture": cells(table) if (table := provenance.mixture(results.cube)) else None,
        "writer": provenance.writer(),
        "recordings": provenance.recording_rows(results),
        "notes": results.notes,
        "views": VIEWS,
        "labels": {
            "simulated": "simulated by the face model",
            "measured": recording_label(str(cube.attrs["origin"])),
        },
        "tag": "simulated motion",
        "viewer": as_json(moving[2]) if moving else None,
    }
    script = viewer_script() if moving else ""
    return (
        environment("emgface.report")
        .get_template("report.html")
        .render(**values, style=style(), script=Markup(script), policy=policy(script))
    )


def _of_treatment(results: Results) -> str:
    """Sentence on the treated faces of a study, also those of its axes; empty without any."""
    names: list[str] = []
    for given in results.faces:
        with suppress(*FAILURES):  # no longer there
            face = study_face(given)
            names += [str(face.attrs["name"])] if is_treated(face.attrs) else []
    return f"{listed(names)}: {NOT_VALIDATED}." if names else ""


def _headline(cube: Any) -> list[dict[str, Any]]:
    """Median rho and counts of each strategy."""
    from analysis.descriptives import descriptives

    statistics = descriptives(cube)
    return [
        {
            "strategy": str(strategy),
            "median": float(statistics["median"].sel(strategy=strategy)),
            "n": int(statistics["n"].sel(strategy=strategy)),
        }
        for strategy in cube["strategy"].values
    ]
