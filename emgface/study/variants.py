"""The studies that the axes of a study make."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.face.accuracy import SET_BY_ACCURACY
from emgface.study.axes import CUBE_NAMES, Label, Value
from emgface.study.configuration import StudyConfiguration

VARIED = ("signals", "simulation", "alignment", "score", "face")
"""Tables of a study file whose parameters may be varied."""


@dataclass(frozen=True)
class Variant:
    """One combination of levels and the study it makes."""

    labels: tuple[Label, ...]
    study: StudyConfiguration

    @property
    def label(self) -> str:
        """Words for a reader."""
        return ", ".join(map(str, self.labels))


def check_axes(study: StudyConfiguration, *, where: str) -> None:
    """Refuse axes that cannot be varied.

    Parameters
    ----------
    study : StudyConfiguration
        As read.
    where : str
        File, for messages.

    Raises
    ------
    ConfigurationError
        An axis without parameters or with fewer than two levels, a parameter that is unknown or
        may not be varied, a level of the wrong length, a name that is taken, or a value that the
        parameter does not take.
    """
    taken: set[str] = set(CUBE_NAMES)
    for number, axis in enumerate(study.axis, 1):
        place = f"{where}: axis {number}"
        if not axis.parameters or len(axis.levels) < 2:
            raise ConfigurationError(
                f"{place} has {len(axis.parameters)} parameters and {len(axis.levels)} levels, "
                "expected at least one parameter and two levels"
            )
        for name in axis.parameters:
            if name.partition(".")[0] not in VARIED:
                raise ConfigurationError(
                    f"{place} varies {name!r}, expected a parameter of {', '.join(VARIED)} with "
                    "its table, such as 'simulation.sigma_max'"
                )
        for values in axis.values():
            if len(values) != len(axis.parameters):
                raise ConfigurationError(
                    f"{place} has a level of {len(values)} values, expected one for each of its "
                    f"{len(axis.parameters)} parameters"
                )
        if not axis.dim.isidentifier() or axis.dim in taken:
            raise ConfigurationError(
                f"{place} is called {axis.dim!r}, expected a word that names nothing else in the "
                f"cube ({', '.join(sorted(taken))}): set its name"
            )
        taken.add(axis.dim)
        if len(set(axis.labels())) < len(axis.labels()):
            raise ConfigurationError(
                f"{place} ({axis.dim}) has a level twice: {', '.join(map(str, axis.labels()))}"
            )
    variants(study, where=where)


def variants(study: StudyConfiguration, *, where: str = "") -> list[Variant]:
    """Make the study of every combination of levels that the design asks for.

    Parameters
    ----------
    study : StudyConfiguration
        With its axes.
    where : str
        File, for messages.

    Returns
    -------
    list of Variant
        The reference first; a study without axes is its own only variant.

    Raises
    ------
    ConfigurationError
        A parameter does not exist or does not take a value.
    """
    counts = [range(len(axis.levels)) for axis in study.axis]
    if study.axis_design == "factorial":
        chosen = list(product(*counts))
    else:
        origin = (0,) * len(counts)
        chosen = [origin]
        for position, levels in enumerate(counts):
            chosen += [
                (*origin[:position], level, *origin[position + 1 :]) for level in levels if level
            ]
    return [_variant(study, index, where) for index in chosen]


def _variant(study: StudyConfiguration, index: tuple[int, ...], where: str) -> Variant:
    if not study.axis:
        return Variant((), study)
    values = study.model_dump(mode="python", exclude={"axis", "axis_design"})
    labels: list[Label] = []
    for axis, level in zip(study.axis, index, strict=True):
        labels.append(axis.labels()[level])
        for name, value in zip(axis.parameters, axis.values()[level], strict=True):
            _set(values, name.split("."), value)
            if name == "simulation.accuracy":
                # It sets these where they are not given; here they are merely its own result.
                for follows in SET_BY_ACCURACY:
                    values["simulation"].pop(follows)
    place = f"{where}: " if where else ""
    words = ", ".join(
        f"{axis.dim} = {label}" for axis, label in zip(study.axis, labels, strict=True)
    )
    made = configure(type(study), _plain(values), where=f"{place}{words}")
    return Variant(tuple(labels), made)


def _set(values: dict[str, Any], path: list[str], value: Value) -> None:
    for part in path[:-1]:
        # A table that may be absent, such as face.template, begins empty.
        values[part] = dict(values.get(part) or {})
        values = values[part]
    values[path[-1]] = value


def _plain(values: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _plain(v) if isinstance(v, Mapping) else v for k, v in values.items()}
