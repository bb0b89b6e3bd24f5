"""Kinds of reported faults in other formats: what a reader must find, or refuse with the place."""

import json
from pathlib import Path

import edfio
import h5py
import numpy as np
import pytest
import scipy.io
import scipy.signal
import xarray as xr

from emgface.errors import DataError, UnitsError
from emgface.recordings.bids import write_bids
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import Finding, findings_in
from emgface.recordings.labels import note
from emgface.recordings.quality.processed import processing
from tests.data.made_exports import EXPORTS
from tests.data.made_recordings import RATE, noise
from tests.data.test_bids import MOTION, edit
from tests.data.test_brainvision import make as brainvision
from tests.data.test_xdf import EMG as XDF_EMG
from tests.data.test_xdf import channel, emg_stream, make, stream

RNG = np.random.default_rng(6)
EMG = RNG.normal(0.0, 50.0, (2, 4000))
KEPT = np.r_[0:1000, 1300:4000]  #: 0.3 s at 1000 Hz are lost


def with_code(recording: xr.Dataset, code: str) -> list[Finding]:
    return [f for f in findings_in(recording) if f.code == code]


def absent(recording: xr.Dataset) -> np.ndarray:
    return np.flatnonzero(np.isnan(recording["emg"].values[0]))


def table(folder: Path, columns: dict[str, np.ndarray], *, above: str = "", more: str = "") -> Path:
    rows = np.column_stack(list(columns.values()))
    lines = [",".join(columns), *(",".join(f"{v:.9g}" for v in row) for row in rows)]
    (folder / "a.csv").write_text(above + "\n".join(lines) + "\n")
    path = folder / "a.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "a.csv"\nunit = "uV"\nrate = 1000.0\n{more}'
    )
    return path


def edf(folder: Path, *signals: edfio.EdfSignal, **options) -> Path:
    edfio.Edf(signals, **options).write(folder / "a.edf")
    return folder / "a.edf"


def signal(values: np.ndarray, label: str, rate: float = 1000.0, **options) -> edfio.EdfSignal:
    return edfio.EdfSignal(values, rate, label=label, physical_dimension="uV", **options)


# Clocks and lost samples


@pytest.mark.parametrize("kind", ["xdf", "AcqKnowledge"])
def test_a_counter_among_the_channels_shows_a_loss_in_every_format(
    tmp_path: Path, kind: str
) -> None:
    counts, emg = KEPT.astype(float), EMG[:, KEPT]
    if kind == "xdf":
        names = [
            channel(label="E1", unit="microvolts", type="EMG"),
            channel(label="n", type="Misc"),
        ]
        path = make(tmp_path, stream(1, "EMG", 1000.0, 0.0, np.c_[emg[0], counts], names))
    else:
        lines = [
            "a.acq",
            "1 msec/sample",
            "2 channels",
            "E1",
            "microvolts",
            "n",
            "Volts",
            "CH1,CH2",
        ]
        lines += [f"{a:.6f},{n:g}" for a, n in zip(emg[0], counts, strict=True)]
        path = tmp_path / "a.txt"
        path.write_text("\n".join(lines) + "\n")
    recording = read_recording(path)
    np.testing.assert_array_equal(absent(recording), np.arange(1000, 1300))
    assert [f.values["samples"] for f in with_code(recording, "gap")] == [300]
    assert "n" in note(recording, "dropped")


@pytest.mark.parametrize("suffix", ["mat", "h5"])
@pytest.mark.parametrize("name", ["time", "timestamps", "t"])
def test_times_in_the_file_of_an_array_show_a_loss(tmp_path: Path, suffix: str, name: str) -> None:
    content = {"emg": EMG[:, KEPT].T, name: KEPT / 1000.0}
    path = tmp_path / f"a.{suffix}"
    if suffix == "mat":
        scipy.io.savemat(path, content)
    else:
        with h5py.File(path, "w") as file:
            file.update(content)
    sidecar = tmp_path / "a.toml"
    sidecar.write_text(
        f'schema = "recording"\n[emg]\nfile = "{path.name}"\nvariable = "emg"\nrate = 1000.0\n'
        'unit = "uV"\n'
    )
    np.testing.assert_array_equal(absent(read_recording(sidecar)), np.arange(1000, 1300))


def test_a_sampling_interval_in_the_file_of_an_array_contradicts_a_rate(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "dt": 0.0005})
    sidecar = tmp_path / "a.toml"
    sidecar.write_text(
        'schema = "recording"\n[emg]\nfile = "a.mat"\nvariable = "emg"\nrate = 1000.0\nunit = "uV"\n'
    )
    (finding,) = with_code(read_recording(sidecar), "rate")
    assert finding.values["other"] == pytest.approx(2000.0)


@pytest.mark.parametrize(
    "line",
    ["%Sample Rate = 250.0 Hz", "# fs: 250", "Sampling frequency (Hz);250", "srate 0.25 kHz"],
)
def test_a_rate_above_a_table_contradicts_its_sidecar(tmp_path: Path, line: str) -> None:
    path = table(tmp_path, {"E1": EMG[0]}, above=f"{line}\n", more="skip_rows = 1\n")
    (finding,) = with_code(read_recording(path), "rate")
    assert finding.values["other"] == 250.0


def test_the_rate_in_the_comment_of_brainvision_is_compared(tmp_path: Path) -> None:
    path = brainvision(tmp_path, interval="488")
    path.write_text(path.read_text() + "Sampling Rate [Hz]: 2048\nSampling Interval [uS]: 488.28\n")
    (finding,) = with_code(read_recording(path), "rate")
    assert (finding.values["other"], round(finding.values["used"], 2)) == (2048.0, 2049.18)


def test_two_recordings_joined_by_an_empty_line_are_doubted(tmp_path: Path) -> None:
    path = table(tmp_path, {"E1": EMG[0], "E2": EMG[1]})
    file = tmp_path / "a.csv"
    text = file.read_text()
    file.write_text(text + "\n" + text.partition("\n")[2])
    (finding,) = with_code(read_recording(path), "blank_line")
    assert (finding.values["first"], finding.values["last"]) == (4002, 4002)
    file.write_text(text + "\n\n")
    assert not with_code(read_recording(path), "blank_line")


# Stated numbers and durations


@pytest.mark.parametrize("name", ["EMGworks", "Noraxon", "AcqKnowledge", "Trigno Discover"])
def test_the_number_of_samples_that_an_export_states_is_compared(tmp_path: Path, name: str) -> None:
    time = np.arange(2000) / 1000.0
    rows = [f"{t:.4f},{v:.6f}" for t, v in zip(time, EMG[0], strict=False)]
    head, suffix = {
        "EMGworks": (["Label: E1 Sampling frequency: 1000 Number of points: 3000 start: 0 "
                      "Unit: uV Domain Label: Time", "X[s],E1 [uV]"], "csv"),
        "Noraxon": (["type,begin_time,frequency,count", "record,0,1000,1500", "", "time,E1 (uV)"],
                    "csv"),
        "AcqKnowledge": (["a.acq", "1 msec/sample", "1 channels", "E1", "microvolts", "sec,CH1",
                          ",3000"], "txt"),
        "Trigno Discover": (["Application:,Trigno Discover", "Collection Length (seconds):,3.0",
                             "E1,", "sensor mode: 65,", "EMG 1 Time Series (s),EMG 1 (uV)",
                             ",1000 Hz"], "csv"),
    }[name]  # fmt: skip
    path = tmp_path / f"a.{suffix}"
    path.write_text("\n".join([*head, *rows]) + "\n")
    assert name in EXPORTS
    (finding,) = with_code(read_recording(path), "sample_count")
    assert finding.values["held"] == 2000 and finding.values["stated"] in (1500, 3000)


@pytest.mark.parametrize(
    ("stated", "samples", "code"),
    [(20.0, 4000, "duration"), (4 / 60, 4000, "duration"), (4.0, 4000, ""), (3.3, 3300, "")],
)
def test_a_stated_duration_cuts_only_what_fills_the_last_record(
    tmp_path: Path, stated: float, samples: int, code: str
) -> None:
    path = edf(tmp_path, signal(EMG[0], "E1")).rename(tmp_path / "sub-01_task-A_emg.edf")
    (tmp_path / "sub-01_task-A_channels.tsv").write_text("name\ttype\tunits\nE1\tEMG\tuV\n")
    sidecar = json.dumps({"SamplingFrequency": 1000, "RecordingDuration": stated})
    (tmp_path / "sub-01_task-A_emg.json").write_text(sidecar)
    recording = read_recording(path)
    assert recording.sizes["time_emg"] == samples
    assert [f.code for f in with_code(recording, "duration")] == ([code] if code else [])


@pytest.mark.parametrize(
    ("kind", "message"), [("epoched", "contains epochs"), ("discontinuous", "")]
)
def test_pauses_that_bids_states_are_refused_or_reported(
    trial: xr.Dataset, tmp_path: Path, kind: str, message: str
) -> None:
    path = write_bids(trial, tmp_path)[0]
    sidecar = path.with_name(path.name.replace("emg.bdf", "emg.json"))
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | {"RecordingType": kind}))
    if message:
        with pytest.raises(DataError, match=message):
            read_recording(path)
    else:
        assert len(with_code(read_recording(path), "pauses")) == 1


def test_latencies_are_read_in_their_unit(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_bids(trial, tmp_path)[0]
    motion = tmp_path / (MOTION + "motion.tsv")
    rows = motion.read_text().splitlines()
    motion.write_text("".join(f"{row}\t{1000 * k / 100:g}\n" for k, row in enumerate(rows)))
    channels = motion.with_name(motion.name.replace("motion.tsv", "channels.tsv"))
    head, first, *_ = channels.read_text().splitlines()
    cells = dict.fromkeys(head.split("\t"), "n/a") | {"name": "t", "type": "LATENCY", "units": "ms"}
    channels.write_text(channels.read_text() + "\t".join(cells.values()) + "\n")
    recording = read_recording(path)
    np.testing.assert_allclose(recording["time_marker"], np.arange(len(rows)) / 100, atol=1e-9)
    assert first


# Channels by name


@pytest.mark.parametrize("end", [" ", ""])
def test_spaces_and_capitals_of_a_table_of_bids_exchange_no_channels(
    trial: xr.Dataset, tmp_path: Path, end: str
) -> None:
    path = write_bids(trial, tmp_path)[0]
    channels = path.with_name(path.name.replace("emg.bdf", "channels.tsv"))
    head, *rows = channels.read_text().splitlines()
    first, second = ([cell + end for cell in row.split("\t")] for row in rows[:2])
    first[0] = first[0].lower() if not end else first[0]
    channels.write_text("\n".join([head, "\t".join(second), "\t".join(first), *rows[2:]]) + "\n")
    recording = read_recording(path)
    given = [str(name).upper() for name in recording["channel"].values]
    assert given == [str(name) for name in trial["channel"].values]
    assert not with_code(recording, "repeated_label")


def test_a_table_of_bids_in_another_order_with_another_name_is_refused(
    trial: xr.Dataset, tmp_path: Path
) -> None:
    path = write_bids(trial, tmp_path)[0]
    channels = path.with_name(path.name.replace("emg.bdf", "channels.tsv"))
    head, first, second, *rows = channels.read_text().splitlines()
    second = second.replace(second.split("\t")[0], "another name", 1)
    channels.write_text("\n".join([head, second, first, *rows]) + "\n")
    with pytest.raises(DataError, match=r"channel 1 is '\w+', and row 2 of its channels.tsv is"):
        read_recording(path)


def test_channels_at_another_rate_are_stated_by_the_check(tmp_path: Path) -> None:
    signals = signal(EMG[0], "E1"), signal(EMG[1], "E2"), signal(EMG[1, :2000], "E3", 500.0)
    rows = check_recording(read_recording(edf(tmp_path, *signals))).set_index("name")
    assert rows.loc["E3", "verdict"] == "warning"
    assert "sampled at 500 Hz, the others at 1000 Hz" in rows.loc["E3", "reason"]


# Units and scales


@pytest.mark.parametrize("which", ["marker", "axis"])
def test_several_units_of_positions_in_xdf_are_refused(tmp_path: Path, which: str) -> None:
    other = {"marker": lambda m, a: m == "chin", "axis": lambda m, a: a == "Z"}[which]
    channels = [
        channel(label=f"{m}_{a}", marker=m, type=f"Position{a}", unit="m" if other(m, a) else "mm")
        for m in ("nasion", "chin")
        for a in "XYZ"
    ]
    path = make(tmp_path, stream(1, "MoCap", 100.0, 0.0, RNG.normal(size=(50, 6)), channels))
    with pytest.raises(UnitsError, match="states the units 'mm', 'm' for positions"):
        read_recording(path)
    assert read_recording(path, mapping={"units": {"position": "mm"}}).sizes["marker"] == 2


def test_a_factor_that_may_be_applied_already_is_refused(tmp_path: Path) -> None:
    names = [channel(label="E1", unit="uV", type="EMG", scaling_factor="0.1")]
    path = make(tmp_path, stream(1, "EMG", 1000.0, 0.0, XDF_EMG[:, :1], names))
    with pytest.raises(UnitsError, match="'E1' states scaling_factor = 0.1"):
        read_recording(path)
    read = read_recording(path, mapping={"units": {"E1": "uV"}})
    np.testing.assert_allclose(read["emg"].values[0], XDF_EMG[:, 0] / 1e6)
    assert emg_stream()


# Marks


def test_marks_without_duration_are_stated_and_marks_of_channels_concern_these(
    tmp_path: Path,
) -> None:
    notes = [
        edfio.EdfAnnotation(0.5, None, "BAD artefact"),
        edfio.EdfAnnotation(1.0, 0.1, "BAD@@E2"),
    ]
    path = edf(tmp_path, signal(EMG[0], "E1"), signal(EMG[1], "E2"), annotations=notes)
    recording = read_recording(path)
    (moment,) = with_code(recording, "bad_moment")
    assert (moment.values["at"], moment.verdict) == (0.5, "warning")
    gaps = np.isnan(recording["emg"].values)
    assert not gaps[0].any()
    np.testing.assert_array_equal(np.flatnonzero(gaps[1]), np.arange(1000, 1100))


def test_comments_of_brainvision_mark_bad_intervals_as_annotations_of_edf_do(
    tmp_path: Path,
) -> None:
    path = brainvision(
        tmp_path,
        markers="Mk1=New Segment,,1,1,0\nMk2=Comment,BAD_movement,11,20,2\nMk3=Comment,badge,50,9,0",
    )
    gaps = np.isnan(read_recording(path)["emg"].values)
    assert not gaps[0].any()
    np.testing.assert_array_equal(np.flatnonzero(gaps[1]), np.arange(10, 30))


def test_an_unknown_status_of_a_channel_is_stated(trial: xr.Dataset, tmp_path: Path) -> None:
    path = write_bids(trial, tmp_path)[0]
    channels = path.with_name(path.name.replace("emg.bdf", "channels.tsv"))
    head, *rows = channels.read_text().splitlines()
    rows = [f"{row}\t{'noisy' if k == 3 else 'good'}" for k, row in enumerate(rows)]
    assert "status\t" not in head
    channels.write_text("\n".join([f"{head}\tstatus", *rows]) + "\n")
    (finding,) = with_code(read_recording(path), "status")
    assert (finding.name, finding.values["status"]) == (str(trial["channel"].values[3]), "noisy")
    edit(channels, "noisy", "n/a")
    assert not with_code(read_recording(path), "status")


# Processed signals


@pytest.mark.parametrize(
    "label",
    ["ZYG_L RMS", "Zyg rectified", "EMG envelope L", "Zyg_L_integrated", "EMG gleichgerichtet"],
)
def test_a_label_that_states_processing_is_reported_after_mapping(
    tmp_path: Path, label: str
) -> None:
    path = table(tmp_path, {label: EMG[0], "ZYG_R": EMG[1]})
    recording = read_recording(path, mapping={"channels": {label: "ZYG_L", "ZYG_R": "ZYG_R"}})
    assert [f.name for f in with_code(recording, "processed")] == ["ZYG_L"]


SMOOTH = scipy.signal.butter(4, 10.0, fs=RATE, output="sos")
PROCESSED = {
    "rectified with offset": (lambda x: np.abs(x) + 1e-3, "rectified"),
    "rectified about its mean": (lambda x: np.abs(x) - np.abs(x).mean(), "rectified"),
    "rectified with the other sign": (lambda x: 1e-3 - np.abs(x), "rectified"),
    "envelope with undershoot": (lambda x: scipy.signal.sosfiltfilt(SMOOTH, np.abs(x)) - 1e-6,
                                 "envelope"),
    "raw": (lambda x: x + 1e-3, None),
    "clipped": (lambda x: np.clip(x, -4e-5, 1.0), None),
    "hum": (lambda x: x + 1e-4 * np.sin(2 * np.pi * 50.0 * np.arange(x.size) / RATE), None),
    "drift": (lambda x: x + 2e-3 * np.linspace(0.0, 1.0, x.size) ** 2, None),
    "steps of the converter": (lambda x: np.round(x / 5e-6) * 5e-6, None),
}  # fmt: skip


@pytest.mark.parametrize("case", PROCESSED)
def test_processed_emg_is_recognised_without_its_sign(case: str) -> None:
    change, code = PROCESSED[case]
    finding = processing("ZYG_L", change(noise(1)[0]), RATE)
    assert (finding and finding.code) == code


@pytest.mark.parametrize(
    ("kind", "filters", "codes"),
    [
        ("SoftwareFilters", {"Rectification": {"type": "full wave"}}, ["processed"]),
        ("SoftwareFilters", {"RMS": {"window": "50 ms"}}, ["processed"]),
        (
            "HardwareFilters",
            {"Highpass RC filter": {"Half amplitude cutoff (Hz)": 100}},
            ["prefiltered"],
        ),
        ("HardwareFilters", {"Low-pass": {"CutoffFrequency": 150.0}}, ["prefiltered"]),
        ("HardwareFilters", {"Highpass": {"cutoff": 10}, "Lowpass": {"cutoff": 500}}, []),
        ("SoftwareFilters", "n/a", []),
    ],
)
def test_filters_in_the_json_file_of_bids_are_compared_with_the_band_of_emg(
    trial: xr.Dataset, tmp_path: Path, kind: str, filters: object, codes: list[str]
) -> None:
    path = write_bids(trial, tmp_path)[0]
    sidecar = path.with_name(path.name.replace("emg.bdf", "emg.json"))
    sidecar.write_text(json.dumps(json.loads(sidecar.read_text()) | {kind: filters}))
    first = str(trial["channel"].values[0])
    codes_of_first = [f.code for f in findings_in(read_recording(path)) if f.name == first]
    assert [code for code in codes_of_first if code in ("processed", "prefiltered")] == codes


@pytest.mark.parametrize(
    ("head", "cell"), [("Low Cutoff [s]", "0.0016"), ("Low Cutoff [Hz]", "99.47")]
)
def test_the_filters_in_the_comment_of_brainvision_are_compared(
    tmp_path: Path, head: str, cell: str
) -> None:
    path = brainvision(tmp_path)
    rows = [
        f"#     Name      Phys. Chn.    Resolution / Unit   {head}   High Cutoff [Hz]   Notch [Hz]",
        f"1     ZYG, left      1      0.5 uV      {cell}      1000      Off",
        "2     DAO      2      0.001 mV      DC      150      Off",
    ]
    path.write_text(path.read_text() + "\n".join(rows) + "\n")
    filters = {f.name: f.values["what"] for f in with_code(read_recording(path), "prefiltered")}
    assert filters["DAO"] == "a low-pass of 150 Hz"
    assert filters["ZYG, left"].startswith("a high-pass of 99.47")
