"""Progress line for long computations, in a terminal and in a notebook."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

Show = Callable[[int, int], None]

PATIENCE: Final = 5.0  #: time after which the progress is shown by default [s]
UPDATE_PERIOD: Final = 0.5  #: time between two updates of the line [s]


@contextmanager
def shown(progress: Show | bool | None, what: str) -> Iterator["Line"]:
    """Show the progress of a computation (`what`) until it ends.

    `progress` True or False switches the line on or off; None shows it after `PATIENCE`; a callable
    receives the completed and the total number.
    """
    line = Line(progress, what)
    try:
        yield line
    finally:
        line.close()


class Line:
    """One line on the error stream, rewritten in place (`emgface.run.observer.Observer`)."""

    def __init__(self, progress: Show | bool | None, what: str) -> None:
        self._callback = progress if callable(progress) else None
        self._wanted = progress is not False and self._callback is None
        start = time.monotonic()
        self._due = start if progress is True else start + PATIENCE
        self._what, self._label, self._done, self._total, self._width = what, "", 0, 0, 0

    def show(self, done: int, total: int) -> None:
        """Set the completed amount."""
        self._done, self._total = done, total
        if self._callback:
            self._callback(done, total)
        self._update()

    def begin(self, total: int) -> None:
        """Set the total."""
        self._total = total

    def working(self, label: str) -> None:
        """Set the description."""
        self._label = label
        self._update()

    def finished(self, label: str, status: str) -> None:
        """Advance by one, and report a failure."""
        self.show(self._done + 1, self._total)
        if status.startswith("failed"):
            self.message(f"{label}: {status}")

    def message(self, text: str) -> None:
        """Print a sentence above the line."""
        self.close()
        print(text, file=sys.stderr, flush=True)

    def close(self) -> None:
        """Remove the line."""
        if self._width:
            print("\r" + " " * self._width + "\r", end="", file=sys.stderr, flush=True)
            self._width = 0

    def _update(self) -> None:
        now = time.monotonic()
        if not self._wanted or now < self._due:
            return
        self._due = now + UPDATE_PERIOD
        text = f"{self._what}: {self._done} of {self._total} {self._label}".rstrip()
        self._width = max(self._width, len(text))
        print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
