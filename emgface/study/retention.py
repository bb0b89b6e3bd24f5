"""Results of a store that its studies use: removal of the others, and copies of one study."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from emgface.errors import DataError, StoreError
from emgface.study.journal import Journal
from emgface.study.runs import lines, run_files
from emgface.study.state import read_state
from emgface.study.store import damage_of

FACES = "face"  #: folder of the store with the faces of its studies, which workers read


@dataclass(frozen=True)
class Unused:
    """Files of a store that no study uses, with their total size [bytes]."""

    files: list[Path]
    size: int


def used_results(folders: Iterable[Path]) -> dict[Path, set[tuple[str, str]]]:
    """Stage and digest of the results of studies, for each of their stores.

    These are the results of the last line of every trial and those of no single trial (rest states,
    ranges, baselines) in every run that has ended. Raises DataError for a folder without a journal.
    """
    used: dict[Path, set[tuple[str, str]]] = {}
    for folder in folders:
        state = read_state(folder)
        trials: dict[tuple[str, ...], list[tuple[str, str]]] = {}
        store = state.store(folder).resolve()
        found = used.setdefault(store, set())
        for path in run_files(folder):
            for _, line in lines(path):
                results = [(s["stage"], s["digest"]) for s in line.get("stages", ())]
                if line["event"] == "trial":
                    trials[line["variant"], *map(str, line["trial"])] = results
                    found.update(r for r in results if r[0] == "rest")
                else:
                    found.update(results)
        found.update(result for results in trials.values() for result in results)
    return used


def unused_files(folders: Iterable[Path]) -> Unused:
    """Find results in the stores of studies that none of them uses, and parts of killed writers.

    All studies that share a store must be named. Raises StoreError if one of them is running.
    """
    folders = list(folders)
    for folder in folders:
        if any(run.state == "running" for run in read_state(folder).runs):
            raise StoreError(
                f"the study in {folder} is running, expected one that has ended: wait until it ends"
            )
    files: list[Path] = []
    for store, used in used_results(folders).items():
        # Other folders may belong to simulated volunteers, or to nobody who is known here.
        for stage in sorted({store / stage for stage, _ in used if (store / stage).is_dir()}):
            for path in sorted(stage.iterdir()):
                part = path.name.startswith(".") and path.suffix == ".part"
                result = path.suffix in (".nc", ".json")
                if part or (result and (stage.name, path.stem) not in used):
                    files.append(path)
    return Unused(files, sum(path.stat().st_size for path in files))


def export(folder: Path, out: Path, *, without: Iterable[str] = ()) -> tuple[int, int]:
    """Copy a study with the results that it uses to a new folder, where it can be continued.

    `without` names stages to leave out, such as ``skin``. Damaged results are not copied. Returns
    the number of copied results and their size [bytes]. Raises DataError if `out` exists or
    `folder` is not that of a study, and StoreError if a file cannot be copied.
    """
    if out.exists():
        raise DataError(f"{out} exists, expected a new folder: specify another one")
    omitted, count, size = set(without), 0, 0
    try:
        for store, used in used_results([folder]).items():
            for stage, digest in sorted(used):
                source = store / stage / f"{digest}.nc"
                if stage in omitted or damage_of(source) is not None:
                    continue
                target = out / "store" / stage
                target.mkdir(parents=True, exist_ok=True)
                for path in (source, source.with_suffix(".json")):
                    shutil.copy2(path, target / path.name)
                    size += path.stat().st_size
                count += 1
        for name in ("runs", "tables", "cube.nc"):
            source = folder / name
            if source.is_dir():
                shutil.copytree(source, out / name)
            elif source.exists():
                shutil.copy2(source, out / name)
        if read_state(out).store(out).resolve() != (out / "store").resolve():
            last = read_state(folder).runs[-1].first
            told = ("study", "folder", "trials", "workers", "code")
            facts = {name: last[name] for name in told if name in last}
            Journal(out, facts | {"store": "store"}).end("copied", [])
    except OSError as error:
        raise StoreError(f"{error.filename} cannot be copied ({error.strerror})") from error
    return count, size
