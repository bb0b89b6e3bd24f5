"""Texts for display: characters without a shape become visible, and words from the right stay in place.

Names of volunteers, channels and files come from others. A control character in one of them would
reorder or hide the words after it in a page, or move the cursor of a terminal.
"""

import re
from typing import Final

_SHAPELESS: Final = re.compile(
    # Joiners shape the letters of some scripts, and are shapeless elsewhere.
    r"(?<![^\x00-\x7f])[\u200c\u200d]|[\u200c\u200d](?![^\x00-\x7f])"
    "|[\x00-\x08\x0b-\x0c\x0e-\x1f\x7f-\x9f\xad\u034f\u061c\u115f\u1160\u180b-\u180e\u200b\u200e\u200f"
    "\u2028-\u202e\u2060-\u206f\u3164\ufeff\uffa0\ufff9-\ufffb\ufffe\uffff\ud800-\udfff"
    "\U0001d173-\U0001d17a\U000e0000-\U000e0fff]"
    r"|\r(?!\n)"
)
"""Controls, marks of direction, letters of no width, unpaired surrogates."""
_RIGHT: Final = "\u0590-\u08ff\ufb1d-\ufdff\ufe70-\ufefc\U00010800-\U00010fff\U0001e800-\U0001efff"
_FROM_THE_RIGHT: Final = re.compile(rf"[{_RIGHT}](?:[^\w<>&\"\n]*[{_RIGHT}])*")
"""Words of scripts that are written from right to left."""
ISOLATE: Final = "\u2067"
END_OF_ISOLATE: Final = "\u2069"


def visible(text: str) -> str:
    r"""Write characters that have no shape of their own as their code; tabs and line ends remain.

    Examples
    --------
    >>> visible("P1\u202eedis\x1b[2J")
    'P1[U+202E]edis[U+001B][2J'
    """
    return _SHAPELESS.sub(lambda match: f"[U+{ord(match[0]):04X}]", text)


def isolated(text: str) -> str:
    """Text for a page: as `visible`, with words that are written from right to left isolated.

    Without the isolation, a number after a Hebrew name would be shown before it.
    """
    if text.isascii() and text.isprintable():
        return text
    return _FROM_THE_RIGHT.sub(rf"{ISOLATE}\g<0>{END_OF_ISOLATE}", visible(text))
