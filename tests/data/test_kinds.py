"""Distinction of EMG from other recorded signals."""

import numpy as np
import pytest
import xarray as xr
from scipy.signal import butter, sosfilt

from emgface.recordings.check import check_recording, problems
from emgface.recordings.findings import with_findings
from emgface.recordings.kinds import kind_of_name, kind_of_unit, signal_of
from emgface.recordings.readers._build import left_out

RATE = 2000.0
TIME = np.arange(8000) / RATE
RNG = np.random.default_rng(11)
NOISE = RNG.standard_normal(TIME.size)
MUSCLE = sosfilt(butter(2, [30.0, 200.0], "bandpass", fs=RATE, output="sos"), NOISE)
EMG = 120e-6 * MUSCLE * (TIME % 1 > 0.5) + 2e-6 * RNG.standard_normal(TIME.size)
SLOW = np.sin(2 * np.pi * 0.7 * TIME)


@pytest.mark.parametrize(
    ("values", "kind"),
    [
        (EMG, "EMG"),
        (EMG + 12e-3, "EMG"),  # an offset of a DC amplifier
        (EMG + 3e-3 * SLOW, "EMG"),  # a drifting electrode
        (EMG + 200e-6 * np.sin(2 * np.pi * 50 * TIME), "EMG"),
        (2e-6 * NOISE, "EMG"),  # a silent muscle
        (np.zeros(TIME.size), "unused"),
        (0.09 * SLOW + 2e-3 * NOISE, "slow signal"),  # a force plate's voltage
        (1e-3 * SLOW + 2e-9 * NOISE, "slow signal"),  # skin conductance
        (5.0 * (TIME % 1 > 0.5), "switch or event marker"),
        (np.abs(np.convolve(np.abs(EMG), np.ones(50) / 50, "same") - 1e-6), "rectified EMG"),
    ],
)
def test_the_kind_follows_from_values_and_spectrum(values: np.ndarray, kind: str) -> None:
    signal = signal_of("channel 3", values, RATE)
    assert signal.kind == kind and bool(signal.reason) == (kind != "EMG")
    if kind != "unused":
        assert signal_of("ZYG_L", values, RATE).kind == "EMG"  # a mapped channel is judged as EMG


def test_the_kind_follows_from_names_and_units() -> None:
    kinds = {"Fx1": "force plate", "Force.Fz": "force plate", "SG1 gonio": "goniometer",
             "Trigger": "switch or event marker", "L ZYG: Acc 1.X (IM)": "accelerometer",
             "GyroY": "gyroscope", "SCR": "skin conductance", "EKG": "electrocardiogram"}  # fmt: skip
    assert {name: kind_of_name(name) for name in kinds} == kinds
    for name in (
        "Delt_ant.EMG1",
        "Voltage.1",
        "ZYG_L",
        "Zyg major R",
        "MEN",
        "masseter",
        "EMG trigger",
    ):
        assert kind_of_name(name) is None
    units = {"N": "force plate", "Nmm": "force plate", "deg": "goniometer", "m/s²": "accelerometer",
             "mV": None, "": None, "°/s": "gyroscope"}  # fmt: skip
    assert {unit: kind_of_unit(unit) for unit in units} == units


def test_other_signals_are_listed_and_not_judged(trial: xr.Dataset) -> None:
    values = np.stack([EMG, 0.09 * SLOW + 2e-3 * NOISE, 0 * EMG, np.zeros(TIME.size)])
    omitted = [left_out("Knee", unit="deg"), left_out("x", kind="TRIG")]
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), values, {"units": "V"})},
        {
            "channel": ["shoulder EMG", "Voltage.1", "Sensor 9", "MEN_L"],
            "time_emg": ("time_emg", TIME, {"units": "s"}),
        },
        {"origin": "measured"},
    )
    recording = with_findings(recording, omitted)
    table = check_recording(recording).set_index("name")
    assert table["signal"].to_dict() == {
        "shoulder EMG": "EMG", "Voltage.1": "slow signal", "Sensor 9": "unused", "MEN_L": "EMG",
        "Knee": "goniometer", "x": "TRIG",
    }  # fmt: skip
    assert table["verdict"].to_list() == ["ok", "not EMG", "not EMG", "error", "not EMG", "not EMG"]
    (only,) = problems(table.reset_index())
    assert only.startswith("channel MEN_L: constant")
    assert table.loc["Voltage.1", "hum"] != table.loc["Voltage.1", "hum"]  # not measured as EMG
