"""Flags of a file: channels and intervals that it marks as bad, positions that were not measured."""

import json
from pathlib import Path

import edfio
import ezc3d
import numpy as np
import pytest

from emgface.recordings.check import check_recording
from emgface.recordings.dataset import read_recording
from emgface.recordings.findings import Finding, findings_in
from tests.data.test_brainvision import make as make_brainvision
from tests.data.test_c3d import FRAMES, make_c3d
from tests.data.test_reader_contracts import EMG, FRAME_RATE, MARKER, N, bids_motion, edf

RNG = np.random.default_rng(8)


def findings_with(code: str, path: Path, **options) -> list[Finding]:
    return [f for f in findings_in(read_recording(path, **options)) if f.code == code]


def test_intervals_that_annotations_of_edf_call_bad_are_gaps(tmp_path: Path) -> None:
    signal = edfio.EdfSignal(EMG[0], 1000, label="E1", physical_dimension="uV")
    notes = [edfio.EdfAnnotation(0.5, 0.25, "BAD_muscle"), edfio.EdfAnnotation(1.0, 0.1, "badge")]
    edfio.Edf([signal], annotations=notes).write(tmp_path / "a.edf")
    recording = read_recording(tmp_path / "a.edf")
    np.testing.assert_array_equal(
        np.flatnonzero(np.isnan(recording["emg"].values[0])), np.arange(500, 750)
    )
    (finding,) = findings_with("bad_interval", tmp_path / "a.edf")
    assert (finding.values["at"], finding.values["by"]) == (0.5, "the annotation 'BAD_muscle'")


def test_electrodes_out_of_range_of_a_biosemi_amplifier_are_gaps(tmp_path: Path) -> None:
    status = np.full(N, float(1 << 20))
    status[300:400] = 3.0  # a trigger while the electrodes are out of range
    limits = {"physical_range": (-8388608, 8388607), "digital_range": (-8388608, 8388607)}
    signals = [
        edfio.BdfSignal(EMG[0], 1000, label="E1", physical_dimension="uV"),
        edfio.BdfSignal(status, 1000, label="Status", **limits),
    ]
    edfio.Bdf(signals).write(tmp_path / "a.bdf")
    gaps = np.isnan(read_recording(tmp_path / "a.bdf")["emg"].values[0])
    np.testing.assert_array_equal(np.flatnonzero(gaps), np.arange(300, 400))
    signals[1] = edfio.BdfSignal(np.where(status == 3.0, 3.0, 0.0), 1000, label="Status", **limits)
    edfio.Bdf(signals).write(tmp_path / "b.bdf")  # a status of another program
    assert not np.isnan(read_recording(tmp_path / "b.bdf")["emg"]).any()


def test_bad_intervals_of_brainvision_are_gaps_of_their_channel(tmp_path: Path) -> None:
    path = make_brainvision(
        tmp_path, markers="Mk1=New Segment,,1,1,0\nMk2=Bad Interval,x,11,20,0\n"
        "Mk3=Bad Interval,x,101,5,2\nMk4=Bad Interval,x,?,5,2"
    )  # fmt: skip
    gaps = np.isnan(read_recording(path)["emg"].values)
    np.testing.assert_array_equal(np.flatnonzero(gaps[0]), np.arange(10, 30))
    np.testing.assert_array_equal(
        np.flatnonzero(gaps[1]), np.r_[np.arange(10, 30), np.arange(100, 105)]
    )
    assert [f.name for f in findings_with("bad_interval", path)] == ["", "DAO"]


def test_bad_markers_of_bids_are_not_visible(tmp_path: Path) -> None:
    path = bids_motion(tmp_path, MARKER, np.arange(200))
    table = next(tmp_path.rglob("*channels.tsv"))
    head, *rows = table.read_text().splitlines()
    rows = [f"{row}\t{'bad' if '_y' in row else 'good'}\tocclusion" for row in rows]
    table.write_text("\n".join([f"{head}\tstatus\tstatus_description", *rows]) + "\n")
    assert np.isnan(read_recording(path)["position"]).all()
    (finding,) = findings_with("bad", path)
    assert finding.sentence == (
        f"marker M1: marked as bad in {table.name} (occlusion): treated as missing"
    )


@pytest.mark.parametrize("value", ["good", "n/a", ""])
def test_other_states_are_not_bad(tmp_path: Path, value: str) -> None:
    path = bids_motion(tmp_path, MARKER, np.arange(200))
    table = next(tmp_path.rglob("*channels.tsv"))
    head, *rows = table.read_text().splitlines()
    table.write_text("\n".join([f"{head}\tstatus", *(f"{row}\t{value}" for row in rows)]) + "\n")
    assert findings_in(read_recording(path)) == []


def test_the_rate_of_a_table_of_markers_is_compared(tmp_path: Path) -> None:
    path = bids_motion(tmp_path, MARKER, np.arange(200))
    sidecar = next(tmp_path.rglob("*motion.json"))
    sidecar.write_text(json.dumps({"SamplingFrequency": 120}))
    (finding,) = findings_with("rate", path)
    assert finding.values["used"] == pytest.approx(FRAME_RATE)
    assert finding.values["other"] == 120


def test_computed_positions_of_c3d_are_reported(tmp_path: Path) -> None:
    residuals = np.full((1, 16, FRAMES), 2.0)
    residuals[0, 4, 3:9] = 0.0
    make_c3d(tmp_path / "a.c3d", residuals=residuals)
    (finding,) = findings_with("interpolated", tmp_path / "a.c3d")
    assert (finding.name, finding.values["frames"]) == ("P5", 6)
    make_c3d(tmp_path / "b.c3d", residuals=np.zeros((1, 16, FRAMES)))
    assert not findings_with("interpolated", tmp_path / "b.c3d")


def test_contradicting_rates_of_c3d_are_reported(tmp_path: Path) -> None:
    make_c3d(tmp_path / "a.c3d")
    content = ezc3d.c3d(str(tmp_path / "a.c3d"))
    content.add_parameter("TRIAL", "CAMERA_RATE", [120.0])
    content.write(str(tmp_path / "b.c3d"))
    (finding,) = findings_with("rate", tmp_path / "b.c3d")
    assert (finding.values["used"], finding.values["other"]) == (100.0, 120.0)


def test_a_column_of_times_that_contradicts_the_rate_is_reported(tmp_path: Path) -> None:
    values = RNG.normal(size=(400, 1))
    for scale, count in ((1e-3, 0), (1.0, 0), (1.024, 1)):
        table = np.hstack([scale * np.arange(400)[:, None], values])
        np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="Timestamp,E1", comments="")
        (tmp_path / "a.toml").write_text(
            'schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 1000\nunit = "uV"\n'
            '[emg.channels]\nE1 = "E1"\n'
        )
        assert len(findings_with("rate", tmp_path / "a.toml")) == count


def test_unsigned_counts_of_c3d_are_read_at_every_width(tmp_path: Path) -> None:
    """A file of 16-bit integers, whose words are raised above 32767 as unsigned ones."""
    from tests.data.unsigned_c3d import write_integers

    counts = np.array([[0, 100, 20000, 32767, 32768, 40000, 65535, 2048] * 20])
    for offset in (0, 2048, 32768):
        write_integers(tmp_path / "a.c3d", counts, offset=offset, scale=1e-6)
        recording = read_recording(tmp_path / "a.c3d")["emg"].values
        np.testing.assert_allclose(recording, (counts - offset) * 1e-6, atol=1e-12)


def test_the_check_lists_bad_channels(tmp_path: Path) -> None:
    path = edf(tmp_path, EMG, np.arange(N))
    named = tmp_path / "sub-01_task-A_emg.edf"
    path.rename(named)
    (tmp_path / "sub-01_task-A_channels.tsv").write_text(
        "name\ttype\tunits\tstatus\nE1\tEMG\tuV\tgood\nE2\tEMG\tuV\tbad\nCOUNT\tMISC\tn/a\tgood\n"
    )
    table = check_recording(read_recording(named)).set_index("name")
    assert table.loc["E2", "verdict"] == "error"
    assert "marked as bad in channels.tsv" in table.loc["E2", "reason"]
