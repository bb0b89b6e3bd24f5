"""``emgface live``: a reduced face that follows streamed sEMG, without a view."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import frame, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.options import FacePath, MappingOption

STREAM = "lsl:"  #: begins the name of a stream


def live(
    source: Annotated[
        str,
        typer.Option(
            help="Recording that is played in real time, or lsl:NAME for a stream of the Lab "
            "Streaming Layer."
        ),
    ],
    reduced: Annotated[Path, typer.Option(help="Reduced face ('face reduce').")],
    log: Annotated[Path, typer.Option(help="Table of all frames to write (csv).")],
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
    seconds: Annotated[
        float, typer.Option(help="Duration in s; a shorter recording is repeated.")
    ] = 60.0,
) -> None:
    """Move a reduced face by sEMG in real time; log latency and jitter."""
    import pandas as pd

    import emgface as ef
    from emgface.api.given import face_of, study_of
    from emgface.errors import ConfigurationError, SignalError
    from emgface.files import write_text
    from emgface.reduced.live import heard, summary, weights_of
    from emgface.reduced.live import live as run
    from emgface.reduced.model import ReducedFace, parameters_of
    from emgface.reduced.stream import Played, Streamed
    from emgface.schema.netcdf import read_netcdf

    name = source.removeprefix(STREAM) if source.startswith(STREAM) else ""
    if name and range_ is None:
        raise ConfigurationError(
            "a stream has no range of features before it ends, expected --range RECORDING of the same "
            "person and electrodes"
        )
    data = read_netcdf(reduced, "reduced_face")
    model = ReducedFace.of(data, face_of(face, study_of(None)), parameters_of(data))
    recording = ef.read(range_ or source, mapping=mapping)
    step = float(data.attrs["step"])
    if name:
        stream = Streamed(name, step)
    else:
        stream = Played(ef.read(source, mapping=mapping) if range_ else recording, step)
    muscles = model.model.system.muscles
    between = heard(recording, step, muscles, stream.channels)
    weights = weights_of(stream.channels, muscles)
    if silent := [name for name, w in zip(muscles, weights, strict=True) if not w.any()]:
        say(f"Warning: no channel of the source records {', '.join(silent)}, which stay at rest.")
    announce_compilation()
    rows: list[dict[str, float]] = []
    try:
        for *_, row in run(stream, model, between, seconds=seconds, step=step):
            rows.append(row)
    except SignalError as error:
        if not rows:
            raise
        say(f"Warning: {error}")
    table = pd.DataFrame(rows)
    write_text(log, table.to_csv(index=False, float_format="%.6g"))
    numbers = pd.DataFrame(summary(table, step).items(), columns=["quantity", "value"])
    title = f"{name or Path(source).name}, {len(table)} frames of {1e3 * step:g} ms, times in s"
    show_table(frame(numbers), title)
    say(f"Wrote {log}.")
