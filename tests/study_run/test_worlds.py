"""Worlds of simulated volunteers: every kind of mismatch changes only its own quantities."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.integrate import solve_ivp
from scipy.signal import coherence, csd, welch
from scipy.special import k0
from scipy.stats import spearmanr

from analysis.tables import origin_of
from emgface.choices import configure
from emgface.errors import ConfigurationError, DataError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import volunteer_face
from emgface.muscles import CHANNELS, INSTRUCTIONS, MODELLED, MUSCLES, RELEVANT
from emgface.recordings.dataset import read_recording, write_recording
from emgface.signals.activation import activation_of
from emgface.signals.parameters import SignalChain
from emgface.signals.truth import true_activation_of
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.intake import take_in
from emgface.volunteers.conduction import (
    REFERENCE_DISTANCE,
    VELOCITY,
    Conduction,
    CurrentSource,
    face_conduction,
)
from emgface.volunteers.emg import draw_pools, synthesise_emg
from emgface.volunteers.instructions import strongest_muscle
from emgface.volunteers.mismatch import draw_mismatch, world_parameters
from emgface.volunteers.muscle_dynamics import activation_of_excitation
from emgface.volunteers.noise import signal_to_noise
from emgface.volunteers.person import draw_volunteer
from emgface.volunteers.repetition import draw_deviation
from emgface.volunteers.session import (
    amplifier_noise,
    simulate_session,
    trial_activation,
    trial_excitation,
)
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED, MISMATCHED, MISMATCHES, World, mismatched_in, world_of
from tests.study_run.test_sessions import motion
from tests.study_run.test_volunteers_emg import still_lips

RATE = 2048.0
PERSON = draw_volunteer(1, 5)


def settings(world: World, **changes) -> VolunteerParameters:
    return VolunteerParameters(emg="noise", resolution="coarse", world=world, **changes)


def recorded(world: World) -> xr.Dataset:
    _, face = still_lips()
    own = settings(world)
    activations = [trial_activation(PERSON, "D", 1, own)]
    conduction = None
    if world.pick_up == "volume":
        conduction = face_conduction(volunteer_face(5, 1, resolution="coarse")[0])
    return simulate_session(PERSON, "D", activations, [motion(0)], face, own, conduction=conduction)


# names


def test_a_world_is_named_by_what_is_mismatched() -> None:
    assert VolunteerParameters().world == MISMATCHED
    assert MISMATCHED.kinds == tuple(MISMATCHES) and MATCHED.kinds == ()
    assert world_of("matched").label == "matched world"
    assert world_of("mismatched").label == "mismatched world"
    assert world_of("delay+noise").label == "world mismatched in delay, noise"
    assert MISMATCHED.without("mesh").label == "mismatched world except mesh"
    for kind in MISMATCHES:
        assert world_of(kind).kinds == (kind,)
        assert set(MISMATCHED.without(kind).kinds) == set(MISMATCHES) - {kind}
    with pytest.raises(ConfigurationError, match="'delai'.*expected matched, mismatched"):
        world_of("delai+noise")
    for wrong in ({"delay": [0.05, 0.03]}, {"snr": [0.5, 20.0]}, {"delays": [0.0, 0.1]}):
        with pytest.raises(ConfigurationError):
            configure(World, wrong)


@pytest.mark.parametrize(
    "kind", ["delay", "recruitment", "repetition", "pick-up", "noise", "strengths"]
)
def test_a_kind_of_mismatch_changes_only_the_named_quantity(kind: str) -> None:
    plain, other = recorded(MATCHED), recorded(mismatched_in([kind]))
    changed = {
        name for name in plain.data_vars if not np.array_equal(plain[name], other[name], True)
    }
    # Motion is given here; strengths act on it alone.
    assert (
        changed
        == {
            "delay": {"true_activation"},
            "recruitment": {"true_activation", "true_excitation", "emg"},
            "repetition": {"true_activation", "true_excitation", "emg"},
            "pick-up": {"emg"},
            "noise": {"emg"},
            "strengths": set(),
        }[kind]
    )
    assert other.attrs["world"] == f"world mismatched in {kind}"
    assert json.loads(other.attrs["settings"])["world"]["strength"] == (
        0.4 if kind == "strengths" else 0.0
    )


# repetitions


def test_repetitions_vary_as_published_profiles_do() -> None:
    """Rank correlation of the peaks of twenty muscles: median 0.88, quartiles 0.81 and 0.91.

    Spiegel et al. 2012; without variation, it is 1, and the correlation of the courses above 0.95.
    """
    fixed = settings(MISMATCHED.without("repetition"))
    ranks_mismatched, none = [], []
    for index in range(1, 13):
        person = draw_volunteer(index, 17)
        for instruction in INSTRUCTIONS:
            for own, ranks in ((settings(MISMATCHED), ranks_mismatched), (fixed, none)):
                peaks = [
                    trial_excitation(person, instruction, r, own).max("time_true") for r in (1, 2)
                ]
                ranks.append(spearmanr(*peaks).statistic)
    np.testing.assert_allclose(
        np.quantile(ranks_mismatched, [0.25, 0.5, 0.75]), [0.81, 0.88, 0.91], atol=0.02
    )
    assert np.median(none) > 0.99


def test_deviations_have_their_spread_and_depend_on_the_repetition_only() -> None:
    world = mismatched_in(["repetition"])
    drawn = [draw_deviation(1, 1, "A", r, world, 1.0) for r in range(1, 401)]
    spread = 0.88  # standard deviation of a normal variable truncated at 2 (clipped: 0.95)
    for values, expected in (
        ([np.log(d.effort) for d in drawn], world.repetition_effort),
        ([d.onset for d in drawn], world.repetition_onset),
        ([np.log(d.duration) for d in drawn], world.repetition_duration),
        ([d.shift["ZYG"] for d in drawn], world.repetition_timing),
    ):
        assert spread * expected < np.std(values) < 1.05 * expected
        assert abs(np.mean(values)) < 0.2 * expected
    sides = [
        np.mean([np.log(d.levels[m]) for m in MUSCLES if m.endswith("_L")])
        - np.mean([np.log(d.levels[m]) for m in MUSCLES if m.endswith("_R")])
        for d in drawn
    ]
    own = world.repetition_level * np.sqrt(2.0 / 10)  # of the means of ten muscles per side
    expected = np.hypot(world.repetition_side, own)
    assert np.std(sides) == pytest.approx(expected, rel=0.15)
    assert draw_deviation(1, 1, "A", 7, world, 1.0) == drawn[6]
    assert draw_deviation(1, 1, "A", 1, MATCHED, 1.0) is None


# force


def test_activation_follows_the_published_equation_after_the_delay() -> None:
    time = np.arange(1501) / 1000.0
    drive = np.clip(np.minimum((time - 0.1) / 0.2, (0.9 - time) / 0.1), 0.0, 0.8)
    excitation = xr.DataArray(
        np.stack([drive, 0.5 * drive]),
        coords={"muscle": ["ZYG_L", "RIS_L"], "time_true": time},
        dims=("muscle", "time_true"),
    )
    activation = activation_of_excitation(
        excitation, delay=0.04, activation_time=0.015, deactivation_time=0.05
    )

    def rate(t, a, scale):
        u = scale * np.interp(t - 0.04, time, drive)
        slower = 0.5 + 1.5 * a
        return (u - a) / np.where(u > a, 0.015 * slower, 0.05 / slower)

    for row, scale in enumerate((1.0, 0.5)):
        exact = solve_ivp(
            rate, (0.0, 1.5), [0.0], t_eval=time, args=(scale,), rtol=1e-9, atol=1e-11,
            max_step=1e-3,
        )  # fmt: skip
        np.testing.assert_allclose(activation[row], exact.y[0], atol=2e-5)
    assert float(activation.max()) <= 0.8 and float(activation.min()) >= 0.0
    np.testing.assert_allclose(activation.sel(time_true=0.8), [0.8, 0.4], atol=1e-3)  # what is held
    only = activation_of_excitation(
        excitation, delay=0.04, activation_time=0.0, deactivation_time=0.0
    )
    np.testing.assert_allclose(only[:, 40:], excitation[:, :-40], atol=1e-12)
    same = activation_of_excitation(
        excitation, delay=0.0, activation_time=0.0, deactivation_time=0.0
    )
    xr.testing.assert_identical(same, excitation)


def test_force_lags_emg_by_the_delay_and_more_at_the_end_than_at_the_beginning() -> None:
    own = settings(mismatched_in(["delay"]))
    mismatch = draw_mismatch(5, 1, own.world)
    assert 0.03 <= mismatch.delay <= 0.05
    u = trial_excitation(PERSON, "A", 1, own).sel(muscle="OOP_L").values
    a = trial_activation(PERSON, "A", 1, own).sel(muscle="OOP_L").values
    half = 0.5 * u.max()
    rise = 1e-3 * (np.argmax(a > half) - np.argmax(u > half))
    fall = 1e-3 * (np.argmax(u[::-1] > half) - np.argmax(a[::-1] > half))
    assert mismatch.delay < rise < mismatch.delay + 0.03
    assert rise + 0.02 < fall < mismatch.delay + 0.08


def test_strengths_scale_the_force_and_leave_its_largest_to_sigma_max() -> None:
    world = mismatched_in(["strengths"])
    mismatch = draw_mismatch(5, 2, world)
    parameters = SimulationParameters(sigma_max=100e3)
    own = world_parameters(parameters, world, mismatch)
    activation = trial_activation(PERSON, "D", 1, settings(world))
    driven = mismatch.driven(activation)
    stress = own.sigma_max * driven.values
    wanted = 100e3 * activation.values * np.array([[mismatch.strength[m]] for m in MUSCLES])
    np.testing.assert_allclose(stress, wanted, rtol=1e-12)
    assert float(driven.max()) <= float(activation.max())
    np.testing.assert_allclose(own.line_force / 1.0, own.sigma_max / 100e3)  # muscles as lines, too
    many = np.log([draw_mismatch(k, 1, world).strength["ZYG_L"] for k in range(400)])
    # 400 draws of SD 0.4, cut off at two of these: 0.88 of it, to 4 %
    assert np.std(many) == pytest.approx(0.88 * 0.4, rel=0.12) and abs(np.mean(many)) < 0.06


def test_laws_are_others_than_those_of_the_study() -> None:
    mismatch = draw_mismatch(5, 1, MATCHED)
    study = SimulationParameters()
    assert world_parameters(study, MATCHED, mismatch) == study
    other = world_parameters(study, mismatched_in(["laws"]), mismatch)
    assert other.kappa == 4 * study.kappa and other.incompressibility == "element"
    assert other.bulk_potential == "quadratic" and other.fibre_law == "generic"
    alike = SimulationParameters(fibre_law="generic")
    assert world_parameters(alike, mismatched_in(["laws"]), mismatch).fibre_law == "blemker"


def test_courses_differ_by_millimetres_and_stay_in_the_tissue() -> None:
    plain, _ = volunteer_face(5, 1, resolution="coarse")
    moved, _ = volunteer_face(5, 1, resolution="coarse", course_shift=4e-3)
    np.testing.assert_array_equal(plain["position"], moved["position"])
    gap = np.linalg.norm(moved["fibre_position"].values - plain["fibre_position"].values, axis=1)
    names = moved["fibre_muscle"].values[moved["fibre_of_point"].values]
    names = moved["muscle"].values[names]
    ends = [gap[names == f"{muscle}_L"] for muscle in MODELLED if muscle not in ("OOM", "OOP")]
    assert all(g.max() > 5e-4 for g in ends)
    assert 2e-3 < np.sqrt(np.mean(np.concatenate(ends) ** 2)) < 9e-3
    assert sum(float(v) > 0 for k, v in moved.attrs.items() if k.startswith("course_shift_")) == 8
    again, _ = volunteer_face(5, 1, resolution=864, course_shift=4e-3)
    assert again.attrs["course_shift_ZYG"] == moved.attrs["course_shift_ZYG"]


# recruitment


def test_recruitment_departs_from_the_table_in_each_person() -> None:
    world = mismatched_in(["recruitment"])
    joined, kept = 0, 0
    for index in range(1, 21):
        mismatch = draw_mismatch(8, index, world)
        for instruction in INSTRUCTIONS:
            own = mismatch.recruitment[instruction]
            assert set(own.factor) == set(RELEVANT[instruction])
            assert not set(own.joining) & set(own.factor)
            joined += len(own.joining)
            kept += own.factor[strongest_muscle(instruction)] > 0.2 * np.exp(-1.2)
    outside = sum(len(MODELLED) - len(RELEVANT[i]) for i in INSTRUCTIONS)
    assert joined / (20 * outside) == pytest.approx(0.3, abs=0.06)
    assert kept == 20 * 6
    assert draw_mismatch(8, 3, world) == draw_mismatch(8, 3, world)
    peaks = [
        trial_excitation(draw_volunteer(k, 8), "D", 1, settings(world)).max("time_true").values
        for k in (1, 2)
    ]
    assert np.abs(peaks[0] - peaks[1]).max() > 0.1
    assert draw_mismatch(8, 3, MATCHED).recruitment == {}


# pick-up


def one_source(distance: float, along: float) -> Conduction:
    sources = tuple(CurrentSource("MEN_L", channel) for channel in CHANNELS)
    far = np.full((14, 14), 0.2)
    np.fill_diagonal(far, REFERENCE_DISTANCE)
    ways = np.zeros((14, 14))
    far[5, 6], ways[5, 6] = distance, along
    return Conduction(sources, far, ways)


def test_tissue_filters_with_the_published_law_and_delays_along_the_fibre() -> None:
    frequency = np.array([0.0, 40.0, 150.0, 400.0])
    transfer = one_source(0.012, 0.016).transfer(frequency)[5, 6]
    wave = 2 * np.pi * frequency[1:] / VELOCITY
    np.testing.assert_allclose(
        np.abs(transfer[1:]), k0(wave * 0.012) / k0(wave * REFERENCE_DISTANCE), rtol=1e-12
    )
    delay = -np.angle(transfer[1]) / (2 * np.pi * 40.0)
    assert delay == pytest.approx(0.016 / VELOCITY) and transfer[0] == 0.0
    near = one_source(0.5 * REFERENCE_DISTANCE, 0.0).transfer(frequency)[5, 6]
    np.testing.assert_allclose(near[1:], 1.0)  # nothing is amplified


def test_cross_talk_is_filtered_and_no_scaled_copy() -> None:
    face, _ = volunteer_face(5, 1, resolution="coarse")
    ways = face_conduction(face)
    active = trial_excitation(PERSON, "A", 1, settings(MATCHED)).isel(time_true=slice(0, 2001))
    active = active.copy(data=np.zeros_like(active.values))
    active.loc["DLI_L"] = 0.6
    active = active.assign_coords(time_true=active["time_true"] * 10.0)  # 20 s
    quiet = {"cross_talk": 0.0, "baseline_noise": 0.0, "mains_hum": 0.0}
    emg = synthesise_emg(
        active, gain=np.ones(14), rng=np.random.default_rng(0), conduction=ways, **quiet
    )
    source = [s.muscle for s in ways.sources].index("DLI_L")
    by_distance = [CHANNELS[k] for k in np.argsort(ways.distance[:, source])[:3]]
    near, far = (emg.sel(channel=by_distance[k]).values for k in (0, 2))
    frequency, spectrum = welch(near, RATE, nperseg=1024)
    _, other = welch(far, RATE, nperseg=1024)
    inside = (frequency > 20) & (frequency < 300)
    _, shared = coherence(near, far, RATE, nperseg=1024)
    assert shared[inside].min() > 0.8  # one muscle
    median = [np.interp(0.5, np.cumsum(s) / s.sum(), frequency) for s in (spectrum, other)]
    assert median[1] < median[0] - 10.0  # Distant sources have lower frequencies.
    _, cross = csd(near, far, RATE, nperseg=1024)
    gain = np.abs(cross / spectrum)[inside]
    assert gain[-1] < 0.5 * gain[0]
    rows = [CHANNELS.index(by_distance[k]) for k in (0, 2)]
    expected = np.abs(ways.transfer(frequency[inside])[rows, source])
    ratio = gain / (expected[1] / expected[0])
    assert ratio.std() / ratio.mean() < 0.1


def test_a_world_that_picks_up_through_tissue_needs_the_ways() -> None:
    _, face = still_lips()
    own = settings(mismatched_in(["pick-up"]))
    with pytest.raises(ConfigurationError, match="specify conduction"):
        simulate_session(
            PERSON, "D", [trial_activation(PERSON, "D", 1, own)], [motion(0)], face, own
        )


# noise


@pytest.mark.parametrize("emg", ["noise", pytest.param("motor_units", marks=pytest.mark.slow)])
def test_recordings_have_the_stated_signal_to_noise_ratio(emg: str) -> None:
    own = settings(MISMATCHED).model_copy(update={"emg": emg})
    pools = draw_pools(np.random.default_rng(3)) if emg == "motor_units" else None
    face, _ = volunteer_face(5, 1, resolution="coarse", course_shift=4e-3)
    ways = face_conduction(face)
    noise = amplifier_noise(PERSON, own, pools=pools, conduction=ways)

    def heard(excitation: xr.DataArray, seed: int) -> np.ndarray:
        return synthesise_emg(
            excitation, gain=[0.25 * PERSON.gain[c] for c in CHANNELS], cross_talk=0.0,
            baseline_noise=noise, mains_hum=PERSON.mains_hum, pools=pools, conduction=ways,
            rng=np.random.default_rng(seed),
        ).values  # fmt: skip

    # The movements by which the noise was chosen, with other action potentials and other noise.
    moved = [trial_excitation(PERSON, instruction, 1, own) for instruction in INSTRUCTIONS]
    trials = [heard(one, 10 * run + k) for run in range(3) for k, one in enumerate(moved)]
    rest = heard(0.0 * trial_excitation(PERSON, "A", 1, own), 99)
    ratio = signal_to_noise(trials, rest, RATE, runs=3)
    wanted = np.array([draw_mismatch(5, 1, own.world).snr[c] for c in CHANNELS])
    assert 14.0 <= wanted.min() and wanted.max() <= 20.0
    # Distant sources have a bandwidth of about 20 Hz: the power of 0.25 s has 10 degrees of freedom
    # and an error of 2 dB, that of two windows in three trials 0.8 dB, and of the selected ones 1.1
    # dB. All channels are within three standard deviations, and most within one.
    away = np.abs(ratio - wanted)
    assert away.max() < 3.3 and np.median(away) < 1.1
    micro = 1e6 * rest.std(axis=1)
    assert 0.5 < micro.min() and micro.max() < 30.0


# files


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_every_file_says_its_world_and_a_study_has_one(slab, tmp_path: Path) -> None:
    parameters = SimulationParameters(step=0.05, gravity=False)
    for world, folder in ((MATCHED, "a"), (MISMATCHED, "b")):
        made = make_volunteers(
            slab, tmp_path / folder, n=1, instructions=("B",), seed=3, parameters=parameters,
            settings=settings(world, duration=0.6),
        )  # fmt: skip
        recording = read_recording(made[0], study=True)
        # A face of a file keeps its mesh and muscles, and the label says so.
        expected = "matched world" if world is MATCHED else "mismatched world except mesh, courses"
        assert recording.attrs["world"] == expected and expected in recording.attrs["source"]
        assert recording.attrs["origin"] == "simulated"
    for made in (
        activation_of(recording, SignalChain(), strategy="act_rel"),
        true_activation_of(recording, SignalChain().resampling),
    ):
        assert origin_of(made) == f"simulated, {expected}"
    later = recording["true_activation"].values - recording["true_excitation"].values
    assert np.abs(later).max() > 0.05
    write_recording(recording.assign_attrs(repetition=2), tmp_path / "a/recordings/S01_B_2.nc")
    with pytest.raises(DataError, match="several worlds .*matched world.*a study of each"):
        take_in(RecordingsConfiguration(folder=tmp_path / "a" / "recordings"))
