"""Stored stages: reuse, recomputation, and damaged files."""

import errno
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import StoreError
from emgface.run import store as store_module
from emgface.run.digest import canonical_json, code_version, dataset_digest
from emgface.run.store import Stage, Store

STAGE = Stage("double", ("emgface.run.store",))


class Doubling:
    """A computation that counts its calls."""

    def __init__(self, value: float = 1.5) -> None:
        self.value, self.calls = value, 0

    def __call__(self) -> xr.Dataset:
        self.calls += 1
        values = xr.DataArray(2 * self.value * np.ones(50), dims="time", attrs={"units": "m"})
        return xr.Dataset({"position": values}, attrs={"origin": "simulated"})


def test_a_second_request_reads_what_the_first_wrote(tmp_path: Path) -> None:
    compute = Doubling()
    first = Store(tmp_path).get_or_compute(STAGE, {"face": "f0"}, {"h": 0.01}, compute)
    again = Store(tmp_path).get_or_compute(STAGE, {"face": "f0"}, {"h": 0.01}, compute)
    assert (first.outcome, again.outcome, compute.calls) == ("computed", "reused", 1)
    xr.testing.assert_identical(first.dataset, again.dataset)


@pytest.mark.parametrize(
    "change", [({"face": "f1"}, {"h": 0.01}), ({"face": "f0"}, {"h": 0.02}), ({}, {"h": 0.01})]
)
def test_another_input_or_parameter_is_another_result(tmp_path: Path, change) -> None:
    store, compute = Store(tmp_path), Doubling()
    first = store.get_or_compute(STAGE, {"face": "f0"}, {"h": 0.01}, compute)
    other = store.get_or_compute(STAGE, *change, compute)
    assert other.outcome == "computed" and other.digest != first.digest and compute.calls == 2


def test_other_source_text_is_another_result(tmp_path: Path, monkeypatch) -> None:
    store, compute = Store(tmp_path), Doubling()
    first = store.get_or_compute(STAGE, {}, {}, compute)
    monkeypatch.setattr(store_module, "code_version", lambda modules: "edited")
    assert store.get_or_compute(STAGE, {}, {}, compute).digest != first.digest


@pytest.mark.parametrize("name", ["law.py", "law.toml", "law.csv"])
@pytest.mark.parametrize("module", ["laws_of_a_test", "laws_of_a_test.law"])
def test_code_version_follows_source_and_data(
    tmp_path: Path, monkeypatch, name: str, module: str
) -> None:
    package = tmp_path / "laws_of_a_test"
    package.mkdir()
    for file in ("__init__.py", "law.py", name):
        (package / file).write_text("")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "laws_of_a_test", raising=False)  # of the case before
    before = code_version.__wrapped__((module,))
    assert code_version.__wrapped__((module,)) == before
    (package / name).write_text("x = 2\n")
    assert code_version.__wrapped__((module,)) != before


def test_code_version_of_an_unknown_module_names_it() -> None:
    with pytest.raises(StoreError, match="no_such_module"):
        code_version(("no_such_module",))


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def flip_a_byte(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))


def put_another_dataset(path: Path) -> None:
    xr.Dataset({"foreign": ("time", np.zeros(3))}).to_netcdf(path)


def lose_the_index(path: Path) -> None:
    path.with_suffix(".json").unlink()


def lose_the_file(path: Path) -> None:
    path.unlink()


def garble_the_index(path: Path) -> None:
    path.with_suffix(".json").write_text("{")


def index_of_another_result(path: Path) -> None:
    index = path.with_suffix(".json")
    known = json.loads(index.read_text())
    known["key"]["parameters"] = {"h": 1.0}
    index.write_text(json.dumps(known))


@pytest.mark.parametrize(
    ("harm", "said"),
    [
        (truncate, "were written"),
        (flip_a_byte, "differs from the written result"),
        (put_another_dataset, "were written"),
        (lose_the_index, "no index"),
        (lose_the_file, "is missing, but its index exists"),
        (garble_the_index, "index that cannot be read"),
        (index_of_another_result, "computed from other inputs"),
    ],
)
def test_a_damaged_result_is_reported_and_recomputed(tmp_path: Path, harm, said: str) -> None:
    messages: list[str] = []
    store, compute = Store(tmp_path, report=messages.append), Doubling()
    first = store.get_or_compute(STAGE, {}, {}, compute)
    harm(first.path)
    again = store.get_or_compute(STAGE, {}, {}, compute)
    assert again.outcome == "recomputed" and compute.calls == 2
    assert len(messages) == 1 and said in messages[0] and "double" in messages[0]
    xr.testing.assert_identical(first.dataset, again.dataset)
    assert store.get_or_compute(STAGE, {}, {}, compute).outcome == "reused"


def test_an_interrupted_write_leaves_no_file(tmp_path: Path, monkeypatch) -> None:
    store, compute = Store(tmp_path), Doubling()

    def half_then_stop(self: xr.Dataset, path: Path, **options: object) -> None:
        Path(path).write_bytes(b"half")
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(xr.Dataset, "to_netcdf", half_then_stop)
        with pytest.raises(KeyboardInterrupt):
            store.get_or_compute(STAGE, {}, {}, compute)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []
    assert store.get_or_compute(STAGE, {}, {}, compute).outcome == "computed"


def test_a_failed_computation_stores_nothing(tmp_path: Path) -> None:
    def fail() -> xr.Dataset:
        raise ZeroDivisionError

    store = Store(tmp_path)
    with pytest.raises(ZeroDivisionError):
        store.get_or_compute(STAGE, {}, {}, fail)
    assert list(tmp_path.rglob("*.nc")) == [] and store.events == []


def test_the_index_states_the_inputs_of_a_result(tmp_path: Path) -> None:
    result = Store(tmp_path).get_or_compute(
        STAGE, {"face": "f0"}, {"h": 0.01}, Doubling(), label="S1 A 1"
    )
    index = json.loads(result.path.with_suffix(".json").read_text())
    assert index["label"] == "S1 A 1"
    assert index["key"]["inputs"] == {"face": "f0"}
    assert index["key"]["parameters"] == {"h": 0.01}
    assert index["key"]["code"]["modules"] == ["emgface.run.store"]


def test_parameters_without_a_canonical_text_are_refused() -> None:
    with pytest.raises(StoreError, match="finite numbers"):
        canonical_json({"sigma_max": float("nan")})
    assert canonical_json({"b": 1, "a": [True]}) == '{"a":[true],"b":1}'


def test_the_dataset_digest_depends_on_values_names_and_units() -> None:
    base = Doubling()()
    assert dataset_digest(base) == dataset_digest(base.copy(deep=True))
    moved = base.copy(deep=True)
    moved["position"][7] += 1e-12
    named = base.rename(position="velocity")
    relabelled = base.copy(deep=True)
    relabelled["position"].attrs["units"] = "mm"
    digests = {dataset_digest(d) for d in (base, moved, named, relabelled)}
    assert len(digests) == 4


def test_dataset_digest_survives_a_file(tmp_path: Path) -> None:
    base = Doubling()().assign_coords(time=np.arange(50) * 0.01)
    base = base.assign(name=("marker", np.array(["corner", "lip"])))
    base.to_netcdf(tmp_path / "a.nc")
    assert dataset_digest(xr.load_dataset(tmp_path / "a.nc")) == dataset_digest(base)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(StoreError, match="taken"):
        Store(tmp_path / "taken" / "inside")


@pytest.mark.parametrize("suffix", [".nc", ".json"])
def test_a_folder_with_the_name_of_a_result_is_an_error(tmp_path: Path, suffix: str) -> None:
    store = Store(tmp_path, report=lambda text: None)
    path = store.get_or_compute(STAGE, {}, {}, Doubling()).path.with_suffix(suffix)
    path.unlink()
    path.mkdir()
    with pytest.raises(
        StoreError, match="is a folder, expected the name|cannot be written .Is a directory.: make"
    ):
        store.get_or_compute(STAGE, {}, {}, Doubling())


def test_a_store_on_a_file_system_that_is_read_only_is_an_error(
    tmp_path: Path, monkeypatch
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "touch", refuse)
    monkeypatch.setattr(Path, "unlink", refuse)
    with pytest.raises(StoreError, match="Read-only file system; expected a writable folder"):
        Store(tmp_path).get_or_compute(STAGE, {}, {}, Doubling())
