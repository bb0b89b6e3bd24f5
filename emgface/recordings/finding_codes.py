"""Codes of the findings about a recording, each with its severity and its clause.

Values in a clause are in SI units or without a unit; a clause states what was found and, after a
colon, what to do. A new kind of finding requires an entry in ``finding_codes.toml``.
"""

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

from emgface.texts import module_toml

Verdict = Literal["ok", "warning", "error", "not EMG"]


class Meaning(NamedTuple):
    """Severity of a code, and the clause in which the values are inserted."""

    verdict: Verdict
    clause: str


CODES: Final[Mapping[str, Meaning]] = {
    code: Meaning(**entry) for code, entry in module_toml(__file__).items()
}
"""Meaning of every code."""
