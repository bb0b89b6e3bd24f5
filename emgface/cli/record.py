"""``emgface record``: recordings of simulated motions of a jaw."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import say


def record(
    path: Annotated[Path, typer.Argument(help="Motion of a jaw (netCDF).")],
    out_path: Annotated[Path, typer.Option("--out", help="Recording to write (netCDF).")],
    person: Annotated[int, typer.Option(min=0, help="Seed of the person's amplitudes.")] = 0,
    repetition: Annotated[int, typer.Option(min=1, help="Seed of the signals.")] = 1,
) -> None:
    """Simulate a recording of a motion: sEMG of temporalis, masseter and digastric, and the incisor."""
    from emgface.anatomy.jaw.recorded import simulated_recording
    from emgface.recordings.dataset import write_recording
    from emgface.schema.netcdf import read_netcdf

    motion = read_netcdf(path, "jaw_motion")
    write_recording(simulated_recording(motion, person=person, repetition=repetition), out_path)
    say(f"Wrote {out_path}: simulated recording of {path.name}.")
