"""Copies of stored results in object storage: reuse elsewhere, damage, two writers, failures."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from fsspec.core import url_to_fs

from emgface.errors import ConfigurationError, StoreError
from emgface.run.objects import Objects
from emgface.run.store import Stage, Store

STAGE = Stage("double", ("emgface.run.store",))


def trajectory() -> xr.Dataset:
    rng = np.random.default_rng(0)
    values = rng.standard_normal((40, 3, 3)).astype(np.float32)
    return xr.Dataset(
        {
            "position": (("time", "marker", "axis"), values, {"units": "m"}),
            "steps": ("time", np.arange(40, dtype=np.int32)),
        },
        coords={
            "time": ("time", np.linspace(0.0, 0.39, 40), {"units": "s"}),
            "marker": ["LL", "UL", "RC"],
            "axis": ["x", "y", "z"],
        },
        attrs={"origin": "simulated", "sigma_max": 1e5, "levels": [0.0, 0.5]},
    )


def table() -> xr.Dataset:
    return xr.Dataset({"rho": ("marker", [0.5, np.nan])}, coords={"marker": ["LL", "é"]})


class Once:
    """A computation that counts its calls."""

    def __init__(self, made: xr.Dataset) -> None:
        self.made, self.calls = made, 0

    def __call__(self) -> xr.Dataset:
        self.calls += 1
        return self.made


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"file://{tmp_path}/bucket with blanks/of a study"


def folder(url: str) -> Path:
    return Path(url.removeprefix("file://"))


@pytest.mark.parametrize("made", [trajectory(), table()], ids=["zarr", "netcdf"])
@pytest.mark.parametrize("protocol", ["file", "memory"])
def test_a_result_of_another_machine_is_copied_unchanged(
    made: xr.Dataset, protocol: str, url: str, tmp_path: Path
) -> None:
    where = url if protocol == "file" else f"memory://{tmp_path.name}"
    compute = Once(made)
    first = Store(tmp_path / "a", objects=Objects(where)).get_or_compute(STAGE, {}, {}, compute)
    other = Store(tmp_path / "b", objects=Objects(where)).get_or_compute(STAGE, {}, {}, compute)
    assert (first.outcome, other.outcome, compute.calls) == ("computed", "reused", 1)
    xr.testing.assert_identical(first.dataset, other.dataset)
    for name, variable in first.dataset.variables.items():
        assert other.dataset[name].dtype == variable.dtype, name
    assert other.computed == first.computed and other.environment == first.environment
    # Without object storage the copy is a complete result of its store.
    again = Store(tmp_path / "b").get_or_compute(STAGE, {}, {}, compute)
    assert again.outcome == "reused"


def test_trajectories_can_be_read_from_the_storage_as_zarr(url: str, tmp_path: Path) -> None:
    result = Store(tmp_path / "a", objects=Objects(url)).get_or_compute(STAGE, {}, {}, trajectory)
    index = json.loads((folder(url) / "double" / f"{result.digest}.json").read_text())
    opened = xr.open_zarr(f"{url}/double/{result.digest}/{index['object']}", decode_times=False)
    np.testing.assert_array_equal(opened["position"], trajectory()["position"])
    assert opened["position"].attrs["units"] == "m"


@pytest.mark.parametrize("made", [trajectory(), table()], ids=["zarr", "netcdf"])
@pytest.mark.parametrize("damage", ["cut", "changed", "missing", "index"])
def test_a_damaged_object_is_reported_and_replaced(
    made: xr.Dataset, damage: str, url: str, tmp_path: Path
) -> None:
    compute, messages = Once(made), list[str]()
    Store(tmp_path / "a", objects=Objects(url)).get_or_compute(STAGE, {}, {}, compute)
    files = [path for path in folder(url).rglob("*") if path.is_file()]
    content = [f for f in files if f.suffix != ".json" and not f.name.startswith(".z")]
    largest = max(content, key=lambda f: f.stat().st_size)  # zarr reads a missing chunk as zeros
    data = largest.read_bytes()
    if damage == "cut":
        largest.write_bytes(data[: len(data) // 2])
    elif damage == "changed":
        largest.write_bytes(data[:-9] + bytes(255 - b for b in data[-9:]))
    elif damage == "missing":
        largest.unlink()
    else:
        next(f for f in files if f.parent.name == "double").write_text("{")
    store = Store(tmp_path / "b", report=messages.append, objects=Objects(url))
    again = store.get_or_compute(STAGE, {}, {}, compute)
    assert again.outcome == "recomputed" and compute.calls == 2
    assert len(messages) == 1 and "computed again" in messages[0]
    xr.testing.assert_identical(again.dataset.drop_attrs(), made.drop_attrs())
    # The damaged object was replaced by a valid one.
    third = Store(tmp_path / "c", objects=Objects(url)).get_or_compute(STAGE, {}, {}, compute)
    assert third.outcome == "reused" and compute.calls == 2


def test_of_two_writers_the_storage_keeps_one_complete_result(url: str, tmp_path: Path) -> None:
    # Both compute before either writes, and their results differ by measured times.
    objects, compute = Objects(url), Once(table())
    results = []
    for name, seconds in (("a", 1.0), ("b", 2.0)):
        made = table().assign_attrs(seconds=seconds)
        results.append(Store(tmp_path / name).get_or_compute(STAGE, {}, {}, Once(made)))
    for result in results:
        objects.publish(result.path)
    third = Store(tmp_path / "c", objects=objects).get_or_compute(STAGE, {}, {}, compute)
    assert third.outcome == "reused" and third.dataset.attrs["seconds"] == 2.0


def test_results_of_runs_without_storage_are_added(url: str, tmp_path: Path) -> None:
    store, objects = Store(tmp_path / "a"), Objects(url)
    for h in (1, 2, 3):
        store.get_or_compute(STAGE, {}, {"h": h}, table)
    (store.folder / "double" / "half.json").write_text("{}")  # its file is not there yet
    assert objects.add_missing(store.folder) == 3
    assert objects.add_missing(store.folder) == 0


def test_an_interrupted_copy_is_no_result(url: str, tmp_path: Path, monkeypatch) -> None:
    objects, compute = Objects(url), Once(table())

    def lost(*_: object, **__: object) -> None:
        raise ConnectionResetError("connection reset by peer")

    monkeypatch.setattr(type(url_to_fs(url)[0]), "pipe_file", lost)
    with pytest.raises(StoreError, match="connection reset by peer.*run the same command again"):
        Store(tmp_path / "a", objects=objects).get_or_compute(STAGE, {}, {}, compute)
    monkeypatch.undo()
    other = Store(tmp_path / "b", objects=Objects(url)).get_or_compute(STAGE, {}, {}, compute)
    assert other.outcome == "computed" and compute.calls == 2


def test_unusable_addresses_are_one_sentence(tmp_path: Path, monkeypatch) -> None:
    with pytest.raises(ConfigurationError, match="abc://bucket cannot be used.*s3://bucket/folder"):
        Objects("abc://bucket")
    readonly = tmp_path / "readonly"
    readonly.write_text("a file, no folder")
    with pytest.raises(StoreError, match="cannot be used"):
        Store(tmp_path / "a", objects=Objects(f"file://{readonly}")).get_or_compute(
            STAGE, {}, {}, table
        )
    monkeypatch.setitem(sys.modules, "fsspec.core", None)
    with pytest.raises(
        ConfigurationError, match=r"requires the package fsspec.*emgface\[objects\]"
    ):
        Objects("memory://x")
