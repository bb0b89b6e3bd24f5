"""Results of a store that its studies use: removal of the others, and copies of one study."""

import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from emgface.errors import StoreError, listed
from emgface.files import is_part, new_folder, plain_files, result_file
from emgface.run.journal import Journal
from emgface.run.lines import damaged_lines, is_cut_off, lines, run_files
from emgface.run.state import read_state
from emgface.run.store import add_owner, damage_of, owners

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
        needed = used.setdefault(store, set())
        for path in run_files(folder):
            for _, line in lines(path):
                results = [(s["stage"], s["digest"]) for s in line.get("stages", ())]
                if line["event"] == "trial":
                    trials[line["variant"], *map(str, line["trial"])] = results
                    needed.update(r for r in results if r[0] == "rest")
                else:
                    needed.update(results)
        needed.update(result for results in trials.values() for result in results)
    return used


def unused_files(folders: Iterable[Path], *, forget: Iterable[Path] = ()) -> Unused:
    """Find results in the stores of studies that none of them uses, and parts of killed writers.

    All studies in the list of the store (`emgface.run.retention`) must be named in `folders`; those
    that no longer exist are named in `forget`. Links are neither followed nor returned. Raises
    StoreError if a study is running, if a store has no list or another study than those
    named, or if a journal is damaged, so that its results are not known.
    """
    folders, forgotten = list(folders), {path.resolve() for path in forget}
    for folder in folders:
        if any(run.state == "running" for run in read_state(folder).runs):
            raise StoreError(
                f"the study in {folder} is running, expected one that has ended: wait until it ends"
            )
        _require_intact(folder)
    files: list[Path] = []
    for store, used in used_results(folders).items():
        _require_owners(store, {folder.resolve() for folder in folders}, forgotten)
        # Other folders may belong to simulated volunteers, or to nobody who is known here.
        for name in sorted({stage for stage, _ in used}):
            stage = result_file(store, name, "0").parent
            for path in plain_files(stage):
                part = is_part(path)
                result = path.suffix in (".nc", ".json")
                own = path.parent == stage
                if own and (part or (result and (name, path.stem) not in used)):
                    files.append(path)
    return Unused(files, sum(path.stat().st_size for path in files))


def _require_intact(folder: Path) -> None:
    """Refuse a study whose journal does not list all of its results."""
    runs = run_files(folder)
    for k, path in enumerate(runs):
        lines_there = damaged_lines(path)
        later = any(_finished(run) for run in runs[k + 1 :])
        if lines_there or (is_cut_off(path) and not later):
            where = f"line {lines_there[0]}" if lines_there else "the last line"
            raise StoreError(
                f"{where} of {path} is damaged, so that it is unknown which results the study uses; "
                "expected a whole journal: move this file to another folder and run the study again, "
                "which reads its stored results"
            )


def _finished(path: Path) -> bool:
    return any(line["event"] == "end" and line["outcome"] == "finished" for _, line in lines(path))


def _require_owners(store: Path, named: set[Path], forgotten: set[Path]) -> None:
    """Refuse a store without a list of its studies, or with others than those named."""
    listed_there = owners(store)
    if not listed_there:
        raise StoreError(
            f"{store} has no list of the studies that use it, expected one, which every run extends: "
            "run each of them again ('emgface study run'), which computes nothing anew"
        )
    strangers = named - listed_there.keys()
    if strangers:
        raise StoreError(
            f"{listed(strangers)} is not in the list of {store}, expected a study that was run here: "
            "run it again with this store"
        )
    others = listed_there.keys() - named - forgotten
    if others:
        raise StoreError(
            f"{store} is also used by {listed(sorted(others))}, expected all studies that share it: "
            "name them as well, or with --forget those that no longer exist"
        )


def export(folder: Path, out: Path, *, without: Iterable[str] = ()) -> tuple[int, int]:
    """Copy a study with the results that it uses to a new folder, where it can be continued.

    `without` names stages to leave out, such as ``skin``. Damaged results and links are not copied.
    The new folder appears when it is complete. Returns the number of copied results and their size
    [bytes]. Raises DataError if `out` exists or `folder` is not that of a study, and StoreError if a
    file cannot be copied.
    """
    copied: list[tuple[int, int]] = []
    try:
        new_folder(out, lambda part: copied.append(_copy(folder, part, set(without))))
    except OSError as error:
        raise StoreError(f"{error.filename} cannot be copied ({error.strerror})") from error
    return copied[0]


def _copy(folder: Path, out: Path, omitted: set[str]) -> tuple[int, int]:
    """Copy a study as `export` to a folder that exists; return number and size of its results."""
    count, size = 0, 0
    for store, used in used_results([folder]).items():
        for stage, digest in sorted(used):
            source = result_file(store, stage, digest)
            if stage in omitted or source.parent.is_symlink() or source.is_symlink():
                continue
            if source.with_suffix(".json").is_symlink() or damage_of(source) is not None:
                continue
            target = out / "store" / stage
            target.mkdir(parents=True, exist_ok=True)
            for path in (source, source.with_suffix(".json")):
                shutil.copy2(path, target / path.name)
                size += path.stat().st_size
            count += 1
    for name in ("runs", "tables", "cube.nc"):
        source = folder / name
        single = source.is_file() and not source.is_symlink()
        for path in [source] if single else plain_files(source):
            target = out / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(path, target)
    if read_state(out).store(out).resolve() != (out / "store").resolve():
        last = read_state(folder).runs[-1].first
        fields = ("study", "folder", "trials", "workers", "code")
        facts = {name: last[name] for name in fields if name in last}
        Journal(out, facts | {"store": "store"}).end("copied", [])
    else:
        add_owner(out / "store", out)
    return count, size
