"""Marks of files that may say that samples are bad: gaps, or findings where it is not certain."""

import struct
from collections.abc import Callable
from pathlib import Path

import edfio
import ezc3d
import numpy as np
import pytest

from emgface.recordings.dataset import read_recording, readers
from emgface.recordings.findings import findings_in
from emgface.recordings.synchronise import cut
from tests.data.test_brainvision import make as make_brainvision
from tests.data.test_c3d import make_c3d
from tests.data.test_xdf import chunk, emg_stream
from tests.data.test_xdf import make as make_xdf

DOUBTFUL = ["artifact", "Bewegungsartefakt", "ARTEFACT: cough", "electrode off", "lead off",
            "loose electrode", "saturated", "disconnected", "clipping", "signal lost", "very bad",
            "reject", "electrode_fell off"]  # fmt: skip
OTHER = [
    "S 1",
    "badge",
    "no artifacts",
    "artefact-free",
    "smile",
    "off",
    "lost in thought",
    "Baden",
]
CODES = {"doubtful_mark", "doubtful_marks", "bad_moment", "bad_interval"}
EMG = np.random.default_rng(3).normal(scale=40.0, size=2000)


def edf(folder: Path, text: str) -> Path:
    signal = edfio.EdfSignal(EMG, 1000, label="E1", physical_dimension="uV")
    notes = [edfio.EdfAnnotation(0.5, 0.25, text)]
    edfio.Edf([signal], annotations=notes).write(folder / "a.edf")
    return folder / "a.edf"


def bids(folder: Path, text: str) -> Path:
    place = folder / "sub-01" / "emg"
    place.mkdir(parents=True)
    signal = edfio.EdfSignal(EMG, 1000, label="E1", physical_dimension="uV")
    edfio.Edf([signal]).write(place / "sub-01_task-A_emg.edf")
    (place / "sub-01_task-A_channels.tsv").write_text("name\ttype\tunits\nE1\tEMG\tuV\n")
    (place / "sub-01_task-A_events.tsv").write_text(
        f"onset\tduration\ttrial_type\n0.5\t0.25\t{text}\n"
    )
    return place / "sub-01_task-A_emg.edf"


def brainvision(folder: Path, text: str) -> Path:
    # 2000 Hz and 200 samples: marked from 0.05 s
    return make_brainvision(
        folder, markers=f"Mk1=New Segment,,1,1,0\nMk2=Comment,{text},101,20,0\n"
    )


def xdf(folder: Path, text: str) -> Path:
    head = (
        '<?xml version="1.0"?><info><name>notes</name><type>Markers</type><channel_count>1'
        "</channel_count><nominal_srate>0</nominal_srate><channel_format>string</channel_format>"
        "</info>"
    )
    which, data = struct.pack("<I", 9), text.encode()
    sample = struct.pack("<BI", 4, 1) + struct.pack("<Bd", 8, 100.25)
    sample += struct.pack("<BB", 1, len(data)) + data
    notes = chunk(2, which + head.encode()) + chunk(3, which + sample)
    return make_xdf(folder, emg_stream(), notes)


def c3d(folder: Path, text: str) -> Path:
    make_c3d(folder / "b.c3d")
    content = ezc3d.c3d(str(folder / "b.c3d"))
    content.add_parameter("EVENT", "LABELS", [text])
    content.add_parameter("EVENT", "TIMES", np.array([[0.0], [0.02]]))
    content.write(str(folder / "a.c3d"))
    return folder / "a.c3d"


WRITERS: dict[Callable[[Path, str], Path], float] = {
    edf: 0.5, bids: 0.5, brainvision: 0.05, xdf: 0.25, c3d: 0.02,
}  # fmt: skip
"""Writers of a recording with one mark, and the instant of the mark [s]."""
WITHOUT = {".toml", ".csv", ".txt", ".asc", ".tsv", ".trc", ".poly5", ".nc", ".gz", ".s00"}
"""Formats without marks of intervals or moments; flags of samples are columns of them."""


def test_every_format_has_marks_or_is_known_to_have_none() -> None:
    marked = {".edf", ".bdf", ".vhdr", ".xdf", ".c3d"}
    assert set(readers()) <= marked | WITHOUT


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
@pytest.mark.parametrize("text", DOUBTFUL)
def test_a_mark_in_other_words_is_a_finding_at_its_instant(tmp_path: Path, write, text) -> None:
    recording = read_recording(write(tmp_path, text))
    (finding,) = [f for f in findings_in(recording) if f.code in CODES]
    assert finding.code == "doubtful_mark"
    assert finding.values["at"] == pytest.approx(WRITERS[write], abs=1e-6)
    assert text in finding.sentence and "begin with BAD" in finding.sentence
    assert not np.isnan(recording["emg"]).any()


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_other_marks_are_no_findings(tmp_path: Path, write) -> None:
    for k, text in enumerate(OTHER):
        (tmp_path / str(k)).mkdir()
        recording = read_recording(write(tmp_path / str(k), text))
        assert not [f for f in findings_in(recording) if f.code in CODES], text


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_a_mark_that_begins_with_bad_is_a_gap_or_a_moment(tmp_path: Path, write) -> None:
    recording = read_recording(write(tmp_path, "BAD_cough"))
    (finding,) = [f for f in findings_in(recording) if f.code in CODES]
    assert finding.code == ("bad_moment" if write in (xdf, c3d) else "bad_interval")
    assert finding.values["at"] == pytest.approx(WRITERS[write], abs=1e-6)


def test_many_marks_are_counted_and_stay_with_every_cut(tmp_path: Path) -> None:
    signal = edfio.EdfSignal(np.tile(EMG, 4), 1000, label="E1", physical_dimension="uV")
    notes = [edfio.EdfAnnotation(0.1 * k, 0.05, "artifact") for k in range(1, 61)]
    edfio.Edf([signal], annotations=notes).write(tmp_path / "a.edf")
    recording = read_recording(tmp_path / "a.edf")
    for part in (recording, cut(recording, 7.0, 7.9)):
        (finding,) = [f for f in findings_in(part) if f.code in CODES]
        assert (finding.code, finding.values["count"]) == ("doubtful_marks", 60)
