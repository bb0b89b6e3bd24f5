"""Commands of a jaw and a recording: `record`, `activate` and `score`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import Rows, say, show_table

if TYPE_CHECKING:
    import xarray as xr

BaselineOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--baseline",
        help="Motion by other excitations, such as those of exchanged channels, that is also scored; "
        "repeatable.",
    ),
]


def motions_of(paths: list[Path] | None) -> "dict[str, xr.Dataset]":
    """Motions that are scored as baselines, by the names of their files."""
    from emgface.schema.netcdf import read_netcdf

    return {path.stem: read_netcdf(path, "jaw_motion") for path in paths or ()}


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


def activate(
    path: Annotated[Path, typer.Argument(help="Recording with channels such as MAS_L.")],
    out_path: Annotated[Path, typer.Option("--out", help="Excitations to write (netCDF).")],
    reference: options.ReferenceOption = None,
    mapping: options.MappingOption = None,
    band: options.BandOption = None,
    feature: options.FeatureOption = None,
    clip: options.ClipOption = False,
) -> None:
    """Compute excitations of a jaw from the sEMG of temporalis, masseter and digastric."""
    from emgface.anatomy.jaw.emg import excitation_of
    from emgface.choices import configure
    from emgface.cli.options import chain_with
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import write_netcdf
    from emgface.signals.parameters import SignalChain

    chain = chain_with(SignalChain(), band=band, feature=feature)
    if clip:
        values = chain.model_dump()
        values["normalisation"]["outside"] = "clip"
        chain = configure(SignalChain, values, where="options")
    given = (read_recording(one, mapping=mapping) for one in reference or ())
    excitation = excitation_of(read_recording(path, mapping=mapping), chain, reference=given)
    write_netcdf(excitation, out_path, "jaw_excitation")
    if passive := excitation.attrs["passive"]:
        say(f"No channel drives {passive}; these muscles are passive.")
    if not reference:
        say("Without --reference the highest value of every channel is taken as full activity.")
    if (above := excitation.attrs["exceeded_fraction"]) > 0.0:
        say(f"{100.0 * above:.2g} % of the samples exceed maximum effort and are clipped to it.")
    if (below := excitation.attrs["clipped_fraction"] - above) > 1e-9:
        say(
            f"{100.0 * below:.2g} % lie below the resting level of the reference and are set to zero."
        )
    say(f"Wrote {out_path}: {excitation.sizes['exciter']} exciters.")


def score(
    recording: Annotated[Path, typer.Argument(help="Recording with positions of the jaw.")],
    motion: Annotated[Path, typer.Argument(help="Motion written by 'run'.")],
    out_path: Annotated[Path, typer.Option("--out", help="Scores to write (netCDF).")],
    mapping: options.MappingOption = None,
    baseline: BaselineOption = None,
) -> None:
    """Align the recorded points of a jaw with a motion, and score every one beside baselines."""
    from emgface.anatomy.jaw.compared import compared
    from emgface.anatomy.jaw.recorded import score_motion
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import read_netcdf, write_netcdf

    given = read_recording(recording, mapping=mapping)
    moved = read_netcdf(motion, "jaw_motion")
    write_netcdf(score_motion(given, moved), out_path, "scores")
    table = compared(given, moved, motions_of(baseline))
    heads = tuple(column.head() for column in table.columns)
    rows = (zip(table.columns, row, strict=True) for row in table.rows)
    cells = tuple(tuple(column.cell(value) for column, value in row) for row in rows)
    show_table(Rows(heads, cells), table.title)
    say(table.note)
    say(f"Wrote {out_path}.")
