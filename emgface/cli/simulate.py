"""``emgface simulate`` and ``show``: motions, and pictures of files of any kind."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli import options
from emgface.cli.console import Bar, frame, progress, say, show_table
from emgface.cli.machine import announce_compilation

if TYPE_CHECKING:
    import xarray as xr

    from emgface.models.kinds import Drive, Kind


def simulate(
    source: Annotated[
        str,
        typer.Argument(
            metavar="INPUT",
            help="Activation of 'activate', recording, or levels of muscles such as "
            "ZYG_L=0.3,ZYG_R=0.3; for other models than a face, a file of excitations (csv, nc; for a "
            "tongue also txt), exciters such as bi_GGP=0.3, a task of a jaw (rest, close, open, "
            "open_head, gape, protrude, lateral, clench, effort, cycles, chew, swallow, pull), or rest.",
        ),
    ],
    out_path: Annotated[
        Path | None, typer.Option("--out", help="Trajectory to write (netCDF).")
    ] = None,
    page: Annotated[
        Path | None, typer.Option(help="Page with the moving face to write (html).")
    ] = None,
    movie: Annotated[Path | None, typer.Option(help="Movie to write (gif, mp4).")] = None,
    vtk: Annotated[
        Path | None, typer.Option(help="Folder for files that ParaView opens (simulated.pvd).")
    ] = None,
    surface: Annotated[
        bool, typer.Option("--surface", help="Store the surface of the face in the trajectory.")
    ] = False,
    model_path: options.ModelPath = None,
    study: options.StudyPath = None,
    duration: Annotated[
        float | None, typer.Option(help="Simulated time in s; not of files of a face.")
    ] = None,
    step: Annotated[float | None, typer.Option(help="Largest time step in s.")] = None,
    settings: options.SettingOption = None,
    sigma_max: options.SigmaMaxOption = None,
    calibrate: Annotated[
        list[Path] | None,
        typer.Option(
            help="Other recordings of the volunteer, from whose markers sigma_max is calibrated; "
            "the option may be repeated."
        ),
    ] = None,
    solver: Annotated[
        str | None,
        typer.Option(
            help="sdirk2, converged, trapezoidal, linearly_implicit or linearly_implicit_trapezoidal."
        ),
    ] = None,
    accuracy: options.AccuracyOption = None,
    reduced: Annotated[
        Path | None,
        typer.Option(help="Reduced face ('reduce'), simulated with the contact of its training."),
    ] = None,
    strategy: Annotated[
        str | None, typer.Option(help="Strategy, if the input is a recording.")
    ] = None,
    instruction: options.InstructionOption = None,
    mapping: options.MappingOption = None,
    band: options.BandOption = None,
    feature: options.FeatureOption = None,
    missing_side: options.MissingSideOption = None,
    missing_muscle: options.MissingMuscleOption = None,
    reference: options.ReferenceOption = None,
    clip: options.ClipOption = False,
    contact: options.ContactSwitch = True,
    check_contact: Annotated[
        bool,
        typer.Option(
            "--check-contact",
            help="Repeat a motion with contact with other time steps, to estimate its error.",
        ),
    ] = False,
    solver_threads: Annotated[
        int,
        typer.Option(
            min=1,
            help="Threads of the linear solver; with several, the last digits differ between processes.",
        ),
    ] = 1,
    waypoints: Annotated[
        Path | None,
        typer.Option(help="New folder for states of the motion, from which others branch."),
    ] = None,
    waypoint_every: Annotated[float, typer.Option(help="Time between these states in s.")] = 0.1,
    branch: Annotated[
        Path | None, typer.Option(help="Folder of such states, at one of which the motion begins.")
    ] = None,
    branch_at: Annotated[float, typer.Option(help="Time of this state in s.")] = 0.1,
) -> None:
    """Simulate the motion of a face, jaw, tongue or head; store it, or show it."""
    if not (out_path or page or movie or vtk):
        from emgface.errors import ConfigurationError

        raise ConfigurationError("no output is specified, expected --out, --page, --movie or --vtk")
    from emgface.models.kinds import Drive, kind_of_model, parsed

    recorded: dict[str, Any] = {
        "study": study,
        "strategy": strategy,
        "instruction": instruction,
        "mapping": mapping,
        "band": band,
        "feature": feature,
        "missing_side": missing_side,
        "missing_muscle": missing_muscle,
        "reference": reference or None,
        "normalisation": {"outside": "clip"} if clip else None,
    }
    recorded = {name: value for name, value in recorded.items() if value is not None}
    drive = Drive(source, duration, step, accuracy, parsed(settings or ()), recorded)
    kind = None if model_path is None else kind_of_model(model_path)
    if kind is not None and model_path is not None and kind.name != "face":
        of_faces = {
            "--vtk": vtk, "--surface": surface, "--sigma-max": sigma_max, "--solver": solver,
            "--calibrate": calibrate,
            "--reduced": reduced, "--check-contact": check_contact, "--no-contact": not contact,
            "--solver-threads": solver_threads != 1, "--waypoints": waypoints, "--branch": branch,
        }  # fmt: skip
        _move(kind, model_path, drive, out_path, page, movie, of_faces)
        return
    given = {"sigma_max": sigma_max, "solver": solver, "step": step}
    changes: dict[str, Any] = {name: v for name, v in given.items() if v is not None}
    if reduced:
        from emgface.reduced.model import contact_of

        changes |= {"reduced": {"file": reduced}, "contact": contact_of(reduced)}
    if not contact:
        changes["contact"] = {"method": "none"}
    if check_contact:
        changes["check_contact"] = True
    if calibrate:
        changes["calibrate"] = calibrate
    if waypoints is not None:
        changes["waypoints"] = (waypoints, waypoint_every)
    if branch is not None:
        changes["branch"] = (branch, branch_at)
    _move_face(
        drive,
        _Outputs(out_path, page, movie, vtk, surface),
        model_path,
        study,
        solver_threads,
        changes,
    )


@dataclass(frozen=True)
class _Outputs:
    """Files of the motion of a face; `surface` is stored in the trajectory on request."""

    trajectory: Path | None
    page: Path | None
    movie: Path | None
    vtk: Path | None
    surface: bool


def _move_face(
    drive: "Drive",
    outputs: _Outputs,
    model_path: Path | None,
    study: Path | None,
    solver_threads: int,
    changes: dict[str, Any],
) -> None:
    """Simulate a face and write what was requested."""
    import emgface as ef
    from emgface.api.given import face_of, study_of
    from emgface.models.face import activation_for, parameters_of
    from emgface.pictures.movie import check_movie
    from emgface.pictures.surface import without_surface
    from emgface.schema.netcdf import write_netcdf
    from sim import Positions

    choices = parameters_of(drive.settings, changes)
    page, movie, vtk = outputs.page, outputs.movie, outputs.vtk
    if movie:
        check_movie(movie)
    plan = study_of(study)
    model = face_of(model_path, plan)
    given = activation_for(model, drive)
    announce_compilation()
    with progress("simulating") as bar:
        trajectory = ef.simulate(
            given,
            model,
            study=plan,
            accuracy=drive.accuracy,
            surface=bool(outputs.surface or page or movie),
            probes=(Positions(),) if vtk else (),
            progress=bar.show,
            solver_threads=solver_threads,
            **choices,
        )
        nodes = trajectory.get("node_position")
        trajectory = trajectory.drop_vars("node_position", errors="ignore")
        if outputs.trajectory:
            kept = trajectory if outputs.surface else without_surface(trajectory)
            write_netcdf(kept, outputs.trajectory, "trajectory")
        _show_motion(trajectory, given, page, movie, bar)
        if vtk and nodes is not None:
            _write_vtk(vtk, model, nodes)
    written = [str(path) for path in (outputs.trajectory, page, movie, vtk) if path]
    _tell(trajectory, ", ".join(written))


def _move(
    kind: "Kind",
    path: Path,
    drive: "Drive",
    out_path: Path | None,
    page: Path | None,
    movie: Path | None,
    of_faces: dict[str, object],
) -> None:
    """Simulate a jaw, tongue or head, write its motion and its page, and report them."""
    from tempfile import TemporaryDirectory

    import emgface as ef
    from emgface.errors import ConfigurationError

    if given := [name for name, value in {**of_faces, "--movie": movie}.items() if value]:
        raise ConfigurationError(
            f"{', '.join(given)} is an option of faces, expected none with the {kind.name} {path.name}: "
            "leave it out"
        )
    model = kind.functions.read(path)
    announce_compilation()
    with progress(f"simulating {drive.source}") as bar:
        moved = kind.functions.move(model, drive, bar.show)
    with TemporaryDirectory() as folder:
        file = out_path or Path(folder) / "motion.nc"
        kind.functions.write_motion(moved.motion, model, file)
        if page is not None:
            ef.show(file, page)
    for note in moved.notes:
        say(note)
    for title, table in moved.tables:
        show_table(frame(table), title)
    tell_motion(moved.motion, ", ".join(str(p) for p in (out_path, page) if p), kind.name)


def tell_motion(motion: "xr.Dataset", written: str, name: str) -> None:
    """Report the files written, clipped excitations and a loss of stability."""
    clipped = motion.attrs["clipped_excitation"]
    if clipped < 0.0:
        say(f"Negative excitations, down to {clipped:.3g}, were set to zero.")
    if "unstable_from_s" in motion.attrs:
        say(
            f"The equilibrium lost stability between {motion.attrs['unstable_from_s']:.4g} and "
            f"{motion.attrs['unstable_until_s']:.4g} s: there the motion may depend on the step and on "
            "rounding; compare it with one of smaller steps."
        )
    say(f"Wrote {written}: {motion.attrs['task']} of the {name}, simulated.")


def show(
    path: Annotated[
        Path, typer.Argument(help="Recording, activation, motion, scores, cube, model or sound.")
    ],
    out_path: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Page (html), picture (png, pdf, svg) or movie (gif, mp4) to write."
        ),
    ] = None,
    mapping: options.MappingOption = None,
    activation: Annotated[
        Path | None, typer.Option(help="Activation of a motion, shown with it.")
    ] = None,
    recording: Annotated[
        Path | None,
        typer.Option(
            help="Recording of a motion, whose lip markers are aligned, shown and scored."
        ),
    ] = None,
    compare: Annotated[
        Path | None, typer.Option(help="Second motion of the same face, shown with the first.")
    ] = None,
    face: Annotated[
        Path | None,
        typer.Option(help="Face of the motion, whose markers place the head of the recording."),
    ] = None,
    baseline: options.BaselineOption = None,
    save: Annotated[
        Path | None,
        typer.Option(
            help="Mapping file to which the page of a recording saves names and unusable channels and "
            "spans; the page then also shows every sample. Ctrl-C ends the program."
        ),
    ] = None,
) -> None:
    """Draw the contents of a file, in the browser or to a file."""
    import emgface as ef

    if save is not None:
        _browse(path, mapping, save)
        return
    view = ef.show(
        path,
        mapping=mapping,
        activation=None if activation is None else ef.read(activation),
        recording=recording,
        compare=compare,
        face=face,
        baseline=baseline or (),
    )
    say(f"Wrote {view.open() if out_path is None else view.save(out_path)}.")


def _browse(path: Path, mapping: Path | None, save: Path) -> None:
    """Serve the page of a recording until Ctrl-C."""
    import time
    import webbrowser

    from emgface.files import refuse_existing
    from emgface.recordings.dataset import read_recording
    from emgface.recordings.labels import read_label_map
    from emgface.view.recording import RecordingPage, findings_shown
    from emgface.view.server import LocalServer

    refuse_existing(save)
    given = read_label_map(mapping).of_file(path)
    data = read_recording(path, mapping=given)
    page = RecordingPage(data, path.name, findings_shown(data), save, given)
    server = LocalServer(
        page.html(served=True), get={"span": page.span}, post={"mapping": page.save}
    )
    server.start()
    opened = webbrowser.open(server.redirect().as_uri())
    say("The page is:" if opened else "Open this page in a browser of this computer:")
    say(server.url)
    say("Ctrl-C ends the program.")
    try:
        while True:
            time.sleep(1.0)
    except KeyboardInterrupt:
        say(f"Wrote {save}." if save.exists() else "Ended; nothing was saved.")
    finally:
        server.stop()


def _show_motion(
    motion: "xr.Dataset", drive: "xr.Dataset", page: Path | None, movie: Path | None, bar: Bar
) -> None:
    from emgface.files import write_text
    from emgface.pictures.movie import write_movie
    from emgface.pictures.page import motion_page

    if page:
        text = motion_page(motion, drive)
        write_text(page, text)
    if movie:
        bar.working("drawing the movie")
        write_movie(motion, movie, progress=bar.show)


def _write_vtk(folder: Path, face: "xr.Dataset", nodes: "xr.DataArray") -> None:
    from emgface.pictures.surface import frame_stride
    from emgface.pictures.vtk import write_vtk

    times = nodes["time"].values
    every = frame_stride(float(times[1] - times[0])) if len(times) > 1 else 1
    chosen = nodes.transpose("time", "node", "axis").isel(time=slice(None, None, every))
    write_vtk(folder, face, chosen.values, chosen["time"].values)


def _tell(trajectory: "xr.Dataset", written: str) -> None:
    """Report the files written, the displacement of the face and its accuracy."""
    from emgface.face.event_error import contact_share

    moved = 1e3 * trajectory.attrs["motion"]
    say(
        f"Wrote {written}: simulated motion, {int(trajectory['steps'].sum())} steps in "
        f"{trajectory.attrs['run_time_s']:.1f} s, sigma_max "
        f"{trajectory.attrs['sigma_max'] / 1e3:.4g} kPa, smallest J "
        f"{float(trajectory['smallest_J'].min()):.2g}, largest marker displacement "
        f"{moved:.2f} mm."
    )
    if trajectory.attrs.get("reduced"):
        bound = 1e3 * trajectory.attrs["reduction_error"]
        say(f"Bound of the error of the reduction: {bound:.2g} mm.")
    if "numerical_error" not in trajectory.attrs:
        solver = trajectory.attrs["solver"]
        say(f"The error of the time steps is not estimated by solver = '{solver}'.")
        return
    error = 1e3 * trajectory.attrs["numerical_error"]
    share = f", {100 * error / moved:.2g} % of the motion" if moved > 0.0 else ""
    sentence = f"Estimated error of the time steps: {error:.2g} mm{share}"
    of_contact = contact_share(trajectory)
    sentence += f", {of_contact}." if of_contact else "."
    say(sentence)
