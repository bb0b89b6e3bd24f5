"""Functions of ``import emgface as ef``: the same results as a study, from files or datasets."""

import base64
import html

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.api.given import changed, simulation_of, study_of
from emgface.errors import (
    ConfigurationError,
    DataError,
    SchemaError,
)
from emgface.face.file import save_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.netcdf import write_netcdf
from emgface.signals.parameters import FilterParameters, SignalChain
from tests.study_run.conftest import MECHANICS as SLAB_MECHANICS

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
SIGNALS = {"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}}
MECHANICS = SLAB_MECHANICS | {"step": 0.01, "output": 0.01, "sigma_max": 100e3}


@pytest.fixture(scope="module")
def plan(laboratory):
    return {
        "strategies": ["act_rel"],
        "recordings": {"folder": str(laboratory / "recordings"), "instructions": ["B"]},
        "face": {"path": str(laboratory / "face.nc")},
        "signals": SIGNALS,
        "simulation": MECHANICS,
    }


@pytest.fixture(scope="module")
def result(plan, tmp_path_factory):
    return ef.study(plan, tmp_path_factory.mktemp("study"), progress=False)


@pytest.fixture(scope="module")
def file(laboratory):
    return next((laboratory / "recordings").glob("*_B_*.nc"))


def test_stages_one_by_one_give_the_scores_of_the_study(laboratory, file, result, tmp_path):
    """Tables as keywords, faces and recordings as files or datasets."""
    recording, face = ef.read(file), ef.face(laboratory / "face.nc")
    activation = ef.activate(recording, strategy="act_rel", **SIGNALS)
    done = []
    trajectory = ef.simulate(
        activation, face, progress=lambda *counts: done.append(counts), **MECHANICS
    )
    assert done[-1][0] == done[-1][1] and trajectory.attrs["strategy"] == "act_rel"
    scores = ef.score(file, trajectory, face=laboratory / "face.nc")
    cell = result.cube.squeeze(["volunteer", "instruction", "repetition", "strategy"])
    np.testing.assert_allclose(scores["rho"], cell["rho"], rtol=0, atol=1e-12)
    assert ef.score(recording, trajectory, face=face, score={"form": "as_printed"})["rho"].max() < 1

    write_netcdf(activation, tmp_path / "activation.nc", "activation")
    xr.testing.assert_identical(ef.read(tmp_path / "activation.nc")["activation"].drop_attrs(),
                                activation["activation"].drop_attrs())  # fmt: skip


def test_read_recognises_what_the_package_has_written(laboratory, result):
    assert "rho" in ef.read(result.path)
    assert "bundle_muscle" in ef.read(laboratory / "face.nc")
    with pytest.raises(DataError, match=r"No file .*none\.nc"):
        ef.read("none.nc")


def test_a_study_is_repeated_from_its_store(plan, result):
    again = ef.study(plan, result.path.parent, progress=False)
    assert again.computed() == []


def test_the_strategy_true_uses_the_true_activation(file):
    truth = ef.activate(file, strategy="true", resampling={"steps": 40})
    assert truth.attrs["strategy"] == "true" and truth.sizes["time"] == 41
    low = ef.activate(file, band=(30, 400), **SIGNALS)
    assert '"low":30.0,"high":400.0' in low.attrs["parameters"]


def test_a_generated_face_takes_measures_with_or_without_units():
    generated = ef.face(resolution="coarse", measures={"mouth_width": "52mm"})
    given = ef.face(resolution="coarse", measures={"mouth_width": 0.052})
    xr.testing.assert_identical(generated, given)
    assert generated.attrs["measure_mouth_width"] == 0.052


def test_changes_keep_the_other_settings_of_a_study():
    """Tables are combined with those of the study; an accuracy replaces its solver."""
    plan = study_of({"signals": {"filter": {"low": 30.0}}, "simulation": {"accuracy": "draft"}})
    chain = changed(plan.signals, {"filter": {"high": 400.0}}, "signals")
    assert (chain.filter.low, chain.filter.high) == (30.0, 400.0)
    same = changed(SignalChain(), {"filter": FilterParameters(low=20.0)}, "signals")
    assert same.filter.low == 20.0 and same.feature == SignalChain().feature
    exact = simulation_of(plan.simulation, "reference", {"sigma_max": 80e3})
    assert exact == SimulationParameters(accuracy="reference", sigma_max=80e3)
    published = simulation_of(plan.simulation, None, {"solver": "linearly_implicit"})
    assert published.error_tolerance is None


def test_errors_are_reported(file, laboratory, tmp_path, slab):
    with pytest.raises(ConfigurationError, match="folder for the results"):
        ef.study()
    with pytest.raises(ConfigurationError, match="did you mean 'sigma_max'"):
        ef.simulate(file, slab, sigmamax=1e5)
    with pytest.raises(ConfigurationError, match="unknown parameter 'mormalisation'"):
        ef.activate(file, mormalisation={})
    for wrong, match in (
        ({"strategy": 3}, "unknown strategy '3'"),
        ({"feature": 3}, "'feature.kind' = 3"),
        ({"band": 20}, "two edges"),
    ):
        with pytest.raises(ConfigurationError, match=match):
            ef.activate(file, **wrong)
    with pytest.raises(SchemaError, match="of type NoneType, expected something to show"):
        ef.show(None)
    with pytest.raises(SchemaError, match="kind 'recording', expected 'activation'"):
        ef.simulate(ef.read(file).drop_vars("true_activation"), slab)
    with pytest.raises(DataError, match="of kind 'recording', expected 'activation'"):
        ef.simulate(file, slab)
    save_face(slab, tmp_path / "face.nc")
    with pytest.raises(DataError, match="expected 'trajectory'"):
        ef.score(file, tmp_path / "face.nc")


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda emg: emg.astype(complex), "contains complex128, expected numbers"),
        (lambda emg: emg.astype(object), "contains object, expected numbers"),
        (lambda emg: emg.drop_vars("time_emg"), "no coordinate 'time_emg' of emg"),
    ],
)
def test_samples_and_times_are_real_numbers(file, change, match):
    recording = ef.read(file)
    emg = change(recording["emg"])
    with pytest.raises(SchemaError, match=match):
        ef.activate(recording.drop_vars(["emg", "time_emg"]).assign(emg=emg), strategy="act_rel")


@pytest.fixture(scope="module")
def moving(file, slab):
    """Trajectory with the surface of the slab, and its activation."""
    activation = ef.activate(file, strategy="true", resampling={"steps": 4})
    short = activation.isel(time=slice(0, 2))
    return ef.simulate(short, slab, surface=True, **MECHANICS), short


def test_a_moving_face_is_a_page_in_a_frame_with_a_still_picture(moving, tmp_path):
    trajectory, activation = moving
    view = ef.show(trajectory, activation=activation)
    bundle = view._repr_mimebundle_()
    assert set(bundle) == {"text/plain", "text/html", "image/png"}
    assert base64.b64decode(bundle["image/png"]).startswith(b"\x89PNG")
    assert bundle["text/html"].startswith("<iframe srcdoc=")
    assert html.escape(view.page) in bundle["text/html"]
    assert "Zygomaticus" in view.page or "zygomaticus" in view.page, "activations next to the face"
    assert view.save(tmp_path / "face.html").read_text(encoding="utf-8") == view.page
    assert view.save(tmp_path / "face.png").stat().st_size > 1000


def test_datasets_without_motion_are_drawn_as_figures(moving, result, tmp_path):
    for shown in (moving[1], result.path):
        bundle = ef.show(shown)._repr_mimebundle_()
        assert set(bundle) == {"text/plain", "image/png"}
    still = ef.show(moving[0].drop_vars("surface_position"), tmp_path / "markers.png")
    assert not still.moving and (tmp_path / "markers.png").is_file()
    with pytest.raises(DataError, match="expected a recording"):
        ef.show(xr.Dataset({"a": 1.0}))
