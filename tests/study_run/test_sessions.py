"""Sessions of simulated volunteers: rests, cameras, faults, and the set as BIDS."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS
from emgface.recordings.bids.rules import bids_problems
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import find_recordings, read_recording, write_recording
from emgface.recordings.events import cut_trials, find_repetitions, read_events
from emgface.schema.netcdf import read_netcdf
from emgface.signals.filters import bandpass
from emgface.signals.parameters import FilterParameters
from emgface.volunteers.disturbances import RAIL, Failure, fail, movement_artefacts
from emgface.volunteers.filming import film, occlude, three_cameras
from emgface.volunteers.instructions import true_activation
from emgface.volunteers.person import draw_volunteer
from emgface.volunteers.session import session_events, simulate_session, trial_activation
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED, MISMATCHED
from emgface.volunteers.write import write_set_as_bids
from tests.study_run.test_volunteers_emg import still_lips

PERSON = draw_volunteer(1, 9)
QUICK = VolunteerParameters(emg="noise", resolution="coarse", world=MATCHED)
MECHANICS = configure(
    SimulationParameters,
    {"accuracy": "draft", "step": 0.05, "gravity": False, "contact": {"method": "none"}},
)
"""Parameters without contact: the tests examine recordings and files, and contact would take most of the
run time."""


def motion(seed: int) -> xr.Dataset:
    """Lips that oscillate and return to rest."""
    time = np.arange(0.0, 2.3001, 0.02)
    lips, _ = still_lips(time.size)
    swing = 5e-3 * np.sin(np.pi * np.clip(time / 1.8, 0, 1)) ** 2
    position = lips.assign_coords(time=time) + xr.DataArray(swing, dims="time")
    return position.to_dataset(name="position").assign_attrs(sigma_max=100e3 + seed)


def session(**changes) -> xr.Dataset:
    settings = QUICK.model_copy(update=changes)
    activations = [trial_activation(PERSON, "D", r, settings) for r in (1, 2, 3, 4)]
    _, face = still_lips()
    return simulate_session(PERSON, "D", activations, [motion(r) for r in range(4)], face, settings)


def test_four_repetitions_have_two_seconds_of_rest_around_them() -> None:
    events = session_events("D", 4, QUICK)
    whole = session()
    starts = np.array([0.0, *(events["onset"] + events["duration"])])
    stops = np.array([*events["onset"], float(whole["time_emg"][-1])])
    assert (stops - starts >= 2.0 - 1e-3).all() and len(events) == 4
    for start, stop in zip(starts, stops, strict=True):
        truth = whole["true_activation"].sel(time_true=slice(start + 0.5, stop))
        assert not truth.any()
        emg = whole["emg"].sel(time_emg=slice(start + 0.5, stop))
        assert float(emg.std("time_emg").max()) < 40e-6  # noise, hum and the end of artefacts
    for onset, k in zip(events["onset"], range(1, 5), strict=True):
        expected = trial_activation(PERSON, "D", k, QUICK)
        activation = whole["true_activation"].sel(time_true=slice(onset, onset + 2.2999))
        np.testing.assert_array_equal(
            activation.values, expected.values[:, : activation.sizes["time_true"]]
        )
    assert whole.attrs["true_sigma_max"] == [100e3, 100e3 + 1, 100e3 + 2, 100e3 + 3]


def test_motions_may_last_until_the_next_begins() -> None:
    """Rests of 0.25 s: the last instant of each motion is the first of the next one."""
    settings = QUICK.model_copy(update={"rest": 0.25, "duration": 2.0, "occlusions": 0.0})
    activations = [trial_activation(PERSON, "D", r, settings) for r in (1, 2)]
    motions = [motion(r).interp(time=0.01 * np.arange(226)) for r in range(2)]
    _, face = still_lips()
    whole = simulate_session(PERSON, "D", activations, motions, face, settings)
    onsets = session_events("D", 2, settings)["onset"].to_numpy()
    np.testing.assert_array_equal(onsets, [0.25, 2.5])
    position = whole["position"]
    assert np.isfinite(position).all() and position.sizes["time_marker"] == 476
    first, second = (position.sel(time_marker=slice(t, t + 2.0)) for t in onsets)
    apart = [x - x.isel(time_marker=0) for x in (first, second)]
    assert float(abs(apart[0]).max()) > 4e-3 and float(abs(apart[1]).max()) > 4e-3


def test_repetitions_are_found_in_the_activity_of_a_session() -> None:
    whole, events = session(artefact_probability=0.0), session_events("D", 4, QUICK)
    repetitions = find_repetitions(bandpass(whole["emg"], FilterParameters()))
    assert len(repetitions) == 4
    start, end = (
        repetitions["onset"].values,
        (repetitions["onset"] + repetitions["duration"]).values,
    )
    # bursts last from 0.18 to 0.82 of a trial, and rise over a third of that
    assert ((start > events["onset"] + 0.2) & (start < events["onset"] + 0.8)).all()
    assert ((end > events["onset"] + 1.0) & (end < events["onset"] + 1.7)).all()


def test_repetitions_differ_in_timing_and_the_sides_in_effort() -> None:
    peaks = [trial_activation(PERSON, "D", r, QUICK).sel(muscle="ZYG_L").values for r in (1, 2)]
    assert abs(peaks[0].max() - peaks[1].max()) > 1e-3
    assert np.abs(peaks[0] - peaks[1]).max() > 1e-2
    ratio = PERSON.efforts["ZYG_L"] / PERSON.efforts["ZYG_R"]
    levels = PERSON.levels["ZYG_L"] / PERSON.levels["ZYG_R"]
    assert ratio / levels == pytest.approx(np.exp(PERSON.asymmetry))
    drawn = [draw_volunteer(k, 1) for k in range(1, 200)]
    assert np.corrcoef([p.skill for p in drawn], [p.co_contraction for p in drawn])[0, 1] < -0.999
    assert all(0.0 <= p.skill <= 1.0 and abs(p.asymmetry) <= 0.25 for p in drawn)
    tail = true_activation("E", tail=0.5)
    np.testing.assert_array_equal(tail.values[:, :1801], true_activation("E").values)


def test_three_cameras_see_markers_to_a_tenth_of_a_millimetre() -> None:
    lips, _ = still_lips(200)
    position = lips.rename(time="time_marker")
    position.attrs["units"] = "m"
    seen = film(position, pixel_noise=0.0, rng=np.random.default_rng(0))
    np.testing.assert_allclose(seen, position, atol=1e-9)
    noisy = film(position, pixel_noise=0.1, rng=np.random.default_rng(0)) - position
    spread = noisy.std(["time_marker", "marker"]).values
    # 0.1 pixel at 0.9 m and 2000 pixels is 0.045 mm; it decreases with three views, except in depth
    assert 0.02e-3 < spread.min() and spread.max() < 0.1e-3
    for camera in three_cameras(np.zeros(3)):
        np.testing.assert_allclose(camera.project(np.zeros(3)), [640.0, 512.0], atol=1e-9)
        assert camera.project(np.array([0.0, 0.0, 0.02]))[1] < 512.0  # up is up
        assert camera.project(np.array([0.02, 0.0, 0.0]))[0] < 640.0  # the subject's right is left


def test_markers_are_lost_for_moments() -> None:
    lips, _ = still_lips(10000)
    position = lips.rename(time="time_marker")
    lost = np.isnan(occlude(position, rate=0.2, rng=np.random.default_rng(1)).values)
    assert (lost.all(axis=1) == lost.any(axis=1)).all()  # all axes together
    # 10 markers x 100 s x 0.2 losses of 50 ms each; 200 +- 14 of them
    assert lost[:, 0].mean() == pytest.approx(0.2 * 0.05, rel=0.3)
    runs = np.diff(np.flatnonzero(np.diff(lost[0, 0].astype(int)))[:40])[::2]
    assert runs.max() <= 17


def test_artefacts_lie_below_the_band_of_muscles() -> None:
    time = np.arange(0.0, 60.0, 1 / 2048)
    swings = movement_artefacts(
        time, [1.0, 20.0, 40.0], 14, probability=0.5, amplitude=1e-4, rng=np.random.default_rng(2)
    )
    moved = np.abs(swings).max(axis=1)
    assert 7 <= (moved > 0).sum() <= 14 and 3e-5 < np.median(moved[moved > 0]) < 4e-4
    power = np.abs(np.fft.rfft(swings, axis=1)) ** 2
    frequency = np.fft.rfftfreq(time.size, 1 / 2048)
    assert power[:, frequency > 15].sum() < 0.01 * power.sum()


@pytest.mark.parametrize(
    ("kind", "said"), [("lost", "constant"), ("railed", "constant"), ("hum", "50 Hz")]
)
def test_a_failed_electrode_is_found_by_the_check(kind, said) -> None:
    rng = np.random.default_rng(3)
    trial = session(artefact_probability=0.0)
    time = trial["time_emg"].values
    values = fail(trial["emg"].values, time, [Failure(3, 0.0, kind)], mains_frequency=50.0, rng=rng)
    np.testing.assert_array_equal(np.delete(values, 3, 0), np.delete(trial["emg"].values, 3, 0))
    if kind == "railed":
        assert (values[3] == RAIL).all()
    table = check_recording(trial.assign(emg=trial["emg"].copy(data=values))).set_index("name")
    assert said in table.loc[CHANNELS[3], "reason"]
    others = table[(table["kind"] == "channel")].drop(CHANNELS[3])
    assert (others["verdict"] == "ok").all(), others["reason"].tolist()


def test_failures_are_random_and_reported() -> None:
    message = json.loads(session(electrode_failure=0.9).attrs["electrode_failures"])
    assert 9 <= len(message) <= 14 and set(message) <= set(CHANNELS)
    assert {one["kind"] for one in message.values()} <= {"lost", "hum", "railed"}
    assert json.loads(session().attrs["electrode_failures"]) == {}


@pytest.mark.slow
def test_a_set_of_drawn_faces_as_bids_with_the_truth_next_to_it(tmp_path: Path) -> None:
    short = QUICK.model_copy(update={"duration": 0.8, "keep_sessions": True, "world": MISMATCHED})
    paths = make_volunteers(
        None, tmp_path, n=2, repetitions=2, instructions=("B",), seed=3, settings=short,
        parameters=MECHANICS,
    )  # fmt: skip
    assert [p.stem for p in paths] == ["S01_B_1", "S01_B_2", "S02_B_1", "S02_B_2"]
    write_set_as_bids(paths, tmp_path / "bids", tmp_path / "truth")
    assert bids_problems(tmp_path / "bids") == []
    recordings = find_recordings(tmp_path / "bids")
    assert len(recordings) == 4
    for path, original in zip(recordings, paths, strict=True):
        first, second = read_recording(path, study=True), read_recording(original, study=True)
        assert first.attrs["origin"] == "simulated"
        assert first.attrs["world"] == second.attrs["world"] == "mismatched world"
        assert {k: first.attrs[k] for k in ("volunteer", "instruction", "repetition")} == {
            k: second.attrs[k] for k in ("volunteer", "instruction", "repetition")
        }
        np.testing.assert_array_equal(first["position"], second["position"])
        largest = float(abs(second["emg"]).max())
        np.testing.assert_allclose(first["emg"], second["emg"], rtol=0, atol=2.4e-7 * largest)
        truth = read_netcdf(tmp_path / "truth" / original.name, "activation")
        np.testing.assert_array_equal(truth["activation"], second["true_activation"])
        assert truth.attrs["origin"] == "simulated"
        assert truth.attrs["world"] == "mismatched world"
    events = read_events(tmp_path / "sessions" / "S01_B_events.tsv")
    cuts = list(cut_trials(read_recording(tmp_path / "sessions" / "S01_B.nc"), events))
    for trial, path in zip(cuts, paths[:2], strict=True):
        xr.testing.assert_equal(trial, read_recording(path))
    again = read_recording(write_recording(read_recording(paths[0]), tmp_path / "again.nc"))
    xr.testing.assert_identical(
        again.assign_attrs(source=""), read_recording(paths[0]).assign_attrs(source="")
    )
    faces = [read_recording(p)["position"].isel(time_marker=0).values for p in paths[::2]]
    assert np.nanmax(np.abs(faces[0] - faces[1])) > 2e-3  # two faces, not one
