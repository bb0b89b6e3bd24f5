"""Sweep of a head: outcomes in mm and mm2 of a table of runs, with the errors of step and mesh."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import pandas as pd
import xarray as xr

import sim
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head, head_digest, read_head, write_head
from emgface.anatomy.head.outcomes import Measure, outcomes
from emgface.anatomy.head.plan import PlannedRun, Setting, labels, nested, read_sweep_plan
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.choices import configure
from emgface.errors import HeadError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.muscles import parse_ring
from emgface.files import write_text
from emgface.run.digest import dataset_digest, text_digest
from emgface.run.mechanics import MECHANICS
from emgface.run.observer import Observer, Silent
from emgface.run.runner import Workers
from emgface.run.store import Stage, Store
from emgface.run.tasks import Task, run_table
from emgface.schema.rules import one_line
from sim.threads import one_blas_thread

STEP_ERROR, MESH_ERROR = "_step_error", "_mesh_error"
"""Endings of the columns with the numerical errors of an outcome."""
ROW: Final = Stage(
    "sweep",
    (
        *MECHANICS,
        "emgface.choices",
        *(f"emgface.anatomy.head.{name}" for name in ("build", "outcomes", "plan", "run")),
    ),
)
"""Rows of sweeps; the module of their measure is part of their code, too."""


@one_blas_thread
def sweep(
    runs: Sequence[PlannedRun],
    setting: Setting | None = None,
    *,
    table: Path | None = None,
    folder: Path | None = None,
    head: Head | None = None,
    measure: Measure | None = None,
    workers: int | Workers = 1,
    observer: Observer | None = None,
    stopping: Callable[[], bool] = lambda: False,
) -> pd.DataFrame:
    """Simulate all runs and tabulate their outcomes with errors.

    Parameters
    ----------
    runs : sequence of Run
    setting : Setting, optional
    table : Path, optional
        CSV file that is written after every run.
    folder : Path, optional
        Of the journal and of the rows, which are stored under the digest of run, setting, head and code,
        so that a repeated sweep computes only what is missing or changed; by default that of the name of
        the table.
    head : Head, optional
        Of all runs, such as an imported one; parts, person and resolution of the setting are then not
        used, and there is no mesh error.
    measure : callable, optional
        Outcomes of a motion, by default `outcomes`; a function of a module, if it is not used by this
        process alone. Its name and the source of its module are part of the digest.
    workers : int or Workers
        Processes, or workers of a scheduler, which share `folder`. The rows do not depend on them.
    observer : Observer, optional
        Receives messages and progress.
    stopping : callable
        If it returns True, the runs that have begun are completed, and KeyboardInterrupt is raised.

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
    StoreError
        A row cannot be stored.
    """
    rows: list[dict[str, Any] | None] = [None] * len(runs)

    def finished(index: int, row: dict[str, Any]) -> None:
        rows[index] = row
        if table is not None:
            write_text(table, pd.DataFrame([r for r in rows if r is not None]).to_csv(index=False))

    with TemporaryDirectory(prefix="emgface-sweep-") as temporary:
        own = folder or (Path(temporary) if table is None else table.with_suffix(""))
        store = Store(own.absolute() / "store")
        given = None if head is None else _stored_head(head, store)
        run_table(
            Task(
                _bench,
                (setting or Setting(), given, measure or outcomes, store.folder),
                _row_of,
                _of_head,
            ),
            runs,
            [(run.name,) for run in runs],
            name="sweep of a head",
            out=own,
            store=store.folder,
            workers=workers,
            observer=observer or Silent(),
            stopping=stopping,
            status=_status,
            finished=finished,
        )
    return pd.DataFrame(rows)


def _stored_head(head: Head, store: Store) -> Path:
    """File of a head in the store, from which the workers read it."""
    path = store.folder / "head" / f"{digest_of_parts(head)}.nc"
    return path if path.is_file() else write_head(head, path)


def digest_of_parts(head: Head) -> str:
    """Digest of the content of a head: its lists and parts."""
    return text_digest(f"{dataset_digest(head.lists)} {head_digest(head.parts)}")


@dataclass(frozen=True)
class _Bench:
    """Heads, measure of their motions, and store of the rows, of one process."""

    heads: "_Heads"
    measure: Measure
    store: Store


def _bench(
    given: tuple[Setting, Path | None, Measure, Path], report: Callable[[str], None]
) -> _Bench:
    setting, path, measure, store = given
    head = None if path is None else read_head(path)
    return _Bench(_Heads(setting, head), measure, Store(store, report=report))


def _row_of(bench: _Bench, run: PlannedRun) -> dict[str, Any]:
    """Return the row of a run, from the store if it is there."""
    heads, measure = bench.heads, bench.measure
    stage = Stage(ROW.name, tuple(dict.fromkeys((*ROW.modules, measure.__module__))))
    result = bench.store.get_or_compute(
        stage,
        {} if heads.given is None else {"head": digest_of_parts(heads.given)},
        {"run": asdict(run), "setting": asdict(heads.setting), "measure": measure.__qualname__},
        lambda: _as_dataset(_row(run, heads, measure)),
        label=run.name,
    )
    return {**labels(run), **_as_row(result.dataset), "key": result.digest}


def _of_head(run: PlannedRun) -> str:
    """Text that is equal for runs with the same head and scene."""
    return repr((run.face, run.tongue, run.rings, run.contacts))


def _status(row: Mapping[str, Any]) -> tuple[str, str]:
    name, _, reason = str(row["end"]).partition(": ")
    return ("ok", "") if name == "reached" else (f"failed:{name}", reason)


def _as_dataset(row: Mapping[str, Any]) -> xr.Dataset:
    numbers = {name: ((), value) for name, value in row.items() if name != "end"}
    return xr.Dataset(numbers, attrs={"end": row["end"], "origin": "simulated"})


def _as_row(stored: xr.Dataset) -> dict[str, Any]:
    return {str(k): float(v) for k, v in stored.items()} | {"end": stored.attrs["end"]}


class _Heads:
    """Heads and scenes of runs, of which the last of each mesh is kept."""

    def __init__(self, setting: Setting, given: Head | None) -> None:
        self.setting, self.given = setting, given
        self.kept: dict[str | int, tuple[object, Head, HeadScene]] = {}

    def for_run(self, run: PlannedRun, resolution: str | int) -> tuple[Head, HeadScene]:
        """Head and compiled scene of a run."""
        key = _of_head(run)
        if resolution not in self.kept or self.kept[resolution][0] != key:
            head = self._head(run, resolution)
            known = head.lists["exciter"].values
            if unknown := [name for name in run.drive if name not in known]:
                raise HeadError(
                    f"run {run.name!r}: the head has no exciter {unknown[0]!r}, expected muscles or "
                    "groups of its parts, such as bi_OOP"
                )
            scene = head_scene(
                head,
                face=configure(
                    SimulationParameters, nested(run.face), where=f"run {run.name!r}, face"
                ),
                tongue=configure(
                    TongueParameters,
                    TONGUE.model_dump() | nested(run.tongue),
                    where=f"run {run.name!r}, tongue",
                ),
                gravity=self.setting.gravity,
            )
            self.kept[resolution] = key, head, scene
        return self.kept[resolution][1:]

    def _head(self, run: PlannedRun, resolution: str | int) -> Head:
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


def _row(run: PlannedRun, heads: _Heads, measure: Measure) -> dict[str, Any]:
    """Outcomes of a run with their errors."""
    s = heads.setting
    try:
        coarse = _simulated(run, heads, s.resolution, s.step, measure)
        row: dict[str, Any] = _simulated(run, heads, s.resolution, 0.5 * s.step, measure)
        finer = (
            _simulated(run, heads, s.finer, s.step, measure)
            if s.finer is not None and heads.given is None
            else None
        )
    except sim.SimulationError as error:
        return {"end": one_line(error)}
    for name in tuple(row):
        if name not in ("smallest_J", "speed_mm_s"):
            row[name + STEP_ERROR] = abs(row[name] - coarse[name])
            if finer is not None:
                row[name + MESH_ERROR] = abs(finer[name] - coarse[name])
    return {**row, "end": "reached"}


def _simulated(
    run: PlannedRun, heads: _Heads, resolution: str | int, step: float, measure: Measure
) -> dict[str, float]:
    s, (head, scene) = heads.setting, heads.for_run(run, resolution)
    drive = raised(dict(run.drive), rise=s.rise, jaw="bi_close" in head.lists["exciter"].values)
    motion = simulate_head(
        head, drive, duration=s.duration, step=step, output=2.0 * s.step, scene=scene, check=False
    )
    return dict(measure(motion, head))


__all__ = ["PlannedRun", "Setting", "outcomes", "read_sweep_plan", "sweep"]
