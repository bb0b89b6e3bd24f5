"""Trials excluded from a study, with reasons, which are stored in the cube."""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from pydantic import field_validator

from emgface.choices import Parameters, choice, configure, parameter
from emgface.errors import ConfigurationError
from emgface.files import existing_file
from emgface.muscles import INSTRUCTIONS, LETTERS
from emgface.texts import read_toml

Place = tuple[str, str, int]  #: volunteer, instruction, repetition


class Exclusion(Parameters):
    """Excluded trials, selected by volunteer, instruction, repetition, or all three."""

    volunteer: str | None = choice(
        None, "Volunteer whose trials are excluded; default: every volunteer."
    )
    instruction: str | None = choice(
        None, "Instruction that is excluded; default: every instruction."
    )
    repetition: int | None = parameter(
        None, "Repetition that is excluded; default: every repetition.", ge=1
    )
    reason: str = choice("", "Reason, as a sentence, which is stored in the cube. Required.")

    @field_validator("instruction")
    @classmethod
    def _known(cls, value: str | None) -> str | None:
        if value is not None and value not in INSTRUCTIONS:
            raise ValueError(f"instruction {value!r} is unknown, expected one of {LETTERS}")
        return value

    @property
    def label(self) -> str:
        """Description of the trials."""
        named = {"volunteer": self.volunteer, "instruction": self.instruction}
        named |= {"repetition": None if self.repetition is None else str(self.repetition)}
        return ", ".join(f"{name} {value}" for name, value in named.items() if value is not None)

    def covers(self, place: Place) -> bool:
        """Return True if a trial is among those excluded."""
        wanted = (self.volunteer, self.instruction, self.repetition)
        return all(want in (None, have) for want, have in zip(wanted, place, strict=True))


class _ExclusionFile(Parameters):
    exclude: tuple[Exclusion, ...] = ()


def check_exclusions(exclusions: Sequence[Exclusion], *, where: str) -> tuple[Exclusion, ...]:
    """Return the exclusions of a file, named `where` in messages.

    Raises ConfigurationError if one has no reason or would exclude every trial.
    """
    for number, exclusion in enumerate(exclusions, 1):
        what = exclusion.label or "every trial"
        if not exclusion.label:
            raise ConfigurationError(
                f"{where}: exclusion {number} specifies no volunteer, instruction or repetition, "
                "expected at least one: it would exclude every trial"
            )
        if not exclusion.reason.strip():
            raise ConfigurationError(
                f"{where}: the exclusion of {what} has no reason, expected a sentence, which "
                "is stored in the cube"
            )
    return tuple(exclusions)


def read_exclusions(path: Path) -> tuple[Exclusion, ...]:
    """Read a TOML file with one table ``[[exclude]]`` per exclusion.

    ``emgface check --exclude`` writes such a file. Raises ConfigurationError if the file is
    absent, is not TOML, or an entry is unknown or lacks its reason.
    """
    existing_file(path, "exclusions, as 'emgface check --exclude' writes", ConfigurationError)
    exclusions = configure(_ExclusionFile, read_toml(path), where=path.name).exclude
    return check_exclusions(exclusions, where=path.name)


def reason_to_exclude(place: Place, exclusions: Iterable[Exclusion]) -> str:
    """Return the reasons for the exclusion of a trial; empty if it is not excluded."""
    return "; ".join(dict.fromkeys(one.reason for one in exclusions if one.covers(place)))


def exclusions_text(exclusions: Iterable[Exclusion]) -> str:
    """Return exclusions as TOML, one table ``[[exclude]]`` each, for `read_exclusions`."""
    lines: list[str] = []
    for exclusion in exclusions:
        lines.append("[[exclude]]")
        for name, value in exclusion.model_dump(exclude_none=True).items():
            # A JSON string is a TOML basic string, except that TOML requires DEL to be escaped.
            text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
            lines.append(f"{name} = {text}")
        lines.append("")
    return "\n".join(lines)
