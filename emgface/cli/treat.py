"""``emgface treat``, ``compare`` and ``dose``: virtual treatment, and the movement that is left."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation, executing, graceful_stop

if TYPE_CHECKING:
    from collections.abc import Iterable

    import pandas as pd


def treat(
    plan: Annotated[Path, typer.Argument(help="Plan of the treatment (TOML).")],
    model: Annotated[Path, typer.Argument(help="Face model, or jaw model (netCDF).")],
    out_path: Annotated[Path, typer.Option("--out", help="Treated model to write (netCDF).")],
    sigma_max: Annotated[
        float | None, typer.Option(help="Largest muscle stress of the tissue that is closed [Pa].")
    ] = None,
) -> None:
    """Treat a face or a jaw by a plan: excise, close, weaken, resect. Not for treatment decisions."""
    import emgface as ef
    from emgface.anatomy.checked import read_model
    from emgface.api.given import simulation_of, study_of
    from emgface.face.file import load_face, save_face
    from emgface.face.identity import treatments
    from emgface.schema.netcdf import kind_of, write_netcdf
    from emgface.treatment.facts import facts_of_report
    from emgface.treatment.plan import NOT_VALIDATED, read_plan
    from emgface.treatment.treat import treat_face

    chosen: dict[str, Any] = {} if sigma_max is None else {"sigma_max": sigma_max}
    if model.is_file() and kind_of(model) == "jaw_model":
        given = read_model(model, "jaw_model")
        treated = ef.treat(given, plan, **chosen)
        write_netcdf(treated, out_path, "jaw_model")
    else:
        parameters = simulation_of(study_of(None).simulation, None, chosen)
        announce_compilation()
        given = load_face(model)
        with progress("closing") as bar:
            treated = treat_face(
                given, read_plan(plan), parameters, folder=plan.parent, progress=bar.show
            )
        save_face(treated, out_path)
    if treated is given:
        say(f"The plan {plan.name} changes nothing: {out_path} is the model itself.")
    for entry in [] if treated is given else treatments(treated)[-1:]:
        for report in entry["steps"]:
            facts = facts_of_report(report)
            changes = (
                ", ".join(f"{name} {text}" for name, text in facts if text != "none") or "done"
            )
            say(f"Step {report['step']}, {report['kind']}: {changes}.")
            for doubt in report.get("doubts", ()):
                say(f"Warning: step {report['step']}: {doubt}.")
    say(f"Wrote {out_path}, simulated. {NOT_VALIDATED.capitalize()}.")


def _write_table(path: Path, table: "pd.DataFrame") -> None:
    """Write a table (csv) whose first line states that it is simulated, and not for decisions."""
    from emgface.files import write_text
    from emgface.treatment.plan import NOT_VALIDATED

    text = table.to_csv(index=False, float_format="%.6g")
    write_text(path, f"# simulated; {NOT_VALIDATED}\n{text}")


def compare(
    before: Annotated[Path, typer.Argument(help="Face or jaw before the treatment (netCDF).")],
    after: Annotated[Path, typer.Argument(help="Face or jaw after the treatment (netCDF).")],
    recordings: Annotated[
        Path | None,
        typer.Argument(help="Folder with recordings of the instructions; default: their gestures."),
    ] = None,
    out_path: Annotated[Path, typer.Option("--out", help="Page to write (html).")] = Path(
        "compared.html"
    ),
    plain: Annotated[
        Path | None, typer.Option(help="Page without terms of the field to write (html).")
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Picture of the treated face from three sides (png, pdf).")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Table of the outcomes to write (csv).")
    ] = None,
    spread: Annotated[
        Path | None,
        typer.Option(help="Table of 'emgface dose --plan', whose intervals are shown (csv)."),
    ] = None,
    both_cuts: Annotated[
        bool,
        typer.Option(
            "--both-cuts",
            help="Also cut by the other method, along the outline or by whole elements, and show the "
            "interval of both.",
        ),
    ] = False,
    reduced: Annotated[
        list[Path] | None,
        typer.Option(
            help="Reduced face ('reduce') of the face before, and, repeated, of that after the "
            "treatment, simulated with the contact of its training."
        ),
    ] = None,
    mapping: options.MappingOption = None,
    accuracy: options.AccuracyOption = "draft",
    sigma_max: options.SigmaMaxOption = None,
    contact: options.ContactSwitch = True,
    workers: options.WorkersOption = None,
) -> None:
    """Simulate two faces under the same activations, and compare their movement.

    Complete motions are kept next to the page, and a repeated command computes only the others. Of two
    jaws, the outcomes are printed and written as a table, without a page.
    """
    from emgface.api.given import simulation_of, study_of
    from emgface.face.file import load_face
    from emgface.files import write_text
    from emgface.pictures.stills import write_figure
    from emgface.reduced.model import contact_of
    from emgface.schema.netcdf import kind_of
    from emgface.treatment.comparison import compare_faces
    from emgface.treatment.motions import MOVEMENTS
    from emgface.treatment.outcomes import with_words
    from emgface.treatment.pages import states_of
    from emgface.treatment.plan import NOT_VALIDATED
    from emgface.treatment.reduced_pair import refuse_reduced

    if before.is_file() and kind_of(before) == "jaw_model":
        return _compare_jaws(before, after, table)
    refuse_reduced(before, after)
    chosen: dict[str, Any] = {} if sigma_max is None else {"sigma_max": sigma_max}
    if reduced:
        chosen["contact"] = contact_of(reduced[0])
    if not contact:
        chosen["contact"] = {"method": "none"}
    parameters = simulation_of(study_of(None).simulation, accuracy, chosen)
    faces = load_face(before), load_face(after)
    announce_compilation()
    with (
        executing(workers, None) as executed,
        graceful_stop("simulations") as stopping,
        progress("simulating") as bar,
    ):
        compared = compare_faces(
            *faces, parameters,
            recordings=recordings, mapping=mapping, reduced=reduced or (), both_cuts=both_cuts,
            spread=spread, store=out_path.with_suffix("").absolute() / "store", workers=executed,
            stopping=stopping, progress=bar.show, report=say,
        )  # fmt: skip
    motions = compared.motions
    for path, simple in ((out_path, False), (plain, True)):
        if path is not None:
            write_text(path, compared.page(plain=simple))
    if picture is not None:
        write_figure(states_of(compared.treated, motions, ("A", "D", *MOVEMENTS)), picture)
    if table is not None:
        _write_table(table, compared.outcomes)
    show_table(frame(with_words(compared.outcomes.round(3), 3)), "outcomes, simulated")
    show_table(frame(compared.movement.round(3)), "movement after, relative to before, simulated")
    for name, reason in motions.failed.items():
        say(f"The movement {name} could not be simulated: {reason}")
    for note in motions.notes:
        say(note)
    written = " and ".join(str(path) for path in (out_path, plain) if path is not None)
    say(f"Wrote {written}, simulated. {NOT_VALIDATED.capitalize()}.")


def _compare_jaws(before: Path, after: Path, table: Path | None) -> None:
    """Print the outcomes of a jaw before and after its treatment, and write them."""
    from emgface.anatomy.checked import read_model
    from emgface.treatment.jaw_outcomes import jaw_outcome_table
    from emgface.treatment.plan import NOT_VALIDATED

    jaws = [read_model(path, "jaw_model") for path in (before, after)]
    announce_compilation()
    with progress("simulating") as bar:
        outcomes = jaw_outcome_table(*jaws, progress=bar.show)
    if table is not None:
        _write_table(table, outcomes)
    show_table(frame(outcomes.round(3)), "outcomes of the jaw, simulated")
    say(f"{NOT_VALIDATED.capitalize()}.")


def _words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _chosen(text: str, option: str, allowed: "Iterable[str]") -> tuple[str, ...]:
    """Words joined by commas, each one of those allowed; typer.BadParameter otherwise."""
    words, known = _words(text), tuple(allowed)
    if not words or any(word not in known for word in words):
        raise typer.BadParameter(
            f"{option} = {text!r}: expected some of {', '.join(known)}, joined by commas"
        )
    return words


def _numbers(text: str, option: str, high: float) -> tuple[float, ...]:
    """Numbers joined by commas, between 0 and `high`; typer.BadParameter otherwise."""
    try:
        values = tuple(float(word) for word in _words(text))
    except ValueError:
        values = ()
    if not values or not all(0.0 < value < high for value in values):
        raise typer.BadParameter(
            f"{option} = {text!r}: expected numbers between 0 and {high:g}, joined by commas"
        )
    return values


def dose(
    out_table: Annotated[
        Path,
        typer.Option("--out", help="Table of all cases to write (csv); its folder keeps them."),
    ],
    plan: Annotated[
        Path | None, typer.Option(help="Plan (TOML) for every person, in place of the shapes.")
    ] = None,
    shapes: Annotated[str, typer.Option(help="V, W, shield, rectangle.")] = "V,shield",
    shares: Annotated[str, typer.Option(help="Shares of the lip.")] = "0.1,0.2,0.3,0.4",
    places: Annotated[str, typer.Option(help="Places along the margin, from 0 to 1.")] = "0.5",
    rejoin: Annotated[str, typer.Option(help="Cut fibres: all (joined), none.")] = "all",
    persons: Annotated[int, typer.Option(min=1, help="Generated persons.")] = 5,
    draws: Annotated[
        int, typer.Option(min=0, help="Draws of stiffness, scar and retraction, which are unknown.")
    ] = 4,
    movements: Annotated[
        str, typer.Option(help="Instructions, opening, closing.")
    ] = "A,D,opening,closing",
    resolution: options.ResolutionOption = "coarse",
    sigma_max: Annotated[float, typer.Option(help="Largest muscle stress [Pa].")] = 100e3,
    contact: options.ContactSwitch = True,
    cube: Annotated[Path | None, typer.Option(help="Cube to write (netCDF).")] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure to write (png, pdf).")] = None,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> None:
    """Tabulate outcomes against the share of a lip that is removed, over generated persons.

    Cases that are complete are kept next to the table, and a repeated command computes the others.
    """
    from emgface.muscles import INSTRUCTIONS
    from emgface.pictures.stills import write_figure
    from emgface.run.store import store_netcdf
    from emgface.treatment import dose
    from emgface.treatment.dose_figure import dose_figure
    from emgface.treatment.motions import MOVEMENTS
    from emgface.treatment.plan import NOT_VALIDATED, Shape, read_plan

    moved = _chosen(movements, "--movements", (*INSTRUCTIONS, *MOVEMENTS))
    setting = dose.DoseSetting(
        resolution=resolution, movements=moved, sigma_max=sigma_max, contact=contact
    )
    if plan is not None:
        every = dose.cases_of_plan(persons, draws, read_plan(plan))
    else:
        every = dose.cases(
            persons, draws, _chosen(shapes, "--shapes", get_args(Shape)),
            _numbers(shares, "--shares", 0.75), _numbers(places, "--places", 1.0),
            _chosen(rejoin, "--rejoin", ("all", "none")),
        )  # fmt: skip
    announce_compilation()
    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        with progress("treating") as bar:
            table = dose.dose_table(
                every, setting, out_table.with_suffix(""), workers=chosen, observer=bar,
                stopping=stopping,
            )  # fmt: skip
    _write_table(out_table, table)
    if cube is not None:
        store_netcdf(dose.cube_of(table, setting), cube)
    if figure is not None:
        write_figure(dose_figure(table, setting), figure)
    intervals = dose.intervals_by_dose(table)
    show_table(frame(intervals[intervals["median"].notna()].round(3)), "change, simulated")
    refused = table[table["end"] != "reached"]
    for row in refused.to_dict("records"):
        say(f"Person {row['person']}, {row['shape']} {100 * row['share']:g} %: {row['end']}")
    say(f"Wrote {out_table}: {len(table)} cases, {len(refused)} not reached. {NOT_VALIDATED}.")
