"""Computing environment of each trial in the cube, and of the report."""

import json
import os
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface import __version__
from emgface.face.file import load_face
from emgface.report import provenance as shown
from emgface.report.results import open_results
from emgface.report.write import render_report
from emgface.run import provenance, store
from emgface.run.digest import dataset_digest
from emgface.schema.netcdf import read_netcdf
from emgface.study.intake import take_in
from emgface.study.run import run_study
from tests.study_run.test_report import text_of
from tests.study_run.test_run import configured

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture(scope="module")
def made(laboratory: Path, tmp_path_factory):
    """A study of B and E under one strategy."""
    return run_study(configured(laboratory), tmp_path_factory.mktemp("provenance"))


def another_version(monkeypatch, **changes) -> None:
    """Replace the environment reported by the store."""
    other = json.loads(provenance.computing_environment()) | {"emgface": "9.9"} | changes
    monkeypatch.setattr(store, "computing_environment", lambda: json.dumps(other))


def test_the_cube_states_its_computing_environment(made) -> None:
    cube = read_netcdf(made.path, "cube")
    listed = json.loads(cube.attrs["environments"])
    (name,) = set(cube["computed_with"].values.flat)
    assert listed == {name: json.loads(provenance.computing_environment())}
    one = listed[name]
    assert one["emgface"] == __version__ and one["packages"]["numpy"] == np.__version__
    assert {"blas", "platform", "processor", "python", "settings", "code"} <= set(one)
    assert re.fullmatch(r"[0-9a-f]{32}", one["code"])
    dates = cube["computed"].values.ravel()
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", date) for date in dates)
    assert cube.attrs["date_created"] == max(dates)


def test_the_threads_of_element_loops_are_no_other_environment(monkeypatch) -> None:
    """They change no bit of a result, and differ between a process and its workers."""
    before = provenance.computing_environment()
    monkeypatch.setenv(
        "NUMBA_NUM_THREADS", "1" if os.environ.get("NUMBA_NUM_THREADS") != "1" else "2"
    )
    assert provenance.computing_environment.__wrapped__() == before


def test_the_cube_states_recordings_face_and_conventions(made, laboratory: Path) -> None:
    cube = made.cube
    for recording in take_in(configured(laboratory).recordings).recordings:
        volunteer, instruction, repetition = recording.place
        one = cube.sel(volunteer=volunteer, instruction=instruction, repetition=repetition)
        assert one["recording"].item() == recording.path.name == f"S01_{instruction}_1.nc"
        assert one["recording_digest"].item() == recording.digest
    assert cube.attrs["Conventions"] == "CF-1.11"
    assert "against simulated recordings, mismatched world" in cube.attrs["title"]
    assert f"emgface {__version__}" in cube.attrs["source"] and "slab" in cube.attrs["source"]
    assert "computed results of 2 trials" in cube.attrs["history"]
    assert cube.attrs["face_digest"] == dataset_digest(load_face(laboratory / "face.nc"))
    assert all(name.isidentifier() for name in cube.attrs)


def test_digests_and_values_do_not_depend_on_the_date(
    made, laboratory: Path, tmp_path, monkeypatch
) -> None:
    """Computation at another time by another version gives the same stages and bits."""
    another_version(monkeypatch)
    monkeypatch.setattr(store, "now", lambda: "2031-01-01T00:00:00Z")
    again = run_study(configured(laboratory), tmp_path)
    assert [e.digest for e in again.events] == [e.digest for e in made.events]
    for name, values in made.cube.data_vars.items():
        if name not in ("run_time", "computed", "computed_with"):
            np.testing.assert_array_equal(again.cube[name].values, values.values, err_msg=str(name))
    assert set(again.cube["computed"].values.flat) == {"2031-01-01T00:00:00Z"}


def test_the_version_is_stored_per_trial_of_a_resumed_study(
    made, laboratory: Path, tmp_path: Path, monkeypatch, without_figures
) -> None:
    """The scores of one trial are deleted and computed by a later version."""
    out = tmp_path / "study"
    shutil.copytree(made.path.parent, out)
    events = [e for e in made.events if e.stage == "scores" and e.label.startswith("S01 E")]
    for suffix in (".nc", ".json"):
        (out / "store" / "scores" / f"{events[0].digest}{suffix}").unlink()
    another_version(monkeypatch)
    cube = run_study(configured(laboratory), out).cube.squeeze()
    assert len(json.loads(cube.attrs["environments"])) == 2
    both = cube["computed_with"].sel(instruction="E").item().split()
    assert len(both) == 2 and cube["computed_with"].sel(instruction="B").item() in both
    assert cube.attrs["source"].startswith(f"emgface {__version__} and 9.9;")
    results = open_results(out)
    table = shown.mixture(results.cube)
    assert table is not None and len(table.rows) == 2
    page = text_of(render_report(results, faces=False))
    assert "2 different environments (emgface of versions" in page
    assert "Trials by computing environment".lower() in page.lower()


def test_the_report_states_the_versions_of_cube_and_page(
    made, tmp_path: Path, monkeypatch, without_figures
) -> None:
    """A report by a later version states both versions."""
    monkeypatch.setattr(shown, "__version__", "7.7")
    results = open_results(made.path.parent)
    page = text_of(render_report(results, faces=False))
    computed, written = page.split("Environment of the cube")[1].split("Environment of this report")
    assert f"emgface {__version__}" in computed and "7.7" not in computed
    assert "emgface 7.7" in written
    digest = made.cube["recording_digest"].sel(instruction="B").item()
    assert digest in page
    old = results.cube.drop_vars(["computed", "computed_with"])
    del old.attrs["environments"]
    assert "not recorded" in shown.warning(old) and shown.mixture(old) is None


def test_the_store_states_date_and_version(tmp_path: Path) -> None:
    def stored() -> store.Result:
        stage = store.Stage("double", ("emgface.run.store",))
        return store.Store(tmp_path).get_or_compute(stage, {}, {}, lambda: xr.Dataset({"x": 1.0}))

    path = stored().path.with_suffix(".json")
    known = json.loads(path.read_text())
    assert known["environment"] == json.loads(provenance.computing_environment())
    assert known["written"].endswith("Z")
    del known["environment"]
    path.write_text(json.dumps(known))
    # An older store is used, without a computing environment.
    again = stored()
    assert again.outcome == "reused"
    assert (again.computed, again.environment) == (known["written"], "")
