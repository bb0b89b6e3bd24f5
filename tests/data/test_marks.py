"""Marks of files that may say that samples are bad: gaps, or findings where it is not certain."""

import struct
from collections.abc import Callable
from pathlib import Path

import edfio
import ezc3d
import numpy as np
import pytest

from emgface.errors import ConfigurationError, SchemaError
from emgface.recordings.dataset import read_recording, readers
from emgface.recordings.findings import findings_in
from emgface.recordings.marks import StatedMark, with_stated_marks
from emgface.recordings.repeated import headline
from emgface.recordings.synchronise import cut
from tests.data.test_brainvision import make as make_brainvision
from tests.data.test_c3d import make_c3d
from tests.data.test_xdf import chunk, emg_stream
from tests.data.test_xdf import make as make_xdf

DOUBTFUL = ["artifact", "Bewegungsartefakt", "ARTEFACT: cough", "electrode off", "lead off",
            "loose electrode", "saturated", "disconnected", "clipping", "signal lost", "very bad",
            "reject", "electrode_fell off", "noise", "noise_2", "very_bad", "Rauschen"]  # fmt: skip
OTHER = [
    "S 1",
    "badge",
    "no artifacts",
    "artefact-free",
    "white noise",
    "no_noise",
    "noiseless",
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
    assert text in finding.sentence and "'marks' of a mapping" in finding.sentence
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


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_a_mapping_states_a_mark_as_harmless_and_the_note_says_who(tmp_path: Path, write) -> None:
    path = write(tmp_path, "noise")
    mapping = {"marks": {"Noise": {"meaning": "harmless", "by": "A. Smith"}}}
    recording = read_recording(path, mapping=mapping)
    assert not [f for f in findings_in(recording) if f.code in CODES]
    (note,) = [f for f in findings_in(recording) if f.code == "harmless_mark"]
    assert note.verdict == "ok" and "harmless by A. Smith" in note.sentence
    assert "harmless" not in headline(findings_in(recording))
    assert not np.isnan(recording["emg"]).any()


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_a_mapping_states_a_mark_as_bad_and_its_samples_are_a_gap(tmp_path: Path, write) -> None:
    path, at = write(tmp_path, "noise"), WRITERS[write]
    stated = {"meaning": "bad", "seconds": 0.0203}  # between two samples
    recording = read_recording(path, mapping={"marks": {"noise": stated}})
    (gap,) = [f for f in findings_in(recording) if f.code in CODES]
    assert gap.code == "bad_interval" and "the mapping states as bad" in gap.sentence
    assert gap.values["seconds"] == pytest.approx(0.0203)
    time = recording["time_emg"].values
    inside = (time > at - 1e-9) & (time < at + 0.0203)
    assert inside.any()
    np.testing.assert_array_equal(np.isnan(recording["emg"].values).all(axis=0), inside)
    np.testing.assert_array_equal(np.isnan(recording["emg"].values).any(axis=0), inside)


@pytest.mark.parametrize("write", WRITERS, ids=lambda one: one.__name__)
def test_without_a_stated_length_the_gap_ends_with_the_mark_or_is_refused(
    tmp_path: Path, write
) -> None:
    path, mapping = write(tmp_path, "noise"), {"marks": {"noise": {"meaning": "bad"}}}
    if write in (xdf, c3d):
        with pytest.raises(SchemaError, match="has no duration.*add 'seconds'"):
            read_recording(path, mapping=mapping)
        return
    (gap,) = [f for f in findings_in(read_recording(path, mapping=mapping)) if f.code in CODES]
    (mark,) = [f for f in findings_in(read_recording(path)) if f.code in CODES]
    assert gap.values["seconds"] == pytest.approx(mark.values["seconds"])


def test_many_marks_are_stated_at_once_also_after_a_cut(tmp_path: Path) -> None:
    signal = edfio.EdfSignal(np.tile(EMG, 4), 1000, label="E1", physical_dimension="uV")
    notes = [edfio.EdfAnnotation(0.1 * k, 0.05, "noise") for k in range(1, 61)]
    edfio.Edf([signal], annotations=notes).write(tmp_path / "a.edf")
    bad = {"noise": StatedMark(meaning="bad")}
    whole = with_stated_marks(read_recording(tmp_path / "a.edf"), bad)
    assert int(np.isnan(whole["emg"]).sum()) == 60 * 50
    part = with_stated_marks(cut(read_recording(tmp_path / "a.edf"), 5.95, 7.0), bad)
    assert [f.code for f in findings_in(part) if f.code in CODES] == ["bad_interval"]
    assert float(part["time_emg"][np.isnan(part["emg"].values[0])][0]) == pytest.approx(0.05)


def test_marks_that_no_recording_has_as_finding_are_refused(tmp_path: Path) -> None:
    path = edf(tmp_path, "smile")
    with pytest.raises(SchemaError, match="'smile', which is no finding.*'unusable'"):
        read_recording(path, mapping={"marks": {"smile": {"meaning": "bad"}}})
    with pytest.raises(SchemaError, match="no channel 'E2'"):
        edf(tmp_path, "noise")
        read_recording(path, mapping={"marks": {"noise": {"meaning": "bad", "channels": ["E2"]}}})
    with pytest.raises(ConfigurationError, match="harmless mark takes neither"):
        read_recording(path, mapping={"marks": {"noise": {"meaning": "harmless", "seconds": 1}}})
