"""The cube of a study is written some volunteers at a time and equals that of all at once."""

from pathlib import Path

import netCDF4
import numpy as np
import pytest
import xarray as xr

from analysis.cube import build_cube
from benchmarks.scale.cube import stub_cube
from benchmarks.scale.stub import outcome, planned
from emgface.errors import SchemaError
from emgface.run.journal import Journal
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.schema.parts import write_netcdf_parts
from emgface.study import assembly
from emgface.study.assembly import Origins
from emgface.study.baselines import MOST_OTHERS, others_of
from emgface.study.outcomes import Entries

TRIALS = planned(2 * 72 + 3)
"""Three volunteers; the last one has a single recording."""


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> tuple[Path, Entries]:
    """Folder with a journal of stub trials, and its entries."""
    folder = tmp_path_factory.mktemp("assembly")
    journal = Journal(folder, {"study": "stub"})
    entries = {
        (*t.place, t.strategy): journal.trial(
            t.label, outcome(t), [], folder, variant="", seconds=1.0, muted=False
        )
        for t in TRIALS
    }
    journal.end("finished", [])
    return folder, entries


def written(made, name: str, at_a_time: int, monkeypatch, checkpoint=lambda: None) -> Path:
    folder, entries = made
    monkeypatch.setattr(assembly, "AT_A_TIME", at_a_time)
    return stub_cube(folder / name, TRIALS, entries, checkpoint)


def test_the_cube_does_not_depend_on_its_parts(made, monkeypatch) -> None:
    whole = read_netcdf(written(made, "whole.nc", 16, monkeypatch), "cube")
    parts = written(made, "parts.nc", 1, monkeypatch)
    xr.testing.assert_identical(read_netcdf(parts, "cube"), whole)
    with netCDF4.Dataset(parts) as opened:
        assert opened["rho"].chunking() == [1, 6, 4, 3, 10]
    direct = build_cube(map(outcome, TRIALS))
    for name in ("rho", "amplitude_ratio", "rmse", "status", "sigma_max"):
        np.testing.assert_array_equal(whole[name].values, direct[name].values)
    assert (
        whole["recording"].sel(volunteer="S00003", instruction="A", repetition=1) == "S00003_A_1.nc"
    )
    assert (
        whole.attrs["title"] == "stub: scores of the simulated face against simulated recordings, w"
    )


def test_an_interruption_leaves_the_former_cube(made, monkeypatch) -> None:
    path = written(made, "kept.nc", 1, monkeypatch)
    before, calls = path.read_bytes(), []

    def stop_at_the_second() -> None:
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(made, "kept.nc", 1, monkeypatch, stop_at_the_second)
    assert path.read_bytes() == before and not list(path.parent.glob(".kept*"))


def test_a_part_with_other_variables_is_refused(tmp_path: Path) -> None:
    cube = build_cube(map(outcome, TRIALS[:144]))
    parts = [
        cube.isel(volunteer=[0]).assign(extra=((), 1.0, {"units": "1"})),
        cube.isel(volunteer=[1]),
    ]
    write_netcdf(cube, tmp_path / "cube.nc", "cube")
    with pytest.raises(SchemaError, match=r"parts of cube.nc differ in extra"):
        write_netcdf_parts(parts, tmp_path / "cube.nc", "cube", "volunteer", dict)
    assert "extra" not in read_netcdf(tmp_path / "cube.nc", "cube")


def test_the_history_counts_the_trials_of_all_parts() -> None:
    origins = Origins()
    for dates in (["2031-02", "2031-01"], ["2031-03", ""]):
        part = xr.Dataset({"computed": ("trial", dates), "computed_with": ("trial", ["a", "a b"])})
        origins.add(part, ['{"a": {"emgface": "1"}, "b": {"emgface": "2"}}'])
    assert origins.last == "2031-03"
    assert origins.history() == [
        "2031-01: emgface 2 (environment b) computed results of 1 trial, the first at 2031-01",
        "2031-03: emgface 1 (environment a) computed results of 3 trials, the first at 2031-01",
    ]


def test_a_volunteer_is_compared_with_others_that_hardly_change() -> None:
    names = [f"S{k}" for k in range(200)]
    others = others_of(names, names)
    assert all(
        len(set(chosen)) == MOST_OTHERS and own not in chosen for own, chosen in others.items()
    )
    counts = np.unique([name for chosen in others.values() for name in chosen], return_counts=True)[
        1
    ]
    assert (counts == MOST_OTHERS).all() and len(counts) == len(names)
    more = others_of(names, [*names, "S200"])
    assert sum(others[name] != more[name] for name in names) == MOST_OTHERS
    few = others_of([*names[:3], "silent"], names[:3])
    assert few == {"S0": ["S1", "S2"], "S1": ["S0", "S2"], "S2": ["S0", "S1"],
                   "silent": ["S0", "S1", "S2"]}  # fmt: skip
