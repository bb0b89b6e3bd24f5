"""Commands on models of any kind: ``build``, ``import``, ``tabulate``, ``reduce``, ``sweep``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation, executing, graceful_stop

if TYPE_CHECKING:
    from emgface.models.kinds import Kind

KindArgument = Annotated[str, typer.Argument(metavar="KIND", help="face, jaw, tongue or head.")]
ModelOut = Annotated[Path, typer.Option("--out", help="Model to write (netCDF).")]


def build(
    kind: KindArgument,
    out_path: ModelOut,
    preset: options.PresetOption = "adult",
    settings: options.MeasureOption = None,
    seed: options.SeedOption = None,
    resolution: Annotated[
        str | None,
        typer.Option(
            help="coarse, medium, fine, or the approximate number of elements; default: medium, for a "
            "head coarse."
        ),
    ] = None,
    parts: Annotated[
        str | None,
        typer.Option(help="Parts of a head, separated by commas; default: face,jaw,tongue,hyoid."),
    ] = None,
    contact: Annotated[
        list[str] | None,
        typer.Option(
            help="Contact in a head: lip-lip, lips-teeth, tongue-teeth, tongue-palate or none; "
            "repeatable. Default: all of the parts."
        ),
    ] = None,
    ring: Annotated[
        list[str] | None,
        typer.Option(
            help="Another part of orbicularis oris of a head, such as OOP='peripheral deep gaps=0.2'; "
            "repeatable."
        ),
    ] = None,
    part_file: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            help="File of a part of a head in place of a generated one, such as face=person.nc (face, "
            "jaw or tongue); repeatable.",
        ),
    ] = None,
) -> None:
    """Generate a face, jaw, tongue or head from published measures of a person."""
    from emgface.models.kinds import Person, kind_named

    chosen = kind_named(kind)
    given = [one.partition("=") for one in ring or []]
    contacts = None if contact is None else () if contact == ["none"] else tuple(contact)
    person = Person(
        preset=preset,
        seed=seed,
        measures=tuple(settings or ()),
        resolution=None if resolution is None else options.mesh_size(resolution),
        parts=None if parts is None else tuple(name.strip() for name in parts.split(",")),
        contacts=contacts,
        rings={muscle: words for muscle, _, words in given} or None,
        models=_files(part_file),
    )
    _write(chosen, chosen.build(person), out_path)


def _files(given: list[str] | None) -> dict[str, Path] | None:
    """Files by part, of options such as face=person.nc; None without options."""
    return {part: Path(file) for part, _, file in map(_parted, given or [])} or None


def _parted(text: str) -> tuple[str, str, str]:
    part, equals, file = text.partition("=")
    if not (part and file):
        raise typer.BadParameter(f"--model {text}: expected PART=FILE, such as face=person.nc")
    return part, equals, file


def import_(
    kind: KindArgument,
    folder: Annotated[Path, typer.Argument(help="Folder with the files of the published model.")],
    out_path: ModelOut,
    settings: options.SettingOption = None,
) -> None:
    """Import the published face, jaw, tongue or head from its files."""
    from emgface.models.kinds import kind_named, parsed

    chosen = kind_named(kind)
    _write(chosen, chosen.functions.import_(folder, parsed(settings or ())), out_path)


def _write(kind: "Kind", model: Any, out_path: Path) -> None:
    kind.functions.write(model, out_path)
    say(f"Wrote {out_path}: {kind.functions.describe(model)}.")


def tabulate(
    path: Annotated[Path, typer.Argument(help="Jaw, tongue or face (netCDF).")],
    out_table: Annotated[Path | None, typer.Option("--out", help="Table to write (csv).")] = None,
    settings: options.SettingOption = None,
) -> None:
    """Run all tasks of a jaw, or raise every muscle of a tongue, and tabulate the outcomes."""
    from emgface.files import write_text
    from emgface.models.kinds import kind_of_model, parsed

    kind = kind_of_model(path)
    model = kind.functions.read(path)
    announce_compilation()
    with progress("simulating") as bar:
        title, table = kind.functions.table(model, parsed(settings or ()), bar.show)
    show_table(frame(table), title)
    if out_table is not None:
        write_text(out_table, table.to_csv(index=False))


def sweep(
    plan: Annotated[
        Path,
        typer.Argument(
            help="Table (csv) with one run per row: exciters such as bi_OOP, face.stiffening, "
            "tongue.sigma_max, ring.OOP, contact, name."
        ),
    ],
    out_table: Annotated[
        Path, typer.Option("--out", help="Table of outcomes (csv); completed runs are kept.")
    ],
    head_path: Annotated[
        Path | None, typer.Option("--head", help="Head (netCDF); default: a generated one.")
    ] = None,
    parts: Annotated[
        str, typer.Option(help="Parts of the head, separated by commas: face, jaw, tongue, hyoid.")
    ] = "face",
    preset: options.PresetOption = "adult",
    seed: options.SeedOption = None,
    resolution: options.ResolutionOption = "coarse",
    finer: Annotated[
        str | None,
        typer.Option(help="Resolution of a second mesh, for the mesh error; for example 1150."),
    ] = None,
    duration: Annotated[float, typer.Option(help="Simulated time in s.")] = 0.4,
    step: Annotated[
        float,
        typer.Option(
            help="Time step in s; every run is repeated with half of it to estimate the step error."
        ),
    ] = 1e-2,
    gravity: options.GravityOption = True,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> None:
    """Tabulate lips, jaw and tongue at the end of many runs, with the errors of step and mesh.

    A repeated command computes only runs that are missing or whose inputs or code changed; `emgface
    study status` shows the state of the folder that has the name of the table.
    """
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.sweep import STEP_ERROR, Setting, read_sweep_plan
    from emgface.anatomy.head.sweep import sweep as sweep_of

    setting = Setting(
        parts=tuple(name.strip() for name in parts.split(",")),
        preset=preset,
        seed=seed,
        resolution=options.mesh_size(resolution),
        finer=None if finer is None else options.mesh_size(finer),
        duration=duration,
        step=step,
        gravity=gravity,
    )
    runs = read_sweep_plan(plan)
    head = None if head_path is None else read_head(head_path)
    announce_compilation()
    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        with progress("simulating runs") as bar:
            table = sweep_of(
                runs, setting, table=out_table, head=head, workers=chosen, observer=bar,
                stopping=stopping,
            )  # fmt: skip
    shown = [c for c in table.columns if not c.endswith(("_error", "key"))]
    show_table(frame(table[shown]), "Outcomes, simulated")
    largest = table.filter(like=STEP_ERROR).max(numeric_only=True).max()
    failed = int((table["end"] != "reached").sum())
    say(f"Wrote {out_table}: {len(table)} runs, {failed} failed; largest step error {largest:.2g}.")


def reduce(
    path: Annotated[Path, typer.Argument(help="Face model (netCDF).")],
    out_path: Annotated[Path, typer.Option("--out", help="Reduced face to write (netCDF).")],
    study: options.StudyPath = None,
    sigma_max: Annotated[
        float | None,
        typer.Option(
            help="Largest muscle stress of the training, which later simulations must not exceed [Pa]."
        ),
    ] = None,
    modes: Annotated[int | None, typer.Option(help="Number of modes, a multiple of three.")] = None,
    elements: Annotated[
        int | None, typer.Option(help="Largest number of elements with a weight.")
    ] = None,
    sequences: Annotated[
        int | None, typer.Option(help="Number of sequences of the training.")
    ] = None,
    calibration: Annotated[
        int | None, typer.Option(help="Number of sequences that calibrate the bound of the error.")
    ] = None,
    ramps: Annotated[bool, typer.Option(help="Also train with ramps of each muscle.")] = True,
    seed: Annotated[int | None, typer.Option(help="Seed of the sequences.")] = None,
    activations: Annotated[
        str | None,
        typer.Option(help="Sequences of the training: study (default) or random."),
    ] = None,
    contact: options.ContactSwitch = True,
) -> None:
    """Train a reduced face; a repeated command reuses the stored training motions."""
    import emgface as ef
    from emgface.schema.netcdf import write_netcdf

    given = {"modes": modes, "elements": elements, "seed": seed}
    options: dict[str, Any] = {name: v for name, v in given.items() if v is not None}
    if sigma_max is not None:
        options["sigma_max"] = sigma_max
    plan: dict[str, Any] = {
        "activations": activations,
        "sequences": sequences,
        "calibration": calibration,
        "ramps": None if ramps else False,
    }
    options["training"] = {name: v for name, v in plan.items() if v is not None}
    if not contact:
        options["contact"] = {"method": "none"}
    announce_compilation()
    with progress("training") as bar:

        def tell(label: str, done: int, total: int) -> None:
            bar.working(label)
            bar.show(done, total)

        reduced = ef.reduce(
            path, study=study, folder=out_path.with_suffix(".training"), progress=tell, **options
        )
    write_netcdf(reduced, out_path, "reduced_face")
    a = reduced.attrs
    say(
        f"Wrote {out_path}: {a['moving']} modes, {reduced.sizes['sample']} elements, from "
        f"{a['training_seconds']:.0f} simulated seconds in {a['training_time_s']:.0f} s. Markers in "
        f"the calibration: {1e3 * a['calibration_rms']:.2g} mm rms, at most "
        f"{1e3 * a['calibration_largest']:.2g} mm from full order."
    )
