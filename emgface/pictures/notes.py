"""Notes of the tables of a page, each sentence once: a later table refers to the earlier one."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

SENTENCES: Final = re.compile(r"(?<=[.!?]) (?=[A-Z])")


@dataclass(frozen=True)
class Note:
    """Note of one table.

    Attributes
    ----------
    own : str
        Its sentences that no earlier table of the page states.
    earlier : mapping of str to str
        Name and title of the earlier tables that state the others.
    """

    own: str
    earlier: Mapping[str, str]


class Notes:
    """Notes of the tables of one page, in the order of the page.

    Examples
    --------
    >>> noted = Notes()
    >>> noted({"title": "rho", "note": "Counts are trials. Means over markers."}, "one").own
    'Counts are trials. Means over markers.'
    >>> noted({"title": "rmse", "note": "Counts are trials. Means over trials."}, "two")
    Note(own='Means over trials.', earlier={'one': 'rho'})
    """

    def __init__(self) -> None:
        self._stated: dict[str, tuple[str, str]] = {}

    def __call__(self, table: Mapping[str, Any], name: str) -> Note:
        """Note of a table (`emgface.pictures.page.cells`) with the name of its anchor."""
        own, earlier = list[str](), dict[str, str]()
        for sentence in filter(None, SENTENCES.split(str(table["note"]))):
            where, title = self._stated.setdefault(sentence, (name, str(table["title"])))
            if where == name:
                own.append(sentence)
            else:
                earlier[where] = title
        return Note(" ".join(own), earlier)
