"""C3D: a generated file, and a real one compared with the arrays of ezc3d."""

import json
from pathlib import Path
from typing import Any

import ezc3d
import numpy as np
import pytest
import xarray as xr

from emgface.errors import ConfigurationError, DataError, SchemaError, UnitsError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.dataset import read_recording, write_recording
from emgface.recordings.labels import note

MARKERS = FACE_MARKERS + LIP_MARKERS
FRAMES, PER_FRAME = 20, 10
REAL_EMG = [
    "Delt_ant.EMG1", "Delt_med.EMG2", "Delt_post.EMG3", "Biceps.EMG4", "Triceps.EMG5",
    "Trap_sup.EMG6", "Trap_inf.EMG7", "Gd_dent.EMG8", "Supra.EMG9", "Infra.EMG10",
    "Subscap.EMG11",
]  # fmt: skip
DEAD_EMG = [f"Sensor {n}.EMG{n}" for n in range(12, 17)]


def make_c3d(path: Path, **changes: Any) -> tuple[np.ndarray, np.ndarray]:
    """Write a study trial in mm and mV under the labels P1.. and E1..; return the arrays."""
    rng = np.random.default_rng(5)
    given: dict[str, Any] = {
        "point_labels": [f"P{i}" for i in range(1, 17)],
        "point_unit": ["mm"],
        "point_rate": 100.0,
        "analog_labels": [f"E{i}" for i in range(1, 15)] + ["Force.Fz", "Empty"],
        "analog_units": ["mV"] * 14 + ["N", "mV"],
    }
    given.update(changes)
    points = np.ones((4, len(given["point_labels"]), FRAMES))
    points[:3] = rng.uniform(-50, 50, size=(3, *points.shape[1:]))
    points[:3, 3, 5:8] = np.nan
    analogs = rng.normal(size=(1, len(given["analog_labels"]), FRAMES * PER_FRAME))
    analogs[0, -1] = 0.5
    content = ezc3d.c3d()
    parameters = content["parameters"]
    parameters["POINT"]["LABELS"]["value"] = given["point_labels"]
    parameters["POINT"]["RATE"]["value"] = [given["point_rate"]]
    parameters["POINT"]["UNITS"]["value"] = given["point_unit"]
    parameters["ANALOG"]["LABELS"]["value"] = given["analog_labels"]
    parameters["ANALOG"]["RATE"]["value"] = [given["point_rate"] * PER_FRAME]
    parameters["ANALOG"]["UNITS"]["value"] = given["analog_units"]
    for name, value in given.get("point_extra", {}).items():
        content.add_parameter("POINT", name, value)
    content["data"]["points"] = points
    if "residuals" in given:
        content["data"]["meta_points"]["residuals"] = given["residuals"]
    content["data"]["analogs"] = analogs
    content.write(str(path))
    return points[:3], analogs[0]


def study_mapping() -> dict[str, Any]:
    return {
        "channels": {f"E{i}": name for i, name in enumerate(CHANNELS, start=1)},
        "markers": {f"P{i}": name for i, name in enumerate(MARKERS, start=1)},
        "volunteer": "V07",
        "instruction": "D",
        "repetition": 3,
    }


def test_a_mapped_file_is_a_study_recording(tmp_path: Path) -> None:
    points, analogs = make_c3d(tmp_path / "trial.c3d")
    trial = read_recording(tmp_path / "trial.c3d", mapping=study_mapping(), study=True)
    assert tuple(trial["channel"].values) == CHANNELS
    assert tuple(trial["marker"].values) == MARKERS
    # C3D has single precision, with a relative rounding error of 2^-24.
    np.testing.assert_allclose(trial["emg"], analogs[:14] / 1e3, rtol=2**-23, atol=0)
    expected = points.transpose(1, 0, 2) / 1e3
    np.testing.assert_allclose(trial["position"], expected, rtol=2**-23, atol=0)
    np.testing.assert_array_equal(trial["time_emg"], np.arange(FRAMES * PER_FRAME) / 1000.0)
    np.testing.assert_array_equal(trial["time_marker"], np.arange(FRAMES) / 100.0)
    named = ("volunteer", "instruction", "repetition", "origin", "source")
    assert [trial.attrs[n] for n in named] == ["V07", "D", 3, "measured", "trial.c3d"]


def test_the_provenance_states_the_use_of_each_label(tmp_path: Path) -> None:
    make_c3d(tmp_path / "trial.c3d")
    trial = read_recording(tmp_path / "trial.c3d", mapping=study_mapping())
    assert note(trial, "original_names")["OOS_L"] == "E1"
    assert note(trial, "original_names")["rhinion"] == "P6"
    assert note(trial, "original_units") == {"emg": "mV", "position": "mm"}
    assert note(trial, "dropped") == {
        "Force.Fz": "in 'N', not a voltage",
        "Empty": "not in the mapping; constant at 0.0005 V",
    }
    assert "flagged" not in trial.attrs


def test_without_mapping_labels_stay_and_dead_channels_are_flagged(tmp_path: Path) -> None:
    make_c3d(tmp_path / "trial.c3d")
    trial = read_recording(tmp_path / "trial.c3d")
    assert list(trial["channel"].values) == [*(f"E{i}" for i in range(1, 15)), "Empty"]
    assert note(trial, "flagged") == {"Empty": "constant at 0.0005 V"}
    with pytest.raises(SchemaError) as caught:
        read_recording(tmp_path / "trial.c3d", study=True)
    text = str(caught.value)
    assert text.startswith("trial.c3d: The recording has") and "channel lacks OOS_L" in text
    assert "marker lacks forehead_left" in text


def test_a_mapping_may_be_a_toml_file(tmp_path: Path) -> None:
    make_c3d(tmp_path / "trial.c3d")
    lines = ['volunteer = "V07"', "[channels]", '"E2" = "OOI_L"']
    (tmp_path / "labels.toml").write_text("\n".join(lines))
    trial = read_recording(tmp_path / "trial.c3d", mapping=tmp_path / "labels.toml")
    assert list(trial["channel"].values) == ["OOI_L"]
    assert trial.sizes["marker"] == 16
    assert trial.attrs["volunteer"] == "V07"


@pytest.mark.parametrize(
    ("mapping", "text"),
    [
        ({"channels": {"E99": "OOS_L"}}, "has no channel 'E99' .did you mean 'E9'"),
        ({"markers": {"Q": "nasion"}}, "has no marker 'Q'; found P1, P2"),
        ({"channels": {"E1": "OOS_L", "E2": "OOS_L"}}, "Two labels are mapped to .* 'OOS_L'"),
        ({"channels": {"Force.Fz": "OOS_L"}}, "'Force.Fz' was omitted .in 'N', not a voltage"),
    ],
)
def test_a_mapping_that_does_not_match_is_refused(
    tmp_path: Path, mapping: dict[str, Any], text: str
) -> None:
    make_c3d(tmp_path / "trial.c3d")
    with pytest.raises(SchemaError, match=f"^trial.c3d: .*{text}"):
        read_recording(tmp_path / "trial.c3d", mapping=mapping)


def test_an_unknown_entry_of_a_mapping_is_named(tmp_path: Path) -> None:
    make_c3d(tmp_path / "trial.c3d")
    with pytest.raises(ConfigurationError, match="'channel', did you mean 'channels'"):
        read_recording(tmp_path / "trial.c3d", mapping={"channel": {}})


@pytest.mark.parametrize("unit", ["", "inch"])
def test_points_need_a_length(tmp_path: Path, unit: str) -> None:
    points, _ = make_c3d(tmp_path / "trial.c3d", point_unit=[unit])
    with pytest.raises(UnitsError, match="^trial.c3d: position (has no unit|is in 'inch')"):
        read_recording(tmp_path / "trial.c3d")
    trial = read_recording(tmp_path / "trial.c3d", mapping={"units": {"position": "cm"}})
    np.testing.assert_allclose(
        trial["position"], points.transpose(1, 0, 2) / 100, rtol=2**-23, atol=0
    )


def test_channels_need_a_unit(tmp_path: Path) -> None:
    _, analogs = make_c3d(tmp_path / "trial.c3d", analog_units=[""] * 16)
    with pytest.raises(UnitsError, match="None of the 16 analog channels has a unit"):
        read_recording(tmp_path / "trial.c3d")
    mapping = study_mapping() | {"units": {"emg": "uV"}}
    trial = read_recording(tmp_path / "trial.c3d", mapping=mapping, study=True)
    np.testing.assert_allclose(trial["emg"], analogs[:14] / 1e6, rtol=2**-23, atol=0)


def test_each_channel_is_converted_from_its_own_unit(tmp_path: Path) -> None:
    units = ["mV", "uV", "V", "mV"] + ["uV", "mV"] * 6
    _, analogs = make_c3d(tmp_path / "trial.c3d", analog_units=units)
    emg = read_recording(tmp_path / "trial.c3d")["emg"]
    divisor = np.array([1e3, 1e6, 1.0, 1e3] + [1e6, 1e3] * 6)[:, None]
    assert list(emg["channel"].values[:4]) == ["E1", "E2", "E3", "E4"]
    np.testing.assert_allclose(emg, analogs / divisor, rtol=2**-23, atol=0)


def test_points_that_are_not_positions_are_omitted(tmp_path: Path) -> None:
    make_c3d(tmp_path / "trial.c3d", point_extra={"ANGLES": ["P2"]})
    trial = read_recording(tmp_path / "trial.c3d")
    assert "P2" not in trial["marker"].values and trial.sizes["marker"] == 15
    assert note(trial, "dropped")["P2"] == "POINT:ANGLES lists it, so it is not a position"


def test_a_point_with_negative_residual_is_missing(tmp_path: Path) -> None:
    residuals = np.zeros((1, 16, FRAMES))
    residuals[0, 8, 11] = -1.0
    make_c3d(tmp_path / "trial.c3d", residuals=residuals)
    position = read_recording(tmp_path / "trial.c3d")["position"]
    gaps = np.argwhere(np.isnan(position.values).all(axis=1))
    assert gaps.tolist() == [[3, 5], [3, 6], [3, 7], [8, 11]]


def test_empty_and_repeated_labels_become_unique(tmp_path: Path) -> None:
    labels = ["A", "A", ""] + [f"P{i}" for i in range(4, 17)]
    make_c3d(tmp_path / "trial.c3d", point_labels=labels)
    trial = read_recording(tmp_path / "trial.c3d")
    assert list(trial["marker"].values[:3]) == ["A", "A (2)", "marker 3"]


def test_more_labels_than_one_parameter_holds(tmp_path: Path) -> None:
    labels = [f"P{i}" for i in range(300)]
    make_c3d(tmp_path / "trial.c3d", point_labels=labels)
    raw = ezc3d.c3d(str(tmp_path / "trial.c3d"))["parameters"]["POINT"]
    assert len(raw["LABELS"]["value"]) == 255 and "LABELS2" in raw
    assert list(read_recording(tmp_path / "trial.c3d")["marker"].values) == labels


def test_any_numbers_of_points_and_channels_are_read(tmp_path: Path) -> None:
    """Among them as many analog samples in a frame as the points have values."""
    for points, channels in ((4 * PER_FRAME, 16), (PER_FRAME, 4), (4, 1), (5, 2)):
        labels = {"point_labels": [f"P{i}" for i in range(points)],
                  "analog_labels": [f"E{i}" for i in range(channels)]}  # fmt: skip
        make_c3d(tmp_path / "a.c3d", **labels, analog_units=["mV"] * channels)
        read = read_recording(tmp_path / "a.c3d")
        assert read.sizes.get("marker", 0) == points and read.sizes.get("channel", 0) == channels


@pytest.mark.parametrize("part", [0.0, 0.001, 0.1, 0.6, 0.97])
def test_a_truncated_file_is_refused(tmp_path: Path, part: float) -> None:
    path = tmp_path / "trial.c3d"
    make_c3d(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(len(whole) * part)])
    with pytest.raises(DataError, match=r"^trial.c3d (cannot be read|declares 20 frames)"):
        read_recording(path)


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "trial.c3d").write_text("no C3D at all\n" * 100)
    with pytest.raises(DataError, match="^trial.c3d cannot be read"):
        read_recording(tmp_path / "trial.c3d")


@pytest.fixture(scope="module")
def real(real_c3d: Path) -> xr.Dataset:
    return read_recording(real_c3d)


def test_the_real_file_has_its_rates_counts_and_units(real: xr.Dataset) -> None:
    assert dict(real.sizes) == {
        "channel": 38, "time_emg": 11600, "marker": 51, "axis": 3, "time_marker": 580,
    }  # fmt: skip
    for time, rate, samples in (("time_emg", 2000.0, 11600), ("time_marker", 100.0, 580)):
        np.testing.assert_array_equal(real[time], np.arange(samples) / rate)
        assert samples / rate == 5.80
    assert note(real, "original_units") == {"emg": "V", "position": "mm"}
    assert (real["emg"].units, real["position"].units) == ("V", "m")


def test_the_real_values_are_those_of_the_file(real: xr.Dataset, real_c3d: Path) -> None:
    raw = ezc3d.c3d(str(real_c3d))["data"]
    np.testing.assert_array_equal(real["emg"], raw["analogs"][0])
    expected = raw["points"][:3].transpose(1, 0, 2) / 1000.0
    np.testing.assert_array_equal(real["position"], expected)
    assert round(100 * np.isnan(raw["points"]).mean(), 1) == 0.8  # as published with the file


def test_the_real_file_has_eleven_live_and_five_dead_surface_channels(real: xr.Dataset) -> None:
    flagged = note(real, "flagged")
    assert not set(REAL_EMG) & set(flagged)
    assert {label: flagged[label] for label in DEAD_EMG} == dict.fromkeys(
        DEAD_EMG, "constant at 0 V"
    )
    deviation = real["emg"].sel(channel="Delt_ant.EMG1").std().item()
    assert deviation == pytest.approx(0.212e-3, abs=0.0005e-3)  # as published with the file


def test_the_real_file_is_mapped_and_written(real_c3d: Path, tmp_path: Path) -> None:
    mapping = {"channels": {label: label.split(".")[0] for label in REAL_EMG}}
    live = read_recording(real_c3d, mapping=mapping)
    assert live.sizes["channel"] == 11 and "flagged" not in live.attrs
    dropped = note(live, "dropped")
    assert len(dropped) == 38 - 11
    assert dropped["Sensor 12.EMG12"] == "not in the mapping; constant at 0 V"
    assert dropped["Voltage.1"] == "not in the mapping"
    back = read_recording(write_recording(live, tmp_path / "live.nc"))
    xr.testing.assert_identical(back, live)
    assert json.loads(back.attrs["original_names"])["Infra"] == "Infra.EMG10"


def test_the_real_file_cut_short_is_refused(real_c3d: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.c3d"
    cut.write_bytes(real_c3d.read_bytes()[:1_000_000])
    with pytest.raises(DataError, match="cut.c3d declares 580 frames but contains 255"):
        read_recording(cut)
