"""``emgface study status``, ``explain``, ``gc``, ``export`` and ``reproduce``."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from emgface.cli.console import PARTIAL, Rows, say, show_table, tell
from emgface.cli.options import StudyPath

if TYPE_CHECKING:
    from emgface.study.configuration import StudyConfiguration

Folder = Annotated[Path, typer.Argument(help="Folder of a study ('emgface study run --out').")]
LISTED_BY_DEFAULT = 5  #: failures and running trials listed by default


def status(
    folder: Folder,
    every: Annotated[bool, typer.Option("--all", help="List all failures.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show the trials of a study by status, its failures, throughput and stored results."""
    from emgface.run.state import read_state

    state = read_state(folder)
    last, running = state.runs[-1], state.running
    done = sum(state.status.values())
    if as_json:
        summary = {
            "state": last.state,
            "trials": state.total,
            "status": dict(state.status),
            "earlier": state.earlier,
            "running": running,
            "trials_per_second": state.throughput,
            "remaining_s": state.remaining,
            "failures": state.failures,
            "stored": {
                stage: {"results": n, "bytes": size} for stage, (n, size) in state.sizes.items()
            },
            "damage": state.damage,
            "runs": [{"file": run.path.name, "state": run.state} for run in state.runs],
        }
        tell(json.dumps(summary, indent=2))
        return
    counts = ", ".join(f"{n} {name}" for name, n in state.status.most_common())
    tell(f"{last.first['study']}: {done} of {state.total} trials have an outcome ({counts}).")
    if state.earlier:
        tell(
            f"{state.earlier} of these outcomes are of earlier runs with another configuration or "
            "version of emgface and may not be those of the present study: 'emgface study explain' "
            "states which trials would be computed again."
        )
    tell(
        f"Last run of {len(state.runs)}, begun {last.first['time']} with "
        f"{last.first['workers']} workers: {last.state}, {sum(last.finished.values())} trials in "
        f"{duration(last.last_at)} ({state.throughput:.3g} per second)."
    )
    if last.state == "running" and state.remaining is not None:
        tell(f"About {duration(state.remaining)} remain.")
    if running:
        more = (
            f" and {len(running) - LISTED_BY_DEFAULT} more"
            if len(running) > LISTED_BY_DEFAULT
            else ""
        )
        tell(f"Running: {', '.join(running[:LISTED_BY_DEFAULT])}{more}.")
    for label, reason in state.failures[: None if every else LISTED_BY_DEFAULT]:
        tell(f"Failed: {label}: {reason}")
    if len(state.failures) > LISTED_BY_DEFAULT and not every:
        say(f"{len(state.failures) - LISTED_BY_DEFAULT} more failures are listed with --all.")
    show_table(
        Rows(
            ("stage", "results", "MB", "kB each"),
            tuple(
                (stage, str(n), f"{size / 1e6:.1f}", f"{size / 1e3 / n:.1f}")
                for stage, (n, size) in sorted(state.sizes.items())
            ),
        ),
        "Stored results of the trials",
    )


def explain(
    folder: Folder,
    trial: Annotated[
        list[str],
        typer.Argument(help="Trial, such as 'S01 A 1 act_rel', or its first parts; default: all."),
    ] = [],  # noqa: B006
    study: StudyPath = None,
) -> None:
    """Explain why trials would be computed again by the next run, or would not."""
    from emgface.study.audit import explain

    for sentence in explain(_study(folder, study), folder, _store(folder), _words(trial)):
        tell(sentence)


def gc(
    folders: Annotated[
        list[Path], typer.Argument(help="Folders of all studies that share the store.")
    ],
    delete: Annotated[bool, typer.Option("--delete", help="Delete the files.")] = False,
    forget: Annotated[
        list[Path],
        typer.Option(
            help="Folder of a study that no longer exists, and whose results may go; repeatable."
        ),
    ] = [],  # noqa: B006
) -> None:
    """List stored results that no study uses, and delete them with --delete."""
    from emgface.run.retention import unused_files

    unused = unused_files(folders, forget=forget)
    for path in unused.files:
        tell(str(path))
    for path in unused.files if delete else []:
        path.unlink(missing_ok=True)
    verb = "deleted" if delete else "unused; --delete removes them"
    tell(f"{len(unused.files)} files, {unused.size / 1e6:.1f} MB, {verb}.")


def export(
    folder: Folder,
    out_folder: Annotated[Path, typer.Option("--out", help="New folder.")],
    without: Annotated[
        list[str], typer.Option(help="Stage to leave out, such as skin; may be repeated.")
    ] = [],  # noqa: B006
) -> None:
    """Copy a study with the results that it uses, to archive it or to continue it elsewhere."""
    from emgface.run.retention import export

    count, size = export(folder, out_folder, without=without)
    tell(f"{count} results, {size / 1e6:.1f} MB, and the journal were copied to {out_folder}.")


def reproduce(
    folder: Folder,
    trial: Annotated[
        list[str],
        typer.Argument(
            help="Trial, such as 'S01 A 1 act_rel', or its first parts; default: drawn at random."
        ),
    ] = [],  # noqa: B006
    study: StudyPath = None,
    count: Annotated[int, typer.Option(min=1, help="Number of trials to draw.")] = 3,
    every: Annotated[bool, typer.Option("--all", help="Compute all trials again.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the draw.")] = 0,
) -> None:
    """Compute trials again and compare every result with the stored one, bit for bit."""
    from emgface.study.audit import reproduce

    configuration, words = _study(folder, study), _words(trial)
    compared = reproduce(
        configuration,
        folder,
        _store(folder),
        count=None if every else count,
        seed=seed,
        wanted=words,
        report=say,
    )
    for one in compared:
        tell(f"{one.label}: {one.equal} results are equal bit for bit.")
        for sentence in one.differences:
            tell(f"{one.label}: DIFFERENT, {sentence}.")
    different = sum(bool(one.differences) for one in compared)
    tell(f"{len(compared) - different} of {len(compared)} trials were reproduced.")
    if different:
        raise typer.Exit(PARTIAL)


def _study(folder: Path, path: Path | None) -> "StudyConfiguration":
    """Study of a file, or else of the cube in its folder, which may have been moved."""
    from emgface.report.results import study_cube
    from emgface.study.configuration import StudyConfiguration
    from emgface.study.file import load_study, placed

    if path is not None:
        return load_study(path)
    text = study_cube(folder).attrs["configuration"]
    study, notes = placed(StudyConfiguration.model_validate_json(str(text)), folder)
    for note in notes:
        say(note)
    return study


def _store(folder: Path) -> Path:
    """Store of the last run of a study."""
    from emgface.run.state import read_state

    return read_state(folder).store(folder)


def _words(parts: list[str]) -> list[str]:
    """Parts of the label of a trial, given together or apart."""
    return [word for part in parts for word in part.split()]


def duration(seconds: float) -> str:
    """Readable duration."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
