"""Report on channels: known spectra, faulty channels, and a real C3D file."""

from pathlib import Path

import ezc3d
import numpy as np
import pytest
import scipy.signal
import xarray as xr

from emgface.choices import configure
from emgface.errors import FeatureWarning, SignalError
from emgface.recordings.channels import channel_report
from emgface.signals.features import willison_amplitude
from emgface.signals.filters import bandpass
from emgface.signals.parameters import SignalChain

LIVE = (
    "Delt_ant.EMG1",
    "Delt_med.EMG2",
    "Delt_post.EMG3",
    "Biceps.EMG4",
    "Triceps.EMG5",
    "Trap_sup.EMG6",
    "Trap_inf.EMG7",
    "Gd_dent.EMG8",
    "Supra.EMG9",
    "Infra.EMG10",
    "Subscap.EMG11",
)
"""Channels of the file that carry signal, as its provider names them."""


def recording_of(rows: dict[str, np.ndarray], rate: float) -> xr.Dataset:
    values = np.stack(list(rows.values()))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), values, {"units": "V"})},
        coords={"channel": list(rows), "time_emg": np.arange(values.shape[1]) / rate},
    )


def test_power_and_median_frequency_of_known_spectra():
    rate, n = 2048.0, 8 * 2048
    t = np.arange(n) / rate
    white = 1e-4 * np.random.default_rng(0).standard_normal(n)
    rows = {
        "two sines": 1e-4 * (np.sin(2 * np.pi * 5 * t) + np.sqrt(3) * np.sin(2 * np.pi * 100 * t)),
        "white": white,
    }
    table = channel_report(recording_of(rows, rate), SignalChain())
    # Powers 1 : 3, the weaker sine below the band.
    assert table.loc["two sines", "power_in_band"] == pytest.approx(0.75, abs=1e-3)
    assert table.loc["two sines", "median_frequency"] == pytest.approx(100.0, abs=1.0)
    # White: the band's share of 0-1024 Hz and its centre; 15 averaged segments of 485 bins.
    assert table.loc["white", "power_in_band"] == pytest.approx(485 / 1024, abs=0.02)
    assert table.loc["white", "median_frequency"] == pytest.approx(257.5, abs=10.0)
    assert table.loc["two sines", "rms"] == pytest.approx(1e-4 * np.sqrt(1.5), rel=0.01)
    assert table.attrs["feature_units"] == "1" and table.attrs["feature_full_scale"] == 409


def test_bad_channels_get_a_status_and_do_not_hide_the_others():
    rng = np.random.default_rng(1)
    rows = {name: 1e-4 * rng.standard_normal(4096) for name in ("good", "gap", "quiet", "loud")}
    rows["gap"][1024:1034] = np.nan
    rows["flat"] = np.full(4096, 0.3)
    rows["quiet"] *= 1e-3
    rows["loud"] *= 1e6
    table = channel_report(recording_of(rows, 2048.0), SignalChain())
    assert table["status"].to_dict() == {
        "good": "ok",
        "gap": "gap of 0.004883 s at t = 0.5 s",
        "quiet": "feature zero",
        "loud": "feature saturated",
        "flat": "constant",
    }
    assert table.loc[["gap", "flat"]].drop(columns="status").isna().all(axis=None)
    assert table.loc[["good", "quiet", "loud"]].notna().all(axis=None)


def test_no_live_channel_and_low_rate():
    flat = channel_report(recording_of({"a": np.zeros(100)}, 2048.0), SignalChain())
    assert flat["status"].tolist() == ["constant"]
    noise = np.random.default_rng(0).standard_normal(5000)
    with pytest.warns(FeatureWarning, match="ends at 45 Hz instead of 500 Hz"):
        report = channel_report(recording_of({"a": noise}, 100.0), SignalChain())
    assert report.attrs["pass_band"] == (15.0, 45.0)
    with pytest.raises(SignalError, match="at least an octave"):
        channel_report(recording_of({"a": noise}, 50.0), SignalChain())


@pytest.fixture(scope="module")
def shoulder(shared: Path) -> xr.Dataset:
    """The sEMG of a real C3D file, read without the package."""
    path = shared / "recordings" / "pyomeca" / "markers_analogs.c3d"
    if not path.is_file():
        pytest.skip("C3D recording not found")
    file = ezc3d.c3d(str(path))
    analog = file["parameters"]["ANALOG"]
    labels, rate = list(analog["LABELS"]["value"]), float(analog["RATE"]["value"][0])
    assert set(analog["UNITS"]["value"]) == {"V"}
    values = file["data"]["analogs"][0]
    return recording_of(
        {name: values[labels.index(name)] for name in labels if "EMG" in name}, rate
    )


def test_real_recording_through_filter_and_willison_amplitude(shoulder):
    live = shoulder["emg"].sel(channel=list(LIVE))
    filtered = bandpass(live, SignalChain().filter)
    assert filtered.attrs["sampling_rate"] == pytest.approx(2000.0)
    feature = willison_amplitude(filtered)
    assert feature.sizes == {"channel": 11, "time": 11600 - 400 + 1}
    # Eq. 7 by its definition at a few windows of each channel.
    for t in (0, 5000, 11200):
        window = filtered.values[:, t : t + 400]
        expected = np.sum(np.abs(np.diff(window, axis=1)) >= 10e-6, axis=1)
        np.testing.assert_array_equal(feature.values[:, t], expected)
    # The filter against SciPy's transfer-function form applied in the frequency domain, far
    # from the ends.
    b, a = scipy.signal.butter(4, (15, 500), "bandpass", fs=2000.0)
    spectrum = np.fft.rfft(live.values, axis=1)
    _, response = scipy.signal.freqz(b, a, worN=np.fft.rfftfreq(11600, 1 / 2000.0), fs=2000.0)
    expected = np.fft.irfft(spectrum * np.abs(response) ** 2, n=11600, axis=1)
    inner = slice(1000, -1000)
    scale = filtered.values.std(axis=1, keepdims=True)
    assert np.abs((filtered.values - expected)[:, inner] / scale).max() < 1e-3


def test_report_on_the_real_recording(shoulder):
    table = channel_report(shoulder, SignalChain())
    for name in (f"Sensor {k}.EMG{k}" for k in range(12, 17)):
        assert table.loc[name, "status"] == "constant"
    live = table.loc[list(LIVE)]
    assert live.loc["Delt_ant.EMG1", "power_in_band"] > 0.99
    assert live["power_in_band"].idxmin() == "Subscap.EMG11"  # mostly movement artefact
    # Described elsewhere over the whole spectrum as 92 Hz and 135 Hz, from segments of 1 s.
    wide = channel_report(shoulder, configure(SignalChain, {"filter": {"low": 1, "high": 999}}))
    assert wide.loc["Delt_ant.EMG1", "median_frequency"] == pytest.approx(92, abs=1)
    assert wide.loc["Infra.EMG10", "median_frequency"] == pytest.approx(135, abs=1)
    finer = configure(SignalChain, {"feature": {"threshold": 1e-6}})
    assert channel_report(shoulder, finer).loc["Subscap.EMG11", "feature_max"] > 0
