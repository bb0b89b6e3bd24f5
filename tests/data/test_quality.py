"""Faults added to a clean EMG signal, their measures and messages."""

import numpy as np
import pytest
import scipy.signal

import emgface as ef
from emgface.errors import ConfigurationError, FeatureWarning, SchemaError, SignalError
from emgface.recordings.check import check_recording, problems
from emgface.recordings.quality import cross_talk, emg_quality, mains_hum, remove_hum
from emgface.recordings.quality.figure import scale_factor
from emgface.recordings.quality.findings import UNLIKELY
from emgface.recordings.quality.plausible import doubtful_gains
from tests.data.made_recordings import RATE, emg, face, noise, recording


def test_a_clean_recording_has_no_finding() -> None:
    table = check_recording(recording(noise(), face(800)))
    assert set(table["verdict"]) == {"ok"}, table["reason"].to_list()
    channels = table[table["kind"] == "channel"]
    assert (channels["hum"] < 0.03).all() and (channels["common"] < 0.02).all()
    assert channels["baseline"].between(1e-6, 3e-6).all()
    # 50 uV over 2 uV at rest, of which the band holds three quarters of the amplitude.
    assert channels["snr"].between(27, 34).all()


@pytest.mark.parametrize("mains", [50.0, 60.0])
@pytest.mark.parametrize("amplitude", [15e-6, 30e-6, 100e-6])
def test_hum_is_measured_as_it_was_added(mains: float, amplitude: float) -> None:
    time = np.arange(int(8 * RATE)) / RATE
    values = noise(1)[0]
    plain = np.mean(values**2)
    values = values + amplitude * (
        np.sin(2 * np.pi * mains * time) + 0.3 * np.sin(2 * np.pi * 3 * mains * time)
    )
    hum = mains_hum(values, RATE)
    added = amplitude**2 * (1 + 0.3**2) / 2
    assert hum.frequency == mains
    # Over 8 s a line of 1/8 Hz contains 1/960 of a spectrum 120 Hz wide, which determines the
    # standard deviation of the product of hum and EMG; the lines also contain a part of the EMG.
    beat = np.sqrt(2 * added * plain / 960)
    assert hum.rms**2 == pytest.approx(added, abs=3 * beat + 0.03 * plain)
    assert hum.share == pytest.approx(added / (added + plain), abs=0.06)


def test_strong_hum_is_reported_and_removed() -> None:
    time = np.arange(int(8 * RATE)) / RATE
    values = noise()
    hum = 100e-6 * (np.sin(2 * np.pi * 50 * time) + 0.2 * np.sin(2 * np.pi * 250 * time))
    dirty = recording(np.concatenate([values[:3], values[3:4] + hum, values[4:]]))
    (sentence,) = problems(check_recording(dirty), "warning")
    assert sentence.startswith("channel ZYG_L: ") and "mains hum of 50 Hz" in sentence
    clean = remove_hum(dirty["emg"], 50.0)
    # The remaining power at these frequencies is that of the EMG, not of hum.
    never = emg_quality(remove_hum(emg(values), 50.0)).loc["ZYG_L", "hum"]
    assert emg_quality(clean).loc["ZYG_L", "hum"] == pytest.approx(never, abs=0.005)
    inner = slice(2048, -2048)
    left = clean.sel(channel="ZYG_L").values[inner] - values[3][inner]
    assert np.std(left) < 0.3 * np.std(values[3][inner])  # 2 Hz in every 50, edges included
    assert np.corrcoef(clean.sel(channel="ZYG_L").values[inner], values[3][inner])[0, 1] > 0.95
    assert clean.attrs["notch_lines"] == 20
    one = remove_hum(dirty["emg"], 50.0, harmonics=False)
    assert one.attrs["notch_lines"] == 1


def test_an_impossible_notch_is_refused() -> None:
    with pytest.raises(SignalError, match="notch of 2 Hz at 1100 Hz does not fit"):
        remove_hum(emg(noise(1)), 1100.0)


def faults() -> dict[str, tuple[np.ndarray, str]]:
    time = np.arange(int(8 * RATE)) / RATE
    whole = noise(1, seed=5)[0]
    stuck, railed = whole.copy(), whole.copy()
    stuck[6000:6300] = stuck[5999]
    railed = np.clip(whole, -1e-4, 1.0)
    swing = sum(np.sin(2 * np.pi * f * time + f) for f in (4.0, 7.0, 9.0))
    return {
        "artefact": (whole + 1e-4 * swing, "lies below 15 Hz: movement artefact"),
        "drift": (whole + 2e-3 * time / 8, "drifts by 1.8"),
        "stuck": (stuck, "stays at one value for 0.147 s: dropout"),
        "saturated": (railed, "at the limits of the amplifier: saturated"),
        "baseline": (whole + 40e-6 * np.random.default_rng(2).normal(size=time.size), "baseline 2"),
    }


@pytest.mark.parametrize("fault", ["artefact", "drift", "stuck", "saturated", "baseline"])
def test_each_fault_of_a_channel_is_reported(fault: str) -> None:
    values = noise()
    values[6], text = faults()[fault]
    table = check_recording(recording(values))
    (sentence,) = problems(table, "warning")
    assert sentence.startswith("channel MEN_L: ") and text in sentence
    before = emg_quality(emg(noise(7, seed=5)[6:]))[fault].iloc[0]
    assert table.set_index("name").loc["MEN_L", fault] > 4 * max(before, 0)


def test_measures_without_sufficient_data_are_absent() -> None:
    values = noise(3)
    values[0, 5], values[1] = np.nan, 1e-3
    table = emg_quality(emg(values))
    assert table.loc[["OOS_L", "OOI_L"]].isna().all(axis=None) and table.loc["RIS_L"].notna().all()
    assert emg_quality(emg(values[2:, :2000])).isna().all(axis=None)
    assert check_recording(recording(values[:2]))["common"].isna().all()


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_cross_talk_is_found_as_it_was_mixed(share: float) -> None:
    sources = noise(2, seed=3)
    mixed = np.array([[1, share], [share, 1]]) @ sources
    (row,) = cross_talk(emg(mixed, ("OOS_L", "OOI_L"))).to_dict("records")
    assert row["share"] == pytest.approx(share, abs=0.03)
    assert row["correlation"] == pytest.approx(2 * share / (1 + share**2), abs=0.05)
    assert row["common"] == row["correlation"] ** 2


def test_cross_talk_of_a_silent_muscle_is_that_of_its_electrode() -> None:
    sources = noise(2, seed=3) * np.array([[1.0], [0.02]])
    mixed = np.array([[1, 0.15], [0.15, 1]]) @ sources
    (row,) = cross_talk(emg(mixed, ("OOS_L", "OOI_L"))).to_dict("records")
    assert row["correlation"] > 0.95 and row["share"] == pytest.approx(0.15, abs=0.01)
    quiet = noise()
    quiet[:2] = np.array([[1, 0.15], [0.15, 0.02]]) @ quiet[:2]
    # The amplifiers add their noise to the mixture of both muscles.
    quiet[:2] += 2e-6 * np.random.default_rng(2).normal(size=quiet[:2].shape)
    quiet[2:7] = 1e-6 * np.random.default_rng(1).normal(size=quiet[2:7].shape)
    assert problems(check_recording(recording(quiet)), "warning") == []


def test_cross_talk_is_found_with_its_delay() -> None:
    sources = noise(2, seed=4)
    late = 0.7 * np.roll(sources[0], 8) + 0.7 * sources[1]
    (row,) = cross_talk(emg(np.stack([late, sources[0]]), ("a", "b"))).to_dict("records")
    assert row["lag"] == 8 / RATE  # the first follows the second
    assert row["correlation"] == pytest.approx(np.sqrt(0.5), abs=0.05)
    values = noise()
    values[7] = 0.8 * values[7] + 0.8 * values[0]  # cross-talk of OOS_L
    texts = problems(check_recording(recording(values)), "warning")
    assert any("channel OOS_L: shares" in text and "with OOS_R" in text for text in texts)


def test_lines_of_a_short_burst_are_no_hum() -> None:
    """In a trial of 1.8 s, bursts have strong lines by chance, which are distinguished from hum."""
    time = np.arange(round(1.8 * RATE)) / RATE
    burst = np.exp(-(((time - 0.9) / 0.3) ** 2))
    rng = np.random.default_rng(11)
    sos = scipy.signal.butter(2, (20.0, 200.0), "bandpass", fs=RATE, output="sos")
    chances, shares = [], []
    for _ in range(200):
        muscle = 100e-6 * burst * scipy.signal.sosfilt(sos, rng.standard_normal(time.size))
        lines = mains_hum(muscle, RATE)
        chances.append(lines.chance)
        shares.append(lines.share)
        assert lines.chance > UNLIKELY
    # By the fraction of power some would be classified as hum; the p value has its nominal size.
    assert max(shares) > 0.1
    assert np.mean(np.array(chances) < 0.05) < 0.1
    hum = 30e-6 * np.sin(2 * np.pi * 50.04 * time + 1.0)
    assert mains_hum(muscle + hum, RATE).chance < 1e-6


def test_channels_of_unusual_amplitude_have_their_own_scale() -> None:
    assert scale_factor(1.0, 1.0) == scale_factor(0.3, 1.0) == scale_factor(0.0, 1.0) == 1.0
    assert scale_factor(float("nan"), 1.0) == 1.0
    for strength in np.logspace(-9, 9, 400):
        factor = scale_factor(strength, 1.0)
        assert 0.25 <= factor * strength <= 1.25
        assert f"{factor:e}"[0] in "125"


@pytest.mark.parametrize(("factor", "word"), [(2.0, "high"), (0.5, "low")])
def test_a_rate_wrong_by_two_is_reported_with_its_evidence(factor: float, word: str) -> None:
    """The spectrum of Shwedyk et al. has its median at 96 Hz, and at 192 or 48 Hz on such a clock."""
    given = recording(noise(seconds=12.0))
    wrong = given.assign_coords(time_emg=("time_emg", given["time_emg"].values / factor))
    wrong["time_emg"].attrs["units"] = "s"
    (sentence,) = problems(check_recording(wrong), "warning")
    assert sentence.startswith("channel OOS_L: median frequency ")
    assert "expected 50 to 180 Hz" in sentence and sentence.endswith(f"the rate is too {word}.")
    with pytest.warns(FeatureWarning, match="median frequency"):
        ef.activate(wrong, strategy="act_all")


def test_a_gain_of_one_channel_is_reported_and_a_one_sided_movement_is_not() -> None:
    values = noise()
    one_sided, quiet = values.copy(), 2e-6 * np.random.default_rng(3).normal(size=values.shape[1])
    one_sided[3] = quiet  # the muscle of one side does not move
    assert problems(check_recording(recording(one_sided)), "warning") == []
    values[10] *= 10.0
    (sentence,) = problems(check_recording(recording(values[:, : int(6.5 * RATE)])), "warning")
    assert sentence.startswith("channel ZYG_R: ") and "that of ZYG_L" in sentence
    with pytest.warns(FeatureWarning, match="channel ZYG_R: amplifier noise is 1?[0-9]"):
        ef.activate(recording(values), strategy="act_all")


def test_a_recording_with_another_gain_is_found_among_those_of_the_volunteer() -> None:
    made = {f"V1_A_{k}.nc": emg_quality(emg(noise(seed=k))) for k in range(4)}
    assert doubtful_gains(made) == {}
    made["V1_A_2.nc"] = emg_quality(emg(10.0 * noise(seed=2)))
    ((file, clause),) = doubtful_gains(made).items()
    assert file == "V1_A_2.nc"
    assert clause.startswith(
        "14 of 14 channels (OOS_L, OOI_L, RIS_L, ZYG_L, ...) are 10 times larger"
    )
    assert doubtful_gains({name: made[name] for name in list(made)[1:3]}) == {}


def test_an_infinite_sample_is_no_constant_channel() -> None:
    """The message names the gap, with either treatment of constant channels."""
    values = noise(seconds=3.0)
    values[3, 500] = np.inf
    for silent in ("error", "zero"):
        with pytest.raises(SignalError, match="ZYG_L") as caught:
            ef.activate(recording(values), strategy="act_all", normalisation={"silent": silent})
        assert "one value throughout" not in str(caught.value)


def test_arguments_of_other_types_are_refused_with_a_sentence() -> None:
    for wrong in (None, 3, noise(2), [recording(noise(2))]):
        with pytest.raises(SchemaError, match="expected a recording as a Dataset or the path"):
            ef.activate(wrong)  # pyright: ignore[reportArgumentType]
    for band in ((20,), (20, 30, 40), "20-400"):
        with pytest.raises(ConfigurationError, match="expected its two edges in Hz"):
            ef.activate(recording(noise()), band=band)  # pyright: ignore[reportArgumentType]
