"""Labels, units and rates that a file states against its sidecar, and labels that occur twice in it."""

from collections.abc import Callable
from pathlib import Path

import ezc3d
import h5py
import numpy as np
import pytest
import scipy.io
from edfio import Edf, EdfSignal

from emgface.errors import EmgfaceError
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording
from emgface.recordings.describe import describe
from emgface.recordings.findings import findings_in
from emgface.recordings.readers._declared import RATE_NAMES
from tests.data.test_xdf import channel, make, stream

RNG = np.random.default_rng(4)
EMG = RNG.normal(0.0, 0.05, (3, 4000))
CODES = {"rate", "repeated_label"}


def codes(recording) -> list[tuple[str, str]]:
    return [(f.code, f.name) for f in findings_in(recording) if f.code in CODES]


def table(folder: Path, labels: str, *, unit: str = "mV", more: str = "") -> Path:
    time = np.arange(EMG.shape[1]) / 2000.0
    rows = np.column_stack([time, *EMG])
    lines = [",".join(f"{v:.6f}" for v in row) for row in rows]
    (folder / "a.csv").write_text("\n".join([labels, *lines]) + "\n")
    first = labels.partition(",")[0]
    path = folder / "a.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "a.csv"\nunit = "{unit}"\ntime = "{first}"\n{more}'
    )
    return path


@pytest.mark.parametrize(
    ("labels", "message"),
    [
        (
            "time,ZYG_L (uV),ZYG_R,OOS_L",
            r"'ZYG_L \(uV\)' is in uV by its label, and in mV by 'unit'",
        ),
        ("time,ZYG_L,ZYG_R [V],OOS_L", "in V by its label"),
        ("time (ms),ZYG_L,ZYG_R,OOS_L", "in ms by its label, and in s by 'time_unit'"),
    ],
)
def test_a_unit_in_a_label_that_contradicts_the_sidecar_is_refused(tmp_path, labels, message):
    with pytest.raises(EmgfaceError, match=message):
        read_recording(table(tmp_path, labels))


@pytest.mark.parametrize("labels", ["time (s),ZYG_L (mV),ZYG_R,OOS_L", "time,ZYG_L V,ZYG_R,OOS_L"])
def test_agreeing_and_ambiguous_units_in_labels_are_read(tmp_path, labels):
    assert read_recording(table(tmp_path, labels)).sizes["channel"] == 3


def test_a_wrong_unit_in_a_label_is_overridden_by_a_mapping_and_counts_have_their_own(tmp_path):
    given = table(tmp_path, "time,ZYG_L (uV),ZYG_R,OOS_L")
    read = read_recording(given, mapping={"units": {"emg": "mV"}})
    assert float(read["emg"].std()) == pytest.approx(5e-5, rel=0.05)
    counts = table(tmp_path, "time,ZYG_L (uV),ZYG_R,OOS_L", more="step = 0.5\n")
    assert float(read_recording(counts)["emg"].std()) == pytest.approx(2.5e-5, rel=0.05)


def test_the_unit_of_an_unused_column_is_not_compared(tmp_path):
    more = '[emg.channels]\nZYG_R = "ZYG_R"\n'
    assert (
        read_recording(table(tmp_path, "time,raw (uV),ZYG_R,OOS_L", more=more)).sizes["channel"]
        == 1
    )


def test_a_unit_in_the_labels_of_markers_is_compared(tmp_path):
    (tmp_path / "p.csv").write_text("a_x_cm,a_y_cm,a_z_cm\n" + "1.0,2.0,3.0\n" * 50)
    path = tmp_path / "p.toml"
    path.write_text(
        'schema = "recording"\n[position]\nfile = "p.csv"\nunit = "mm"\nrate = 100\n'
        'axes = ["_x_cm", "_y_cm", "_z_cm"]\n'
    )
    with pytest.raises(EmgfaceError, match="in cm by its label, and in mm by 'unit'"):
        read_recording(path)


def mat(path: Path, **more: object) -> None:
    scipy.io.savemat(path, {"emg": EMG.T, **more})


def structure(path: Path, **more: object) -> None:
    scipy.io.savemat(path, {"rec": {"emg": EMG.T, **more}, "fs": 123.0})


def hdf5(path: Path, **more: float) -> None:
    with h5py.File(path, "w") as opened:
        data = opened.create_dataset("rec/emg", data=EMG.T)
        opened["other/fs"] = 123.0
        data.attrs.update(more)


STATED: list[tuple[Callable[..., None], str, str]] = [
    (mat, "a.mat", "emg"),
    (structure, "a.mat", "rec.emg"),
    (hdf5, "a.h5", "rec/emg"),
]


@pytest.mark.parametrize(
    ("save", "name", "variable"), STATED, ids=lambda x: getattr(x, "__name__", None)
)
@pytest.mark.parametrize("word", sorted(RATE_NAMES))
def test_a_rate_next_to_an_array_is_compared(tmp_path, save, name, variable, word):
    path = tmp_path / "a.toml"
    for stated, expected in ((1000.0, [("rate", "")]), (2000.0, []), (2.0, [])):
        save(tmp_path / name, **{word: stated})
        path.write_text(
            f'schema = "recording"\n[emg]\nfile = "{name}"\nvariable = "{variable}"\nunit = "mV"\n'
            'rate = 2000\ndims = ["time", "channel"]\ncolumns = ["ZYG_L", "ZYG_R", "OOS_L"]\n'
        )
        assert codes(read_recording(path)) == expected


def matlab73(path: Path, **more: object) -> None:
    """As MATLAB writes: dims reversed, texts as characters."""
    with h5py.File(path, "w", userblock_size=512) as opened:
        opened["emg"] = EMG
        for name, value in more.items():
            text = isinstance(value, str)
            stored = [[ord(c)] for c in str(value)] if text else [[value]]
            data = opened.create_dataset(name, data=np.array(stored, "u2" if text else "f8"))
            data.attrs["MATLAB_class"] = np.bytes_("char" if text else "double")
    with path.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


def next_to(path: Path, **more: object) -> None:
    with h5py.File(path, "w") as opened:
        opened["rec/emg"] = EMG.T
        for name, value in more.items():
            opened[f"rec/{name}"] = value


def of_group(path: Path, **more: object) -> None:
    with h5py.File(path, "w") as opened:
        opened["rec/emg"] = EMG.T
        opened["rec"].attrs.update(more)


def of_file(path: Path, **more: object) -> None:
    with h5py.File(path, "w") as opened:
        opened["rec/emg"] = EMG.T
        opened.attrs.update(more)


PLACES = [
    *STATED,
    (matlab73, "a.mat", "emg"),
    (next_to, "a.h5", "rec/emg"),
    (of_group, "a.h5", "rec/emg"),
    (of_file, "a.h5", "rec/emg"),
]
"""Places in which a file states something next to an array."""


def array(folder: Path, name: str, variable: str, more: str = "", unit: str = "mV") -> Path:
    path = folder / "a.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "{name}"\nvariable = "{variable}"\nunit = "{unit}"\n'
        f'rate = 2000\ncolumns = ["ZYG_L", "ZYG_R", "OOS_L"]\n{more}'
    )
    return path


def stated_by(recording) -> list[str]:
    return [f.code for f in findings_in(recording) if f.code in ("conversion", "bad_list")]


@pytest.mark.parametrize(
    ("save", "name", "variable"), PLACES, ids=lambda x: getattr(x, "__name__", "")
)
@pytest.mark.parametrize("word", ["unit", "Units", "EMGUnits", "amplitude_unit"])
def test_a_unit_next_to_an_array_is_compared(tmp_path, save, name, variable, word):
    for stated in ("uV", "microvolts", "V"):
        save(tmp_path / name, **{word: stated})
        with pytest.raises(EmgfaceError, match=r"(states|in) (uV|V)\b.*correct the sidecar"):
            read_recording(array(tmp_path, name, variable))
    for stated in ("mV", "millivolts", "N", "see protocol"):
        save(tmp_path / name, **{word: stated})
        assert stated_by(read_recording(array(tmp_path, name, variable))) == []


@pytest.mark.parametrize(
    ("save", "name", "variable"), PLACES, ids=lambda x: getattr(x, "__name__", "")
)
@pytest.mark.parametrize("word", ["gain", "EMG_Gain", "scale", "resolution", "calibration_factor"])
def test_a_conversion_next_to_an_array_is_a_finding(tmp_path, save, name, variable, word):
    save(tmp_path / name, **{word: 0.25})
    recording = read_recording(array(tmp_path, name, variable))
    (finding,) = [f for f in findings_in(recording) if f.code == "conversion"]
    assert word in finding.sentence and "0.25" in finding.sentence
    assert stated_by(read_recording(array(tmp_path, name, variable, "step = 1.0\n"))) == []
    converted = read_recording(array(tmp_path, name, variable, "step = 0.25\n"))
    assert stated_by(converted) == []
    assert float(converted["emg"].std()) == pytest.approx(EMG.std() * 0.25e-3, rel=1e-6)
    save(tmp_path / name, **{word: 1.0})
    assert stated_by(read_recording(array(tmp_path, name, variable))) == []


def test_a_draft_has_the_unit_of_the_file(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "fs": 2000.0, "EMGUnits": "mV"})
    draft = describe(tmp_path / "a.mat")
    assert 'unit = "mV"' in draft and "emg.unit" not in draft


def test_statements_of_another_signal_do_not_apply(tmp_path):
    given = {
        "emg": EMG.T,
        "eog": EMG.T[:, :1],
        "eog_unit": "V",
        "force_gain": 5.0,
        "time_unit": "ms",
    }
    scipy.io.savemat(tmp_path / "a.mat", given)
    assert stated_by(read_recording(array(tmp_path, "a.mat", "emg"))) == []
    scipy.io.savemat(tmp_path / "a.mat", {**given, "unit": "uV", "emg_unit": "mV"})
    assert stated_by(read_recording(array(tmp_path, "a.mat", "emg"))) == []


def test_units_of_each_channel_and_a_mapping(tmp_path):
    units = np.array(["mV", "uV", "mV"], dtype=object)
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "units": units})
    with pytest.raises(EmgfaceError, match="'units' states mV, uV"):
        read_recording(array(tmp_path, "a.mat", "emg"))
    read_recording(array(tmp_path, "a.mat", "emg", 'units = { ZYG_R = "uV" }\n'))
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "units": "V"})
    read_recording(array(tmp_path, "a.mat", "emg"), mapping={"units": {"emg": "mV"}})


@pytest.mark.parametrize("stated", [np.array([2.0]), np.array(["ZYG_R"], dtype=object)])
def test_a_list_of_bad_channels_is_a_finding(tmp_path, stated):
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "bad_channels": stated})
    assert stated_by(read_recording(array(tmp_path, "a.mat", "emg"))) == ["bad_list"]
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "bad_channels": np.array([])})
    assert stated_by(read_recording(array(tmp_path, "a.mat", "emg"))) == []


@pytest.mark.parametrize("attribute", ["_FillValue", "missing_value", "valid_max", "valid_range"])
def test_numbers_that_attributes_call_missing_are_gaps(tmp_path, attribute):
    values = np.rint(1e3 * EMG.T).astype("i2")
    values[100:150, 1] = 9999
    stated = {"valid_max": np.int16(9000), "valid_range": np.array([-9000, 9000], "i2")}
    with h5py.File(tmp_path / "a.h5", "w") as opened:
        opened["emg"] = values
        opened["emg"].attrs[attribute] = stated.get(attribute, np.int16(9999))
    for more in ("", "step = 0.5\n"):
        lost = np.isnan(read_recording(array(tmp_path, "a.h5", "emg", more))["emg"].values)
        assert lost[1, 100:150].all() and lost.sum() == 50


@pytest.mark.parametrize(
    ("line", "result"),
    [("# Unit: uV", "states uV"), ("Units = V", "states V"), ("EMG unit,uV,uV", "states uV"),
     ("# Unit: mV", ""), ("unit: see below", ""), ("Gain = 500", "conversion"),
     ("# scale factor: 0.5", "conversion"), ("offset;0", ""), ("Subject: unit 5", "")],
)  # fmt: skip
def test_lines_before_a_table_are_compared(tmp_path, line, result):
    path = table(tmp_path, "time,ZYG_L,ZYG_R,OOS_L", more="skip_rows = 1\n")
    file = tmp_path / "a.csv"
    file.write_text(f"{line}\n{file.read_text()}")
    if result.startswith("states"):
        with pytest.raises(EmgfaceError, match=result):
            read_recording(path)
        read_recording(path, mapping={"units": {"emg": "mV"}})
    else:
        assert stated_by(read_recording(path)) == ([result] if result else [])


def edf(path: Path) -> Path:
    labels = ["ZYG_L", "ZYG_L", "OOS_L"]
    signals = [
        EdfSignal(1e3 * row, sampling_frequency=2000, label=label, physical_dimension="uV")
        for row, label in zip(EMG, labels, strict=True)
    ]
    Edf(signals).write(path.with_suffix(".edf"))
    return path.with_suffix(".edf")


def c3d(path: Path) -> Path:
    content = ezc3d.c3d()
    content["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    content["parameters"]["POINT"]["LABELS"]["value"] = ["nasion", "nasion", "rhinion"]
    content["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    content["data"]["points"] = RNG.normal(size=(4, 3, 200))
    content["parameters"]["ANALOG"]["RATE"]["value"] = [2000.0]
    content["parameters"]["ANALOG"]["LABELS"]["value"] = ["ZYG_L", "ZYG_L", "OOS_L"]
    content["parameters"]["ANALOG"]["UNITS"]["value"] = ["mV"] * 3
    content["data"]["analogs"] = EMG[None]
    content.write(str(path.with_suffix(".c3d")))
    return path.with_suffix(".c3d")


def trc(path: Path) -> Path:
    names = ["nasion", "nasion", "rhinion"]
    rows = [
        "\t".join([str(k + 1), f"{k / 100:.2f}", *(f"{v:.3f}" for v in RNG.normal(size=9))])
        for k in range(50)
    ]
    axes = "\t".join(f"{a}{k}" for k in (1, 2, 3) for a in "XYZ")
    head = ["PathFileType\t4\t(X/Y/Z)\ta.trc",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t"
            "OrigNumFrames", "100\t100\t50\t3\tmm\t100\t1\t50",
            "Frame#\tTime\t" + "\t\t\t".join(names), "\t\t" + axes, ""]  # fmt: skip
    path.with_suffix(".trc").write_text("\n".join([*head, *rows]) + "\n")
    return path.with_suffix(".trc")


@pytest.mark.parametrize(
    ("write", "expected"),
    [
        (edf, [("repeated_label", "ZYG_L")]),
        (c3d, [("repeated_label", "ZYG_L"), ("repeated_label", "nasion")]),
        (trc, [("repeated_label", "nasion")]),
    ],
)
def test_a_label_that_occurs_twice_is_a_finding_that_the_check_tells(tmp_path, write, expected):
    recording = read_recording(write(tmp_path / "a"))
    assert codes(recording) == expected
    table = check_recording(recording).set_index("name")
    assert all("have this label" in table.loc[name, "reason"] for _, name in expected)


def test_a_mapping_of_both_labels_settles_it(tmp_path):
    path = edf(tmp_path / "a")
    one = read_recording(path, mapping={"channels": {"ZYG_L": "ZYG_L"}})
    both = read_recording(path, mapping={"channels": {"ZYG_L": "ZYG_L", "ZYG_L (2)": "ZYG_R"}})
    assert codes(one) == [("repeated_label", "ZYG_L")]
    assert codes(both) == []


def test_a_repeated_label_of_a_table_that_its_sidecar_uses_is_refused(tmp_path):
    labels = "time,EMG,EMG,OOS_L"
    more = '[emg.channels]\nEMG = "ZYG_L"\n'
    with pytest.raises(EmgfaceError, match="several columns 'EMG'"):
        read_recording(table(tmp_path, labels, more=more))
    both = more + '"EMG.1" = "ZYG_R"\n'
    assert read_recording(table(tmp_path, labels, more=both)).sizes["channel"] == 2
    neither = '[emg.channels]\nOOS_L = "OOS_L"\n'
    assert read_recording(table(tmp_path, labels, more=neither)).sizes["channel"] == 1


@pytest.mark.parametrize("key", ["gain", "offset", "conversion", "sensitivity", "bit_volts"])
@pytest.mark.parametrize("kind", ["channel", "marker"])
def test_conversions_of_channels_of_xdf_are_stated(tmp_path, kind, key):
    def codes_with(value: str, **mapping: object) -> list[str]:
        entries = {"unit": "uV" if kind == "channel" else "mm", key: value}
        if kind == "channel":
            labels = [channel(label=k, type="EMG", **entries) for k in ("ZYG_L", "ZYG_R")]
            path = make(tmp_path, stream(1, "EMG", 1000.0, 5.0, EMG[:2].T, labels))
        else:
            labels = [
                channel(label=f"a_{axis}", marker="a", type=f"Position{axis}", **entries)
                for axis in "XYZ"
            ]
            path = make(tmp_path, stream(1, "MoCap", 100.0, 5.0, EMG.T, labels))
        every = findings_in(read_recording(path, mapping=mapping))
        stated = [f for f in every if f.code == "unapplied_conversion"]
        assert all(f.kind == kind and key in f.sentence for f in stated)
        return [f"{f.values['value']}" for f in stated]

    assert codes_with("24") == ["24"]
    assert codes_with("0" if key == "offset" else "1") == []
    assert codes_with("24", units={"emg": "mV", "position": "mm"}) == []
