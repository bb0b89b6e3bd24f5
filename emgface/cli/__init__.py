"""Command line of the package.

Modules are imported in the commands, so that ``--help`` is fast.
"""

import os
from itertools import zip_longest
from typing import Annotated, Any

import typer

from emgface.cli import (
    data,
    data_describe,
    data_files,
    fit,
    inverse,
    live,
    models,
    record,
    segment,
    simulate,
    sound,
    study,
    study_state,
    treat,
    trial,
    volunteers,
)
from emgface.cli.console import Commands, out, show_warnings_as_sentences
from emgface.cli.machine import collect_seldom, unwind_when_terminated, use_one_blas_thread
from emgface.cli.numbers import guard


class Listing(Commands):
    """Commands of the program, which ``--help`` lists on one screen of 24 lines."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Print two panels side by side, each command with a few words."""
        lines = [
            "Usage: emgface COMMAND [ARGUMENTS] [OPTIONS]   (emgface COMMAND --help)",
            f"{self.help}",
        ]
        panels = list(LISTED_COMMANDS.items())
        for left, right in zip(panels[::2], panels[1::2], strict=True):
            cells = [
                [name, *(f" {verb:<11}{few}" for verb, _, few in verbs)]
                for name, verbs in (left, right)
            ]
            lines += ["", *(f"{a:<40}{b}".rstrip() for a, b in zip_longest(*cells, fillvalue=""))]
        lines += ["", "Options: --version, --debug (tracebacks), --install-completion"]
        formatter.write("\n".join(lines) + "\n")


app = typer.Typer(
    cls=Listing,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="sEMG-driven finite-element face: from muscle activity to scored lip motion.",
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


LISTED_COMMANDS = {
    "Recordings": (
        ("check", data.check, "faults of recordings and models"),
        ("map", data.propose, "labels to muscles and markers"),
        ("describe", data_describe.describe, "sidecar of a table or array"),
        ("inventory", data_files.inventory, "all files of a folder"),
        ("features", data.features, "amplitude of every channel"),
        ("convert", data_files.convert, "to netCDF or BIDS"),
        ("cut", data_files.cut, "trials of a long recording"),
        ("activate", trial.activate, "sEMG to activations"),
    ),
    "Models": (
        ("build", models.build, "face, jaw, tongue or head"),
        ("import", models.import_, "published models"),
        ("segment", segment.segment, "parts in images"),
        ("fit", fit.fit, "a face to a person"),
        ("treat", treat.treat, "virtual treatment"),
        ("compare", treat.compare, "faces before and after"),
        ("dose", treat.dose, "outcomes by removed share"),
        ("reduce", models.reduce, "a fast face"),
        ("tabulate", models.tabulate, "tasks of jaw or tongue"),
        ("sweep", models.sweep, "many runs of a head"),
    ),
    "Motions": (
        ("simulate", simulate.simulate, "motion of a model"),
        ("show", simulate.show, "draw any file"),
        ("score", trial.score, "measured against simulated"),
        ("live", live.live, "a face in the browser"),
        ("invert", inverse.app, "activations from motion"),
        ("sound", sound.app, "formants and voice"),
    ),
    "Studies": (
        ("demo", study.demo, "two simulated volunteers"),
        ("volunteers", volunteers.volunteers, "simulate recordings"),
        ("record", record.record, "recording of a jaw's motion"),
        ("study", study.app, "run, status, reproduce ..."),
        ("report", study.report, "tables and page of a study"),
        ("schema", data_files.schema, "variables of all files"),
    ),
}
"""Commands by panel, with what `emgface --help` prints of them."""
for panel, verbs in LISTED_COMMANDS.items():
    for verb, function, _ in verbs:
        if isinstance(function, typer.Typer):
            app.add_typer(function, name=verb, rich_help_panel=panel)
        else:
            app.command(name=verb, rich_help_panel=panel)(function)
for state in (
    study_state.status,
    study_state.explain,
    study_state.gc,
    study_state.export,
    study_state.reproduce,
):
    study.app.command()(state)
guard(app)


def main() -> None:
    """Run the command line."""
    use_one_blas_thread()
    collect_seldom()
    unwind_when_terminated()
    app()
