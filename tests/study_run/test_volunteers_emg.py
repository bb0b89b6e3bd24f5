"""Synthesised activations, sEMG and marker tracks compared with closed forms and their sources."""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import coherence, welch

from emgface.errors import ConfigurationError, MarkerError, SignalError
from emgface.muscles import (
    AXES,
    CHANNELS,
    CHANNELS_AT_MIDLINE,
    FACE_MARKERS,
    INSTRUCTIONS,
    LIP_MARKERS,
    MEASURED,
    MODELLED,
    MUSCLES,
    NEIGHBOURS,
    RELEVANT,
)
from emgface.volunteers.emg import (
    RECORDING_BAND,
    band_limited_noise,
    cross_talk_matrix,
    pickup_matrix,
    power_spectrum,
    synthesise_emg,
)
from emgface.volunteers.instructions import (
    INSTRUCTION_PHASES,
    Timing,
    burst,
    draw_timing,
    true_activation,
)
from emgface.volunteers.markers import head_motion, record_markers
from emgface.volunteers.person import draw_volunteer

RATE = 2048.0


def constant_activation(muscle: str, level: float, duration: float = 8.0) -> xr.DataArray:
    time = np.linspace(0.0, duration, 101)
    values = np.zeros((len(MUSCLES), time.size))
    values[MUSCLES.index(muscle)] = level
    return xr.DataArray(
        values, coords={"muscle": list(MUSCLES), "time_true": time}, dims=("muscle", "time_true")
    )


def quiet(activation: xr.DataArray, gain: float = 100e-6, **options: float) -> xr.DataArray:
    choices = {"cross_talk": 0.0, "baseline_noise": 0.0, "mains_hum": 0.0} | options
    rng = np.random.default_rng(5)
    return synthesise_emg(activation, gain=np.full(14, gain), rng=rng, **choices)


# activations


@pytest.mark.parametrize("instruction", INSTRUCTIONS)
def test_muscles_of_table_1_dominate_and_all_stay_within_0_and_1(instruction: str) -> None:
    activation = true_activation(instruction, co_contraction=0.02, timing=Timing(effort=1.1))
    assert float(activation.min()) == 0.0 and float(activation.max()) <= 1.0
    peak = activation.max("time_true")
    relevant = [f"{m}_{s}" for m in RELEVANT[instruction] for s in ("L", "R")]
    others = [m for m in MUSCLES if m not in relevant]
    assert float(peak.sel(muscle=relevant).min()) > float(peak.sel(muscle=others).max())
    assert {m for phase in INSTRUCTION_PHASES[instruction] for m in phase.levels} == set(
        RELEVANT[instruction]
    )


def test_every_trial_begins_and_ends_at_rest() -> None:
    rng = np.random.default_rng(1)
    for instruction in INSTRUCTIONS:
        activation = true_activation(instruction, timing=draw_timing(rng))
        assert np.all(activation.isel(time_true=[0, -1]).values == 0.0)


def test_instruction_e_goes_left_right_left_and_the_others_are_symmetric() -> None:
    activation = true_activation("E")
    difference = (activation.sel(muscle="ZYG_L") - activation.sel(muscle="ZYG_R")).values
    n = difference.size
    thirds = [difference[int(n * c)] for c in (0.25, 0.51, 0.77)]
    assert thirds[0] > 0.3 and thirds[1] < -0.3 and thirds[2] > 0.3
    for instruction in "ABCDF":
        symmetric = true_activation(instruction).values
        np.testing.assert_array_equal(symmetric[:10], symmetric[10:])


def test_burst_is_smooth_to_its_curvature() -> None:
    time = np.linspace(0.0, 2.0, 20001)
    shape = burst(time, 0.5, 1.4)
    curvature = np.gradient(np.gradient(shape, time), time)
    # the flank 6s^5 - 15s^4 + 10s^3 over 0.3 s: largest second derivative (10/sqrt 3)/0.3^2
    assert np.abs(curvature).max() == pytest.approx(10.0 / np.sqrt(3.0) / 0.09, rel=1e-3)
    assert shape.max() == 1.0 and shape[0] == 0.0


def test_an_unknown_instruction_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'G'.*A .purse lips., B .raise"):
        true_activation("G")


# volunteers


def test_a_volunteer_depends_on_seed_and_index_alone() -> None:
    assert draw_volunteer(2, 7) == draw_volunteer(2, 7)
    assert draw_volunteer(2, 7).sigma_max != draw_volunteer(3, 7).sigma_max
    assert draw_volunteer(2, 7).sigma_max != draw_volunteer(2, 8).sigma_max
    person = draw_volunteer(1, 0)
    numbers = {tuple(person.rng(i, r).standard_normal(2)) for i in INSTRUCTIONS for r in (1, 2, 3)}
    assert len(numbers) == 18


# sEMG


def test_noise_has_the_stated_spectrum_and_unit_variance() -> None:
    noise = band_limited_noise(40, int(8 * RATE), RATE, np.random.default_rng(0))
    # band limited noise of about 100 Hz bandwidth: 40 x 8 s give a variance to about 1/sqrt(64000)
    assert noise.var() == pytest.approx(1.0, rel=0.02)
    frequency, density = welch(noise, RATE, nperseg=2048)
    density = density.mean(axis=0)
    # 40 signals x 15 windows, half overlapped: relative error of a bin about 1/sqrt(300) = 6 %
    core = (frequency >= 25) & (frequency <= 480)
    expected = power_spectrum(frequency)
    expected *= density[core].sum() / expected[core].sum()
    np.testing.assert_allclose(density[core], expected[core], rtol=0.3)
    ratio = density[core] / expected[core]
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)
    inside = (frequency >= RECORDING_BAND[0] - 3) & (frequency <= RECORDING_BAND[1] + 3)
    assert density[~inside].sum() < 1e-4 * density.sum()


def test_spectrum_peaks_where_its_derivative_vanishes() -> None:
    frequency = np.linspace(1.0, 500.0, 50001)
    peak = frequency[power_spectrum(frequency).argmax()]
    # d ln S / df = 0 with x = f^2: 1/x - 1/(x + l^2) - 2/(x + h^2) = 0
    # => l^2 (x + h^2) = 2 x (x + l^2) => 2 x^2 + l^2 x - l^2 h^2 = 0
    low, high = 60.0, 120.0
    x = (-(low**2) + np.sqrt(low**4 + 8 * low**2 * high**2)) / 4.0
    assert peak == pytest.approx(np.sqrt(x), abs=0.02)


def test_amplitude_is_proportional_to_activation() -> None:
    rms = {
        level: float(quiet(constant_activation("MEN_L", level)).sel(channel="MEN_L").std())
        for level in (0.2, 0.4, 0.8)
    }
    assert rms[0.4] / rms[0.2] == pytest.approx(2.0, rel=1e-9)  # same noise, so exactly
    assert rms[0.8] == pytest.approx(0.8 * 100e-6, rel=0.1)


def test_amplitude_follows_a_burst() -> None:
    activation = true_activation("D")
    emg = quiet(activation).sel(channel="ZYG_R")
    window = 205
    rms = np.sqrt(np.convolve(emg.values**2, np.ones(window) / window, mode="same"))
    truth = activation.sel(muscle="ZYG_R").interp(time_true=emg["time_emg"]).values
    assert np.corrcoef(rms, truth)[0, 1] > 0.9
    assert rms.max() == pytest.approx(0.6 * 100e-6, rel=0.4)


def test_without_cross_talk_a_muscle_is_recorded_by_its_electrodes_only() -> None:
    rms = quiet(constant_activation("LAO_R", 0.5)).std("time_emg")
    heard = [str(c) for c in rms["channel"].values if float(rms.sel(channel=c)) > 0.0]
    assert heard == ["LLSAN_R"]


def test_cross_talk_reaches_neighbours_with_its_share_and_no_one_else() -> None:
    emg = quiet(constant_activation("MEN_L", 1.0), cross_talk=0.1)
    rms = emg.std("time_emg")
    neighbours = {"OOI_L", "DAO_L", "MEN_R"}
    for channel in CHANNELS:
        share = float(rms.sel(channel=channel) / rms.sel(channel="MEN_L"))
        expected = 1.0 if channel == "MEN_L" else 0.1 if channel in neighbours else 0.0
        assert share == pytest.approx(expected, abs=1e-12)
    _, shared = coherence(
        emg.sel(channel="MEN_L").values, emg.sel(channel="DAO_L").values, RATE, nperseg=512
    )
    assert shared[10:100].min() > 0.999


def test_cross_talk_matrix_is_symmetric_between_sides_and_invertible() -> None:
    matrix = cross_talk_matrix(0.1)
    np.testing.assert_array_equal(matrix, matrix.T)
    np.testing.assert_array_equal(matrix[:7, :7], matrix[7:, 7:])
    assert np.count_nonzero(matrix) == 14 + 2 * (2 * len(NEIGHBOURS) + len(CHANNELS_AT_MIDLINE))
    assert np.linalg.eigvalsh(matrix).min() > 0.5


def test_baseline_noise_and_hum_have_their_size() -> None:
    silent = constant_activation("MEN_L", 0.0)
    noise = quiet(silent, baseline_noise=1e-6)
    assert float(noise.std()) == pytest.approx(1e-6, rel=0.01)
    hum = quiet(silent, mains_hum=2e-6).sel(channel="DAO_R").values
    spectrum = np.abs(np.fft.rfft(hum[:16384])) * 2 / 16384
    assert np.argmax(spectrum) == round(50.0 * 16384 / RATE)
    assert spectrum.max() == pytest.approx(2e-6, rel=1e-6)


def test_pickup_is_a_generalised_inverse_of_the_muscle_mapping() -> None:
    """M P M = M with M of Eqs 2-6, so that the mapping recovers the drive."""
    mapping = np.zeros((10, 7))
    weights = {
        "OOP": {"OOS": 0.5, "OOI": 0.5},
        "OOM": {"OOS": 0.1, "OOI": 0.1},
        "BUC": {"RIS": 0.5, "ZYG": 0.5},
        "LAO": {"LLSAN": 0.75},
        "DLI": {"DAO": 0.75},
    }
    for row, muscle in enumerate(MODELLED):
        for channel, weight in weights.get(muscle, {muscle: 1.0}).items():
            mapping[row, MEASURED.index(channel)] = weight
    pickup = pickup_matrix()
    for side in (0, 1):
        block = pickup[7 * side : 7 * side + 7, 10 * side : 10 * side + 10]
        np.testing.assert_allclose(mapping @ block @ mapping, mapping, atol=1e-15)
    assert np.count_nonzero(pickup[:7, 10:]) == np.count_nonzero(pickup[7:, :10]) == 0


def test_amplitudes_of_a_volunteer_are_tens_to_hundreds_of_microvolts() -> None:
    person = draw_volunteer(1, 3)
    emg = synthesise_emg(
        true_activation("D", levels=person.levels, co_contraction=person.co_contraction),
        gain=[person.gain[c] for c in CHANNELS],
        cross_talk=person.cross_talk,
        baseline_noise=person.baseline_noise,
        mains_hum=person.mains_hum,
        rng=person.rng("D", 1),
    )
    middle = emg.sel(time_emg=slice(0.7, 1.1)).sel(channel=["ZYG_L", "ZYG_R", "RIS_L", "RIS_R"])
    rms = middle.std("time_emg")
    assert float(rms.min()) > 20e-6 and float(rms.max()) < 500e-6
    assert float(emg.sel(time_emg=slice(0.0, 0.1)).std()) < 3e-6


def test_a_sampling_rate_below_the_band_is_refused() -> None:
    with pytest.raises(SignalError, match="1000 Hz cannot represent.*500 Hz"):
        band_limited_noise(1, 1000, 1000.0, np.random.default_rng(0))
    with pytest.raises(SignalError, match="shorter than one period"):
        band_limited_noise(1, 100, RATE, np.random.default_rng(0))


# markers


def still_lips(n_times: int = 181) -> tuple[xr.DataArray, xr.DataArray]:
    rng = np.random.default_rng(2)
    lips = np.repeat(rng.normal(0.0, 0.02, (10, 3, 1)), n_times, axis=2)
    lip_position = xr.DataArray(
        lips,
        coords={"marker": list(LIP_MARKERS), "axis": list(AXES), "time": np.arange(n_times) * 0.01},
        dims=("marker", "axis", "time"),
    )
    face_position = xr.DataArray(
        rng.normal(0.0, 0.05, (6, 3)),
        coords={"face_marker": list(FACE_MARKERS), "axis": list(AXES)},
        dims=("face_marker", "axis"),
    )
    return lip_position, face_position


def test_head_motion_is_rigid_and_of_the_stated_size() -> None:
    time = np.linspace(0.0, 60.0, 6001)
    R, t = head_motion(time, 0.05, 3e-3, np.random.default_rng(0))
    np.testing.assert_allclose(
        R @ R.transpose(0, 2, 1), np.broadcast_to(np.eye(3), R.shape), atol=1e-14
    )
    assert np.abs(t).max() <= 3e-3 and np.abs(t).max() > 2e-3
    assert np.arccos((np.trace(R, axis1=1, axis2=2) - 1) / 2).max() <= 0.05 * np.sqrt(3.0)


def test_a_moving_head_keeps_all_distances_between_markers() -> None:
    lips, face = still_lips()
    seen = record_markers(
        lips, face, noise=0.0, rotation=0.05, shift=3e-3, rng=np.random.default_rng(3)
    )
    values = seen.transpose("time_marker", "marker", "axis").values
    distances = np.linalg.norm(values[:, :, None] - values[:, None, :], axis=-1)
    np.testing.assert_allclose(
        distances, np.broadcast_to(distances[0], distances.shape), atol=1e-14
    )
    assert np.ptp(values, axis=0).max() > 1e-3


def test_marker_noise_has_its_size_and_frames_come_at_100_hz() -> None:
    lips, face = still_lips()
    seen = record_markers(
        lips, face, noise=1e-4, rotation=0.0, shift=0.0, rng=np.random.default_rng(4)
    )
    assert list(seen["marker"].values) == [*FACE_MARKERS, *LIP_MARKERS]
    assert float(seen.std("time_marker").mean()) == pytest.approx(1e-4, rel=0.03)
    np.testing.assert_allclose(np.diff(seen["time_marker"]), 0.01)
    assert seen.sizes["time_marker"] == 181


def test_a_missing_marker_is_named() -> None:
    lips, face = still_lips()
    with pytest.raises(MarkerError, match="corner_left"):
        record_markers(
            lips.isel(marker=slice(1, None)),
            face,
            noise=0.0,
            rotation=0.0,
            shift=0.0,
            rng=np.random.default_rng(0),
        )
