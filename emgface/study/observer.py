"""Who is told how a long run is getting on; the command line shows it, a test may record it."""

from typing import Protocol


class Observer(Protocol):
    """Is told of the progress of a run."""

    def begin(self, total: int) -> None:
        """Learn how many trials there are."""
        ...

    def working(self, label: str) -> None:
        """Learn which trial is being computed."""
        ...

    def finished(self, label: str, status: str) -> None:
        """Learn how a trial ended."""
        ...

    def message(self, text: str) -> None:
        """Receive one sentence for the reader."""
        ...


class Silent:
    """Tells no one."""

    def begin(self, total: int) -> None:
        """Ignore."""

    def working(self, label: str) -> None:
        """Ignore."""

    def finished(self, label: str, status: str) -> None:
        """Ignore."""

    def message(self, text: str) -> None:
        """Ignore."""
