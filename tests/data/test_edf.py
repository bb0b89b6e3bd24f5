"""EDF and BDF: files of edfio and byte by byte, complete, truncated and contradictory."""

from pathlib import Path
from typing import Any

import edfio
import numpy as np
import pytest

from emgface.errors import DataError, UnitsError
from emgface.recordings.dataset import find_recordings, read_recording
from emgface.recordings.labels import note


def packed(
    counts: np.ndarray,
    *,
    unit: str = "uV",
    physical: tuple[str, str] = ("-1000", "1000"),
    digital: tuple[str, str] = ("-32768", "32767"),
    **header: str,
) -> bytes:
    """Return an EDF file of one-second records, counts of shape (signals, records, samples)."""
    signals, records, samples = counts.shape
    given = {"version": "0", "length": str(256 * (signals + 1)), "records": str(records)}
    given |= {"seconds": "1", "signals": str(signals), "samples": str(samples), "reserved": ""}
    given |= header
    text = given["version"].ljust(8) + "X X X X".ljust(80)
    text += "Startdate X X X X".ljust(80) + "01.01.70" + "00.00.00" + given["length"].ljust(8)
    text += given["reserved"].ljust(44) + given["records"].ljust(8) + given["seconds"].ljust(8)
    text += given["signals"].ljust(4)
    per_signal = ("", unit, *physical, *digital, "", given["samples"], "")
    widths = (80, 8, 8, 8, 8, 8, 80, 8, 32)
    text += "".join(f"E{i + 1}".ljust(16) for i in range(signals))
    text += "".join(v.ljust(w) * signals for v, w in zip(per_signal, widths, strict=True))
    return text.encode("latin-1") + counts.swapaxes(0, 1).astype("<i2").tobytes()


@pytest.fixture
def counts() -> np.ndarray:
    return np.random.default_rng(4).integers(-32768, 32767, size=(2, 3, 50))


def test_values_are_counts_scaled_by_the_header(tmp_path: Path, counts: np.ndarray) -> None:
    (tmp_path / "a.edf").write_bytes(packed(counts, unit="\u00b5V"))
    trial = read_recording(tmp_path / "a.edf")
    expected = (-1000 + (counts.reshape(2, -1) + 32768) * 2000 / 65535) / 1e6
    np.testing.assert_allclose(trial["emg"], expected, rtol=1e-12, atol=1e-18)
    np.testing.assert_array_equal(trial["time_emg"], np.arange(150) / 50)
    assert list(trial["channel"].values) == ["E1", "E2"]
    assert note(trial, "original_units") == {"emg": "\u00b5V"}


@pytest.mark.parametrize("kind", ["edf", "bdf"])
def test_files_of_edfio_are_read(tmp_path: Path, kind: str) -> None:
    rng = np.random.default_rng(1)
    values = rng.normal(scale=0.1, size=(3, 200))
    make: Any = {"edf": edfio.EdfSignal, "bdf": edfio.BdfSignal}[kind]
    signals = [
        make(v, 100, label=f"L{i}", physical_dimension="mV", physical_range=(-1, 1))
        for i, v in enumerate(values)
    ]
    signals.append(make(np.arange(2.0), 1, label="Temp", physical_dimension="degC"))
    signals.append(make(values[0, ::2], 50, label="Slow", physical_dimension="mV"))
    whole: Any = {"edf": edfio.Edf, "bdf": edfio.Bdf}[kind]
    device = edfio.Recording(equipment_code="TMSi_Porti")
    whole(signals, recording=device, annotations=[edfio.EdfAnnotation(0.5, None, "go")]).write(
        tmp_path / f"a.{kind}"
    )
    trial = read_recording(tmp_path / f"a.{kind}")
    assert list(trial["channel"].values) == ["L0", "L1", "L2"]
    step = 2e-3 / (2**16 - 1 if kind == "edf" else 2**24 - 1)
    assert np.abs(trial["emg"].values - values / 1e3).max() <= 0.5001 * step
    assert note(trial, "dropped") == {
        "Temp": "in 'degC', not a voltage",
        "Slow": "sampled at 50 Hz, the others at 100 Hz: left out, export channels of one rate, or "
        "resample it",
    }
    assert trial.attrs["device"] == "TMSi Porti"


def test_every_truncation_is_refused(tmp_path: Path, counts: np.ndarray) -> None:
    whole = packed(counts)
    path = tmp_path / "a.edf"
    for length in range(0, len(whole), 13):
        path.write_bytes(whole[:length])
        with pytest.raises(DataError, match="^a.edf"):
            read_recording(path)


@pytest.mark.parametrize(
    ("header", "text"),
    [
        ({"records": "99999999"}, "declares 99999999 records but contains 3; expected all"),
        ({"records": "2"}, "declares 2 records but contains 3"),
        ({"records": "0"}, "declares 0 records"),
        ({"records": "3e2"}, "the number of records is '3e2     '; expected an integer"),
        ({"signals": "9999"}, "declares 9999 signals"),
        ({"signals": "0  E"}, "the number of signals is '0  E'; expected an integer"),
        ({"samples": "99999999"}, "expected all of them"),
        ({"samples": "-5"}, "declares 3 records of -10 samples"),
        ({"seconds": "0"}, "a record lasts '0       ' s; expected"),
        ({"seconds": "-1"}, "a record lasts"),
        ({"seconds": "x"}, "a record lasts"),
        ({"length": "512"}, "declares 2 signals and a header of 512 bytes"),
        ({"version": "7"}, "begins with b'7 "),
        ({"reserved": "EDF+D"}, "has pauses between its records"),
        ({"physical": ("5", "5")}, "channel 'E1': counts|cannot be read"),
        ({"physical": ("nan", "5")}, "channel 'E1': counts|cannot be read"),
        ({"digital": ("7", "7")}, "channel 'E1': counts|cannot be read"),
        ({"digital": ("9", "-9")}, "channel 'E1': counts 9 to -9 correspond to"),
    ],
)
def test_a_header_that_contradicts_the_file_is_refused(
    tmp_path: Path, counts: np.ndarray, header: dict[str, Any], text: str
) -> None:
    (tmp_path / "a.edf").write_bytes(packed(counts, **header))
    with pytest.raises(DataError, match=text):
        read_recording(tmp_path / "a.edf")


@pytest.mark.parametrize("number", [1, 2, 3])
def test_every_number_of_records_is_read(tmp_path: Path, counts: np.ndarray, number: int) -> None:
    for name, kept in (("all", counts), ("some", counts[:, :number])):
        (tmp_path / f"{name}.edf").write_bytes(packed(kept))
    every, some = (read_recording(tmp_path / f"{n}.edf")["emg"].values for n in ("all", "some"))
    np.testing.assert_array_equal(some, every[:, : 50 * number])


def test_an_interrupted_recording_keeps_its_whole_records(
    tmp_path: Path, counts: np.ndarray
) -> None:
    (tmp_path / "a.edf").write_bytes(packed(counts))
    expected = read_recording(tmp_path / "a.edf")["emg"].values
    (tmp_path / "a.edf").write_bytes(packed(counts, records="-1"))
    np.testing.assert_array_equal(read_recording(tmp_path / "a.edf")["emg"], expected)
    (tmp_path / "a.edf").write_bytes(packed(counts, records="-1")[:-2])
    with pytest.raises(DataError, match="declares whole records but contains 2.99; expected all"):
        read_recording(tmp_path / "a.edf")


def test_pauses_in_the_timekeeping_are_refused(tmp_path: Path) -> None:
    signal = edfio.EdfSignal(np.arange(30.0), 10, label="E1", physical_dimension="uV")
    edf = edfio.Edf([signal], data_record_duration=1, annotations=[])
    edf.write(tmp_path / "a.edf")
    assert read_recording(tmp_path / "a.edf").sizes["time_emg"] == 30
    data = (tmp_path / "a.edf").read_bytes()
    assert data.count(b"+2\x14\x14") == 1
    (tmp_path / "a.edf").write_bytes(data.replace(b"+2\x14\x14", b"+9\x14\x14"))
    with pytest.raises(DataError, match="lacks 70 samples between the 30 that it contains"):
        read_recording(tmp_path / "a.edf")


def test_channels_need_a_unit(tmp_path: Path, counts: np.ndarray) -> None:
    (tmp_path / "a.edf").write_bytes(packed(counts, unit=""))
    with pytest.raises(UnitsError, match="^a.edf: None of the 2 analog channels has a unit"):
        read_recording(tmp_path / "a.edf")
    trial = read_recording(tmp_path / "a.edf", mapping={"units": {"emg": "mV"}})
    expected = (-1000 + (counts.reshape(2, -1) + 32768) * 2000 / 65535) / 1e3
    np.testing.assert_allclose(trial["emg"], expected, rtol=1e-12, atol=1e-15)


def test_eeg_of_a_dataset_is_not_a_recording(tmp_path: Path, counts: np.ndarray) -> None:
    for name in ("sub-1_task-A_eeg.edf", "sub-1_task-A_emg.edf"):
        (tmp_path / name).write_bytes(packed(counts))
    assert [path.name for path in find_recordings(tmp_path)] == ["sub-1_task-A_emg.edf"]
