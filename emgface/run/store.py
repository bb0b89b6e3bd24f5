"""Store of stage results as netCDF files, identified by a digest of their inputs.

A result is the file ``<folder>/<stage>/<digest>.nc`` with an index ``<digest>.json``, which
describes its inputs, the date and the environment of its computation. The digest covers the stage's
name, the digests of its inputs, its parameters and the source text of the modules that computed it.
A changed parameter, recording or line of code therefore changes the digest: outdated results are
never used, and an interrupted study computes only missing results. Date and machine do not affect
the digest.

Several processes and machines may use one folder. Files are written under temporary names and then
linked to their own, which only the first of several writers of a result can do; the others use its
file. A file that does not agree with the size and SHA-256 in its index is computed again.
"""

import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

import xarray as xr

from emgface.errors import DataError, StoreError
from emgface.files import expressible, new_part, plain_files, replace_file, result_file
from emgface.plugins import versions
from emgface.run.dependencies import reached
from emgface.run.digest import canonical_json, code_version, file_digest, text_digest
from emgface.run.objects import Objects
from emgface.run.provenance import computing_environment, now

SCHEMA_VERSION = 1

Outcome = Literal["computed", "reused", "recomputed"]


@dataclass(frozen=True)
class Stage:
    """Stage of the study whose results are stored in a folder of its name.

    `modules` are the dotted names of the modules and packages that compute the result. What they import
    determines it, too (`emgface.run.dependencies`), except what begins with one of `without`.
    """

    name: str
    modules: tuple[str, ...]
    without: tuple[str, ...] = ()

    @property
    def reached(self) -> tuple[str, ...]:
        """All modules and packages whose source determines the result."""
        return reached(self.modules, self.without)


@dataclass(frozen=True)
class Event:
    """Event of one result: computed, reused, or recomputed because it was damaged."""

    stage: str
    digest: str
    label: str
    outcome: Outcome
    seconds: float


@dataclass(frozen=True)
class Result:
    """Stored dataset, its digest (the input of later stages) and its event.

    `computed` is the UTC date of its computation and `environment` describes its computation
    (`emgface.run.provenance.computing_environment`); both are empty if unknown.
    """

    dataset: xr.Dataset
    digest: str
    outcome: Outcome
    path: Path
    computed: str = ""
    environment: str = ""


@dataclass
class Store:
    """Folder of stage results.

    `report` receives one sentence if a stored file is damaged and computed again; `events` lists
    the results that this process has computed and reused, in order. With `objects`, a result that
    the folder lacks is copied from there, and a computed one is copied there.
    """

    folder: Path
    report: Callable[[str], None] = print
    events: list[Event] = field(default_factory=list)
    objects: Objects | None = None

    def __post_init__(self) -> None:  # noqa: D105
        expressible(self.folder)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(
                f"the folder {self.folder} cannot be created ({error.strerror}): specify a "
                "writable folder"
            ) from error

    def key(
        self, stage: Stage, inputs: Mapping[str, str], parameters: Mapping[str, Any]
    ) -> dict[str, Any]:
        """All inputs of a result, as plain data."""
        code = {"modules": list(stage.modules), "version": code_version(stage.reached)}
        if of_others := versions(parameters):
            code["plugins"] = of_others
        return {
            "stage": stage.name,
            "inputs": dict(inputs),
            "parameters": json.loads(canonical_json(dict(parameters))),
            "code": code,
        }

    def path(self, key: Mapping[str, Any]) -> Path:
        """File of the result with this key."""
        return result_file(self.folder, str(key["stage"]), text_digest(canonical_json(key)))

    def get_or_compute(
        self,
        stage: Stage,
        inputs: Mapping[str, str],
        parameters: Mapping[str, Any],
        compute: Callable[[], xr.Dataset],
        *,
        label: str = "",
    ) -> Result:
        """Return the stored result, computing it if it is absent or damaged.

        `inputs` contains the digest of each input by name, `parameters` all other values on which
        the result depends, as JSON. Exceptions of `compute` are propagated, and no result is
        stored. `label` describes the result in the index and does not affect the digest. Raises
        StoreError if parameters cannot be expressed as JSON or the folder cannot be written.
        """
        key = self.key(stage, inputs, parameters)
        path = self.path(key)
        started = time.perf_counter()
        damage, result = self._stored(path, key)
        if result is None and self.objects is not None:
            lost, result = self._fetched(path, key, self.objects)
            damage = damage or lost
        if result is not None:
            self._log(stage, path, label, "reused", started)
            return result
        if damage:
            self.report(
                f"Stored result {path.name} of stage {stage.name} {damage}; it is computed again."
            )
        computed = compute()
        self._write(computed, path, key, label, time.perf_counter() - started)
        if self.objects is not None:
            self.objects.publish(path)
        outcome: Outcome = "recomputed" if damage else "computed"
        self._log(stage, path, label, outcome, started)
        # Identical to what a later run reads, including attributes.
        return Result(_load(path), path.stem, outcome, path, *_made(path))

    def _stored(self, path: Path, key: Mapping[str, Any]) -> tuple[str, Result | None]:
        """Problem of a stored result, empty if it is absent; and the result if it is valid."""
        try:
            damage = damage_of(path, key)
            if damage is not None:
                return damage, None
            return "", Result(_load(path), path.stem, "reused", path, *_made(path))
        except PermissionError as error:
            raise StoreError(
                f"{path} cannot be read ({error.strerror}), expected the permission to read the "
                "store: change its permissions, or specify another --store"
            ) from error
        except (OSError, ValueError, RuntimeError) as error:
            return f"cannot be read ({error})", None

    def _fetched(
        self, path: Path, key: Mapping[str, Any], objects: Objects
    ) -> tuple[str, Result | None]:
        """Problem of a result in object storage, and the result if it is valid, as `_stored`."""
        try:
            index = objects.fetch(path)
        except DataError as error:
            return str(error), None
        if index is None:
            return "", None
        store_text(path.with_suffix(".json"), index)
        return self._stored(path, key)

    def read(self, stage: str, digest: str) -> xr.Dataset | None:
        """Return the stored result with a digest, None if it is absent or damaged."""
        path = result_file(self.folder, stage, digest)
        return _load(path) if damage_of(path) is None else None

    def _log(self, stage: Stage, path: Path, label: str, outcome: Outcome, started: float) -> None:
        seconds = time.perf_counter() - started
        self.events.append(Event(stage.name, path.stem, label, outcome, seconds))

    def _write(
        self, dataset: xr.Dataset, path: Path, key: Mapping[str, Any], label: str, seconds: float
    ) -> None:
        own = new_part(path)
        try:
            store_netcdf(dataset, own)
            if damage_of(path, key) is None:
                return  # another process has written the same result meanwhile
            _put(own, path, keep=not path.with_suffix(".json").exists())
        finally:
            with suppress(OSError):  # of a file system that is read-only
                own.unlink(missing_ok=True)
        index = {
            "label": label,
            "written": now(),
            "seconds": round(seconds, 3),
            "schema_version": SCHEMA_VERSION,
            "bytes": path.stat().st_size,
            "sha256": file_digest(path),
            "key": key,
            "environment": json.loads(computing_environment()),
        }
        store_text(path.with_suffix(".json"), json.dumps(index, indent=2) + "\n")


def damage_of(path: Path, key: Mapping[str, Any] | None = None) -> str | None:
    """Problem of a stored result: None if it is valid, empty if it is absent.

    With `key`, it must have been computed from these inputs.
    """
    index = path.with_suffix(".json")
    if not path.exists() and not index.exists():
        return ""
    if not path.exists():
        return "is missing, but its index exists"
    if not index.exists():
        return "has no index, so that its origin is unknown"
    if path.is_dir() or index.is_dir():
        return "is a folder, or its index is one"
    try:
        known = json.loads(index.read_text(encoding="utf-8"))
        digest, size, recorded = known["sha256"], known["bytes"], known["key"]
    except (json.JSONDecodeError, KeyError, TypeError, UnicodeDecodeError):
        return "has an index that cannot be read"
    if key is not None and recorded != key:
        return "was computed from other inputs"
    if path.stat().st_size != size:
        return f"has {path.stat().st_size} bytes, but {size} were written"
    if file_digest(path) != digest:
        return "differs from the written result"
    return None


def _put(source: Path, path: Path, *, keep: bool) -> None:
    """Give a complete file its name; with `keep` a complete file of that name remains.

    Without an index the file may be that of another process, which is about to write the index;
    both then describe the same file. With an index it is damaged and replaced.
    """
    try:
        if keep and not path.exists():
            try:
                os.link(source, path)
                return
            except FileExistsError:
                return
            except OSError:  # a file system without links
                pass
        source.replace(path)
    except OSError as error:
        raise StoreError(
            f"{path} cannot be written ({error.strerror}): make its folder writable, or remove a "
            "folder of the same name"
        ) from error


def _made(path: Path) -> tuple[str, str]:
    """Date and environment of a stored result, from its index."""
    index = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    by = index.get("environment")
    return str(index.get("written", "")), "" if by is None else canonical_json(by)


def _load(path: Path) -> xr.Dataset:
    dataset = xr.load_dataset(path, engine="netcdf4", decode_times=False).drop_encoding()
    for name, variable in dataset.variables.items():
        if variable.dtype.kind in "OT":
            dataset[name] = dataset[name].astype(str)
    return dataset


def store_netcdf(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset atomically: a reader finds the old or the complete new file.

    Raises StoreError if the folder cannot be written or netCDF cannot represent the dataset.
    """
    _replace(path, lambda temporary: dataset.to_netcdf(temporary, engine="netcdf4"))


def store_text(path: Path, text: str) -> None:
    """Write a text file atomically; raises StoreError if the folder cannot be written."""
    _replace(path, lambda temporary: temporary.write_text(text, encoding="utf-8"))


def _replace(path: Path, write: Callable[[Path], object]) -> None:
    try:
        replace_file(path, write)
    except DataError as error:
        raise StoreError(str(error)) from error
    except (TypeError, ValueError, RuntimeError) as error:
        free = shutil.disk_usage(path.parent).free if path.parent.is_dir() else 0
        room = f"{free / 1e6:.1f} MB are free on its disk"
        raise StoreError(f"{path} cannot be written ({error}); {room}") from error


OWNERS: Final = "owners"
"""Folder of a store with one small file for each study that uses it, with the path of its folder.

Results that no study of the list uses may be removed. Paths are relative to the store: both may be
moved together. Simultaneous runs do not affect each other.
"""


def add_owner(store: Path, study: Path) -> None:
    """Add the folder of a study to the list of a store; StoreError if it cannot be written."""
    place = _relative(store, study)
    path = store / OWNERS / f"{text_digest(place)}.txt"
    if path.is_file():
        return
    store_text(path, f"{place}\n")


def owners(store: Path) -> dict[Path, Path]:
    """Folders of the studies in the list of a store, each with its file in the list."""
    folders: dict[Path, Path] = {}
    for path in plain_files(store / OWNERS):
        if path.suffix == ".txt":
            place = path.read_text(encoding="utf-8").strip()
            folders[Path(os.path.normpath(store.resolve() / place))] = path
    return folders


def _relative(store: Path, study: Path) -> str:
    store, study = store.resolve(), study.resolve()
    try:
        return Path(os.path.relpath(study, store)).as_posix()
    except ValueError:  # on another drive of Windows
        return study.as_posix()
