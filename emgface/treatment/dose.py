"""Outcomes against the share of a lip that is removed, over shapes, places, joining and persons.

Every case is a generated person, a draw of the parameters that nobody has measured, and a plan. Cases
are stored under the digest of their inputs and code, so that a repeated run computes only those missing.
"""

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.choices import configure
from emgface.errors import DataError, FaceError
from emgface.face.lip_shape import lip_rim
from emgface.face.motion import settle_face, simulate_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.build import volunteer_face
from emgface.run.digest import canonical_json
from emgface.run.mechanics import MECHANICS
from emgface.run.observer import Observer, Silent
from emgface.run.store import Stage, Store
from emgface.run.tasks import Task, run_table
from emgface.texts import labelled, open_text
from emgface.treatment.jobs import NO_PRESSURE, pressure_attributes
from emgface.treatment.motions import gestures
from emgface.treatment.outcomes import OUTCOMES, UNIT_FACTORS, bound_of
from emgface.treatment.plan import NOT_VALIDATED, Plan, Tumour, steps_digest
from emgface.treatment.treat import treat_face
from sim import SimulationError
from sim.threads import one_blas_thread

OUTCOME: Final = Stage("treatment_outcomes", (*MECHANICS, "emgface.treatment", "emgface.choices"))
COMPARISONS: Final = ("person", "draw", "shape", "share", "place", "rejoin")
PLAN: Final = "plan"  #: column with the digest of the steps of a plan, empty for an excision
BOUNDS: Final = "lower bounds"  #: column with the names of the outcomes that are lower bounds
SEPARATOR: Final = "; "  #: between these names
DRAWN_RANGES: Final = {
    "stiffness": (0.5, 2.0),
    "scar_stiffness": (1.0, 10.0),
    "scar_radius": (1.5, 6.0),
    "retraction": (2.0, 12.0),
}
"""Ranges of unknown parameters, uniform in the logarithm: no measured values exist (`plan.py`)."""


@dataclass(frozen=True)
class DoseSetting:
    """Settings of all cases: seed of the random draws, resolution, movements, persons and stress."""

    seed: int = 2026
    resolution: str = "coarse"
    movements: tuple[str, ...] = ("A", "D", "opening", "closing")
    sigma_max: float = 100e3  #: [Pa]
    contact: bool = True
    lip: str = "lower"
    height: float = 12.0  #: of an excision [mm]

    def parameters(self) -> SimulationParameters:
        """Parameters of the simulations."""
        given: dict[str, Any] = {"accuracy": "draft", "sigma_max": self.sigma_max}
        if not self.contact:
            given["contact"] = {"method": "none"}
        return configure(SimulationParameters, given, where="dose")


@dataclass(frozen=True)
class Case:
    """Person (from 1), draw (0 is the default of every parameter) and excision; a share of 0 is none.

    `steps` is the JSON of the steps of a plan, in place of an excision.
    """

    person: int
    draw: int
    shape: str = "V"
    share: float = 0.0
    place: float = 0.5
    rejoin: str = "all"
    steps: str = ""

    @property
    def name(self) -> str:
        """Label of the case."""
        what = "plan" if self.steps else f"{self.shape} {100 * self.share:g} %"
        return f"person {self.person}, draw {self.draw}, {what}, {self.place:g}, {self.rejoin}"


def cases(
    persons: int,
    draws: int,
    shapes: Sequence[str],
    shares: Sequence[float],
    places: Sequence[float],
    rejoin: Sequence[str],
) -> list[Case]:
    """All combinations, with the untreated face of every person and draw."""
    whole = [Case(p, d) for p, d in product(range(1, persons + 1), range(draws + 1))]
    cut = [
        Case(w.person, w.draw, *values)
        for w in whole
        for values in product(shapes, shares, places, rejoin)
    ]
    return whole + cut


def cases_of_plan(persons: int, draws: int, plan: Plan) -> list[Case]:
    """The untreated face and that after a plan, of every person and draw.

    Raises DataError if the plan contains the surface of a tumour, which is that of one person.
    """
    if any(isinstance(step, Tumour) and step.surface for step in plan.step):
        raise DataError(
            "the plan contains the surface of a tumour, which belongs to one person: expected its "
            "centre and radii, or a wedge"
        )
    steps = json.dumps([step.model_dump(mode="json") for step in plan.step])
    whole = [Case(p, d) for p, d in product(range(1, persons + 1), range(draws + 1))]
    return whole + [Case(w.person, w.draw, "plan", 1.0, steps=steps) for w in whole]


def drawn_persons(draw: int, seed: int) -> dict[str, float]:
    """Values of the unknown parameters of a draw; empty for 0, the defaults."""
    if draw == 0:
        return {}
    rng = np.random.default_rng((seed, draw))
    return {
        name: float(np.exp(rng.uniform(np.log(low), np.log(high))))
        for name, (low, high) in DRAWN_RANGES.items()
    }


def plan_of(case: Case, setting: DoseSetting, margin: float) -> Plan:
    """Plan of a case on a face whose margin of the lip has a length [m]."""
    values = drawn_persons(case.draw, setting.seed)
    steps: list[dict[str, Any]] = []
    if values:
        steps.append({"kind": "change", "stiffness": values["stiffness"]})
    if case.steps:
        own = json.loads(case.steps)
    elif case.share > 0.0:
        own = [
            {
                "kind": "wedge", "shape": case.shape, "lip": setting.lip, "place": case.place,
                "width": 1e3 * case.share * margin, "height": setting.height,
                "rejoin": case.rejoin,
            }
        ]  # fmt: skip
    else:
        own = []
    for step in own:
        if values and step["kind"] in ("wedge", "tumour", "incision"):
            step["retraction"] = values["retraction"]
            if step.get("scar") is not None or "scar" not in step:
                step["scar"] = {
                    "radius": values["scar_radius"], "stiffness": values["scar_stiffness"],
                }  # fmt: skip
    return configure(Plan, {"name": "dose", "step": [*steps, *own]}, where=case.name)


@lru_cache(maxsize=2)
def _person(seed: int, index: int, resolution: str) -> xr.Dataset:
    return volunteer_face(seed, index, resolution=resolution)[0]


def computed(case: Case, setting: DoseSetting) -> xr.Dataset:
    """Outcomes of a case in their units; NaN where a movement fails, or all if the plan is refused.

    ``at_least`` is 1 where a value is a lower bound. The attribute ``end`` is "reached", or contains the
    reason.
    """
    face, p = _person(setting.seed, case.person, setting.resolution), setting.parameters()
    rim = getattr(lip_rim(face), setting.lip)
    margin = np.linalg.norm(np.diff(face["position"].values[rim], axis=0), axis=1).sum()
    values = dict.fromkeys((o.name for o in OUTCOMES), np.nan)
    values |= {f"amplitude of {name}": np.nan for name in setting.movements}
    ends: list[str] = []
    try:
        treated = treat_face(face, plan_of(case, setting, float(margin)), p)
        settled = settle_face(treated, p)
    except (FaceError, SimulationError) as error:
        return _row(values, f"refused: {error}")
    motions: dict[str, xr.Dataset] = {}
    for name, activation in gestures(face, setting.movements).items():
        try:
            motion = simulate_face(treated, activation, p, settled=settled)
            own = pressure_attributes(treated, p, settled) if name == "closing" else {}
            motions[name] = motion.assign_attrs(own)
            if NO_PRESSURE in motions[name].attrs:
                ends.append(f"pressure held: {motions[name].attrs[NO_PRESSURE]}")
        except SimulationError as error:
            ends.append(f"{name}: {error}")
    least: list[str] = []
    for outcome in OUTCOMES:
        motion = motions.get(outcome.movement)
        if not outcome.movement or motion is not None:
            values[outcome.name] = outcome.value(treated, motion) * UNIT_FACTORS[outcome.unit]
        if motion is not None and outcome.at_least(motion):
            least.append(outcome.name)
    for name, motion in motions.items():
        path = motion["position"].transpose("time", "marker", "axis").values
        away = np.linalg.norm(path - path[0], axis=2).max(axis=0)
        values[f"amplitude of {name}"] = 1e3 * float(np.median(away))
    return _row(values, "reached" if not ends else "failed: " + "; ".join(ends), least)


def _row(values: dict[str, float], end: str, least: Sequence[str] = ()) -> xr.Dataset:
    return xr.Dataset(
        {
            "value": ("outcome", np.array([*values.values()])),
            "at_least": ("outcome", np.array([name in least for name in values], dtype=np.int8)),
        },
        {"outcome": [*values]},
        attrs={"end": end, "origin": "simulated"},
    )


@dataclass(frozen=True)
class _Worker:
    setting: DoseSetting
    store: Store


def _prepared(given: tuple[DoseSetting, Path], report: Callable[[str], None]) -> _Worker:
    setting, store = given
    return _Worker(setting, Store(store, report=report))


def _row_of(worker: _Worker, case: Case) -> dict[str, Any]:
    """Row of a case, from the store if it is there."""
    setting = worker.setting
    key = {"case": asdict(case), "setting": asdict(setting)}
    result = worker.store.get_or_compute(
        OUTCOME, {}, key, lambda: computed(case, setting), label=case.name
    )
    numbers = zip(result.dataset["outcome"].values, result.dataset["value"].values, strict=True)
    row = {axis: getattr(case, axis) for axis in COMPARISONS}
    row |= {str(name): float(value) for name, value in numbers}
    least = result.dataset["outcome"].values[result.dataset["at_least"].values > 0]
    row[PLAN] = steps_digest([{"step": json.loads(case.steps)}]) if case.steps else ""
    row[BOUNDS] = SEPARATOR.join(map(str, least))
    row["end"] = result.dataset.attrs["end"]
    return row


def _status(row: dict[str, Any]) -> tuple[str, str]:
    """Status of a row, which names the movement that failed or "refused", and its reason."""
    end = str(row["end"])
    name, _, reason = end.removeprefix("failed: ").partition(": ")
    return ("ok", "") if end == "reached" else (f"failed:{name}", reason)


@one_blas_thread
def dose_table(
    every: Iterable[Case],
    setting: DoseSetting,
    folder: Path,
    *,
    workers: Any = 1,
    observer: Observer | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> pd.DataFrame:
    """Compute all cases; one row per case, with its axes, outcomes and ``end``.

    The journal and the store are in `folder`. Raises KeyboardInterrupt if `stopping` returns True,
    after the cases that have begun.
    """
    own, store = list(every), folder.absolute() / "store"
    rows = run_table(
        Task(_prepared, (setting, store), _row_of, lambda case: case.person),
        own,
        [(case.name,) for case in own],
        name="treatments",
        out=folder,
        store=store,
        workers=workers,
        observer=observer or Silent(),
        stopping=stopping,
        status=_status,
    )
    return pd.DataFrame(rows)


def _outcomes_of(table: pd.DataFrame) -> list[str]:
    """Names of the outcomes in a table of cases."""
    return [c for c in table.columns if c not in (*COMPARISONS, PLAN, BOUNDS, "end")]


def bounds_of(table: pd.DataFrame) -> pd.DataFrame:
    """Return, per outcome and case, True if the value is a lower bound.

    Tables of earlier versions do not state it; their values are not lower bounds.
    """
    texts = table[BOUNDS].fillna("") if BOUNDS in table else [""] * len(table)
    bounded = [set(str(text).split(SEPARATOR)) for text in texts]
    names = _outcomes_of(table)
    return pd.DataFrame([[n in one for n in names] for one in bounded], table.index, names)


def changes_by_dose(table: pd.DataFrame) -> pd.DataFrame:
    """Change of every outcome from the untreated face of the same person and draw, in long form.

    ``bound`` is that of `outcome_table`: the values that are lower bounds.
    """
    table = table.reset_index(drop=True)
    names, least = _outcomes_of(table), bounds_of(table)
    whole = table["share"] == 0.0
    cut = table[~whole]
    people = pd.MultiIndex.from_frame(cut[["person", "draw"]])
    index = pd.MultiIndex.from_frame(table.loc[whole, ["person", "draw"]])
    before, before_least = (
        frame[whole].set_axis(index)[names].loc[people].to_numpy() for frame in (table, least)
    )
    changes = (
        cut[[*COMPARISONS]]
        .join(cut[names] - before)
        .melt([*COMPARISONS], names, "outcome", "change")
    )
    pairs = zip(before_least.T.ravel(), least[~whole].to_numpy().T.ravel(), strict=True)
    changes["bound"] = [bound_of(bool(a), bool(b)) for a, b in pairs]
    changes["change"] = changes["change"].mask(changes["bound"] == "both")
    return changes


def cube_of(table: pd.DataFrame, setting: DoseSetting) -> xr.Dataset:
    """Cube of ``before``, ``after`` (axes, outcome) and ``end`` (axes).

    ``before_at_least`` and ``after_at_least`` are 1 where these values are lower bounds.
    """
    table = table.reset_index(drop=True)
    names, is_cut = _outcomes_of(table), table["share"] > 0.0
    cut = table[is_cut].set_index([*COMPARISONS])

    def cube(values: pd.DataFrame, axes: tuple[str, ...]) -> xr.DataArray:
        own = values[is_cut if axes == COMPARISONS else ~is_cut]
        index = pd.MultiIndex.from_frame(table.loc[own.index, [*axes]])
        array = own[names].set_axis(index).to_xarray().to_array("outcome")
        return array.transpose(*axes, "outcome")

    least = bounds_of(table).astype(float)
    people = ("person", "draw")
    arrays = {
        "before": cube(table, people),
        "after": cube(table, COMPARISONS),
        "before_at_least": cube(least, people).fillna(0.0).astype(np.int8),
        "after_at_least": cube(least, COMPARISONS).fillna(0.0).astype(np.int8),
    }
    end = cut["end"].to_xarray().fillna("not computed").astype(str)
    units = {o.name: o.unit for o in OUTCOMES}
    return xr.Dataset(
        {**arrays, "end": end},
        {"unit": ("outcome", [units.get(name, "mm") for name in names])},
        attrs={
            "origin": "simulated", "note": NOT_VALIDATED, "setting": canonical_json(asdict(setting)),
        },
    )  # fmt: skip


LEAST_FOR_QUANTILES: Final = 20
"""Number of values from which their 5 and 95 % are stated; of fewer, the smallest and largest are."""


def spread_of(values: int) -> tuple[float, float, str]:
    """Levels of the quantiles of a number of values that show their spread, and their words."""
    return (
        (0.05, 0.95, "5–95 %")
        if values >= LEAST_FOR_QUANTILES
        else (0.0, 1.0, "smallest to largest")
    )


def draws_of(table: pd.DataFrame) -> int:
    """Number of draws of the unknown parameters in a table of cases."""
    return int(table.loc[table["draw"] > 0, "draw"].nunique())


def intervals_by_dose(table: pd.DataFrame) -> pd.DataFrame:
    """Median change and its spread over persons (draw 0) and over draws (mean over persons).

    The spread, from ``low`` to ``high``, is that of `spread_of` for the number of persons or draws.
    ``bounds`` is the number of changes that are bounds or, between two bounds, unknown: median and
    spread of the persons and draws contain the bounds as if they were values.
    """
    long = changes_by_dose(table)
    keys = ["shape", "share", "place", "rejoin", "outcome"]
    persons = long[long["draw"] == 0].groupby(keys, sort=False)["change"]
    drawn_means = long[long["draw"] > 0].groupby([*keys, "draw"], sort=False)["change"].mean()
    bounded = (long["bound"] != "").groupby([long[key] for key in keys], sort=False).sum()
    intervals = pd.DataFrame({"n": persons.count(), "median": persons.median(), "bounds": bounded})
    of_persons, of_draws = (
        spread_of(n)[:2] for n in (int(table["person"].nunique()), draws_of(table))
    )
    drawn = drawn_means.groupby(keys, sort=False)
    for name, level, of_draw in zip(("low", "high"), of_persons, of_draws, strict=True):
        intervals[f"persons {name}"] = persons.quantile(level)
        if len(drawn_means):
            intervals[f"parameters {name}"] = drawn.quantile(of_draw)
    return intervals.reset_index()


def read_cases(path: Path, entries: Sequence[Any]) -> pd.DataFrame:
    """Read the table of cases of the plans of a treated face (`entries`).

    Raises DataError if it has no axes of cases, or is that of other plans.
    """
    try:
        table = pd.read_csv(labelled(open_text(path)), comment="#")
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path} cannot be read ({error}), expected a table of 'emgface dose'"
        ) from error
    if missing := [axis for axis in (*COMPARISONS, "end") if axis not in table]:
        raise DataError(
            f"{path} has no column {missing[0]!r}, expected a table written by 'emgface dose'"
        )
    own = steps_digest(entry["plan"] for entry in entries)
    cut = table["share"] > 0.0
    stated = set(map(str, table.loc[cut, PLAN].dropna())) if PLAN in table else set[str]()
    if stated != {own}:
        raise DataError(
            f"{path} contains other plans than that of the treated face ({own}; found "
            f"{', '.join(sorted(stated)) or 'none'}), whose intervals are expected: "
            "write it by 'emgface dose --plan' with the plan that was applied"
        )
    return table


def with_intervals(outcomes: pd.DataFrame, table: pd.DataFrame) -> pd.DataFrame:
    """Outcomes of one face with the intervals of the change in a table of the same plan."""
    intervals = intervals_by_dose(table).drop(columns=["n", "median"])
    intervals = intervals.drop(columns=[axis for axis in COMPARISONS if axis in intervals])
    names = {c: f"change, {c}" for c in intervals.columns if c != "outcome"}
    intervals = intervals.rename(columns=names | {"bounds": "bounds among the changes"})
    if intervals["outcome"].duplicated().any():
        raise DataError(
            "the table of intervals has several plans, expected one: write it by "
            "'emgface dose --plan plan.toml'"
        )
    return outcomes.merge(intervals, "left", "outcome")
