"""Gestures of the six instructions on a face: their activation levels."""

from collections.abc import Mapping
from typing import Final

from emgface.errors import DataError

_SMILE: Final = {"ZYG": 0.7, "RIS": 0.1, "LAO": 0.6, "LLSAN": 0.5}
GESTURES: Final[Mapping[str, tuple[str, Mapping[str, float], Mapping[str, float]]]] = {
    # Name; activation of the left and of the right muscles.
    "A": ("purse lips", {"OOP": 0.5, "OOM": 0.4, "BUC": 0.05}, {}),
    "B": ("raise upper lip", {"LLSAN": 0.5}, {}),
    "C": ("depress mouth corners", {"DAO": 0.5, "MEN": 0.2}, {}),
    "D": ("voluntary smile", {**_SMILE, "DLI": 0.15}, {}),
    "E": (
        "to the left with closed mouth",
        {"ZYG": 0.4, "RIS": 0.4, "BUC": 0.2, "OOP": 0.1, "OOM": 0.05},
        {"OOP": 0.2, "OOM": 0.05},
    ),
    "F": (
        "closed mouth smile",
        {**_SMILE, "LAO": 0.4, "LLSAN": 0.15, "OOP": 0.1, "OOM": 0.35, "BUC": 0.05},
        {},
    ),
}
"""One held gesture of every instruction, by muscles of Table 1 of Eskes et al. 2017. A level without
value for the right side is that of the left. The levels are chosen, those of the smiles so that the
corners of the medium face move in the direction measured by Tarantili et al. 2005 (Am J Orthod
Dentofacial Orthop 128:8-15)."""


def gesture_activation(instruction: str) -> dict[str, float]:
    """Activation [1] of every active muscle, such as ``ZYG_L``, of a gesture (A to F).

    Raises DataError if the instruction is unknown.
    """
    if instruction not in GESTURES:
        raise DataError(f"unknown instruction {instruction!r}, expected one of {[*GESTURES]}")
    _, left, right = GESTURES[instruction]
    return {f"{muscle}_L": level for muscle, level in left.items()} | {
        f"{muscle}_R": level for muscle, level in (right or left).items()
    }
