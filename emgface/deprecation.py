"""Former names, which still work with a warning until the version that removes them."""

import warnings
from dataclasses import dataclass
from typing import Final

FORMER: Final[list["Former"]] = []
"""All former names; a test fails when the version of their removal is reached."""


@dataclass(frozen=True)
class Former:
    """Former name: what replaces it, since which version, and the version that removes it."""

    old: str
    new: str
    since: str
    removal: str

    def __post_init__(self) -> None:  # noqa: D105
        FORMER.append(self)

    @property
    def text(self) -> str:
        """Sentence for the reader."""
        return (
            f"{self.old} is called {self.new} since version {self.since} and is removed in version "
            f"{self.removal}: write {self.new}"
        )

    def warn(self, stacklevel: int) -> None:
        """Warn at a line of the user, `stacklevel` calls above the caller."""
        warnings.warn(self.text, DeprecationWarning, stacklevel=stacklevel + 1)
