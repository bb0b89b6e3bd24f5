"""``emgface describe``: draft of a sidecar for a table or array."""

from pathlib import Path
from typing import Annotated

import typer

from emgface.cli.console import say


def describe(
    path: Annotated[
        Path, typer.Argument(help="Text table (.csv, .txt, .gz), MATLAB (.mat) or HDF5 (.h5) file.")
    ],
    out_path: Annotated[
        Path | None,
        typer.Option("--out", help="Sidecar to write (TOML); by default it is printed."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option(min=0.001, help="Sampling rate [Hz], if known.")
    ] = None,
    unit: Annotated[
        str | None, typer.Option(help="Unit of the EMG, if known: V, mV or uV.")
    ] = None,
    columns: Annotated[
        str | None, typer.Option(help="Labels of the columns, separated by commas.")
    ] = None,
    variable: Annotated[
        str | None, typer.Option(help="Array of a MATLAB or HDF5 file, if known.")
    ] = None,
    confirm: Annotated[bool, typer.Option("--confirm", help="Accept all guesses.")] = False,
) -> None:
    """Draft the sidecar of a table or array from its contents, for your confirmation.

    Guesses are marked and listed under 'unconfirmed'; the sidecar is refused until that list is
    deleted.
    """
    import tomllib

    from emgface.files import refuse_existing, write_text
    from emgface.recordings.describe import describe as draft

    refuse_existing(out_path)
    text = draft(
        path,
        sidecar_folder=None if out_path is None else out_path.parent,
        rate=rate,
        unit=unit,
        columns=None if columns is None else [label.strip() for label in columns.split(",")],
        variable=variable,
        confirmed=confirm,
    )
    if out_path is None:
        typer.echo(text, nl=False)
        return
    write_text(out_path, text)
    guesses = tomllib.loads(text).get("unconfirmed", [])
    if guesses:
        say(f"Unconfirmed: {', '.join(guesses)}. Check them and delete the line 'unconfirmed'.")
    say(f"Wrote {out_path}.")
