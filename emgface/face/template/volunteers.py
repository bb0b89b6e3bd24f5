"""Measures of groups of people, and of random members of a group."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from analysis.arguments import count
from emgface.errors import FaceError
from emgface.face.template.measures import MM, Measures
from emgface.face.template.norms import NORMS
from emgface.texts import module_toml

TRUNCATION: Final = 2.5  #: number of standard deviations beyond which a measure is drawn again
_ATTEMPTS: Final = 1000
ASYMMETRY: Final[Mapping[str, float]] = {"width_asymmetry": 0.02, "droop": 1.0 * MM}
"""Standard deviations of the differences between the sides, with zero mean; chosen [1], [m]."""

_GROUPS: Final = module_toml(__file__)
_OLDER: Final[Mapping[str, float]] = _GROUPS["older"]
_CHILD: Final = 0.86
_AT_EIGHT: Final[Mapping[str, list[float]]] = _GROUPS["at_eight"]
"""Boys, girls [mm]."""
GROUP_PRESETS: Final[Mapping[str, str]] = _GROUPS["presets"]
"""Groups of people, with the origin of their means, of ``volunteers.toml``."""


def preset_measures(preset: str = "adult") -> Measures:
    """Mean measures of a group of `GROUP_PRESETS`; FaceError if its name is unknown."""
    mean, _ = _distribution(preset)
    return Measures(**mean)


def random_measures(
    seed: int | Sequence[int],
    *,
    preset: str = "adult",
    spread: float = 1.0,
    asymmetry: float = 0.0,
) -> Measures:
    """Draw the measures of one person of a group; equal seeds result in the same person.

    Every measure is drawn independently from a normal distribution truncated at 2.5 standard
    deviations; correlations between measures are not published for this set and are omitted. A
    person whose measures contradict each other (`Measures`) is drawn again. `preset` is a name of
    `GROUP_PRESETS`; "adult" draws women and men with equal probability. `spread` is a factor on the
    standard deviations, and `asymmetry` one on those of `ASYMMETRY`; 0 does not change the other
    measures. Raises FaceError if the name is unknown, or a factor is negative or so large that no
    person is possible.
    """
    if not spread >= 0.0:
        raise FaceError(f"the spread of the volunteers is {spread}, expected a number >= 0")
    if not asymmetry >= 0.0:
        raise FaceError(f"the asymmetry of the volunteers is {asymmetry}, expected a number >= 0")
    if preset not in GROUP_PRESETS:
        _distribution(preset)
    for one in seed if isinstance(seed, tuple | list) else (seed,):
        count("the seed", one, least=0, error=FaceError)
    generator = np.random.default_rng(seed)
    why = ""
    for _ in range(_ATTEMPTS):
        group = preset
        if preset == "adult":
            group = ("woman", "man")[generator.integers(2)]
        mean, deviation = _distribution(group)
        values = {
            name: mean[name] + spread * deviation[name] * _truncated(generator) for name in mean
        }
        for name, one in ASYMMETRY.items():
            values[name] = asymmetry * one * _truncated(generator)
        try:
            return Measures(**values)
        except FaceError as error:
            why = str(error)
    raise FaceError(
        f"no possible person was drawn in {_ATTEMPTS} attempts with spread {spread:g} (the "
        f"last: {why}): expected a smaller spread"
    )


def _truncated(generator: np.random.Generator) -> float:
    while True:
        value = float(generator.standard_normal())
        if abs(value) <= TRUNCATION:
            return value


def _distribution(preset: str) -> tuple[dict[str, float], dict[str, float]]:
    """Means and standard deviations [m] of the measures of a group."""
    if preset not in GROUP_PRESETS:
        raise FaceError(f"unknown preset {preset!r}, expected one of {', '.join(GROUP_PRESETS)}")
    mean: dict[str, float] = {}
    deviation: dict[str, float] = {}
    for norm in NORMS:
        (man, man_sd), (woman, woman_sd) = norm.men, norm.women
        if preset == "adult":
            value, spread = 0.5 * (man + woman), 0.5 * (man_sd + woman_sd)
        elif preset in ("man", "older_man", "boy"):
            value, spread = man, man_sd
        else:
            value, spread = woman, woman_sd
        factor = 1.0
        if preset.startswith("older"):
            factor = _OLDER.get(norm.name, 1.0)
        elif preset in ("girl", "boy"):
            factor = _CHILD
        mean[norm.name] = value * factor * MM
        if preset in ("boy", "girl") and norm.name in _AT_EIGHT:
            mean[norm.name] = _AT_EIGHT[norm.name][preset == "girl"] * MM
        deviation[norm.name] = spread * factor * MM
    return mean, deviation
