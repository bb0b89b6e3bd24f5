"""Reduced faces: training that resumes, binding to a face, doubt and fall-back to full order."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from threadpoolctl import threadpool_limits
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.errors import ConfigurationError, FaceError, SignalError
from emgface.face.file import save_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS, RELEVANT
from emgface.reduced import training
from emgface.reduced.live import LiveFace, heard, live, live_summary
from emgface.reduced.model import ReducedFace, parameters_of
from emgface.reduced.motion import simulate_reduced
from emgface.reduced.parameters import ReductionParameters
from emgface.reduced.plan import TrainingDrive, random_drives, training_plan
from emgface.reduced.stream import Played
from emgface.reduced.study_plan import study_drives
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf, write_netcdf
from sim import Activation, ContactFailure, InvertedElement, Positions

SMALL = ReductionParameters(
    modes=9, omitted=3, elements=60, calibration=3, coverage=0.7, every=0.01
)
PARAMETERS = SimulationParameters(sigma_max=50e3, accuracy="published", contact={"method": "none"})


def short(muscles, *_, **__):
    """Six drives of 0.15 s: right and left muscles at other levels."""
    time, right = np.array([0.0, 0.1, 0.15]), np.array([m.endswith("_R") for m in muscles])
    drives = []
    for k, (a, b) in enumerate(
        [(0.5, 0.5), (0.6, 0.2), (0.2, 0.6), (0.3, 0.4), (0.5, 0.3), (0.4, 0.5)]
    ):
        level = np.where(right, a, b)
        values = np.array([0.0 * level, level, level])
        drives.append(TrainingDrive(str(k), "training" if k < 3 else "calibration", time, values))
    return drives


@pytest.fixture(scope="module")
def face(coarse) -> xr.Dataset:
    return coarse


@pytest.mark.parametrize(
    "failure",
    [ContactFailure("the reach", surface="lips"), InvertedElement(1, -0.1, 0.2)],
    ids=lambda error: type(error).__name__,
)
def test_a_drive_that_fails_is_repeated_with_a_weaker_one(failure, monkeypatch) -> None:
    def moved(_, drive: TrainingDrive, every: float) -> xr.Dataset:
        if drive.values.max() > 0.7:
            raise failure
        return xr.Dataset(attrs={"largest": float(drive.values.max())})

    monkeypatch.setattr(training.FullOrder, "_motion", moved)
    full = object.__new__(training.FullOrder)
    drive = TrainingDrive("a", "training", np.array([0.0, 1.0]), np.ones((2, 1)))
    motion = full.motion(drive, 0.01)
    assert motion.attrs["scale"] == motion.attrs["largest"] == pytest.approx(0.64)
    assert full.motion(drive.scaled(10.0), 0.01).attrs["scale"] == 0.0


@pytest.fixture(scope="module")
def trained(face, tmp_path_factory):
    """Reduced face, its file, and the outcomes of the motions in a first and a second training.

    The second one is called with two threads of linear algebra.
    """
    folder, outcomes, reductions = tmp_path_factory.mktemp("reduced"), [], []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "training_plan", short)
        for threads in (1, 2):
            store = Store(folder / "motions")
            with threadpool_limits(limits=threads, user_api="blas"):
                reductions.append(training.reduce_face(face, PARAMETERS, SMALL, store))
            outcomes.append({event.outcome for event in store.events})
    first, data = (one.assign_attrs(training_time_s=0.0) for one in reductions)
    xr.testing.assert_identical(first, data)
    path = write_netcdf(data, folder / "face.rom.nc", "reduced_face")
    return data, path, outcomes


def activation(face, left, right):
    muscles = list(map(str, face["muscle"].values))
    level = np.array([left if m.endswith("_L") else right for m in muscles])
    values = np.array([0.0 * level, level, level]).T
    return xr.DataArray(
        values, dims=("muscle", "time"), coords={"muscle": muscles, "time": [0.0, 0.1, 0.15]}
    )


def simulate(face, drive, **reduced):
    more = {"reduced": reduced} if reduced else {}
    return ef.simulate(
        drive, face, sigma_max=50e3, accuracy="published", contact={"method": "none"}, **more
    )


def test_training_resumes_and_its_file_is_read_back(trained):
    data, path, outcomes = trained
    assert outcomes == [{"computed"}, {"reused"}]
    assert (
        read_netcdf(path, "reduced_face").attrs["training_digest"] == data.attrs["training_digest"]
    )
    assert (np.diff(data["projection_rms"].values) <= 1e-12).all()


def test_the_command_passes_its_options_to_the_training(face, trained, tmp_path, monkeypatch):
    """Number of modes and elements, sequences and contact; the training itself is that of `trained`."""
    given = []

    def reduce_face(face, parameters, reduction, store, *, progress):
        given.append((parameters, reduction))
        return trained[0]

    monkeypatch.setattr(training, "reduce_face", reduce_face)
    save_face(face, tmp_path / "face.nc")
    size = ["--modes", "9", "--elements", "60", "--seed", "3"]
    plan = ["--activations", "random", "--sequences", "7", "--calibration", "20", "--no-ramps"]
    paths = [str(tmp_path / "face.nc"), "--out", str(tmp_path / "face.rom.nc")]
    done = CliRunner().invoke(app, ["reduce", *paths, *size, *plan, "--no-contact"])
    assert done.exit_code == 0, done.output
    (parameters, reduction), *_ = given
    assert parameters.contact.method == "none"
    assert (reduction.modes, reduction.elements) == (9, 60)
    assert (reduction.activations, reduction.sequences, reduction.seed) == ("random", 7, 3)
    assert (reduction.calibration, reduction.ramps) == (20, False)
    read_netcdf(tmp_path / "face.rom.nc", "reduced_face")


def test_a_reduced_motion_is_that_of_full_order_within_its_bound(face, trained):
    drive = activation(face, 0.35, 0.45)
    reduced, full = simulate(face, drive, file=trained[1]), simulate(face, drive)
    assert reduced.attrs["reduced"] == 1 and reduced.attrs["reduction_doubt"] == ""
    apart = (reduced["position"] - full["position"]).transpose("time", "marker", "axis").values
    error = np.linalg.norm(apart, axis=2).max(axis=1)
    assert (error <= reduced["reduction_error"].values).all()
    assert error.max() < 0.1 * full.attrs["motion"]
    assert abs(reduced["lip_opening"] - full["lip_opening"]).max() < 0.1 * full.attrs["motion"]


def test_an_activation_outside_the_training_is_simulated_at_full_order(face, trained):
    drive = activation(face, 0.0, 0.0)
    drive.loc[{"muscle": "ZYG_L"}] = [0.0, 0.9, 0.9]  # muscles of a side always act together
    reduced, full = simulate(face, drive, file=trained[1]), simulate(face, drive)
    assert reduced.attrs["reduced"] == 0 and "farther than any" in reduced.attrs["reduction_doubt"]
    np.testing.assert_array_equal(reduced["position"], full["position"])
    kept = simulate(face, drive, file=trained[1], fall_back=False)
    assert kept.attrs["reduced"] == 1 and "farther than any" in kept.attrs["reduction_doubt"]


def test_a_jump_of_all_muscles_is_not_trusted(face, trained):
    """The level is one of the training, which reaches it within 0.1 s; also between two outputs."""
    level = np.full(len(face["muscle"]), 0.45)
    reduced = ReducedFace.for_face(trained[0], face, PARAMETERS)
    assert reduced.trained.distances(level[None])[0] < reduced.trained.distance
    ramp = Activation(np.array([0.0, 0.1]), np.array([0.0 * level, level]))
    assert simulate_reduced(reduced, ramp, 0.2).attrs["reduction_doubt"] == ""
    constant = Activation(np.zeros(1), level[None])
    times = np.array([0.0, 0.1, 0.105, 0.11, 0.2])
    spike = Activation(times, np.outer([0.0, 0.0, 1.0, 0.0, 0.0], level))
    for drive, step, when in (
        (constant, 0.01, "0.01"),
        (constant, 0.005, "0.005"),
        (spike, 0.005, "0.105"),
    ):
        reduced_motion = simulate_reduced(reduced, drive, 0.2, step=step, output=0.1)
        assert reduced_motion.attrs["reduction_doubt"].startswith(
            f"the activation jumps at {when} s"
        )
    for first, inside in ((0.1 * level, True), (level, False)):
        assert LiveFace(reduced, 0.01)(first)[3] == inside


def test_an_activation_that_is_not_a_number_is_not_trusted(face, trained):
    reduced = ReducedFace.for_face(trained[0], face, PARAMETERS)
    times = np.array([0.01, 0.02])
    unknown = np.full((2, len(face["muscle"])), np.nan)
    assert "nan from rest" in reduced.trained.doubt(times, unknown)


def test_a_probe_of_full_order_sees_all_nodes_of_a_reduced_face(face, trained):
    """At the start and at all outputs; a marker without its correction is a node."""
    reduced = ReducedFace.for_face(trained[0], face, PARAMETERS)
    n = len(face["muscle"])
    drive = Activation(np.array([0.0, 0.1]), np.array([np.zeros(n), np.full(n, 0.4)]))
    motion = simulate_reduced(reduced, drive, 0.1, further=(Positions(),))
    seen = motion["node_position"].transpose("time", "node", "axis").values
    assert seen.shape == (11, *reduced.rest.shape)
    assert np.abs(seen - reduced.rest).max() > 1e-3
    corrected = motion["position"].transpose("time", "marker", "axis").values
    apart = seen[:, face["marker_node"].values.astype(int)] - corrected
    assert np.abs(apart).max() < 0.1 * np.abs(seen - seen[0]).max()


def test_longer_steps_than_in_the_training_are_not_trusted(face, trained):
    reduced = ReducedFace.for_face(trained[0], face, PARAMETERS)
    muscles = list(map(str, face["muscle"].values))
    level = np.where([m.endswith("_L") for m in muscles], 0.35, 0.45)
    drive = Activation(np.array([0.0, 0.1]), np.array([0.0 * level, level]))
    for step, doubt in ((0.005, ""), (0.01, ""), (0.02, "the steps of 0.02 s are longer")):
        reduced_motion = simulate_reduced(reduced, drive, 0.2, step=step, output=0.02)
        assert reduced_motion.attrs["reduction_doubt"].startswith(doubt) and bool(doubt) == bool(
            reduced_motion.attrs["reduction_doubt"]
        )


def test_realtime_never_repeats_a_trial_at_full_order(face, trained):
    options = {"sigma_max": 50e3, "accuracy": "realtime", "contact": {"method": "none"}}
    strict = {"file": trained[1], "largest_error": 1e-9}
    motion = ef.simulate(activation(face, 0.35, 0.45), face, reduced=strict, **options)
    assert motion.attrs["reduced"] == 1 and "above 1e-06 mm" in motion.attrs["reduction_doubt"]
    with pytest.raises(ConfigurationError, match="'realtime' requires a reduced face"):
        ef.simulate(activation(face, 0.35, 0.45), face, **options)


def test_a_bound_that_is_too_large_is_not_trusted(face, trained):
    drive = activation(face, 0.35, 0.45)
    motion = simulate(face, drive, file=trained[1], largest_error=1e-9)
    assert motion.attrs["reduced"] == 0 and "above 1e-06 mm" in motion.attrs["reduction_doubt"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"C10": 2000.0}, "trained with C10 = 2500.0, found 2000.0"),
        ({"sigma_max": 60e3}, "trained with sigma_max = 50000 Pa, found 60000 Pa"),
        (
            {"contact": {"method": "constraint"}},
            "trained with contact.method = 'none', found 'constraint'",
        ),
    ],
)
def test_other_parameters_are_refused(face, trained, change, message):
    values = PARAMETERS.model_dump(exclude_unset=True) | change
    with pytest.raises(FaceError, match=message):
        ReducedFace.for_face(trained[0], face, SimulationParameters.model_validate(values))


def test_an_earlier_file_has_no_contact(face, trained):
    mechanics = json.loads(trained[0].attrs["mechanics"])
    del mechanics["contact"]
    earlier = trained[0].assign_attrs(mechanics=json.dumps(mechanics))
    assert parameters_of(earlier).contact.method == "none"
    assert ReducedFace.for_face(earlier, face, PARAMETERS).contact is None


def test_another_face_is_refused(face, trained):
    other = face.assign(marker_node=face["marker_node"].copy(data=face["marker_node"].values[::-1]))
    with pytest.raises(FaceError, match="belongs to the face with digest"):
        ReducedFace.for_face(trained[0], other, PARAMETERS)


@pytest.mark.parametrize(
    "step", [{"kind": "palsy", "degree": 0.1}, {"kind": "wedge", "width": 8.0, "height": 8.0}]
)
def test_a_treated_face_is_refused(face, trained, step):
    """The bound of the error is calibrated for the face before; a treatment of no size is that face."""
    with pytest.raises(FaceError, match="belongs to the face with digest"):
        ReducedFace.for_face(trained[0], ef.treat(face, {"step": [step]}), PARAMETERS)
    none = ef.treat(face, {"step": [{"kind": "wedge", "width": 0.0}]})
    assert ReducedFace.for_face(trained[0], none, PARAMETERS) is not None


def test_the_plan_reaches_full_activation_of_each_muscle_and_of_all(face):
    muscles = list(map(str, face["muscle"].values))
    plan = training_plan(muscles, random_drives, sequences=12, calibration=2)
    ramps = [d.values.max(axis=0) for d in plan if d.label.startswith("ramp")]
    assert np.array_equal(np.array(ramps)[: len(muscles)], np.eye(len(muscles)))
    assert max((d.values > 0.0).any(axis=0).sum() for d in plan) == len(muscles)
    again = training_plan(muscles, random_drives, sequences=12, calibration=2)
    assert all(np.array_equal(a.values, b.values) for a, b in zip(plan, again, strict=True))
    assert sum(d.purpose == "calibration" for d in plan) == 2


def test_study_drives_are_those_of_the_strategies(face):
    """Eighteen in turn contain every pair of instruction and strategy, of other volunteers each."""
    muscles = list(map(str, face["muscle"].values))
    drives = study_drives(muscles, 18, "training", 0)
    assert len({drive.label.split(" ", 2)[2] for drive in drives}) == 18
    for drive in drives:
        assert drive.values.min() >= 0.0 and 0.8 < drive.values.max() <= 1.0
        assert drive.time[0] == 0.0 and drive.time[-1] == pytest.approx(1.1)
        active = {muscles[i].rsplit("_", 1)[0] for i in np.flatnonzero(drive.values.any(axis=0))}
        if "act_rel" in drive.label:
            assert active <= set(RELEVANT[drive.label.split()[2]])
        if "act_3" in drive.label:
            assert len(active) == 3
    again = study_drives(muscles, 1, "training", 0)[0]
    other = study_drives(muscles, 1, "calibration", 0)[0]
    np.testing.assert_array_equal(again.values, drives[0].values)
    assert np.abs(other.values - drives[0].values).max() > 0.1


def test_recordings_that_cannot_be_followed_live_are_refused(face) -> None:
    """Too slow for the filter, or with other channels than the source."""

    def recording(rate, channels):
        t = np.arange(rate) / rate
        emg = np.random.default_rng(3).normal(size=(len(channels), rate)) * 1e-4
        return xr.Dataset(
            {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
            {"channel": list(channels), "time_emg": ("time_emg", t, {"units": "s"})},
        )

    muscles = list(map(str, face["muscle"].values))
    with pytest.raises(SignalError, match="512 samples per second, expected more than 900"):
        heard(recording(512, CHANNELS), 0.01, muscles)
    with pytest.raises(
        SignalError, match=f"differ in the channels {CHANNELS[-1]}, expected the same"
    ):
        heard(recording(2048, CHANNELS), 0.01, muscles, CHANNELS[:-1])


def test_a_live_face_moves_as_one_that_is_simulated_with_the_same_activation(face, trained):
    """Frames of simulated noise on a clock that only advances by waiting, until a window is complete."""
    now = [0.0]
    reduced = ReducedFace.for_face(trained[0], face, PARAMETERS)
    t = np.arange(512) / 2048
    emg = np.random.default_rng(3).normal(size=(len(CHANNELS), 512)) * (0.1 + t) * 1e-4
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        {"channel": list(CHANNELS), "time_emg": ("time_emg", t, {"units": "s"})},
    )

    def wait(seconds):
        now[0] += seconds

    source = Played(recording, 0.01, clock=lambda: now[0], wait=wait)
    between = heard(recording, 0.01, reduced.model.system.muscles)
    frames = list(live(source, reduced, between, seconds=0.2, step=0.01))
    log = pd.DataFrame([row for _, _, row in frames])
    summary = live_summary(log, 0.01)
    assert summary["frames"] == 20 and summary["late frames"] == 0 and now[0] == pytest.approx(0.2)
    values = np.array([0.0 * frames[0][0], *(a for a, _, _ in frames)])
    assert values.max() > 0.05
    drive = Activation(0.01 * np.arange(21), values)
    expected = simulate_reduced(reduced, drive, 0.2)["position"].transpose("time", "marker", "axis")
    moved = np.array([markers for _, markers, _ in frames])
    np.testing.assert_allclose(moved, expected.values[1:], atol=1e-9)


def test_too_few_sequences_of_the_calibration_are_refused_before_the_training():
    """The training takes minutes, after which a coverage of 95 % requires 19 sequences."""
    with pytest.raises(ConfigurationError, match="calibration = 18, expected at least 19"):
        ef.reduce(training={"calibration": 18})
    assert ReductionParameters(calibration=19).calibration == 19
