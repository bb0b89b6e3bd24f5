"""Sweep of a head: outcomes in mm and mm2 of a table of runs, with the errors of step and mesh."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

import sim
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import PARTS, Head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.choices import configure
from emgface.errors import HeadError
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.muscles import parse_ring
from emgface.files import write_text
from emgface.schema.rules import one_line

STEP_ERROR, MESH_ERROR = "_step_error", "_mesh_error"
"""Endings of the columns with the numerical errors of an outcome."""
_POINTS: Final = ("lower_incisor", "hyoid", "tip", "back")
_TWO_SIDED: Final = ("corner_left", "corner_right")


@dataclass(frozen=True)
class Run:
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


Measure = Callable[[xr.Dataset, Head], Mapping[str, float]]


def sweep(
    runs: Sequence[Run],
    setting: Setting | None = None,
    *,
    table: Path | None = None,
    head: Head | None = None,
    measure: Measure | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Simulate all runs and tabulate their outcomes with errors.

    Parameters
    ----------
    runs : sequence of Run
    setting : Setting, optional
    table : Path, optional
        CSV file that is written after every run. Its rows that belong to the same runs and setting are
        not computed again, so that an interrupted sweep continues.
    head : Head, optional
        Of all runs, such as an imported one; parts, person and resolution of the setting are then not
        used, and there is no mesh error.
    measure : callable, optional
        Outcomes of a motion, by default `outcomes`.
    progress : callable, optional
        Receives the number of completed runs and of all.

    Returns
    -------
    pandas.DataFrame
        One row per run: name, levels, parameters, every outcome y at the end with the smaller step h/2,
        |y(h/2) - y(h)| in the column ``_step_error`` (the error of y(h/2) for a method of first order)
        and |y_finer(h) - y(h)| in ``_mesh_error``, and ``end`` "reached" or the reason of a failure.

    Raises
    ------
    HeadError
        An exciter or contact is unknown, or a given head shall have other rings.
    FaceError, ConfigurationError
        A ring or parameter is invalid.
    """
    shared = setting or Setting()
    who = "" if head is None else head.lists.attrs["name"]
    stored = _stored(table)
    rows = list[dict[str, Any]]()
    heads = _Heads(shared, head)
    for k, run in enumerate(runs):
        key = hashlib.sha256(repr((run, shared, who)).encode()).hexdigest()[:12]
        known = stored.get(key)
        if known is None:
            known = {**_labels(run), **_row(run, heads, measure or outcomes), "key": key}
        rows.append(known)
        if table is not None:
            write_text(table, pd.DataFrame(rows).to_csv(index=False))
        if progress is not None:
            progress(k + 1, len(runs))
    return pd.DataFrame(rows)


def outcomes(motion: xr.Dataset, head: Head) -> dict[str, float]:
    """Outcomes at the end of a motion, as displacements from its start unless they are absolute.

    Of a face: `opening_mm` between the margins in the midline (negative if they have passed each
    other), `area_mm2` through which one sees from the front, and `width_mm` between the ends of the
    margins, all absolute; `protrusion_mm` of the margins; `corner_in_mm`, `corner_forward_mm` and
    `corner_up_mm`, the means of both corners; `upper_up_mm` and `lower_up_mm` of the margins. Of jaw,
    hyoid and tongue: lower incisor, hyoid, tip and back of the tongue forward and up. `smallest_J` is
    the smallest det F of the motion, and `speed_mm_s` the largest speed of a named point at the end.
    """
    x = motion["position"].transpose("time", "marker", "axis")
    d = 1e3 * (x - x.isel(time=0))
    last = d.isel(time=-1)
    found = dict[str, float]()
    if "face" in head.parts:
        found |= _of_mouth(motion, head.parts["face"])
        left, right = (last.sel(marker=name).values for name in _TWO_SIDED)
        found["corner_in_mm"] = float(0.5 * (left[0] - right[0]))
        found["corner_forward_mm"] = float(0.5 * (left[1] + right[1]))
        found["corner_up_mm"] = float(0.5 * (left[2] + right[2]))
    for name in _POINTS:
        if name in x["marker"].values:
            found[f"{name}_forward_mm"], found[f"{name}_up_mm"] = map(
                float, last.sel(marker=name).values[1:]
            )
    if "smallest_J" in motion:
        found["smallest_J"] = float(motion["smallest_J"].min())
    t = motion["time"].values
    moved = np.linalg.norm(d.values[-1] - d.values[-2], axis=-1)
    found["speed_mm_s"] = float(moved.max() / (t[-1] - t[-2]))
    return found


def _of_mouth(motion: xr.Dataset, face: xr.Dataset) -> dict[str, float]:
    n = face.sizes["node"]
    q = motion["node_position"].transpose("time", "node", "axis").values[[0, -1], :n]
    margins = face["lip_opening_node"].values
    upper, lower = 1e3 * (q[1] - q[0])[margins]
    return {
        "opening_mm": 1e3 * float(motion["lip_opening"][-1]),
        "area_mm2": 1e6 * float(motion["mouth_area"][-1]),
        "width_mm": 1e3 * lip_shape(face, lip_rim(face), q[1])["width"],
        "protrusion_mm": 0.5 * float(upper[1] + lower[1]),
        "upper_up_mm": float(upper[2]),
        "lower_up_mm": float(lower[2]),
    }


class _Heads:
    """Heads and scenes of runs, of which the last of each mesh is kept."""

    def __init__(self, setting: Setting, given: Head | None) -> None:
        self.setting, self.given = setting, given
        self.kept: dict[str | int, tuple[object, Head, HeadScene]] = {}

    def of(self, run: Run, resolution: str | int) -> tuple[Head, HeadScene]:
        """Head and compiled scene of a run."""
        key = repr((run.face, run.tongue, run.rings, run.contacts))
        if resolution not in self.kept or self.kept[resolution][0] != key:
            head = self._head(run, resolution)
            unknown = [name for name in run.drive if name not in head.lists["exciter"].values]
            if unknown:
                raise HeadError(
                    f"run {run.name!r}: the head has no exciter {unknown[0]!r}, expected muscles or "
                    "groups of its parts, such as bi_OOP"
                )
            scene = head_scene(
                head,
                face=configure(
                    SimulationParameters, _nested(run.face), where=f"run {run.name!r}, face"
                ),
                tongue=configure(
                    TongueParameters,
                    TONGUE.model_dump() | _nested(run.tongue),
                    where=f"run {run.name!r}, tongue",
                ),
                gravity=self.setting.gravity,
            )
            self.kept[resolution] = key, head, scene
        return self.kept[resolution][1:]

    def _head(self, run: Run, resolution: str | int) -> Head:
        s = self.setting
        if self.given is None:
            return build_head(
                s.parts,
                preset=s.preset,
                seed=s.seed,
                resolution=resolution,
                contacts=run.contacts,
                rings={muscle: parse_ring(words) for muscle, words in run.rings.items()},
            )
        if run.rings:
            raise HeadError(
                f"run {run.name!r} has rings of orbicularis oris, which a given head cannot change: "
                "expected a generated head"
            )
        return self.given if run.contacts is None else self.given.touching(run.contacts)


def _row(run: Run, heads: _Heads, measure: Measure) -> dict[str, Any]:
    """Outcomes of a run with their errors."""
    s = heads.setting
    try:
        coarse = _simulated(run, heads, s.resolution, s.step, measure)
        found: dict[str, Any] = _simulated(run, heads, s.resolution, 0.5 * s.step, measure)
        finer = (
            _simulated(run, heads, s.finer, s.step, measure)
            if s.finer is not None and heads.given is None
            else None
        )
    except sim.SimulationError as error:
        return {"end": f"{type(error).__name__}: {one_line(error)}"}
    for name in tuple(found):
        if name not in ("smallest_J", "speed_mm_s"):
            found[name + STEP_ERROR] = abs(found[name] - coarse[name])
            if finer is not None:
                found[name + MESH_ERROR] = abs(finer[name] - coarse[name])
    return {**found, "end": "reached"}


def _simulated(
    run: Run, heads: _Heads, resolution: str | int, step: float, measure: Measure
) -> dict[str, float]:
    s = heads.setting
    head, scene = heads.of(run, resolution)
    drive = raised(dict(run.drive), rise=s.rise, jaw="bi_close" in head.lists["exciter"].values)
    motion = simulate_head(
        head, drive, duration=s.duration, step=step, output=2.0 * s.step, scene=scene
    )
    return dict(measure(motion, head))


def _nested(values: Mapping[str, Any]) -> dict[str, Any]:
    """Nested tables from names with dots."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        place = found
        *outer, last = name.split(".")
        for part in outer:
            place = place.setdefault(part, {})
        place[last] = value
    return found


def _labels(run: Run) -> dict[str, Any]:
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


def _stored(table: Path | None) -> dict[str, dict[str, Any]]:
    """Rows of a table by key, without empty cells."""
    if table is None or not table.is_file():
        return {}
    try:
        found = pd.read_csv(table, dtype={"key": str})
        return {
            str(row["key"]): {str(k): v for k, v in row.items() if not pd.isna(v)}
            for row in found.to_dict("records")
        }
    except (ValueError, KeyError) as error:
        raise HeadError(
            f"{table} is no table of a sweep ({one_line(error)}), expected a new name or one written by "
            "this command"
        ) from error


def read_plan(path: str | Path) -> tuple[Run, ...]:
    """Runs of a CSV table, one per row.

    Columns are exciters with their levels, ``name``, ``contact`` (pairs with spaces between, or none),
    ``ring.OOP`` and ``ring.OOM`` (words), and ``face.`` or ``tongue.`` with the name of a parameter.
    Empty cells keep the default.

    Raises
    ------
    HeadError
        The file cannot be read, has no rows, or a level is not between 0 and 1.
    """
    try:
        table = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (OSError, ValueError) as error:
        raise HeadError(
            f"{path} is no plan ({one_line(error)}): expected a table with columns such as bi_OOP, "
            "face.stiffening, ring.OOP and contact"
        ) from error
    if table.empty:
        raise HeadError(f"{path} has no rows, expected one per run")
    return tuple(_run(row, k) for k, row in enumerate(table.to_dict("records"), start=1))


def _run(row: Mapping[Any, Any], number: int) -> Run:
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
    return Run(name, kinds[""], kinds["face"], kinds["tongue"], kinds["ring"], contacts)


__all__ = ["Run", "Setting", "outcomes", "read_plan", "sweep"]
