"""``emgface head``: couple face, jaw, tongue and hyoid of a person, move them, and show the motion."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import frame, progress, say, show_table
from emgface.cli.machine import announce_compilation, executing, graceful_stop
from emgface.cli.moved import (
    ExcitationOption,
    PictureOption,
    check_drive,
    tell_motion,
    write_picture,
)

if TYPE_CHECKING:
    from emgface.anatomy.head.model import Head

app = typer.Typer(
    no_args_is_help=True, help="Build, move and show heads of face, jaw, tongue and hyoid."
)

ContactOption = Annotated[
    list[str] | None,
    typer.Option(
        help="lip-lip, lips-teeth, tongue-teeth, tongue-palate or none; repeatable. "
        "Default: all of the parts."
    ),
]
PartsOption = Annotated[
    str, typer.Option(help="Parts of the head, separated by commas: face, jaw, tongue, hyoid.")
]
GravityOption = Annotated[bool, typer.Option(help="Simulate gravity.")]
HeadPath = Annotated[Path, typer.Argument(help="Head (netCDF).")]


@app.command()
def build(
    out_path: Annotated[Path, typer.Option("--out", help="Head to write (netCDF).")],
    parts: PartsOption = "face,jaw,tongue,hyoid",
    preset: options.PresetOption = "adult",
    seed: options.SeedOption = None,
    settings: options.MeasureOption = None,
    resolution: options.ResolutionOption = "coarse",
    contact: ContactOption = None,
    ring: Annotated[
        list[str] | None,
        typer.Option(
            help="Another part of orbicularis oris, such as OOP='peripheral deep gaps=0.2'; repeatable."
        ),
    ] = None,
) -> None:
    """Generate the head of a person."""
    from emgface.anatomy.head.build import build_head
    from emgface.anatomy.head.model import write_head
    from emgface.anatomy.jaw.template.measures import parse_settings
    from emgface.face.template.muscles import parse_ring

    given = (one.partition("=") for one in ring or [])
    head = build_head(
        [name.strip() for name in parts.split(",")],
        preset=preset,
        seed=seed,
        measures=parse_settings(settings or []),
        resolution=options.mesh_size(resolution),
        contacts=[] if contact == ["none"] else contact,
        rings={muscle: parse_ring(words) for muscle, _, words in given},
    )
    write_head(head, out_path)
    _say_written(head, out_path)


def _say_written(head: "Head", out_path: Path) -> None:
    own = head.lists
    say(
        f"Wrote {out_path}: {own.attrs['name']}: {own.sizes['muscle']} muscles, "
        f"{own.sizes['attachment']} attached nodes ({', '.join(own['pair'].values) or 'none'}), "
        f"contact of {', '.join(own['contact'].values) or 'nothing'}."
    )


@app.command(name="import")
def import_(
    folder: Annotated[
        Path,
        typer.Argument(help="Folder with jaw_tongue_face, face_badin, face_reference and tongue."),
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Head to write (netCDF).")],
    parts: PartsOption = "face,jaw,tongue,hyoid",
    contact: ContactOption = None,
    floor: Annotated[
        bool, typer.Option(help="Attach the floor of the mouth to tongue and hyoid.")
    ] = False,
) -> None:
    """Import the published coupled head from its files."""
    from emgface.anatomy.head.model import write_head
    from emgface.anatomy.head.published import import_head

    names = [name.strip() for name in parts.split(",")]
    head = import_head(folder, names, contacts=[] if contact == ["none"] else contact, floor=floor)
    write_head(head, out_path)
    _say_written(head, out_path)


@app.command(name="run", hidden=True)  # as `emgface jaw run`
@app.command()
def simulate(
    path: HeadPath,
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    excitation: ExcitationOption = None,
    muscle: Annotated[
        list[str] | None,
        typer.Option(
            help="Exciter and its level, which is reached within 0.2 s, such as bi_GGP=0.3; repeatable."
        ),
    ] = None,
    duration: Annotated[float, typer.Option(help="Simulated time in s.")] = 0.5,
    law: Annotated[
        str, typer.Option(help="Muscle law of the jaw, as in `emgface jaw run`.")
    ] = "peck",
    gravity: GravityOption = True,
    step: Annotated[float, typer.Option(help="Largest time step in s.")] = 5e-3,
) -> None:
    """Move a head by excitations of any of its muscles."""
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.run import raised, simulate_head, write_motion
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.errors import HeadError

    check_drive(muscle, excitation)
    head = read_head(path)
    levels = dict[str, float]()
    for one in muscle or []:
        name, _, level = one.partition("=")
        try:
            levels[name] = float(level or 0.3)
        except ValueError:
            levels[name] = float("nan")
        if not 0.0 <= levels[name] <= 1.0:
            raise HeadError(
                f"--muscle {one!r}, expected a name and a level from 0 to 1: bi_GGP=0.3"
            )
    known = head.lists["exciter"].values
    drive = (
        raised(levels, jaw="bi_close" in known)
        if excitation is None
        else read_excitation(excitation)
    )
    announce_compilation()
    task = " and ".join(levels) or (excitation.stem if excitation else "rest")
    with progress(f"simulating {task}") as bar:
        motion = simulate_head(
            head, drive, duration=duration, law=law, gravity=gravity, step=step, progress=bar.show
        )
    motion.attrs["task"] = task
    write_motion(motion, head, out_path)
    tell_motion(motion, out_path, head.lists.attrs["name"])


@app.command()
def follow(
    path: HeadPath,
    recording: Annotated[
        Path, typer.Argument(help="Recording with channels of the face and of the jaw (DIG_L ...).")
    ],
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    mapping: options.MappingOption = None,
    study: options.StudyPath = None,
    strategy: Annotated[
        str | None,
        typer.Option(help="Strategy for the face: act_all, act_3, act_rel or act_threshold."),
    ] = None,
    instruction: options.InstructionOption = None,
    effort: options.ReferenceOption = None,
    step: Annotated[float, typer.Option(help="Largest time step in s.")] = 5e-3,
) -> None:
    """Move a head by a recording of face and jaw, and score lips and incisor."""
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.recorded import Drive, move_as_recorded, score_head
    from emgface.anatomy.head.run import write_motion
    from emgface.api.given import recording_of, study_of

    head, given = read_head(path), recording_of(recording, mapping)
    efforts = [recording_of(one, mapping) for one in effort or []]
    drive = Drive(study_of(study), strategy, instruction, efforts)
    announce_compilation()
    with progress(f"simulating {recording.stem}") as bar:
        motion = move_as_recorded(given, head, drive, step=step, progress=bar.show)
    motion.attrs["task"] = recording.stem
    write_motion(motion, head, out_path)
    tell_motion(motion, out_path, head.lists.attrs["name"])
    if "position" not in given:
        return
    scores = score_head(given, motion, head, drive)
    table = scores[["rho", "amplitude_ratio", "rmse"]].to_dataframe().reset_index()
    show_table(frame(table.assign(rmse=1e3 * table["rmse"])), "Scores, rmse in mm")


@app.command()
def sweep(
    plan: Annotated[
        Path,
        typer.Argument(
            help="Table (csv) with one run per row: exciters such as bi_OOP, face.stiffening, "
            "tongue.sigma_max, ring.OOP, contact, name."
        ),
    ],
    out_path: Annotated[
        Path, typer.Option("--out", help="Table of outcomes (csv); completed runs are kept.")
    ],
    head_path: Annotated[
        Path | None, typer.Option("--head", help="Head (netCDF); default: a generated one.")
    ] = None,
    parts: PartsOption = "face",
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
    gravity: GravityOption = True,
    workers: options.WorkersOption = None,
    scheduler: options.SchedulerOption = None,
) -> None:
    """Tabulate lips, jaw and tongue at the end of many runs, with the errors of step and mesh.

    A repeated command computes only runs that are missing or whose inputs or code changed; `emgface
    study status` shows the state of the folder that has the name of the table.
    """
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.sweep import STEP_ERROR, Setting, read_plan
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
    runs = read_plan(plan)
    head = None if head_path is None else read_head(head_path)
    announce_compilation()
    with executing(workers, scheduler) as chosen, graceful_stop() as stopping:
        with progress("simulating runs") as bar:
            table = sweep_of(
                runs, setting, table=out_path, head=head, workers=chosen, observer=bar,
                stopping=stopping,
            )  # fmt: skip
    shown = [c for c in table.columns if not c.endswith(("_error", "key"))]
    show_table(frame(table[shown]), "Outcomes, simulated")
    largest = table.filter(like=STEP_ERROR).max(numeric_only=True).max()
    failed = int((table["end"] != "reached").sum())
    say(f"Wrote {out_path}: {len(table)} runs, {failed} failed; largest step error {largest:.2g}.")


@app.command()
def show(
    path: Annotated[Path, typer.Argument(help="Motion of a head (netCDF).")],
    out_path: PictureOption = None,
) -> None:
    """Write the page of a motion: skin, bones, teeth, tongue and muscles by activation."""
    from emgface.anatomy.head.picture import head_figure, head_page
    from emgface.anatomy.head.run import read_motion

    motion, parts = read_motion(path)
    write_picture(path, out_path, lambda: head_page(motion, parts), lambda: head_figure(motion))
