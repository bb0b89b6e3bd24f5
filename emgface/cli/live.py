"""``emgface live``: a face in the browser that follows sliders, edited curves or streamed sEMG."""

import signal
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from emgface.cli.console import frame, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.options import FacePath, MappingOption, PresetOption, ResolutionOption

if TYPE_CHECKING:
    import xarray as xr

    from emgface.reduced.model import ReducedFace
    from emgface.view.live import Drive, LiveSession
    from emgface.view.moving import Moving
    from emgface.view.workspace import Workspace

STREAM = "lsl:"  #: begins the name of a stream
FULL_ORDER_STEP = 0.01  #: step at full order [s]


def live(
    model: Annotated[
        Path | None, typer.Argument(metavar="[FACE]", help="Face model; default: the template.")
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            help="Recording that is played in real time, or lsl:NAME for a stream of the Lab "
            "Streaming Layer. Default: sliders in the page."
        ),
    ] = None,
    reduced: Annotated[
        Path | None,
        typer.Option(
            help="Reduced face ('reduce'). Without it, the face moves at full order, at its own "
            "pace, and curves cannot be edited."
        ),
    ] = None,
    log: Annotated[
        Path | None,
        typer.Option(
            help="Steps to write at the end: activations, markers and latencies (netCDF), or the "
            "numbers alone (csv)."
        ),
    ] = None,
    face: FacePath = None,
    range_: Annotated[
        Path | None,
        typer.Option(
            "--range",
            help="Recording of the same person and electrodes, whose smallest and largest features "
            "are 0 and 1. Default: the source; a stream requires one.",
        ),
    ] = None,
    mapping: MappingOption = None,
    curves: Annotated[
        Path | None,
        typer.Option(
            help="Curves to edit: a table (csv), an activation (netCDF), a folder of probe files, or a "
            "recording, with whose markers the motion is then compared."
        ),
    ] = None,
    workspace: Annotated[
        Path | None,
        typer.Option(
            help="Folder that keeps edited curves, view and notes; it opens with the same files only."
        ),
    ] = None,
    send: Annotated[
        str | None,
        typer.Option(
            help="Name of streams of the Lab Streaming Layer for activations and markers."
        ),
    ] = None,
    seconds: Annotated[
        float | None,
        typer.Option(help="Duration in s. Default: until Ctrl-C, without a page 60 s."),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of this computer; 0 chooses a free one.")
    ] = 0,
    open_page: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in a browser.")
    ] = True,
    page: Annotated[
        bool, typer.Option("--page/--no-page", help="Show the face, or only compute and log.")
    ] = True,
    preset: PresetOption = "adult",
    resolution: ResolutionOption = "coarse",
) -> None:
    """Move a face in the browser by sliders, edited curves or streamed sEMG."""
    from emgface.errors import ConfigurationError
    from emgface.view.server import LocalServer
    from emgface.view.workspace import Workspace

    if source is None and not page:
        raise ConfigurationError(
            "without a page there are no sliders, expected --source with a recording or a stream"
        )
    chosen, moving, small = _face(model or face, reduced, preset, resolution)
    drive = _drive(source, range_, mapping, moving)
    announce_compilation()
    kept = None
    if workspace is not None:
        if small is None:
            raise ConfigurationError(
                "a workspace keeps curves, expected --reduced with a reduced face"
            )
        files = {"face": model or face, "reduced": reduced, "recording": curves}
        kept = Workspace.open(workspace, files, moving.muscles)
    session, text = _session(chosen, moving, small, drive, curves, mapping, send, kept)
    server = None
    if page:
        post = {"curves": _opened} | ({"workspace": kept.save} if kept else {})
        server = LocalServer(text, talk=session.talk, post=post, port=port)
        server.start()
        _show(server, open_page)
    # A closed terminal and a polite end from outside write the log as Ctrl-C does.
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGTERM", "SIGHUP"):
            if hasattr(signal, name):  # Windows lacks the second
                signal.signal(getattr(signal, name), signal.default_int_handler)
    try:
        session.run(seconds if seconds is not None or page else 60.0)
    except KeyboardInterrupt:
        say("Ended.")
    finally:
        try:
            if server is not None:
                server.stop()
        finally:
            _conclude(session, log, source or "sliders")


def _show(server: Any, open_page: bool) -> None:
    import webbrowser

    redirect = server.redirect()
    opened = open_page and webbrowser.open(redirect.as_uri())
    say("The page is:" if opened else "Open this page in a browser of this computer:")
    say(server.url)
    say("Ctrl-C ends the program and writes the log.")


def _face(
    path: Path | None, reduced: Path | None, preset: str, resolution: str
) -> "tuple[xr.Dataset, Moving, ReducedFace | None]":
    """The face, the same as it moves, and the reduced face, if there is one."""
    import emgface as ef
    from emgface.api.given import simulation_of, study_of
    from emgface.cli.options import mesh_size
    from emgface.pictures.body import skin_of
    from emgface.reduced.model import ReducedFace, parameters_of
    from emgface.schema.netcdf import read_netcdf
    from emgface.view.moving import FullMoving, ReducedMoving

    made = {} if path else {"preset": preset, "resolution": mesh_size(resolution)}
    chosen = ef.face(path, **made)
    skin = skin_of(chosen)
    if reduced is None:
        parameters = simulation_of(
            study_of(None).simulation, "draft", {"contact": {"method": "none"}}
        )
        return chosen, FullMoving(chosen, parameters, skin, FULL_ORDER_STEP), None
    data = read_netcdf(reduced, "reduced_face")
    small = ReducedFace.for_face(data, chosen, parameters_of(data))
    return chosen, ReducedMoving(small, skin, float(data.attrs["step"])), small


def _drive(
    source: str | None, range_: Path | None, mapping: Path | None, moving: "Moving"
) -> "Drive":
    """Sliders, or a recording or stream with the range of its features."""
    import numpy as np

    import emgface as ef
    from emgface.errors import ConfigurationError
    from emgface.reduced.live import heard, span_of, weights_of
    from emgface.reduced.stream import Played, Streamed
    from emgface.view.live import Semg, Sliders

    if source is None:
        return Sliders(moving.muscles, moving.step, real_time=moving.real_time)
    name = source.removeprefix(STREAM) if source.startswith(STREAM) else ""
    if name and range_ is None:
        raise ConfigurationError(
            "a stream has no range of features before it ends, expected --range RECORDING of the same "
            "person and electrodes"
        )
    recording = ef.read(range_ or source, mapping=mapping)
    if name:
        stream = Streamed(name, moving.step)
    else:
        played = ef.read(source, mapping=mapping) if range_ else recording
        stream = Played(played, moving.step)
        _tell_other_person(recording, played)
    between = heard(recording, moving.step, moving.muscles, stream.channels)
    recorded = weights_of(stream.channels, moving.muscles).any(axis=1)
    still = recorded & np.isinf(span_of(between))
    for which, reason in ((~recorded, "has no channel"), (still, "is constant in the range")):
        if names := ", ".join(moving.muscles[k] for k in np.flatnonzero(which)):
            say(f"Warning: the sEMG of {names} {reason}; these muscles stay at rest.")
    return Semg(stream, moving.muscles, between, name or Path(source).name)


def _tell_other_person(recording: "xr.Dataset", played: "xr.Dataset") -> None:
    """Warn if the range is that of another volunteer than the one whose recording is played."""
    own, other = (str(one.attrs.get("volunteer", "")) for one in (recording, played))
    if own and other and own != other:
        say(
            f"Warning: the range is of volunteer {own}, the source of {other}, expected the same person "
            "and electrodes: activations are then relative to another person."
        )


def _session(
    face: "xr.Dataset",
    moving: "Moving",
    reduced: "ReducedFace | None",
    drive: "Drive",
    curves: Path | None,
    mapping: Path | None,
    send: str | None,
    workspace: "Workspace | None",
) -> "tuple[LiveSession, str]":
    """The session and the page that belongs to it."""
    from emgface.errors import ConfigurationError
    from emgface.pictures.body import skin_of
    from emgface.pictures.encoding import middle_of
    from emgface.view.edited import EditedMotion, curves_and_recording
    from emgface.view.live import LiveSession, Sliders
    from emgface.view.outlets import Outlets
    from emgface.view.page import live_page

    skin = skin_of(face)
    centre = middle_of(face["position"].values[skin.node])
    if curves is not None and reduced is None:
        raise ConfigurationError("curves require a reduced face: pass --reduced ('reduce')")
    given, edited = None, None
    if reduced is not None:
        given, compared = curves_and_recording(curves, mapping)
        edited = EditedMotion(reduced, skin, centre, step=moving.step, **compared)
    outlets = Outlets(send, moving, [str(m) for m in face["marker"].values]) if send else None
    session = LiveSession(
        moving,
        drive,
        list(map(str, face["marker"].values)),
        centre=centre,
        curves=edited,
        ahead=None if edited is None else edited.ahead,
        further=outlets,
    )
    words = f"activations by {drive.name}"
    words += "" if moving.real_time else ", full order, slower than real time"
    sliders = isinstance(drive, Sliders)
    edits = edited is not None
    return session, live_page(
        face,
        skin,
        moving,
        words=words,
        sliders=sliders,
        edits=edits,
        curves=given,
        workspace=workspace,
    )


def _opened(body: bytes) -> Any:
    """Curves of a table that the page sends, as JSON."""
    import json

    from emgface.errors import EmgfaceError
    from emgface.view.curves import curves_in
    from emgface.view.page import as_message
    from emgface.view.server import Answer

    try:
        content: Any = as_message(curves_in(body.decode("utf-8-sig"), "the file"))
    except (EmgfaceError, UnicodeDecodeError) as error:
        content = {"why": str(error)}
    return Answer(json.dumps(content).encode(), "application/json")


def _conclude(session: "LiveSession", log: Path | None, source: str) -> None:
    """Write the log, and print latencies."""
    import pandas as pd

    from emgface.files import write_text
    from emgface.reduced.live import live_summary
    from emgface.schema.netcdf import write_netcdf
    from emgface.view.frames import FRAME_NUMBERS

    if not len(session.log.rows):
        return
    table = pd.DataFrame(session.log.rows, columns=list(FRAME_NUMBERS))
    step = session.face.step
    numbers = pd.DataFrame(live_summary(table, step).items(), columns=["quantity", "value"])
    title = f"{source}, {len(table)} frames of {1e3 * step:g} ms, times in s"
    show_table(frame(numbers), title)
    for at, note in session.log.notes[:20]:
        say(f"At {at:.2f} s: {note}")
    if log is not None:
        if log.suffix.lower() == ".nc":
            write_netcdf(session.log.dataset({"source": source, "step": step}), log, "activation")
        else:
            write_text(log, table.to_csv(index=False, float_format="%.6g"))
        say(f"Wrote {log}.")
