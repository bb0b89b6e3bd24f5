"""Run tables of other jobs than trials: several recordings inverted by workers."""

import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.choices import configure
from emgface.cli import app
from emgface.errors import ConfigurationError, DataError, ExecutionError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.calibrate import calibrate
from emgface.inverse.calibrate_many import calibrate_all
from emgface.inverse.doubts import doubts
from emgface.inverse.many import invert_all
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.recordings.dataset import read_recording, write_recording
from emgface.run.state import read_state
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf
from emgface.signals.activation import feature_range
from emgface.signals.parameters import SignalChain
from emgface.study import outcomes as workers
from emgface.study.configuration import StudyConfiguration
from emgface.study.stages import Laboratory
from tests.study_run.conftest import MECHANICS

STUDY = configure(StudyConfiguration, {"simulation": MECHANICS})
STEPWISE = InverseParameters(variant="motion", form="step")


@pytest.fixture
def recordings(laboratory: Path, tmp_path: Path) -> list[Path]:
    """B, and E without its markers in the first 0.2 s."""
    made = list[Path]()
    for name in ("S01_B_1", "S01_E_1"):
        one = read_recording(laboratory / "recordings" / f"{name}.nc")
        if name == "S01_E_1":
            one["position"] = one["position"].where(one["time_marker"] > 0.2)
        made.append(write_recording(one, tmp_path / "given" / f"{name}.nc"))
    return made


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_recordings_are_inverted_alike_by_any_number_of_workers_and_continued(
    recordings: list[Path], slab: xr.Dataset, tmp_path: Path
) -> None:
    def inverted(name: str, **options):
        return invert_all(recordings, slab, STUDY, tmp_path / name, STEPWISE, **options)

    alone = invert(
        read_recording(recordings[0]), slab, STUDY.simulation, STUDY.signals, STEPWISE
    ).drop_attrs()
    called = ef.invert(recordings[0], slab, study=STUDY, variant="motion", form="step")
    xr.testing.assert_identical(called.drop_attrs(), alone)
    for name, count in (("one", 1), ("two", 2)):
        good, bad = inverted(name, workers=count)
        assert good.status == "ok" and 0.0 < good.misfit_ratio < 0.5
        assert bad.status == "failed:MarkerError" and "not visible" in bad.reason
        written = read_netcdf(tmp_path / name / "S01_B_1.nc", "activation")
        xr.testing.assert_identical(written.drop_attrs(), alone)
        assert not (tmp_path / name / "S01_E_1.nc").exists()
        state = read_state(tmp_path / name)
        assert state.runs[-1].state == "finished" and state.total == 2
        assert state.status == {"ok": 1, "failed:MarkerError": 1}
        assert state.failures[0][0] == "S01_E_1"
    (tmp_path / "one" / "S01_B_1.nc").unlink()
    again, _ = inverted("one")
    assert again.misfit == good.misfit and (tmp_path / "one" / "S01_B_1.nc").exists()
    events = [name for name, (n, _) in read_state(tmp_path / "one").sizes.items() if n]
    assert sorted(events) == ["inverted", "rest"]
    assert len(list((tmp_path / "one" / "store" / "inverted").glob("*.nc"))) == 1
    with pytest.raises(KeyboardInterrupt):
        inverted("stopped", stopping=lambda: True)
    assert read_state(tmp_path / "stopped").runs[-1].state == "interrupted"


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_calibration_is_the_same_by_any_number_of_workers_and_continued(
    recordings: list[Path], laboratory: Path, slab: xr.Dataset, tmp_path: Path
) -> None:
    good, brief = list[Path](), InverseParameters(iterations=1)
    for name in ("S01_B_1", "S01_E_1"):
        one = read_recording(laboratory / "recordings" / f"{name}.nc")
        one = one.sel(time_emg=slice(0.0, 0.8), time_marker=slice(0.0, 0.8))
        good.append(write_recording(one, tmp_path / "short" / f"{name}.nc"))

    def calibrated(name: str, paths: list[Path], **options) -> xr.Dataset:
        return plain(calibrate_all(paths, slab, STUDY, tmp_path / name, brief, **options).data)

    def plain(estimate: xr.Dataset) -> xr.Dataset:
        return estimate.drop_attrs().assign(model_error=estimate.attrs["model_error"])

    trials = [read_recording(path) for path in good]
    known = calibrate(trials, slab, STUDY.simulation, STUDY.signals, brief)
    alone = plain(known.data)
    assert 8 <= alone["estimated"].sum() <= 10 and 0.0 < known.model_error < 1.0
    assert np.ptp(alone["gain"].values) > 0.05
    xr.testing.assert_identical(calibrated("two", good, workers=2), alone)
    with pytest.raises(DataError, match=r"1 of 2 calibration trials .*S01_E_1: MarkerError"):
        calibrated("one", [good[0], recordings[1]])
    fits = tmp_path / "one" / "store" / "calibration_trial"
    assert not list(fits.glob("*.nc.unfinished.npz"))
    xr.testing.assert_identical(calibrated("one", good), alone)
    before = {path: path.stat().st_mtime_ns for path in fits.glob("*.nc")}
    assert "mixing" in calibrated("one", good, cross_talk=True)
    assert before == {path: path.stat().st_mtime_ns for path in fits.glob("*.nc")}
    state = read_state(tmp_path / "one")
    assert state.runs[-1].state == "finished" and state.status == {"ok": 2}
    with pytest.raises(KeyboardInterrupt):
        calibrated("stopped", good, stopping=lambda: True)
    driven = InverseParameters(variant="driven", form="step")
    estimate = invert(trials[0], slab, STUDY.simulation, STUDY.signals, driven, calibration=known)[
        "emg_activation"
    ]
    assert 0.0 < float(estimate.max()) <= float(alone["gain"].max())


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_a_range_over_the_session_fits_an_inversion(laboratory: Path, slab: xr.Dataset) -> None:
    """Muscles that were not recorded are left out in the inversion, but not in the range."""
    recording = read_recording(laboratory / "recordings" / "S01_B_1.nc")
    chain = configure(SignalChain, {"normalisation": {"reach": "session"}})
    session = feature_range([recording], chain)
    inverse = invert(recording, slab, STUDY.simulation, chain, STEPWISE, session=session)
    other = configure(SignalChain, {"normalisation": {"reach": "session"}, "filter": {"low": 30.0}})
    assert float(inverse["emg_activation"].max()) == pytest.approx(1.0, abs=0.05)
    with pytest.raises(ConfigurationError, match="differ from those of this chain"):
        invert(recording, slab, STUDY.simulation, other, STEPWISE, session=session)


def test_results_never_replace_recordings_or_one_another(
    recordings: list[Path], slab: xr.Dataset, tmp_path: Path
) -> None:
    with pytest.raises(DataError, match="contains the recordings"):
        invert_all(recordings, slab, STUDY, recordings[0].parent)
    with pytest.raises(DataError, match="2 recordings are named S01_B_1"):
        invert_all([recordings[0], tmp_path / "S01_B_1.edf"], slab, STUDY, tmp_path / "out")


def test_command_inverts_several_recordings_and_reports_those_that_failed(
    recordings: list[Path], laboratory: Path, tmp_path: Path
) -> None:
    out, study = tmp_path / "out", tmp_path / "study.toml"
    study.write_text('[simulation]\nsolver = "linearly_implicit"\nstep = 0.02\noutput = 0.02\n')
    options = ["--face", str(laboratory / "face.nc"), "--study", str(study), "--variant", "motion"]
    paths = [str(path) for path in recordings]
    result = CliRunner().invoke(
        app,
        ["invert", "run", *paths, "--out", str(out), *options, "--form", "step", "--workers", "1"],
    )
    assert result.exit_code == 1, result.output
    assert "Failed: S01_E_1: MarkerError: marker" in result.output
    assert "Wrote 1 of 2 activations" in result.output
    dataset = read_netcdf(out / "S01_B_1.nc", "activation")
    assert np.isfinite(dataset["activation"].values).all()
    result = CliRunner().invoke(app, ["study", "status", str(out)])
    assert result.exit_code == 0 and "inverse, motion: 2 of 2" in result.output, result.output
    assert Store(out / "store").folder.is_dir()


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_command_inverts_one_recording_and_keeps_its_result(
    laboratory: Path, tmp_path: Path
) -> None:
    out, study = tmp_path / "one.nc", tmp_path / "study.toml"
    study.write_text('[simulation]\nsolver = "linearly_implicit"\nstep = 0.02\noutput = 0.02\n')
    given = [
        "invert", "run", str(laboratory / "recordings" / "S01_B_1.nc"), "--out", str(out), "--face",
        str(laboratory / "face.nc"), "--study", str(study), "--form", "step", "--gain", "0.5",
        "--leave-out", "corner_left",
    ]  # fmt: skip
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0 and "assisted" in result.output, result.output
    dataset = read_netcdf(out, "activation")
    chosen = json.loads(dataset.attrs["parameters"])
    assert chosen["left_out"] == ["corner_left"] and chosen["gain"] == 0.5
    assert dataset.attrs["strategy"] == "assisted" and float(dataset["activation"].max()) > 0.01
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0 and "exists and is kept" in result.output.replace("\n", " ")
    # its strength is kept, because the same activation of another one is another motion
    assert dataset.attrs["sigma_max"] == STUDY.simulation.sigma_max
    same, other = MECHANICS, MECHANICS | {"sigma_max": 115e3}
    with pytest.warns(UserWarning, match="relative to a largest stress of 300000 Pa"):
        ef.simulate(dataset, laboratory / "face.nc", **other)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ef.simulate(dataset, laboratory / "face.nc", **same)


@pytest.mark.parametrize("sigma_max", [SimulationParameters().sigma_max, 115e3, 30e3])
def test_doubts_tell_a_fit_that_did_not_converge_and_nothing_of_the_stress(
    sigma_max: float,
) -> None:
    """The stress of persons is unknown: no value is doubted, in particular not the default."""
    attrs = {"rest_ratio": 0.0, "misfit_ratio": 0.1, "sigma_max": sigma_max, "interval": 0.9}
    assert doubts(xr.Dataset(attrs=attrs | {"converged": 1})) == []
    (doubt,) = doubts(xr.Dataset(attrs=attrs | {"converged": 0}))
    assert doubt.startswith("the fit did not converge")


def test_a_worker_refuses_a_reduced_face_that_changed(slab: xr.Dataset, tmp_path: Path) -> None:
    laboratory = Laboratory(Store(tmp_path), slab, STUDY, print)
    workers._keep_face(laboratory, tmp_path)
    workers.read_laboratory((STUDY, tmp_path, laboratory.moved, None, {}), print)
    changed = laboratory.moved | {"reduced": "other"}
    with pytest.raises(ExecutionError, match="was changed while the study ran"):
        workers.read_laboratory((STUDY, tmp_path, changed, None, {}), print)
    reduced = {"reduced": {"file": str(tmp_path / "absent.nc")}}
    study = configure(StudyConfiguration, {"simulation": MECHANICS | reduced})
    with pytest.raises(ExecutionError, match=r"a worker cannot read .*absent\.nc"):
        workers.read_laboratory((study, tmp_path, laboratory.moved, None, {}), print)
