"""``emgface head``: couple face, jaw, tongue and hyoid of a person, move them, and show the motion."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import progress, say
from emgface.cli.machine import announce_compilation
from emgface.cli.moved import PictureOption, tell_motion, write_picture

app = typer.Typer(
    no_args_is_help=True, help="Build, move and show heads of face, jaw, tongue and hyoid."
)

HeadPath = Annotated[Path, typer.Argument(help="Head (netCDF).")]


@app.command()
def build(
    out_path: Annotated[Path, typer.Option("--out", help="Head to write (netCDF).")],
    parts: Annotated[
        str, typer.Option(help="Names of face, jaw, tongue and hyoid, with commas between.")
    ] = "face,jaw,tongue,hyoid",
    preset: Annotated[
        str, typer.Option(help="adult, woman, man, older_woman, older_man, girl or boy.")
    ] = "adult",
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of a random person.")] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", help="Measure, such as mouth_width=52mm; repeatable."),
    ] = None,
    resolution: Annotated[
        str, typer.Option(help="coarse, medium, fine or a number of elements, of face and tongue.")
    ] = "coarse",
    contact: Annotated[
        list[str] | None,
        typer.Option(
            help="lip-lip, lips-teeth, tongue-teeth, tongue-palate or none; repeatable. "
            "Default: all of the parts."
        ),
    ] = None,
) -> None:
    """Generate the head of a person."""
    from emgface.anatomy.head.build import build_head
    from emgface.anatomy.head.model import write_head
    from emgface.anatomy.jaw.template.measures import parse_settings

    head = build_head(
        [name.strip() for name in parts.split(",")],
        preset=preset,
        seed=seed,
        measures=parse_settings(settings or []),
        resolution=int(resolution) if resolution.isdigit() else resolution,
        contacts=[] if contact == ["none"] else contact,
    )
    write_head(head, out_path)
    own = head.lists
    say(
        f"Wrote {out_path}: {own.attrs['name']}: {own.sizes['muscle']} muscles, "
        f"{own.sizes['attachment']} attached nodes ({', '.join(own['pair'].values) or 'none'}), "
        f"contact of {', '.join(own['contact'].values) or 'nothing'}."
    )


@app.command()
def simulate(
    path: HeadPath,
    out_path: Annotated[Path, typer.Option("--out", help="Motion to write (netCDF).")],
    excitation: Annotated[
        Path | None,
        typer.Option(help="Excitations (csv, nc) with a column time and one per exciter."),
    ] = None,
    muscle: Annotated[
        list[str] | None,
        typer.Option(
            help="Exciter and level that rises within 0.2 s, such as bi_GGP=0.3; repeatable."
        ),
    ] = None,
    duration: Annotated[float, typer.Option(help="Simulated time [s].")] = 0.5,
    law: Annotated[
        str, typer.Option(help="Muscle law of the jaw, as of `emgface jaw run`.")
    ] = "peck",
    gravity: Annotated[bool, typer.Option(help="With gravity.")] = True,
    step: Annotated[float, typer.Option(help="Largest time step [s].")] = 5e-3,
) -> None:
    """Move a head by excitations of any of its muscles."""
    from emgface.anatomy.head.model import read_head
    from emgface.anatomy.head.run import raised, simulate_head, write_motion
    from emgface.anatomy.jaw.series import read_excitation
    from emgface.errors import ConfigurationError, HeadError

    if muscle and excitation is not None:
        raise ConfigurationError(
            "--muscle and --excitation are both specified, expected one of them: add the muscles to the "
            "series, or leave out the file"
        )
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
def show(
    path: Annotated[Path, typer.Argument(help="Motion of a head (netCDF).")],
    out_path: PictureOption = None,
) -> None:
    """Write the page of a motion: skin, bones, teeth, tongue and muscles by activation."""
    from emgface.anatomy.head.picture import head_figure, head_page
    from emgface.anatomy.head.run import read_motion

    motion, parts = read_motion(path)
    write_picture(path, out_path, lambda: head_page(motion, parts), lambda: head_figure(motion))
