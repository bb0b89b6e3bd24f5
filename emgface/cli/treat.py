"""``emgface treat`` and ``compare``: virtual treatment of a face, and the movement that is left."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation


def treat(
    plan: Annotated[Path, typer.Argument(help="Plan of the treatment (TOML).")],
    model: Annotated[Path, typer.Argument(help="Face model, or jaw model (netCDF).")],
    out_path: Annotated[Path, typer.Option("--out", help="Treated model to write (netCDF).")],
    sigma_max: Annotated[
        float | None, typer.Option(help="Largest muscle stress of the tissue that is closed [Pa].")
    ] = None,
) -> None:
    """Treat a face or a jaw by a plan: excise, close, weaken, resect. Not for treatment decisions."""
    from emgface.api.given import simulation_of, study_of
    from emgface.face.file import load_face, save_face
    from emgface.schema.netcdf import kind_of, read_netcdf, write_netcdf
    from emgface.treatment.plan import NOT_VALIDATED, read_plan
    from emgface.treatment.treat import treat_face, treat_jaw

    if model.is_file() and kind_of(model) == "jaw_model":
        write_netcdf(
            treat_jaw(read_netcdf(model, "jaw_model"), read_plan(plan)), out_path, "jaw_model"
        )
        say(f"Wrote {out_path}, simulated. {NOT_VALIDATED.capitalize()}.")
        return
    chosen: dict[str, Any] = {} if sigma_max is None else {"sigma_max": sigma_max}
    parameters = simulation_of(study_of(None).simulation, None, chosen)
    announce_compilation()
    with progress("closing") as bar:
        treated = treat_face(
            load_face(model), read_plan(plan), parameters, folder=plan.parent, progress=bar.show
        )
    save_face(treated, out_path)
    for step in json.loads(treated.attrs.get("treatment", "[]"))[-1:]:
        for report in step["steps"]:
            numbers = ", ".join(
                f"{name.replace('_', ' ')} {value:.3g}"
                for name, value in report.items()
                if isinstance(value, float)
            )
            say(f"Step {report['step']}, {report['kind']}: {numbers or 'done'}.")
    say(f"Wrote {out_path}, simulated. {NOT_VALIDATED.capitalize()}.")


def compare(
    before: Annotated[Path, typer.Argument(help="Face before the treatment (netCDF).")],
    after: Annotated[Path, typer.Argument(help="Face after the treatment (netCDF).")],
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
    mapping: options.MappingOption = None,
    accuracy: options.AccuracyOption = "draft",
    sigma_max: Annotated[
        float | None, typer.Option(help="Largest muscle stress at the start [Pa].")
    ] = None,
    contact: options.ContactSwitch = True,
) -> None:
    """Simulate two faces under the same activations, and compare their movement."""
    from emgface.api.given import simulation_of, study_of
    from emgface.face.file import load_face
    from emgface.files import write_text
    from emgface.pictures.stills import write_figure
    from emgface.treatment.motions import TASKS, compared, gestures, recorded
    from emgface.treatment.outcomes import movement_table, outcome_table
    from emgface.treatment.pages import compare_page, states_of

    chosen: dict[str, Any] = {} if sigma_max is None else {"sigma_max": sigma_max}
    if not contact:
        chosen["contact"] = {"method": "none"}
    parameters = simulation_of(study_of(None).simulation, accuracy, chosen)
    intact, treated = load_face(before), load_face(after)
    activations, source = gestures(intact), "The activations are gestures of the instructions."
    if recordings is not None:
        activations = recorded(recordings, mapping) | gestures(intact, tuple(TASKS))
        source = f"The activations are those of the recordings in {recordings.name}."
    announce_compilation()
    with progress("simulating") as bar:
        motions = compared(
            intact, treated, activations, parameters, source=source, progress=bar.show
        )
    tables = outcome_table(intact, treated, motions), movement_table(motions)
    for path, simple in ((out_path, False), (plain, True)):
        if path is not None:
            page = compare_page(
                intact, treated, motions, activations, tables, folder=after.parent, plain=simple
            )
            write_text(path, page)
    if picture is not None:
        write_figure(states_of(treated, motions, ("A", "D", *TASKS)), picture)
    if table is not None:
        write_text(table, "# simulated\n" + tables[0].to_csv(index=False, float_format="%.6g"))
    show_table(frame(tables[0].round(3)), "outcomes, simulated")
    show_table(frame(tables[1].round(3)), "movement after, relative to before, simulated")
    for name, reason in motions.failed.items():
        say(f"The movement {name} could not be simulated: {reason}")
    say(f"Wrote {out_path}" + (f" and {plain}." if plain else "."))
