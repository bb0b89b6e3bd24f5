"""Runs of a sweep of heads, and their table."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from emgface.anatomy.head.model import PARTS
from emgface.errors import HeadError
from emgface.schema.rules import one_line
from emgface.texts import labelled, open_text


@dataclass(frozen=True)
class PlannedRun:
    """One row of a sweep."""

    name: str
    #: level of exciters, raised linearly and held [1]
    drive: Mapping[str, float]
    #: parameters of the face and of the tongue that differ from the defaults, nested ones with dots
    face: Mapping[str, Any] = field(default_factory=dict)
    tongue: Mapping[str, Any] = field(default_factory=dict)
    #: parts of orbicularis oris in words (`emgface.face.template.muscles.parse_ring`)
    rings: Mapping[str, str] = field(default_factory=dict)
    #: contact pairs; None for all of the parts
    contacts: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Setting:
    """Person, mesh and duration that the runs of a sweep share."""

    parts: tuple[str, ...] = PARTS
    preset: str = "adult"
    seed: int | None = None
    resolution: str | int = "coarse"
    #: resolution of a second mesh, from which the mesh error is estimated; None omits it
    finer: str | int | None = None
    duration: float = 0.4  #: simulated time [s]
    rise: float = 0.15  #: time within which the levels are reached [s]
    step: float = 1e-2  #: larger of the two time steps, of which the other is a half [s]
    gravity: bool = True


def labels(run: PlannedRun) -> dict[str, Any]:
    """Columns that describe a run, as those of a plan."""
    contacts = {} if run.contacts is None else {"contact": " ".join(run.contacts) or "none"}
    return {
        "name": run.name,
        **run.drive,
        **{f"face.{name}": value for name, value in run.face.items()},
        **{f"tongue.{name}": value for name, value in run.tongue.items()},
        **{f"ring.{name}": words for name, words in run.rings.items()},
        **contacts,
    }


def read_sweep_plan(path: str | Path) -> tuple[PlannedRun, ...]:
    """Runs of a CSV table, one per row.

    Columns are exciters with their levels, ``name``, ``contact`` (pairs with spaces between, or
    none), ``ring.OOP`` and ``ring.OOM`` (words), and ``face.`` or ``tongue.`` with the name of a
    parameter. Empty cells keep the default. Raises HeadError if the file cannot be read, has no
    rows, or a level is not between 0 and 1.
    """
    try:
        table = pd.read_csv(labelled(open_text(Path(path))), comment="#", skipinitialspace=True)
    except (OSError, ValueError) as error:
        raise HeadError(
            f"{path} is not a plan ({one_line(error)}): expected a table with columns such as bi_OOP, "
            "face.stiffening, ring.OOP and contact"
        ) from error
    if table.empty:
        raise HeadError(f"{path} has no rows, expected one per run")
    return tuple(_run(row, k) for k, row in enumerate(table.to_dict("records"), start=1))


def _run(row: Mapping[Any, Any], number: int) -> PlannedRun:
    kinds: dict[str, dict[str, Any]] = {"face": {}, "tongue": {}, "ring": {}, "": {}}
    name, contacts = f"run {number}", None
    for column, value in row.items():
        kind, dot, rest = str(column).partition(".")
        if pd.isna(value):
            continue
        if column == "name":
            name = str(value)
        elif column == "contact":
            contacts = () if value == "none" else tuple(str(value).split())
        elif dot and kind in kinds:
            kinds[kind][rest] = value
        else:
            kinds[""][str(column)] = value
    for exciter, level in kinds[""].items():
        if not isinstance(level, (int, float)) or not 0.0 <= level <= 1.0:
            raise HeadError(f"row {number}: {exciter} = {level}, expected a level from 0 to 1")
    return PlannedRun(name, kinds[""], kinds["face"], kinds["tongue"], kinds["ring"], contacts)


def nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables from names with dots."""
    tables: dict[str, Any] = {}
    for name, value in values.items():
        place = tables
        *outer, last = name.split(".")
        for part in outer:
            place = place.setdefault(part, {})
        place[last] = value
    return tables
