"""``emgface data``: examine recordings before they are used."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import BAD_INPUT, fail, frame, say, show_table

app = typer.Typer(no_args_is_help=True, help="Recordings: examine them before use.")

COLUMNS = ("name", "kind", "rate", "duration", "unit", "finite", "longest_gap", "rms", "verdict",
           "reason")  # fmt: skip


@app.command()
def check(
    paths: Annotated[list[Path], typer.Argument(help="Recordings, or folders of them.")],
    study: Annotated[
        bool, typer.Option(help="Demand the channels and markers of the study.")
    ] = False,
    mapping: Annotated[
        Path | None, typer.Option(help="TOML file that maps labels of the file to names.")
    ] = None,
) -> None:
    """Examine every channel and marker; fail if one cannot be used."""
    from emgface.check import check_recording, problems
    from emgface.dataset import read_recording, read_recordings
    from emgface.errors import EmgfaceError

    n_bad = n_all = 0
    for path in paths:
        given = (
            read_recordings(path, mapping=mapping)
            if path.is_dir()
            else [(path, read_recording(path, mapping=mapping))]
        )
        for file, recording in given:
            n_all += 1
            if isinstance(recording, EmgfaceError):
                fail(recording)
                n_bad += 1
                continue
            report = check_recording(recording, study=study)
            origin = recording.attrs.get("origin", "")
            show_table(frame(report[list(COLUMNS)]), f"{file.name} ({origin})")
            bad = problems(report)
            n_bad += bool(bad)
            for sentence in bad:
                say(f"{file.name}: {sentence}")
    say(f"{n_all - n_bad} of {n_all} recordings can be used.")
    if n_bad:
        raise typer.Exit(BAD_INPUT)
