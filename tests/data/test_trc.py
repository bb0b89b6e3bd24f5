"""TRC: generated files in both dialects, and a real one compared with its cells."""

from pathlib import Path

import numpy as np
import pytest

from emgface.errors import DataError, UnitsError
from emgface.recordings.dataset import read_recording
from emgface.recordings.labels import note

LABELS = ["nasion", "rhinion", ""]


def content(mark: str = "\t", **changes: str) -> str:
    """Return three markers over four frames at 50 Hz, the second lost in the third frame."""
    text = {"rate": "50.00", "frames": "4", "markers": "3", "unit": "mm"} | changes
    names = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate".split()
    counts = [text["rate"], text["rate"], text["frames"], text["markers"], text["unit"], "50"]
    lines = [
        ["PathFileType", "4", "(X/Y/Z)", "trial.trc"],
        names,
        counts,
        ["Frame#", "Time", *(cell for label in LABELS for cell in (label, "", ""))],
        ["", "", *(f"{axis}{i}" for i in (1, 2, 3) for axis in "XYZ")],
        [],
    ]
    for k in range(4):
        cells = [f"{100 * k + i}.25" for i in range(9)]
        if k == 2:
            cells[3:6] = ["", "", ""]
        lines.append([str(k + 1), f"{k / 50:.3f}", *cells])
    return "\n".join(mark.join(line) for line in lines) + "\n"


@pytest.mark.parametrize("mark", ["\t", ","])
def test_both_dialects_are_read(tmp_path: Path, mark: str) -> None:
    (tmp_path / "a.trc").write_text(content(mark))
    trial = read_recording(tmp_path / "a.trc")
    assert list(trial["marker"].values) == ["nasion", "rhinion", "marker 3"]
    expected = (np.arange(9).reshape(3, 3, 1) + 100.0 * np.arange(4) + 0.25) / 1e3
    expected[1, :, 2] = np.nan
    np.testing.assert_array_equal(trial["position"], expected)
    np.testing.assert_array_equal(trial["time_marker"], np.arange(4) / 50)
    assert note(trial, "original_units") == {"position": "mm"}


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("50.00", "0", "has DataRate = '0'; expected a number above 0"),
        ("50.00", "60.00", "has 50 Hz by the column of times, and 60 Hz by the header"),
        ("\t4\t3\tmm", "\t999999999\t3\tmm", "declares 999999999 frames but contains 4"),
        ("\t4\t3\tmm", "\t1e400\t3\tmm", "has NumFrames = '1e400'"),
        ("\t4\t3\tmm", "\t4\t2\tmm", "frame 1, has 11 columns; expected 8 for 2 markers"),
        ("NumMarkers", "Markers", "specifies no NumMarkers"),
        ("\n3\t0.04", "\n4\t0.04", "continues from frame 4 to frame 4"),
        ("104.25", "1O4.25", "frame 2, column 7 contains '1O4.25'"),
        ("PathFileType", "Path", "begins with 'Path"),
    ],
)
def test_contradictory_files_are_refused(tmp_path: Path, old: str, new: str, text: str) -> None:
    whole = content()
    assert old in whole
    (tmp_path / "a.trc").write_text(whole.replace(old, new))
    with pytest.raises(DataError, match=f"^a.trc.*{text}"):
        read_recording(tmp_path / "a.trc")


def test_every_truncation_before_the_last_number_is_refused(tmp_path: Path) -> None:
    whole = content()
    end = whole.rindex("\t")
    for length in range(0, end + 1, 5):
        (tmp_path / "a.trc").write_text(whole[:length])
        with pytest.raises(DataError, match="^a.trc"):
            read_recording(tmp_path / "a.trc")


def test_the_unit_is_a_length(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(content(unit="px"))
    with pytest.raises(
        UnitsError, match="^a.trc: position is in 'px', which is not a unit of length"
    ):
        read_recording(tmp_path / "a.trc")
    trial = read_recording(tmp_path / "a.trc", mapping={"units": {"position": "cm"}})
    assert trial["position"].values[0, 0, 0] == 0.0025


def test_the_truncated_real_file_is_reported(shared: Path, tmp_path: Path) -> None:
    path = shared / "recordings" / "pyomeca" / "markers.trc"
    if not path.is_file():
        pytest.skip("the TRC file is not there")
    with pytest.raises(DataError, match="markers.trc declares 652 frames but contains 93"):
        read_recording(path)
    text = path.read_text()
    (tmp_path / "repaired.trc").write_text(text.replace("100,100,652,", "100,100,93,", 1))
    trial = read_recording(tmp_path / "repaired.trc")
    assert dict(trial.sizes) == {"marker": 51, "axis": 3, "time_marker": 93}
    rows = [line.split(",") for line in text.splitlines()[6:]]
    cells = np.array([[float(c) if c.strip() else np.nan for c in row[2:155]] for row in rows])
    expected = cells.reshape(93, 51, 3).transpose(1, 2, 0) / 1e3
    np.testing.assert_array_equal(trial["position"], expected)
    assert list(trial["marker"].values[:3]) == ["ASISl", "ASISr", "PSISl"]
