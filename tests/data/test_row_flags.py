"""Columns of every reader that state which samples are good: gaps, or a finding if it is unclear."""

from collections.abc import Callable
from pathlib import Path

import edfio
import ezc3d
import h5py
import numpy as np
import pytest
import scipy.io

from emgface.errors import ConfigurationError, DataError
from emgface.recordings.dataset import read_recording, readers
from emgface.recordings.describe import describe
from emgface.recordings.exports.contract import Column, Export
from emgface.recordings.findings import findings_in
from emgface.recordings.readers.text_exports import part_of
from tests.data.test_poly5 import make_poly5
from tests.data.test_reader_contracts import bids_motion
from tests.data.test_xdf import channel, make, stream

N = 1000
RNG = np.random.default_rng(5)
EMG = np.round(40.0 * RNG.normal(size=(2, N)), 3)  #: in uV
POSITION = 30.0 + np.cumsum(0.05 * RNG.normal(size=(3, N)), axis=1)  #: in mm
HIDDEN = slice(300, 360)
GOOD = np.ones(N)
GOOD[HIDDEN] = 0.0
CODES = {"bad_interval", "bad_frames", "all_bad", "all_bad_frames", "unused_flags"}


def csv(folder: Path, label: str, flags: np.ndarray, more: str = "") -> Path:
    rows = [",".join(map(str, row)) for row in zip(*EMG, flags, strict=True)]
    (folder / "a.csv").write_text("\n".join([f"E1,E2,{label}", *rows]) + "\n")
    path = folder / "a.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 1000\nunit = "uV"\n{more}'
    )
    return path


def csv_mapped(folder: Path, label: str, flags: np.ndarray) -> Path:
    return csv(folder, label, flags, '[emg.channels]\nE1 = "E1"\nE2 = "E2"\n')


def _array(folder: Path, name: str, variable: str, more: str = "") -> Path:
    path = folder / "a.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "{name}"\nvariable = "{variable}"\nunit = "uV"\n'
        f'rate = 1000\ncolumns = ["E1", "E2"]\n{more}'
    )
    return path


def matlab(folder: Path, label: str, flags: np.ndarray) -> Path:
    scipy.io.savemat(folder / "a.mat", {"rec": {"emg": EMG.T, label: flags[:, None]}})
    return _array(folder, "a.mat", "rec.emg")


def matlab_logical(folder: Path, label: str, flags: np.ndarray) -> Path:
    if not np.isin(flags, (0.0, 1.0)).all():
        return matlab(folder, label, flags)
    scipy.io.savemat(folder / "a.mat", {"emg": EMG.T, label: flags.astype(bool)})
    return _array(folder, "a.mat", "emg")


def hdf5(folder: Path, label: str, flags: np.ndarray) -> Path:
    with h5py.File(folder / "a.h5", "w") as opened:
        opened["rec/emg"], opened[f"rec/{label}"] = EMG.T, flags
    return _array(folder, "a.h5", "rec/emg")


def positions(folder: Path, label: str, flags: np.ndarray) -> Path:
    rows = [",".join(map(str, row)) for row in zip(*POSITION, flags, strict=True)]
    (folder / "a.csv").write_text("\n".join([f"E1_x,E1_y,E1_z,{label}", *rows]) + "\n")
    path = folder / "a.toml"
    path.write_text('schema = "recording"\n[position]\nfile = "a.csv"\nrate = 100\nunit = "mm"\n')
    return path


def edf(folder: Path, label: str, flags: np.ndarray) -> Path:
    signals = [
        edfio.EdfSignal(row, 1000, label=f"E{k}", physical_dimension="uV")
        for k, row in enumerate(EMG, start=1)
    ]
    limits = {"physical_range": (0, 1000), "digital_range": (0, 1000)}
    signals.append(edfio.EdfSignal(np.rint(flags), 1000, label=label, **limits))
    edfio.Edf(signals).write(folder / "a.edf")
    return folder / "a.edf"


def brainvision(folder: Path, label: str, flags: np.ndarray) -> Path:
    (folder / "a.vhdr").write_text(
        "Brain Vision Data Exchange Header File Version 1.0\n[Common Infos]\nDataFile=a.eeg\n"
        "DataFormat=BINARY\nDataOrientation=VECTORIZED\nNumberOfChannels=3\n"
        "SamplingInterval=1000\n[Binary Infos]\nBinaryFormat=IEEE_FLOAT_32\n[Channel Infos]\n"
        f"Ch1=E1,,1,uV\nCh2=E2,,1,uV\nCh3={label},,1,n\n"
    )
    (folder / "a.eeg").write_bytes(np.vstack([EMG, flags]).astype("<f4").tobytes())
    return folder / "a.vhdr"


def poly5(folder: Path, label: str, flags: np.ndarray) -> Path:
    rows = [("E1", b"uV", EMG[0]), ("E2", b"uV", EMG[1]), (label, b"", flags)]
    described = [(name, unit, row.astype(np.float32)) for name, unit, row in rows]
    return make_poly5(folder / "a.poly5", described, rate=1000)


def c3d(folder: Path, label: str, flags: np.ndarray) -> Path:
    content = ezc3d.c3d()
    analog = content["parameters"]["ANALOG"]
    analog["LABELS"]["value"], analog["UNITS"]["value"] = ["E1", "E2", label], ["uV", "uV", "n"]
    analog["RATE"]["value"] = [1000.0]
    content["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    content["data"]["points"] = np.ones((4, 0, N // 10))
    content["data"]["analogs"] = np.vstack([EMG, flags])[None]
    content.write(str(folder / "a.c3d"))
    return folder / "a.c3d"


def xdf(folder: Path, label: str, flags: np.ndarray) -> Path:
    channels = [channel(label=name, unit="microvolts", type="EMG") for name in ("E1", "E2")]
    channels.append(channel(label=label, type="MISC"))
    return make(folder, stream(1, "EMG", 1000.0, 0.0, np.vstack([EMG, flags]).T, channels))


def tsv(folder: Path, label: str, flags: np.ndarray) -> Path:
    path = bids_motion(folder, POSITION, np.arange(N))
    table = next(folder.rglob("*channels.tsv"))
    table.write_text(table.read_text().replace("M1", "E1") + f"{label}\tn/a\tMISC\tn/a\tn/a\n")
    rows = np.loadtxt(path)
    np.savetxt(path, np.column_stack([rows, flags]), delimiter="\t", fmt="%.6f")
    return path


WRITERS = [
    csv,
    csv_mapped,
    positions,
    matlab,
    matlab_logical,
    hdf5,
    edf,
    brainvision,
    poly5,
    c3d,
    xdf,
    tsv,
]
WITHOUT = {".trc", ".nc", ".csv", ".txt", ".asc", ".gz", ".s00"}
"""TRC and netCDF of this package, without such columns, and exports, which are tested separately."""
Write = Callable[[Path, str, np.ndarray], Path]


def read(path: Path) -> tuple[np.ndarray, list[str], list[str]]:
    """Samples that are NaN (channels or one marker, samples), codes and names of the findings."""
    recording = read_recording(path)
    values = recording["emg"].values if "emg" in recording else recording["position"].values[:, 0]
    findings = [f for f in findings_in(recording) if f.code in CODES]
    return np.isnan(values), [f.code for f in findings], [f.name for f in findings]


def test_every_reader_is_tested() -> None:
    tested = {".toml", ".edf", ".bdf", ".vhdr", ".poly5", ".c3d", ".xdf", ".tsv"}
    assert set(readers()) == tested | WITHOUT


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
@pytest.mark.parametrize(
    ("label", "flags"),
    [("valid", GOOD), ("isOk", GOOD), ("artifact", 1 - GOOD), ("bad_mask", 1 - GOOD)],
)
def test_samples_that_a_column_calls_bad_are_gaps(tmp_path: Path, write: Write, label, flags):
    lost, codes, names = read(write(tmp_path, label, flags))
    assert codes in (["bad_interval"], ["bad_frames"]) and names == [""]
    for row in lost:
        np.testing.assert_array_equal(np.flatnonzero(row), np.arange(N)[HIDDEN])


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_a_column_of_one_channel_concerns_it_alone(tmp_path: Path, write: Write) -> None:
    lost, codes, names = read(write(tmp_path, "E1_valid", GOOD))
    assert codes in (["bad_interval"], ["bad_frames"]) and names == ["E1"]
    assert lost[0].sum() == 60 and not lost[1:].any()


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
@pytest.mark.parametrize(
    ("label", "flags"),
    [("mask", GOOD), ("quality", 100 * GOOD), ("E9_ok", GOOD)],
)
def test_a_column_whose_meaning_is_not_certain_is_a_finding(tmp_path, write: Write, label, flags):
    lost, codes, _ = read(write(tmp_path, label, flags))
    assert codes == ["unused_flags"] and not lost.any()


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
@pytest.mark.parametrize(("label", "value"), [("status", 1.0), ("quality", 3.0), ("valid", 1.0)])
def test_a_column_that_marks_nothing_is_no_finding(tmp_path: Path, write: Write, label, value):
    lost, codes, _ = read(write(tmp_path, label, np.full(N, value)))
    assert codes == [] and not lost.any()


@pytest.mark.parametrize(
    ("label", "words"),
    [("valid", ("true", "false")), ("status", ("good", "bad")), ("quality", ("ok", "artifact"))],
)
def test_words_in_the_cells_are_flags(tmp_path: Path, label: str, words: tuple[str, str]) -> None:
    lost, codes, _ = read(csv(tmp_path, label, np.where(GOOD == 1.0, *words)))
    assert codes == ["bad_interval"] and lost.sum() == 2 * 60


@pytest.mark.parametrize("words", [("1", ""), ("True", ""), ("good", "")])
def test_an_empty_cell_calls_no_sample_good(tmp_path: Path, words: tuple[str, str]) -> None:
    """Such samples were used without a word."""
    recording = read_recording(csv_mapped(tmp_path, "valid", np.where(GOOD == 1.0, *words)))
    np.testing.assert_array_equal(np.isnan(recording["emg"][0]), GOOD == 0.0)


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_other_numbers_of_a_column_of_flags_are_a_finding(tmp_path: Path, write: Write) -> None:
    """A column `valid` of 0 and 2 was left out without a word."""
    recording = read_recording(write(tmp_path, "valid", 2.0 * GOOD))
    assert [f.code for f in findings_in(recording) if f.code in CODES] == ["unused_flags"]


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_a_column_may_name_a_channel_as_the_mapping_does(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path, "ZYG_L_valid", GOOD)
    kind = "markers" if write in (positions, tsv) else "channels"
    assert read(path)[1] == ["unused_flags"]
    recording = read_recording(path, mapping={kind: {"E1": "ZYG_L"}})
    (finding,) = [f for f in findings_in(recording) if f.code in CODES]
    assert (finding.code[:4], finding.name) == ("bad_", "ZYG_L")
    values = recording["emg" if kind == "channels" else "position"].values
    assert np.isnan(values[0]).reshape(-1, N).all(axis=0).sum() == 60


def test_labels_of_the_file_precede_names_and_a_sidecar_precedes_a_mapping(tmp_path: Path) -> None:
    path = csv(tmp_path, "E2_valid", GOOD, '[emg.channels]\nE1 = "E2"\nE2 = "E1"\n')
    lost, codes, names = read(path)
    assert (codes, names) == (["bad_interval"], ["E1"]) and lost[1].sum() == 60
    path = csv(tmp_path, "MEN_L_valid", GOOD, '[emg.channels]\nE1 = "a"\nE2 = "b"\n')
    recording = read_recording(path, mapping={"channels": {"a": "ZYG_L", "b": "MEN_L"}})
    np.testing.assert_array_equal(np.isnan(recording["emg"].values).sum(axis=1), [0, 60])


def test_a_sidecar_states_the_meaning_of_a_column(tmp_path: Path) -> None:
    for meaning, count in (("good", 120), ("bad", 2 * (N - 60)), ("ignored", 0)):
        path = csv(tmp_path, "status", GOOD, f'flags = {{ status = "{meaning}" }}\n')
        lost, codes, _ = read(path)
        assert lost.sum() == count and "unused_flags" not in codes
    other = csv(tmp_path, "status", GOOD, 'flags = { stats = "good" }\n')
    with pytest.raises(DataError, match="the table 'flags' names 'stats'"):
        read_recording(other)
    with pytest.raises(ConfigurationError, match="flags"):
        read_recording(csv(tmp_path, "status", GOOD, 'flags = { status = "perhaps" }\n'))


def test_an_array_of_flags_states_them_of_each_channel(tmp_path: Path) -> None:
    mask = np.column_stack([GOOD, np.ones(N)])
    scipy.io.savemat(tmp_path / "a.mat", {"emg": EMG.T, "valid": mask})
    lost, codes, names = read(_array(tmp_path, "a.mat", "emg"))
    assert codes == ["bad_interval"] and names == ["E1"]
    assert lost[0].sum() == 60 and not lost[1].any()


def test_a_channel_called_so_is_a_channel(tmp_path: Path) -> None:
    path = csv(tmp_path, "ok", EMG[0])
    assert read_recording(path).sizes["channel"] == 3
    mapped = csv(tmp_path, "valid", GOOD, '[emg.channels]\nE1 = "E1"\nvalid = "ZYG_L"\n')
    assert read_recording(mapped).sizes["channel"] == 2


def test_a_draft_names_the_column(tmp_path: Path) -> None:
    csv(tmp_path, "valid", GOOD)
    assert "may state which samples are good" in describe(tmp_path / "a.csv", rate=1000.0)


def test_a_column_of_an_export_is_a_finding() -> None:
    columns = [Column(label, unit, values, 1000.0)
               for label, unit, values in (("E1", "uV", EMG[0]), ("Quality", "", 9 * GOOD))]  # fmt: skip
    part = part_of(Path("a.csv"), Export(columns), {})
    assert [f.code for f in part.findings if f.code in CODES] == ["unused_flags"]
