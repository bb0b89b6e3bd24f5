"""Output of commands: messages, progress bars, tables, and failures as one sentence."""

import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table
from typer.core import TyperGroup

from emgface.characters import visible

if TYPE_CHECKING:
    import pandas as pd

out = Console()  #: console for results
err = Console(stderr=True)
"""Console for messages, progress and failures, so that a pipe receives only results."""

LEAST_TEXT = 30  #: width in characters below which a column of text begins a new block
PARTIAL, BAD_INPUT, INTERRUPTED = 1, 2, 130
"""Exit codes: some trials failed, the command failed, interrupted by the user."""
STOPPED = "Interrupted. Completed results are stored; run the same command again to continue."


class Commands(TyperGroup):
    """Group of commands that report failures as one sentence and an exit code."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the command line; a former command is replaced by the present one."""
        from emgface.cli.aliases import translated

        start = next((k for k, word in enumerate(args) if not word.startswith("-")), len(args))
        words, replacement = translated(args[start:])
        if replacement:
            say(replacement)
        return super().parse_args(ctx, [*args[:start], *words])

    def invoke(self, ctx: Any) -> Any:
        """Run a command; failures of the package exit with code 2, an interruption with 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say(STOPPED)
            raise typer.Exit(INTERRUPTED) from None
        except BrokenPipeError:  # the reader, for example ``head``, has read enough
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            raise typer.Exit() from None
        except Exception as error:
            if (code := code_of_interruption(error)) is not None:
                say(STOPPED)
                raise typer.Exit(code) from None
            if debugging() or not is_expected(error):
                raise
            fail(error)
            raise typer.Exit(BAD_INPUT) from None


def code_of_interruption(error: BaseException) -> int | None:
    """Exit code of an interruption or signal during which an error was raised, None without one.

    A signal may end a library in any of its lines, whose clean-up then fails in turn.
    """
    context: BaseException | None = error.__context__
    while context is not None:
        if isinstance(context, KeyboardInterrupt):
            return INTERRUPTED
        if isinstance(context, SystemExit) and isinstance(context.code, int) and context.code > 128:
            return context.code
        context = context.__context__
    return None


def is_expected(error: Exception) -> bool:
    """Return True for errors of this package and of the file system, which need no traceback.

    A class of errors cannot have been raised if its module was never imported. Nothing is therefore
    imported here; ``--help``, which also ends in an exception, remains fast.
    """
    bases = (
        getattr(sys.modules.get(module), name, None)
        for module, name in (
            ("emgface.errors", "EmgfaceError"),
            ("sim.errors", "SimulationError"),
            ("analysis.errors", "AnalysisError"),
        )
    )
    return isinstance(error, (OSError, *(base for base in bases if base is not None)))


def debugging() -> bool:
    """Return True if tracebacks are requested (``--debug``, or EMGFACE_DEBUG set)."""
    return bool(os.environ.get("EMGFACE_DEBUG"))


def fail(error: Exception) -> None:
    """Print a failure as a sentence."""
    err.print(f"[bold red]{type(error).__name__}[/]: ", end="")
    say(str(error))


def say(text: str) -> None:
    """Print a message separately from the results."""
    err.print(visible(text), markup=False, highlight=False, soft_wrap=True)


def tell(text: str) -> None:
    """Print a result that is not a table."""
    # A pipe receives the text as it is, such as a sidecar.
    shown = visible(text) if out.is_terminal else text
    out.print(shown, markup=False, highlight=False, soft_wrap=True)


def warn(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning as a sentence (replaces `warnings.showwarning`)."""
    err.print("[yellow]Warning[/]: ", end="")
    say(str(message))


def show_warnings_as_sentences() -> None:
    """Print warnings in the form of other messages, each once."""
    warnings.showwarning = warn
    warnings.simplefilter("ignore", DeprecationWarning)
    warnings.simplefilter("ignore", FutureWarning)


@contextmanager
def progress(
    description: str, total: int | None = None, bar: "type[Bar] | None" = None
) -> Iterator["Bar"]:
    """Show a progress bar, or one of a derived class, with elapsed and remaining time."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True) as shown:
        yield (bar or Bar)(shown, shown.add_task(description, total=total))


@dataclass(frozen=True)
class Rows:
    """Heads and cells of a table."""

    heads: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


def frame(given: "pd.DataFrame") -> Rows:
    """Cells of a data frame; an index with a name becomes the first column."""
    if given.index.name:
        given = given.reset_index()

    def cell(value: object) -> str:
        if isinstance(value, float):
            return "" if value != value else f"{value:.6g}" if abs(value) >= 1 else f"{value:.3g}"
        return str(value)

    return Rows(
        tuple(map(str, given.columns)),
        tuple(tuple(cell(v) for v in row) for row in given.itertuples(index=False)),
    )


def show_table(rows: Rows, title: str) -> None:
    """Print a table without truncating cells.

    In a terminal that is too narrow, columns that do not fit follow in a further block that repeats
    the first column, and the text of the last column is wrapped.
    """
    cells = tuple(tuple(map(visible, row)) for row in rows.cells)
    rows = Rows(tuple(map(visible, rows.heads)), cells)
    every = list(range(len(rows.heads)))
    needed = [
        2 + max(map(len, (rows.heads[k], *(cells[k] for cells in rows.cells)))) for k in every
    ]
    folded = out.is_terminal and sum(needed) > out.width and bool(rows.cells)
    for number, columns in enumerate(_blocks(needed, out.width) if folded else [every]):
        head = escape(title) if number == 0 else None
        table = Table(title=head, title_justify="left", box=None, header_style="bold")
        for k in columns:
            justify = "right" if all(_is_number(cells[k]) for cells in rows.cells) else "left"
            whole = not (folded and k == every[-1])
            table.add_column(escape(rows.heads[k]), no_wrap=whole, overflow="fold", justify=justify)
        for cells in rows.cells:
            if len(columns) > 2 or len(rows.heads) <= 2 or cells[columns[-1]]:
                table.add_row(*(escape(cells[k]) for k in columns))
        if folded:
            out.print(table)
            continue
        wanted = out.measure(table, options=out.options.update(max_width=10_000)).maximum
        Console(width=max(wanted, out.width)).print(table)


def _blocks(needed: list[int], width: int) -> list[list[int]]:
    """Columns of a table in blocks that fit the terminal, each with the first column."""
    blocks, used = [[0]], needed[0]
    for k in range(1, len(needed)):
        wraps = k == len(needed) - 1 and width - used >= LEAST_TEXT
        if used + needed[k] > width and len(blocks[-1]) > 1 and not wraps:
            blocks.append([0])
            used = needed[0]
        blocks[-1].append(k)
        used += needed[k]
    return blocks


def _is_number(cell: str) -> bool:
    try:
        float(cell or "0")
    except ValueError:
        return False
    return True


class Bar:
    """Progress bar, also as `emgface.run.observer.Observer`."""

    def __init__(self, shown: Progress, task: Any) -> None:
        self._shown, self._task, self._failed = shown, task, 0

    def begin(self, total: int) -> None:
        """Set the total."""
        self._shown.update(self._task, total=total, completed=0)

    def working(self, label: str) -> None:
        """Set the description, with the number of failures so far."""
        failed = f" ({self._failed} failed)" if self._failed else ""
        self._shown.update(self._task, description=f"{label}{failed}")

    def finished(self, label: str, status: str) -> None:
        """Advance by one, and report a failed trial."""
        self._shown.advance(self._task)
        if status.startswith("failed"):
            self._failed += 1
            self.message(f"{label}: {status}")

    def show(self, done: int, total: int) -> None:
        """Set the completed amount."""
        self._shown.update(self._task, total=total, completed=done)

    def message(self, text: str) -> None:
        """Print a line above the bar."""
        self._shown.console.print(visible(text), markup=False, highlight=False, soft_wrap=True)
