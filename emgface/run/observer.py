"""Observers of the progress of a long run."""

from typing import Protocol


class Observer(Protocol):
    """Interface of observers of the progress of a run."""

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
        """Do nothing."""

    def working(self, label: str) -> None:
        """Do nothing."""

    def finished(self, label: str, status: str) -> None:
        """Do nothing."""

    def message(self, text: str) -> None:
        """Do nothing."""
