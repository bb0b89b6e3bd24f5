"""``emgface bench``: error against run time, stability, cost, growth and start, on this machine."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import frame, progress, say, show_table

if TYPE_CHECKING:
    import xarray as xr

app = typer.Typer(no_args_is_help=True, help="Measure accuracy, run time and stability.")

FaceOption = Annotated[
    Path | None, typer.Option("--face", help="Face model (netCDF); the template face if absent.")
]
OutOption = Annotated[Path, typer.Option("--out", help="Folder for netCDF, table and figure.")]
SigmaOption = Annotated[float, typer.Option("--sigma-max", help="Largest active stress [Pa].")]


def _face(path: Path | None, resolution: str = "coarse") -> "xr.Dataset":
    from emgface.cli.machine import announce_compilation
    from emgface.face.file import load_face
    from emgface.face.template import template_face

    announce_compilation()
    return template_face(resolution=resolution) if path is None else load_face(path)


def _finish(kind: str, found: "xr.Dataset", folder: Path) -> None:
    from emgface.bench.store import store

    table, paths = store(kind, found, folder)
    show_table(frame(table), f"{kind} (simulated)")
    say("written: " + ", ".join(str(path) for path in paths))


@app.command(name="work-precision")
def work_precision(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    sigma_max: SigmaOption = 100e3,
    duration: Annotated[float, typer.Option(help="Simulated seconds.")] = 0.4,
    repeats: Annotated[int, typer.Option(help="Runs per setting; times are medians.")] = 2,
    instruction: Annotated[
        list[str] | None, typer.Option(help="Gesture, A to F; A, D and E by default.")
    ] = None,
    model: Annotated[
        list[str] | None,
        typer.Option(
            help="Treatment of the volume: pointwise, element, nodal or hard; after 'refined:' on the "
            "mesh with every element divided into eight. The first is measured widely. All four and "
            "refined:pointwise, refined:element by default."
        ),
    ] = None,
    processor: Annotated[
        bool,
        typer.Option(
            "--processor", help="Take processor time: for a machine that does other work."
        ),
    ] = False,
    full: Annotated[
        bool, typer.Option("--full", help="Measure every model as widely as the first; hours.")
    ] = False,
) -> None:
    """Measure error against run time: integrators, steps, tolerances, solvers, meshes, volume."""
    from emgface.bench.work_precision import MODELS, Model, measure
    from emgface.face.simulation_parameters import SimulationParameters

    face = _face(face_path)
    with progress("work-precision") as bar:
        found = measure(
            face,
            SimulationParameters(sigma_max=sigma_max),
            instructions=tuple(instruction or "ADE"),
            models=tuple(map(Model.named, model)) if model else MODELS,
            full=full,
            processor=processor,
            duration=duration,
            repeats=repeats,
            progress=bar.working,
        )
    say(f"U = {1e3 * found.attrs['unit_s']:.1f} ms (one factorisation and one solution)")
    _finish("work-precision", found, out_path)


@app.command()
def stability(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    row: Annotated[list[int] | None, typer.Option(help="Row 1 to 11; all by default.")] = None,
) -> None:
    """Run the stability battery: extreme cases with every integrator."""
    from emgface.bench.stability import run_battery

    face = _face(face_path)
    with progress("stability") as bar:
        found = run_battery(face, rows=row, progress=bar.show)
    _finish("stability", found, out_path)
    wrong = int(found["outcome"].str.startswith("WRONG").sum())
    if wrong:
        say(f"{wrong} wrong answers came without an error")
        raise typer.Exit(1)


@app.command()
def cost(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    rounds: Annotated[int, typer.Option(help="Rounds over all scenes; times are medians.")] = 15,
) -> None:
    """Switch each part of a scene on and off and time the step."""
    from emgface.bench.cost import measure

    face = _face(face_path)
    with progress("cost") as bar:
        found = measure(face, rounds=rounds, progress=bar.show)
    _finish("cost", found, out_path)


@app.command()
def scaling(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    refine: Annotated[
        bool, typer.Option(help="Also divide every element of the largest face into eight.")
    ] = True,
) -> None:
    """Time every phase of a step on growing meshes, and fit the exponents."""
    from emgface.bench.scaling import measure
    from emgface.face.simulation_parameters import SimulationParameters

    faces = (
        [_face(None, resolution) for resolution in ("coarse", "medium", "fine")]
        if face_path is None
        else [_face(face_path)]
    )
    with progress("scaling") as bar:
        found = measure(faces, SimulationParameters(), refine=refine, progress=bar.working)
    _finish("scaling", found, out_path)


@app.command()
def contact(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    resolution: Annotated[
        str, typer.Option(help="Of the template face: coarse, medium or fine.")
    ] = "medium",
    case: Annotated[
        list[str] | None,
        typer.Option(help="'closing', 'protrusion', or an instruction A to F."),
    ] = None,
    method: Annotated[
        list[str] | None, typer.Option(help="none, constraint or barrier; all by default.")
    ] = None,
    between: Annotated[
        list[str] | None, typer.Option(help="What may touch, lips or teeth; both by default.")
    ] = None,
    friction: Annotated[float, typer.Option(help="Coulomb coefficient.")] = 0.0,
    sigma_max: SigmaOption = 100e3,
    hold: Annotated[float, typer.Option(help="Seconds that the activation is held.")] = 1.0,
) -> None:
    """Close the lips with and without contact: penetration, steadiness, iterations, time per step."""
    from emgface.bench.contact import CLOSING, METHODS, STEPPING, measure
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.face.template.gestures import GESTURES

    face = _face(face_path, resolution)
    with progress("contact") as bar:
        found = measure(
            face,
            methods=tuple(method or METHODS),
            cases=tuple(case or (CLOSING, *GESTURES)),
            between=tuple(between or ("lips", "teeth")),
            friction=friction,
            hold=hold,
            parameters=SimulationParameters(sigma_max=sigma_max, gravity=False, **STEPPING),
            progress=bar.show,
        )
    _finish("contact", found, out_path)


@app.command()
def start(
    out_path: OutOption = Path("bench"),
    face_path: FaceOption = None,
    volume: Annotated[
        list[str] | None,
        typer.Option(help="pointwise, element, nodal or hard; all four by default."),
    ] = None,
    repeats: Annotated[int, typer.Option(help="Processes per case; times are medians.")] = 3,
) -> None:
    """Time fresh processes until their first result, their imports and their memory."""
    from emgface.bench.start import VOLUMES, measure

    with progress("start") as bar:
        found = measure(
            face_path, volumes=tuple(volume or VOLUMES), repeats=repeats, progress=bar.working
        )
    _finish("start", found, out_path)
