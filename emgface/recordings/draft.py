"""Draft of a sidecar: its entries, and those that are guesses."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Draft:
    """Lines of a sidecar, and the entries that are guesses."""

    lines: list[str] = field(default_factory=list)
    guesses: list[str] = field(default_factory=list)

    def put(
        self, key: str, value: Any, why: str = "", *, table: str = "", sure: bool = True
    ) -> None:
        """Write an entry; a guess is marked and listed."""
        mark = "" if sure else "UNCONFIRMED "
        note = f"  # {mark}{why}" if why or mark else ""
        self.lines.append(f"{key} = {toml_value(value)}{note}".rstrip())
        if not sure:
            self.guesses.append(f"{table}.{key}" if table else key)

    def text(self, file: str, confirmed: bool) -> str:
        """Return the sidecar, without the list of guesses if `confirmed`."""
        head = [f"# Sidecar of {file}, drafted by 'emgface describe'.", 'schema = "recording"']
        if self.guesses and not confirmed:
            head += [
                "# The entries listed here are guesses. Check and correct each, then delete this line;",
                "# until then the recording is refused.",
                f"unconfirmed = {toml_value(self.guesses)}",
            ]
        head += ['# volunteer = "V01"', '# instruction = "A"', "# repetition = 1", ""]
        return "\n".join([*head, *self.lines, ""])


def toml_value(value: Any) -> str:
    """Return a value in TOML."""
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml_value, value))}]"
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{toml_value(k)} = {toml_value(v)}' for k, v in value.items())} }}"
    return json.dumps(value, ensure_ascii=False)
