"""A complete study on a slab of tissue: cube, failed trials, and resumption."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.errors import DataError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.strategy import FOLDS
from emgface.muscles import MEASURED
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.contents import verdict
from emgface.report.methods import methods
from emgface.report.results import open_results
from emgface.run.lines import lines, run_files
from emgface.run.observer import Silent
from emgface.schema.netcdf import read_netcdf
from emgface.study import run as run_module
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED
from tests.study_run.conftest import MECHANICS, STEP

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


def configured(laboratory: Path, **changes) -> StudyConfiguration:
    values = {
        "strategies": ["act_rel"],
        "recordings": {"folder": str(laboratory / "recordings")},
        "face": {"path": str(laboratory / "face.nc")},
        "signals": {"normalisation": {"silent": "zero"}},
        "simulation": MECHANICS | {"sigma_max": 100e3},
    }
    return configure(StudyConfiguration, values | changes)


@pytest.fixture(scope="module")
def finished(laboratory: Path):
    return run_study(configured(laboratory), laboratory / "study")


def stages(result) -> list[str]:
    return sorted(event.stage for event in result.computed())


def stored(result, stage: str, out: Path) -> Path:
    """File of the first result of a stage, in a copy of the study's folder."""
    digest = next(event.digest for event in result.events if event.stage == stage)
    return out / "store" / stage / f"{digest}.nc"


def test_every_trial_has_a_status_and_scores(finished) -> None:
    cube = read_netcdf(finished.path, "cube")
    assert dict(cube.sizes) == {
        "volunteer": 1, "instruction": 2, "repetition": 1, "strategy": 1, "marker": 10,
    }  # fmt: skip
    assert (cube["status"] == "ok").all()
    assert np.isfinite(cube["rho"]).all() and (abs(cube["rho"]) <= 1).all()
    # including left-right-left: the direction of the components determines their sign
    assert (cube["sign_by_direction"] == 1).all() and (cube["direction_cosine"] > 0.75).all()
    assert (cube["sign_disagrees"] == 0).all()
    assert (cube["noise"] > 1e-5).all() and (cube["noise"] < 2e-4).all()
    assert (cube["attenuation"] > 0.9).all() and (cube["attenuation"] <= 1).all()
    assert (cube["sigma_max"] == 100e3).all() and (cube["steps"] >= 80).all()
    assert cube.attrs["origin"] == "simulated" and cube.attrs["face"] == "slab"
    assert json.loads(cube.attrs["configuration"])["simulation"]["step"] == STEP


def test_true_activations_on_the_same_face_have_a_perfect_score(
    laboratory: Path, slab: xr.Dataset, tmp_path: Path
) -> None:
    """The chain behind the activation: head frame, timing, alignment, score.

    In the matched world only the size and the stiffness of the face differ.
    """
    make_volunteers(
        slab, tmp_path, n=1, instructions=("B",), seed=2,
        parameters=configure(SimulationParameters, MECHANICS),
        settings=VolunteerParameters(world=MATCHED, emg="noise"),
    )  # fmt: skip
    recordings = {"folder": str(tmp_path / "recordings"), "instructions": ["B"]}
    study = configured(laboratory, activation_source="true", recordings=recordings)
    cube = run_study(study, tmp_path / "study").cube
    assert cube.attrs["world"] == "matched world"
    assert list(cube["strategy"].values) == ["true"]
    moving = cube["rho"].where(cube["rmse"] > 0)
    assert float(moving.median()) > 0.95
    assert float(abs(cube["shift"]).max()) < 0.05


def test_a_second_run_computes_nothing_and_gives_the_same_cube(
    laboratory, finished, tmp_path: Path
) -> None:
    shared = {"store": laboratory / "study" / "store"}
    for out, options in ((laboratory / "study", {}), (tmp_path, shared)):
        again = run_study(configured(laboratory), out, **options)
        assert stages(again) == [] and again.path.parent == out
        xr.testing.assert_identical(again.cube, finished.cube)
    reported = open_results(tmp_path).laboratory
    assert reported is not None and reported.store.folder == shared["store"].resolve()


def test_only_what_was_deleted_is_computed_again(laboratory, finished, tmp_path: Path) -> None:
    out = tmp_path / "study"
    shutil.copytree(laboratory / "study", out)
    victim = stored(finished, "motion", out)
    victim.unlink()
    victim.with_suffix(".json").unlink()
    again = run_study(configured(laboratory), out)
    assert stages(again) == ["motion"]
    assert again.computed()[0].digest == victim.stem
    np.testing.assert_array_equal(again.cube["rho"].values, finished.cube["rho"].values)


def test_strategies_activate_different_muscles(laboratory, finished) -> None:
    study = configured(laboratory, strategies=["act_all", "act_rel"])
    result = run_study(study, laboratory / "study")
    assert stages(result).count("activation") == 2  # act_all alone: act_rel is there
    active = {
        xr.load_dataset(p).attrs["strategy"]: xr.load_dataset(p).attrs["selected"].split()
        for p in (laboratory / "study" / "store" / "activation").glob("*.nc")
        if xr.load_dataset(p).attrs["instruction"] == "B"
    }
    assert active["act_rel"] == ["LLSAN"] and len(active["act_all"]) == 10


def test_a_changed_score_leaves_the_simulations_alone(laboratory, finished) -> None:
    study = configured(laboratory, score={"form": "as_printed"})
    result = run_study(study, laboratory / "study")
    assert stages(result) == ["baselines"] * 2 + ["scores"] * 2
    # 1.6 s are 81 outputs, fewer where the shift leaves some out: (n - 1)/n
    ratio = (result.cube["rho"] / finished.cube["rho"]).values
    assert ((ratio > 60 / 61) & (ratio <= 80 / 81 + 1e-12)).all()


def test_a_damaged_result_is_reported_and_computed_again(laboratory, finished, tmp_path) -> None:
    out = tmp_path / "study"
    shutil.copytree(laboratory / "study", out)
    victim = stored(finished, "aligned", out)
    victim.write_bytes(victim.read_bytes()[:1000])
    said: list[str] = []

    class Listener(run_module.Silent):
        def message(self, text: str) -> None:
            said.append(text)

    again = run_study(configured(laboratory), out, observer=Listener())
    assert stages(again) == ["aligned"]
    assert [victim.name in text for text in said].count(True) == 1


def test_an_interrupted_study_is_resumed(laboratory, finished, tmp_path, monkeypatch) -> None:
    out, calls = tmp_path / "study", []
    simulate = run_module.Laboratory._move

    def interrupt_the_second(self, *arguments):
        calls.append(arguments)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return simulate(self, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(run_module.Laboratory, "_move", interrupt_the_second)
        with pytest.raises(KeyboardInterrupt):
            run_study(configured(laboratory), out)
    assert len(list((out / "store" / "motion").glob("*.nc"))) == 1
    assert not (out / "cube.nc").exists()
    resumed = run_study(configured(laboratory), out)
    assert stages(resumed) == [
        "aligned", "baselines", "baselines", "motion", "scores", "skin",
        *["typical"] * 4,
    ]  # fmt: skip
    xr.testing.assert_allclose(
        resumed.cube.drop_vars(["run_time", "computed"]),
        finished.cube.drop_vars(["run_time", "computed"]),
    )
    runs = [[line for _, line in lines(path)] for path in run_files(out)]
    assert [run[-1]["outcome"] for run in runs] == ["interrupted", "finished"]
    log = [s["digest"] for run in runs for line in run for s in line.get("stages", ())
           if s["outcome"] == "computed"]  # fmt: skip
    assert len(set(log)) == len(log) == 17  # 7 stages x 2 trials + rest


def test_two_processes_give_the_cube_of_one(laboratory, finished, tmp_path: Path) -> None:
    parallel = run_study(configured(laboratory), tmp_path, workers=2)
    np.testing.assert_array_equal(parallel.cube["rho"].values, finished.cube["rho"].values)
    assert (parallel.cube["status"].values == finished.cube["status"].values).all()
    assert len(stages(parallel)) == len(stages(finished))
    assert (
        stages(run_study(configured(laboratory), tmp_path)) == []
    )  # one process reuses all results


# failed trials remain in the cube


def spoiled(laboratory: Path, folder: Path, change) -> StudyConfiguration:
    """Copy of the recordings in which B was changed."""
    shutil.copytree(laboratory / "recordings", folder / "recordings")
    path = next((folder / "recordings").glob("*_B_*.nc"))
    recording = read_recording(path)
    path.unlink()
    write_recording(change(recording), path)
    return configured(laboratory, recordings={"folder": str(folder / "recordings")})


def without_a_channel(recording: xr.Dataset) -> xr.Dataset:
    return recording.drop_sel(channel="LLSAN_L")


def without_a_marker(recording: xr.Dataset) -> xr.Dataset:
    return recording.drop_sel(marker="nasion")


def with_a_gap(recording: xr.Dataset) -> xr.Dataset:
    recording["emg"][3, 100:200] = np.nan
    return recording


def with_a_lost_marker(recording: xr.Dataset) -> xr.Dataset:
    recording["position"].loc[{"marker": "corner_left"}][:, 50:100] = np.nan
    return recording


@pytest.mark.parametrize(
    ("change", "status", "said"),
    [
        (without_a_channel, "failed:SchemaError", "LLSAN_L"),
        (without_a_marker, "failed:SchemaError", "nasion"),
        (with_a_gap, "failed:SignalError", "gap"),
        (with_a_lost_marker, "failed:MarkerError", "corner_left"),
    ],
)
def test_an_invalid_recording_fails_without_affecting_others(
    laboratory, finished, tmp_path, change, status: str, said: str
) -> None:
    study = spoiled(laboratory, tmp_path, change)
    # motions of the good trial are found in the store of the finished study
    shutil.copytree(laboratory / "study", tmp_path / "study")
    cube = run_study(study, tmp_path / "study").cube
    bad, good = cube.sel(instruction="B").squeeze(), cube.sel(instruction="E").squeeze()
    assert bad["status"].item() == status and said in bad["reason"].item()
    assert bad["rho"].isnull().all()
    assert good["status"].item() == "ok"
    np.testing.assert_array_equal(
        good["rho"].values, finished.cube.sel(instruction="E").squeeze()["rho"].values
    )


def test_a_montage_of_one_side_is_scored_and_reported(laboratory, finished, tmp_path) -> None:
    left = [f"{name}_L" for name in MEASURED]
    study = spoiled(laboratory, tmp_path, lambda recording: recording.sel(channel=left))
    signals = {**study.signals.model_dump(), "montage": {"missing_side": "mirror"}}
    study = configure(StudyConfiguration, study.model_dump() | {"signals": signals})
    shutil.copytree(laboratory / "study", tmp_path / "study")
    cube = run_study(study, tmp_path / "study").cube
    assert (cube["status"] == "ok").all()
    said = cube.attrs["montage"]
    assert "In 1 recording (S01 B 1) 7 of 14 channels were recorded" in said
    assert "copied from the other side: OOS_R" in said and "(S01 E 1) all 14 channels" in said
    assert "Channels: In 1 recording" in methods(study, cube)
    assert verdict(cube)[1].startswith("The montage is incomplete: In 1 recording")
    assert finished.cube.attrs["montage"] == "all 14 channels were recorded"
    assert "montage" not in " ".join(verdict(finished.cube))


def test_a_marker_invisible_at_an_end_is_scored_on_the_rest(laboratory, finished, tmp_path) -> None:
    """0.15 s at the beginning, of which the simulation uses 0.05 s, and 0.05 s at the end, unused."""

    def cut(recording: xr.Dataset) -> xr.Dataset:
        recording["position"].loc[{"marker": "corner_left"}][:, :15] = np.nan
        recording["position"].loc[{"marker": "upper_lateral_left"}][:, -5:] = np.nan
        return recording

    study = spoiled(laboratory, tmp_path, cut)
    shutil.copytree(laboratory / "study", tmp_path / "study")
    cube = run_study(study, tmp_path / "study").cube.sel(instruction="B").squeeze()
    whole = finished.cube.sel(instruction="B").squeeze()
    assert cube["status"].item() == "ok"
    assert float(cube["unseen_ends"]) == pytest.approx(0.05, abs=0.011)
    assert float(cube["overlap"]) == pytest.approx(float(whole["overlap"]), abs=0.05)
    assert float(cube["scale"]) == 1.0
    np.testing.assert_allclose(cube["rho"], whole["rho"], atol=0.05)


def test_a_simulation_that_fails_is_kept_with_the_last_sigma_max(
    laboratory, finished, tmp_path, monkeypatch
) -> None:
    from emgface.study import skin as skin_module
    from sim.errors import InvertedElement

    def inverts(face, activation, parameters, **rest):
        raise InvertedElement(7, -0.1, 0.5)

    study = configured(
        laboratory,
        simulation=MECHANICS | {"sigma_max": 100e3, "sigma_max_policy": {"minimum": 90e3}},
    )
    with monkeypatch.context() as patched:
        patched.setattr(skin_module, "simulate_face", inverts)
        first = run_study(study, tmp_path)
    assert (first.cube["status"] == "failed:InvertedElement").all()
    np.testing.assert_allclose(first.cube["sigma_max"], 90e3)
    assert "lowered 1 times from 100 to 90 kPa" in first.cube["reason"].values.flat[0]
    again = run_study(study, tmp_path)  # the failure is stored: nothing is simulated again
    assert stages(again) == []
    assert (again.cube["status"] == "failed:InvertedElement").all()


def test_a_cell_without_a_recording_is_missing(laboratory, finished, tmp_path) -> None:
    folder = tmp_path / "recordings"
    shutil.copytree(laboratory / "recordings", folder)
    second = read_recording(next(folder.glob("*_E_*.nc"))).assign_attrs(repetition=2)
    write_recording(second, folder / "S01_E_2.nc")
    study = configured(laboratory, recordings={"folder": str(folder)})
    shutil.copytree(laboratory / "study", tmp_path / "study")
    cube = run_study(study, tmp_path / "study").cube.squeeze(["volunteer", "strategy"])
    assert cube["status"].sel(instruction="B", repetition=2).item() == "missing"
    assert "no recording" in cube["reason"].sel(instruction="B", repetition=2).item()
    assert (cube["status"].sel(instruction="E") == "ok").all()


def test_an_unreadable_file_is_omitted_and_listed(laboratory, finished, tmp_path) -> None:
    folder = tmp_path / "recordings"
    shutil.copytree(laboratory / "recordings", folder)
    broken = folder / "S01_F_1.nc"
    broken.write_bytes(next(folder.glob("*_B_*.nc")).read_bytes()[:2000])
    study = configured(laboratory, recordings={"folder": str(folder)})
    shutil.copytree(laboratory / "study", tmp_path / "study")
    result = run_study(study, tmp_path / "study")
    assert list(result.unreadable) == [broken]
    assert (result.cube["status"] == "ok").all()


def test_a_recording_that_cannot_be_read_for_a_while_is_tried_again(laboratory, tmp_path) -> None:
    folder = tmp_path / "recordings"
    shutil.copytree(laboratory / "recordings", folder)
    study = configured(laboratory, recordings={"folder": str(folder)})
    shutil.copytree(laboratory / "study", tmp_path / "study")
    for name in ("runs", "store/activation"):
        shutil.rmtree(tmp_path / "study" / name)
    path, away = folder / "S01_B_1.nc", tmp_path / "away.nc"

    class Unmounted(Silent):
        def working(self, label: str) -> None:
            if label == "S01 B 1 act_rel":
                path.rename(away)

    status = run_study(study, tmp_path / "study", observer=Unmounted()).cube["status"]
    assert status.sel(instruction="B").item() == "failed:RecordingChanged"
    assert status.sel(instruction="E").item() == "ok"
    away.rename(path)
    again = run_study(study, tmp_path / "study")
    assert (again.cube["status"] == "ok").all()


def test_a_folder_of_unreadable_files_is_an_error(laboratory, tmp_path) -> None:
    (tmp_path / "a.nc").write_bytes(b"\x89HDF\r\n\x1a\n and no more")
    study = configured(laboratory, recordings={"folder": str(tmp_path)})
    with pytest.raises(DataError, match=r"a\.nc"):
        run_study(study, tmp_path / "out")


def test_the_same_trial_twice_is_an_error(laboratory, tmp_path) -> None:
    folder = tmp_path / "recordings"
    shutil.copytree(laboratory / "recordings", folder)
    shutil.copy(next(folder.glob("*_B_*.nc")), folder / "again.nc")
    study = configured(laboratory, recordings={"folder": str(folder)})
    with pytest.raises(DataError, match="both volunteer S01, instruction B, repetition 1"):
        run_study(study, tmp_path / "out")


def test_measured_and_simulated_recordings_do_not_mix(laboratory, tmp_path) -> None:
    def measured(recording: xr.Dataset) -> xr.Dataset:
        return recording.assign_attrs(origin="measured").drop_dims(["muscle", "time_true"])

    with pytest.raises(DataError, match="measured and simulated"):
        run_study(spoiled(laboratory, tmp_path, measured), tmp_path / "out")


def test_true_activations_of_a_recording_without_them_fail_by_name(laboratory, tmp_path) -> None:
    def bare(recording: xr.Dataset) -> xr.Dataset:
        return recording.drop_dims(["muscle", "time_true"])

    study = spoiled(laboratory, tmp_path, bare).model_copy(update={"activation_source": "true"})
    study = study.model_copy(
        update={"recordings": study.recordings.model_copy(update={"instructions": ("B",)})}
    )
    cube = run_study(study, tmp_path / "out").cube
    assert cube["status"].item() == "failed:ConfigurationError"


def test_normalisation_over_the_session_uses_all_trials_of_the_volunteer(
    laboratory, finished, tmp_path
) -> None:
    study = configured(
        laboratory, signals={"normalisation": {"silent": "zero", "reach": "session"}}
    )
    result = run_study(study, tmp_path)
    assert (result.cube["status"] == "ok").all()
    assert stages(result).count("range") == 1
    peaks = [
        xr.load_dataset(path)["activation"].max("time")
        for path in (tmp_path / "store" / "activation").glob("*.nc")
    ]
    # with session extremes each selected muscle reaches 1 in one trial, not in every trial
    assert any(float(peak.where(peak > 0).min()) < 0.9 for peak in peaks)


def test_no_marker_is_scored_in_a_simulation_that_follows_it(laboratory, tmp_path: Path) -> None:
    recordings = {"folder": str(laboratory / "recordings"), "instructions": ["B"]}
    study = configured(laboratory, strategies=["inverse"], recordings=recordings)
    result = run_study(study, tmp_path)
    assert (result.cube["status"] == "ok").all() and np.isfinite(result.cube["rho"]).any()
    assert stages(result).count("inverse") == 1 + len(FOLDS)
    files = {p.stem: xr.load_dataset(p) for p in (tmp_path / "store" / "motion").glob("*.nc")}
    joined = [d for d in files.values() if "left_out" in d.attrs]
    assert len(joined) == 1 and len(files) == 1 + len(FOLDS)
    alone = [d["position"] for d in files.values() if "left_out" not in d.attrs]
    used = [  # simulations that contain each marker's motion
        [np.array_equal(x.sel(marker=m), joined[0]["position"].sel(marker=m)) for x in alone]
        for m in joined[0]["marker"].values
    ]
    assert np.array(used).sum(axis=1).tolist() == [1] * 10
    assert np.array(used).sum(axis=0).tolist() == [2] * len(FOLDS)
    tracked = [xr.load_dataset(p) for p in (tmp_path / "store" / "inverse").glob("*.nc")]
    without = [tuple(json.loads(one.attrs["parameters"])["left_out"]) for one in tracked]
    assert set(without) == {(), *FOLDS}
    assert "estimated without this pair" in methods(study, result.cube)


def test_parameters_of_the_inversion_do_not_concern_other_strategies(laboratory, finished) -> None:
    result = run_study(configured(laboratory, inverse={"gain": 0.5}), laboratory / "study")
    assert stages(result) == []
