"""``emgface live``: a reduced face that follows streamed sEMG, without a view."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import frame, say, show_table
from emgface.cli.machine import announce_compilation
from emgface.cli.options import FacePath, MappingOption


def live(
    source: Annotated[Path, typer.Option(help="Recording that is played in real time.")],
    reduced: Annotated[Path, typer.Option(help="Reduced face ('face reduce').")],
    log: Annotated[Path, typer.Option(help="Table of all frames to write (csv).")],
    face: FacePath = None,
    mapping: MappingOption = None,
    seconds: Annotated[
        float, typer.Option(help="Duration in s; the recording is repeated.")
    ] = 60.0,
) -> None:
    """Move a reduced face by sEMG in real time; log latency and jitter."""
    import pandas as pd

    import emgface as ef
    from emgface.api.given import face_of, study_of
    from emgface.files import write_text
    from emgface.reduced.live import live as run
    from emgface.reduced.live import summary
    from emgface.reduced.model import ReducedFace, parameters_of
    from emgface.schema.netcdf import read_netcdf

    data = read_netcdf(reduced, "reduced_face")
    model = ReducedFace.of(data, face_of(face, study_of(None)), parameters_of(data))
    recording = ef.read(source, mapping=mapping)
    announce_compilation()
    step = float(data.attrs["step"])
    table = pd.DataFrame([row for *_, row in run(recording, model, seconds=seconds, step=step)])
    write_text(log, table.to_csv(index=False, float_format="%.6g"))
    numbers = pd.DataFrame(summary(table, step).items(), columns=["quantity", "value"])
    show_table(
        frame(numbers), f"{source.name}, {len(table)} frames of {1e3 * step:g} ms, times in s"
    )
    say(f"Wrote {log}.")
