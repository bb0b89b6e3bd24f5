"""Choices varied by a study; each is an axis of its cube."""

from pathlib import PurePosixPath
from typing import Literal

from analysis.baselines import VARIABLES
from analysis.cube import MARKER_DIMS, OF_INCISOR, PER_MARKER, PER_TRIAL
from analysis.formants import VARIABLES as OF_SOUND
from emgface.choices import Parameters, choice

Design = Literal["one_at_a_time", "factorial"]
Value = bool | int | float | str
Label = str | float

CUBE_NAMES = {
    *MARKER_DIMS, *PER_MARKER, *PER_TRIAL, *OF_INCISOR, *VARIABLES, *OF_SOUND, "formant", "instant",
    "status", "reason", "marker_reason", "skill_reason",
}  # fmt: skip
"""Names used in a cube."""


class Axis(Parameters):
    """Varied choice. Its levels are a dimension of the cube, the first is the reference."""

    parameters: tuple[str, ...] = choice(
        (),
        "Parameters to vary, with their tables, such as 'signals.mapping.mapping_stage'; "
        "several are varied together.",
    )
    levels: tuple[Value | tuple[Value, ...], ...] = choice(
        (),
        "Values, the reference first; for several parameters, lists of one value for each.",
        note="in the unit of the parameter; with several parameters, the values of the first "
        "label the dimension",
    )
    name: str | None = choice(
        None,
        "Name of the dimension; default: the last part of the first parameter, with its "
        "table if the cube already has that name.",
    )

    @property
    def dim(self) -> str:
        """Name of the dim."""
        if self.name is not None:
            return self.name
        table, _, last = self.parameters[0].rpartition(".")
        # The cube has a variable sigma_max, the value with which a trial was simulated.
        return f"{table.rpartition('.')[2]}_{last}" if last in CUBE_NAMES else last

    def values(self) -> list[tuple[Value, ...]]:
        """Return one value per parameter, for each level."""
        return [level if isinstance(level, tuple) else (level,) for level in self.levels]

    def labels(self) -> list[Label]:
        """Return the labels along the dim: numbers, text, or file names without suffix."""
        found: list[Label] = []
        for first, *_ in self.values():
            if isinstance(first, bool):
                found.append(str(first).lower())
            elif isinstance(first, int | float):
                found.append(float(first))
            elif self.parameters[0] == "face.path":
                found.append(_file_label(first))
            else:
                found.append(first)
        return found


def _file_label(name: str) -> str:
    """Name of a file without suffix; of one file per volunteer, what precedes the volunteer."""
    path = PurePosixPath(name.replace("\\", "/"))
    own = path.stem.replace("{volunteer}", "").strip("_-. ")
    return own or path.parent.name.replace("{volunteer}", "").strip("_-. ") or path.stem
