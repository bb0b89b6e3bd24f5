"""Observers of the progress of a long run."""

from typing import Protocol


class Observer(Protocol):
    """Interface of observers of a run."""

    def begin(self, total: int) -> None:
        """Receive the number of trials."""
        ...

    def working(self, label: str) -> None:
        """Receive the label of the trial being computed."""
        ...

    def finished(self, label: str, status: str) -> None:
        """Receive the status of a trial."""
        ...

    def message(self, text: str) -> None:
        """Receive a message."""
        ...


class Silent:
    """Observer that does nothing."""

    def begin(self, total: int) -> None:
        """Ignore."""

    def working(self, label: str) -> None:
        """Ignore."""

    def finished(self, label: str, status: str) -> None:
        """Ignore."""

    def message(self, text: str) -> None:
        """Ignore."""
