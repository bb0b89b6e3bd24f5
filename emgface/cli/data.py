"""``emgface check``, ``map`` and ``features``: examine recordings and map their labels."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli import options
from emgface.cli.console import BAD_INPUT, fail, frame, out, say, show_table

if TYPE_CHECKING:
    import xarray as xr

    from emgface.recordings.exclusions import Exclusion
    from emgface.study.configuration import StudyConfiguration

FORMATS = (
    "netCDF (.nc), C3D (.c3d), TRC (.trc), EDF and BDF (.edf, .bdf), Poly5 (.poly5, .s00), "
    "BrainVision (.vhdr), XDF (.xdf), BIDS motion (_motion.tsv)"
    ", text exports of EMGworks, Trigno Discover, AcqKnowledge, OpenSignals and Noraxon (.csv, .txt, "
    ".asc, also .csv.gz), and the TOML sidecar (.toml) of another table, a MATLAB or HDF5 file"
)


class Side(StrEnum):
    """Sides of the face, from the perspective of the volunteer."""

    left = "L"
    right = "R"


def check(
    paths: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings, folders of recordings, a study file, or a face, jaw, tongue or head: "
            f"{FORMATS}."
        ),
    ],
    study: Annotated[
        bool, typer.Option(help="List missing channels and markers of the study as errors.")
    ] = False,
    mapping: options.MappingOption = None,
    channels: Annotated[
        str, typer.Option(help="Show only channels whose name contains this text.")
    ] = "",
    missing_side: options.MissingSideOption = None,
    missing_muscle: options.MissingMuscleOption = None,
    page: Annotated[
        Path | None,
        typer.Option(help="Overview page to draw (png, svg), or PDF with one page per recording."),
    ] = None,
    exclude: Annotated[
        Path | None,
        typer.Option(
            help="File of exclusions to write (TOML): the trials that cannot be used, and why. "
            "Check it, correct it, and specify it in the study file as recordings.exclusions."
        ),
    ] = None,
) -> None:
    """Examine every channel and marker, or a model; fail if one cannot be used.

    Of a study file, its recordings are examined with its mapping and its signal chain. In a
    terminal the results are tables; into a pipe or file they are written as one CSV table.
    """
    import pandas as pd

    from analysis.tables import no_formula
    from emgface.cli.checked import Checked, checked, copies, gains, later_steps
    from emgface.cli.pages import overview_pages
    from emgface.errors import EmgfaceError
    from emgface.files import refuse_existing, write_text
    from emgface.recordings.dataset import find_recordings, read_recordings
    from emgface.recordings.exclusions import Exclusion, exclusions_text
    from emgface.recordings.folder import left_out_sentence
    from emgface.signals.parameters import SignalChain

    paths, unusable = _without_models(paths)
    if not paths:
        if unusable:
            raise typer.Exit(BAD_INPUT)
        return
    refuse_existing(exclude)
    chain = SignalChain()
    if planned := _study_alone(paths):
        paths, chain = [planned.recordings.folder], planned.signals
        mapping = mapping or planned.recordings.mapping
    chain = options.chain_with(chain, missing_side=missing_side, missing_muscle=missing_muscle)
    n_files = 0
    if page is not None:
        n_files = sum(len(find_recordings(path)) if path.is_dir() else 1 for path in paths)
    n_all, n_read = 0, 0
    done, excluded = list[Checked](), list[Exclusion]()
    with overview_pages(page, n_files) as add_page:
        for file, recording in read_recordings(*paths, mapping=mapping):
            n_all += 1
            try:
                if isinstance(recording, EmgfaceError):
                    raise recording
                n_read += 1
                verdict = checked(file.name, recording, chain, study, channels)
            except EmgfaceError as error:
                fail(error)
                continue
            done.append(verdict)
            add_page(recording, verdict.report)
            verdict.show()
            if verdict.bad and exclude is not None:
                excluded += _exclusion(recording, verdict.bad, file.name)
    if done and not out.is_terminal:
        tables = pd.concat([verdict.labelled() for verdict in done], ignore_index=True)
        typer.echo(tables.map(no_formula).to_csv(index=False), nl=False)
    for folder in (path for path in paths if path.is_dir()):
        if sentence := left_out_sentence(folder):
            say(sentence)
    for sentence in later_steps(done):
        say(sentence)
    for sentence in [*gains(done), *copies(done)]:
        say(f"Warning: {sentence}")
    n_good = sum(not verdict.bad for verdict in done)
    if n_read or n_all > 1:
        say(
            f"{n_good} of {n_all} recordings can be used; {sum(not f.refused for f in done)} pass "
            "every later step (activate, score, study run, convert)."
        )
    if exclude is not None:
        write_text(exclude, exclusions_text(excluded))
        say(f"Wrote {exclude}: {len(excluded)} trials; check it before using it in a study.")
    if n_good < n_all or unusable:
        raise typer.Exit(BAD_INPUT)


def _study_alone(paths: list[Path]) -> "StudyConfiguration | None":
    """Study, if a study file is the only file to check."""
    from emgface.texts import read_toml

    if len(paths) != 1 or paths[0].suffix.lower() != ".toml" or not paths[0].is_file():
        return None
    if "schema_version" not in read_toml(paths[0]):
        return None
    from emgface.study.file import load_study

    return load_study(paths[0])


def _without_models(paths: list[Path]) -> tuple[list[Path], bool]:
    """Check the models among the files; return the other files, and whether a model is unusable.

    A file that cannot be opened is among the others, so that it does not end the check.
    """
    from emgface.errors import EmgfaceError

    rest, unusable = list[Path](), False
    for path in paths:
        try:
            if not _model_checked(path):
                rest.append(path)
        except EmgfaceError as error:
            fail(error)
            unusable = True
    return rest, unusable


def _model_checked(path: Path) -> bool:
    """Report counts and measures of the model in a file; return False for another file."""
    if path.suffix.lower() != ".nc" or not path.is_file():
        return False
    from emgface.errors import EmgfaceError
    from emgface.models.kinds import MODEL_KINDS
    from emgface.schema.netcdf import kind_of

    try:
        declared = kind_of(path)
    except EmgfaceError:  # reported by the reader of recordings
        return False
    kind = next((one for one in MODEL_KINDS.values() if one.model == declared), None)
    if kind is None:
        return False
    model = kind.functions.read(path)
    say(f"{path.name}: {kind.functions.describe(model)}.")
    for title, table in kind.functions.check(model):
        show_table(frame(table), title)
    return True


def _exclusion(recording: "xr.Dataset", bad: list[str], name: str) -> "list[Exclusion]":
    """Exclude a trial, if it is identified."""
    from emgface.recordings.exclusions import Exclusion

    attrs = recording.attrs
    if any(key not in attrs for key in ("volunteer", "instruction", "repetition")):
        say(
            f"{name} cannot be assigned to a trial of a study and is therefore not in the list: "
            "specify a mapping."
        )
        return []
    reason = "; ".join(sentence.rstrip(".") for sentence in bad[:3])
    if len(bad) > 3:
        reason += f"; and {len(bad) - 3} more"
    return [
        Exclusion(
            volunteer=str(attrs["volunteer"]),
            instruction=str(attrs["instruction"]),
            repetition=int(attrs["repetition"]),
            reason=reason,
        )
    ]


def features(
    path: Annotated[Path, typer.Argument(help=f"Recording: {FORMATS}.")],
    channels: Annotated[
        str, typer.Option(help="Part of the names of the channels to show; default: all.")
    ] = "",
    mapping: options.MappingOption = None,
    study: options.StudyPath = None,
    band: options.BandOption = None,
) -> None:
    """Show the power in the pass-band and the range of the feature of every channel."""
    from analysis.tables import origin_of
    from emgface.api.given import signals_of
    from emgface.cli.checked import containing
    from emgface.recordings.channels import channel_report
    from emgface.recordings.dataset import read_recording

    chain = options.chain_with(signals_of(study), band=band)
    recording = read_recording(path, mapping=mapping)
    names = [str(name) for name in recording["channel"].values] if "emg" in recording else []
    chosen = containing(channels, names, path.name)
    report = channel_report(recording.sel(channel=chosen) if names else recording, chain)
    rows = report.reset_index()
    rows["rms"] *= 1e6
    rows = rows.rename(columns={"rms": "rms in uV", "median_frequency": "median frequency in Hz"})
    origin = origin_of(recording)
    used = report.attrs.get("pass_band", (chain.filter.low, chain.filter.high))
    edges = f"{used[0]:g}-{used[1]:g} Hz"
    show_table(frame(rows), f"{path.name} ({origin}): {chain.feature.kind}, band {edges}")
    live = int((report["status"] == "ok").sum())
    say(f"{live} of {len(report)} channels contain a signal.")
    if not live:
        raise typer.Exit(BAD_INPUT)


def propose(
    path: Annotated[Path, typer.Argument(help=f"Recording: {FORMATS}.")],
    out_path: Annotated[
        Path | None, typer.Option("--out", help="Mapping file to write (TOML).")
    ] = None,
    units: Annotated[
        list[str] | None,
        typer.Option(
            "--unit",
            help="Unit, where the file specifies none or a wrong one, such as emg=uV or "
            "position=mm; repeatable.",
        ),
    ] = None,
    side: Annotated[
        Side | None, typer.Option(help="Side of channels whose label contains none.")
    ] = None,
) -> None:
    """Propose the muscle of each channel and the position of each marker, for your confirmation.

    Proposals are based on the labels (names and abbreviations of muscles, words for sides), on
    target muscles if the file states them, and on the positions of markers.
    """
    import json

    from emgface.errors import DataError
    from emgface.files import refuse_existing, write_text
    from emgface.recordings.dataset import read_recording
    from emgface.recordings.labels import note
    from emgface.recordings.proposal import mapping_text, missing_names, propose_for

    refuse_existing(out_path)
    if path.is_dir():
        raise DataError(f"{path} is a folder, expected one recording: specify a file in it")
    given = dict(_unit(setting) for setting in units or [])
    recording = read_recording(path, mapping={"units": given})
    tables = propose_for(recording, side=None if side is None else side.value)
    for kind, table in tables.items():
        show_table(frame(table), f"{path.name}: {kind}s")
        if unresolved := int((table["certainty"] == "unresolved").sum()):
            say(f"Unresolved: {unresolved} of {len(table)} {kind}s; the table states the reasons.")
        lacking = missing_names(table, kind)
        if lacking:
            say(f"No label found for: {', '.join(lacking)}.")
    dropped = note(recording, "dropped")
    for reason in dict.fromkeys(dropped.values()):
        labels = ", ".join(repr(label) for label in dropped if dropped[label] == reason)
        say(f"Omitted on reading ({reason}): {labels}.")
    if out_path is None:
        say("No file was written: specify one with --out.")
        return
    text = mapping_text(tables.get("channel"), tables.get("marker"))
    if given:
        text += "\n".join(
            ["", "[units]", *(f'{json.dumps(n)} = "{unit}"' for n, unit in given.items()), ""]
        )
    write_text(out_path, text)
    say(
        f"Wrote {out_path}: check it, complete the unresolved entries, and specify it as --mapping."
    )


def _unit(setting: str) -> tuple[str, str]:
    """Name and unit of a setting such as ``emg=uV``."""
    from emgface.errors import UnitsError
    from emgface.schema.units import DIVISORS, spelling

    si = {"emg": "V", "position": "m"}
    name, _, unit = (part.strip() for part in setting.rpartition("="))
    if not name:
        raise UnitsError(
            f"the unit {setting!r} refers to neither emg, position nor a channel, expected for example "
            "emg=uV"
        )
    quantity = si.get(name, "V")  # other names are labels of channels
    if spelling(unit) not in DIVISORS[quantity]:
        known = ", ".join(DIVISORS[quantity])
        raise UnitsError(f"the unit of {name} is {unit!r}, expected one of {known}")
    return name, unit
