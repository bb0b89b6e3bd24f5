"""Command line of the package.

Modules are imported in the commands, so that ``--help`` is fast.
"""

import os
from typing import Annotated

import typer

from emgface.cli import (
    data,
    data_describe,
    data_files,
    face,
    fit,
    head,
    inverse,
    jaw,
    jaw_recorded,
    live,
    simulate,
    sound,
    study,
    study_state,
    tongue,
    treat,
    trial,
    volunteers,
)
from emgface.cli.console import Commands, out, show_warnings_as_sentences
from emgface.cli.machine import collect_seldom, use_one_blas_thread
from emgface.cli.numbers import guard

app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="sEMG-driven finite-element face: from recordings of muscle activity to scored lip "
    "motion.",
)


def _version(wanted: bool) -> None:
    if wanted:
        from emgface import __version__

        out.print(f"emgface {__version__}", highlight=False)
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks of failures.")] = False,
) -> None:
    """Process the options common to all commands."""
    if debug:
        os.environ["EMGFACE_DEBUG"] = "1"
    show_warnings_as_sentences()


app.command()(study.demo)
for state in (
    study_state.status,
    study_state.explain,
    study_state.gc,
    study_state.export,
    study_state.reproduce,
):
    study.app.command()(state)
app.add_typer(study.app, name="study")
app.add_typer(face.app, name="face")
app.add_typer(head.app, name="head")
app.add_typer(inverse.app, name="inverse")
for verb in (jaw_recorded.record, jaw_recorded.activate, jaw_recorded.score):
    jaw.app.command()(verb)
app.add_typer(jaw.app, name="jaw")
app.add_typer(data.app, name="data")
app.add_typer(tongue.app, name="tongue")
app.add_typer(sound.app, name="sound")
for verb in (
    data_describe.describe,
    data_files.inventory,
    data_files.convert,
    data_files.cut,
    data_files.schema,
):
    data.app.command()(verb)
app.command()(fit.fit)
app.command()(trial.activate)
app.command()(simulate.simulate)
app.command()(simulate.show)
app.command()(live.live)
app.command()(treat.treat)
app.command()(treat.compare)
app.command()(treat.dose)
app.command()(trial.score)
app.command(name="volunteers")(volunteers.volunteers)
app.command()(study.report)
guard(app)


def main() -> None:
    """Run the command line."""
    use_one_blas_thread()
    collect_seldom()
    app()
