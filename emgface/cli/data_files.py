"""Commands ``inventory``, ``convert``, ``cut`` and ``schema``."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import BAD_INPUT, fail, frame, say, show_table
from emgface.cli.data import FORMATS
from emgface.cli.options import BandOption, MappingOption, OutPath, ReplaceOption, chain_with

if TYPE_CHECKING:
    import xarray as xr


def inventory(
    folder: Annotated[Path, typer.Argument(help="Folder with files of any kind.")],
    sidecars: Annotated[
        Path | None,
        typer.Option(help="Folder with TOML sidecars for tables and arrays in the first folder."),
    ] = None,
    out_path: Annotated[
        Path | None,
        typer.Option("--out", help="Table to write (.csv or .md), in addition to the printed one."),
    ] = None,
) -> None:
    """List every file: channels, rates, units, duration and findings, or the reason of refusal."""
    from analysis.tables import no_formula
    from emgface.errors import DataError
    from emgface.files import write_text
    from emgface.recordings.inventory import inventory_table, markdown

    if out_path is not None and out_path.suffix.lower() not in (".csv", ".md"):
        raise DataError(f"{out_path.name} ends in {out_path.suffix!r}, expected .csv or .md")
    table = inventory_table(folder, sidecars=sidecars)
    read = table[table["refusal"].isna()]
    show_table(frame(read.drop(columns=["findings", "refusal"])), f"read from {folder}")
    for row in read.to_dict("records"):
        say(f"{row['file']}: {row['findings']}.")
    for row in table[table["refusal"].notna()].to_dict("records"):
        say(f"Refused {row['file']}: {row['refusal']}")
    say(f"{len(read)} of {len(table)} files were read.")
    if out_path is not None:
        csv = out_path.suffix.lower() == ".csv"
        text = table.map(no_formula).to_csv(index=False) if csv else markdown(table)
        write_text(out_path, text)
        say(f"Wrote {out_path}.")


NOTCH = "Notch filter at the mains frequency and its harmonics, forward and backward"


class Target(StrEnum):
    """Output formats of recordings."""

    bids = "bids"
    netcdf = "netcdf"


def convert(
    paths: Annotated[
        list[Path], typer.Argument(help=f"Recordings, or folders of them: {FORMATS}.")
    ],
    out_folder: Annotated[Path, typer.Option("--out", help="Folder to write to.")],
    to: Annotated[Target, typer.Option(help="Format to write.")] = Target.netcdf,
    mapping: MappingOption = None,
    notch: Annotated[
        float | None,
        typer.Option(help="Remove mains hum of this frequency and its harmonics [Hz], 50 or 60."),
    ] = None,
    notch_width: Annotated[float, typer.Option(help="Width of each notch [Hz].")] = 2.0,
    subject: Annotated[
        str | None, typer.Option(help="Volunteer, if the recordings specify none or a wrong one.")
    ] = None,
    task: Annotated[
        str | None, typer.Option(help="Instruction, if the recordings specify none or a wrong one.")
    ] = None,
    run: Annotated[
        int | None,
        typer.Option(min=1, help="Repetition, if the recordings specify none or a wrong one."),
    ] = None,
    replace: ReplaceOption = False,
) -> None:
    """Convert recordings to netCDF or to EMG-BIDS and Motion-BIDS, optionally with a notch filter."""
    from emgface.errors import DataError, EmgfaceError
    from emgface.files import named_file, new_files
    from emgface.recordings.bids import write_bids
    from emgface.recordings.bids.names import file_name
    from emgface.recordings.bids.rules import bids_problems
    from emgface.recordings.bids.write import bids_entities
    from emgface.recordings.dataset import find_recordings, read_recording, write_recording
    from emgface.recordings.folder import left_out_sentence
    from emgface.recordings.quality import remove_hum

    given = [
        file for path in paths for file in (find_recordings(path) if path.is_dir() else [path])
    ]
    named = {"volunteer": subject, "instruction": task, "repetition": run}
    named = {name: value for name, value in named.items() if value is not None}
    edges = {"frequency (Hz)": notch, "width (Hz)": notch_width}
    filtered = {} if notch is None else {"SoftwareFilters": {NOTCH: edges}}
    taken: dict[str, Path] = {}
    n_bad = 0
    for file in given:
        try:
            recording = read_recording(file, mapping=mapping).assign_attrs(named)
            target = named_file(out_folder, file.stem, suffix=".nc").name
            if to == Target.bids:
                given_names = bids_entities(recording)
                target = "_".join(given_names.values())
                start = file_name(given_names, "")
                there = sorted(out_folder.glob(f"sub-{given_names['sub']}/*/{start}*"))
            else:
                there = [out_folder / target]
            if target in taken:
                raise DataError(
                    f"{file} and {taken[target]} would both be written as {target}, expected "
                    "different names: convert them into different folders, or specify "
                    "--run for each"
                )
            taken[target] = file
            new_files(dict.fromkeys(there), replace=replace, sources=given)
            if notch is not None and "emg" in recording:
                emg = remove_hum(recording["emg"], notch, width=notch_width)
                recording = recording.assign(emg=emg)
            if to == Target.bids:
                written = write_bids(recording, out_folder, emg=filtered)[0]
            else:
                written = write_recording(recording, out_folder / target)
        except EmgfaceError as error:
            fail(error)
            n_bad += 1
            continue
        say(f"{file.name}: wrote {written}.")
        if unseen := _unseen(recording):
            say(f"Warning: {file.name}: {unseen}.")
    broken = bids_problems(out_folder) if to == Target.bids and n_bad < len(given) else []
    for sentence in broken:
        say(sentence)
    for folder in (path for path in paths if path.is_dir()):
        if sentence := left_out_sentence(folder):
            say(sentence)
    say(f"{len(given) - n_bad} of {len(given)} recordings were converted.")
    if n_bad or broken:
        raise typer.Exit(BAD_INPUT)


def _unseen(recording: "xr.Dataset") -> str:
    """Markers whose positions are NaN in some frames, and in how many."""
    if "position" not in recording:
        return ""
    from emgface.errors import listed

    missing = recording["position"].isnull().any("axis").sum("time_marker")
    n, frames = int((missing > 0).sum()), recording.sizes["time_marker"]
    names = [
        f"{label} ({int(count)} of {frames} frames)"
        for label, count in zip(missing["marker"].values, missing.values, strict=True)
        if count
    ]
    return (
        f"{n} markers have no position in some frames, which are NaN: {listed(names)}" if n else ""
    )


def cut(
    path: Annotated[Path, typer.Argument(help=f"Recording of several repetitions: {FORMATS}.")],
    out_folder: Annotated[Path, typer.Option("--out", help="Folder to write the trials to.")],
    events: Annotated[
        Path | None,
        typer.Option(
            help="Events (*_events.tsv); default: repetitions are detected from the activity."
        ),
    ] = None,
    mapping: MappingOption = None,
    offset: Annotated[
        float | None,
        typer.Option(help="Offset of the marker clock in s: t_emg = offset + t_marker."),
    ] = None,
    band: BandOption = None,
    before: Annotated[float, typer.Option(min=0, help="Time before the onset in s.")] = 0.0,
    after: Annotated[float, typer.Option(min=0, help="Time after the end in s.")] = 0.0,
    replace: ReplaceOption = False,
) -> None:
    """Cut a long recording into trials, by events or by its activity."""
    from emgface.errors import DataError, SignalError
    from emgface.files import different_names, named_file, new_files
    from emgface.recordings.dataset import read_recording, write_recording
    from emgface.recordings.events import cut_trials, find_repetitions, read_events
    from emgface.recordings.synchronise import synchronise
    from emgface.signals.filters import bandpass
    from emgface.signals.parameters import SignalChain

    recording = read_recording(path, mapping=mapping)
    if offset is not None:
        recording = synchronise(recording, offset=offset)
    if events is not None:
        table = read_events(events)
    elif "emg" in recording:
        chain = chain_with(SignalChain(), band=band)
        table = find_repetitions(bandpass(recording["emg"], chain.filter))
    else:
        raise DataError(
            f"{path.name} contains no EMG from which repetitions could be detected, expected "
            "EMG or events: specify a table with --events"
        )
    show_table(frame(table), f"{path.name}: {len(table)} trials")
    trials: list[xr.Dataset] = []
    outside: SignalError | None = None
    try:
        for trial in cut_trials(recording, table, before=before, after=after):
            trials.append(trial)  # noqa: PERF402  # those before the error are kept
    except SignalError as error:  # events beyond the recording; the others are written
        outside = error
    targets: list[Path] = []
    for trial in trials:
        names = [str(trial.attrs.get(k, "")) for k in ("volunteer", "instruction", "repetition")]
        names[0] = names[0] or path.stem
        targets.append(named_file(out_folder, *names, suffix=".nc"))
    from_events = [f"the trial from {float(t.attrs['cut_from'][0]):.4g} s on" for t in trials]
    origins = different_names(zip(targets, from_events, strict=True))
    new_files(origins, replace=replace, sources=[path])
    for trial, target in zip(trials, targets, strict=True):
        say(f"Wrote {write_recording(trial, target)}.")
    if outside is not None:
        raise outside


def schema(
    out_path: OutPath = None,
    study: Annotated[
        bool,
        typer.Option("--study", help="Write the JSON Schema of a study file instead of the page."),
    ] = False,
) -> None:
    """Write the page that documents all objects: variables, dims, units, ranges."""
    from emgface.files import write_text
    from emgface.schema.page import schema_page, study_schema_text

    text = study_schema_text() if study else schema_page()
    if out_path is None:
        typer.echo(text, nl=False)
        return
    write_text(out_path, text)
    say(f"Wrote {out_path}.")
