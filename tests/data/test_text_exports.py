"""Text exports of recording programs: length, rate, labels, units, and what is left out."""

import json
from pathlib import Path

import numpy as np
import pytest

from benchmarks.mutants import mutant  # the same damage as other formats
from emgface.errors import DataError, UnitsError
from emgface.recordings.dataset import find_recordings, read_recording
from emgface.recordings.describe import describe
from emgface.recordings.exports import EXPORTS as LAYOUTS
from emgface.recordings.exports import layout_of
from emgface.recordings.findings import findings_in
from emgface.recordings.labels import note
from emgface.recordings.proposal import propose_for
from tests.data.made_exports import EXPORTS, Made
from tests.data.test_mutations import attempt

REPORTED = "reported"


def suffix_of(name: str, seed: int) -> str:
    return ".txt" if name in ("AcqKnowledge", "OpenSignals") else (".csv", ".txt", ".asc")[seed % 3]


def made(name: str, seed: int, folder: Path) -> Made:
    rng = np.random.default_rng([seed, sorted(EXPORTS).index(name)])
    return EXPORTS[name](folder / f"a{suffix_of(name, seed)}", rng)


def test_every_layout_is_made_here() -> None:
    assert {layout.NAME for layout in LAYOUTS} == set(EXPORTS)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_is_read_as_it_was_recorded(name: str, seed: int, tmp_path: Path) -> None:
    """Ten archives of each program, with other encodings, delimiters, versions and sensors."""
    truth = made(name, seed, tmp_path)
    layout = layout_of(truth.path)
    assert layout is not None and layout.NAME == name
    if truth.units:
        with pytest.raises(UnitsError, match="has a unit"):
            read_recording(truth.path)
    recording = read_recording(truth.path, mapping={"units": truth.units})
    emg, time = recording["emg"], recording["time_emg"].values
    labels = [str(label) for label in emg["channel"].values]
    # Characters beyond ASCII are only in a code page if the file was saved in one.
    assert labels == truth.labels
    assert emg.shape == truth.volts.shape
    assert (time.size - 1) / (time[-1] - time[0]) == pytest.approx(truth.rate, rel=2e-6)
    assert abs(time[0]) < 0.01 / truth.rate
    np.testing.assert_allclose(emg.values, truth.volts, rtol=1e-6, atol=truth.resolution)
    assert set(truth.others) <= set(note(recording, "dropped"))
    assert not [f for f in findings_in(recording) if f.code != "left_out"]

    draft = describe(truth.path, unit=truth.units.get("emg"))
    assert "unconfirmed" not in draft and f'layout = "{name}"' in draft
    sidecar = tmp_path / "b.toml"
    sidecar.write_text(draft, encoding="utf-8")
    again = read_recording(sidecar)
    np.testing.assert_array_equal(again["emg"].values, emg.values)
    assert [str(label) for label in again["channel"].values] == labels
    # The file is listed once: by its sidecar, or without one by itself.
    assert find_recordings(tmp_path) == [sidecar]
    sidecar.unlink()
    assert find_recordings(tmp_path) == [truth.path]


@pytest.mark.parametrize("name", EXPORTS)
def test_damaged_exports_give_typed_errors(name: str, tmp_path: Path) -> None:
    truth = made(name, 3, tmp_path)
    data = truth.path.read_bytes()
    for k in range(100):
        truth.path.write_bytes(mutant(data, f"{name} {k}")[2])
        attempt(truth.path)


@pytest.mark.parametrize("name", EXPORTS)
def test_a_truncated_export_is_refused_or_says_so(name: str, tmp_path: Path) -> None:
    """Within a row, and within the header."""
    truth = made(name, 4, tmp_path)
    data = truth.path.read_bytes()
    for part in (0.02, 0.1):
        truth.path.write_bytes(data[: int(part * len(data))])
        try:
            recording = read_recording(truth.path, mapping={"units": truth.units})
        except DataError:
            continue
        assert recording.sizes["time_emg"] <= 0.2 * truth.volts.shape[1] + 2


def discover(path: Path, clocks: list[np.ndarray], rates: list[float]) -> Path:
    rng = np.random.default_rng(5)
    names, cells, columns = [], [], []
    for k, (clock, rate) in enumerate(zip(clocks, rates, strict=True)):
        names += [f"EMG {k} Time Series (s)", f"EMG {k} (mV)"]
        cells += ["", f"{rate} Hz"]
        columns += [[f"{t:.7f}" for t in clock], [f"{v:.5f}" for v in rng.normal(size=clock.size)]]
    n = max(map(len, columns))
    rows = [",".join(c[i] if i < len(c) else "" for c in columns) for i in range(n)]
    path.write_text("\n".join([",".join(names), ",".join(cells), *rows]) + "\n")
    return path


def test_lost_samples_of_a_sensor_are_a_gap_of_that_sensor(tmp_path: Path) -> None:
    clock = np.arange(4000) / 2000.0
    lossy = np.delete(clock, slice(1000, 1500))
    recording = read_recording(discover(tmp_path / "a.csv", [clock, lossy], [2000.0, 2000.0]))
    assert recording["emg"].shape == (2, 4000)
    missing = np.isnan(recording["emg"].values)
    assert not missing[0].any() and missing[1].sum() == 500 and missing[1, 1000:1500].all()
    (gap,) = findings_in(recording)
    assert (gap.code, gap.name, gap.values["samples"]) == ("gap", "EMG 1", 500)


def test_sensors_of_two_rates_are_distinguished(tmp_path: Path) -> None:
    clocks = [np.arange(4000) / 2000.0, np.arange(4000) / 2000.0, np.arange(2500) / 1259.26]
    path = discover(tmp_path / "a.csv", clocks, [2000.0, 2000.0, 1259.26])
    recording = read_recording(path)
    assert [str(c) for c in recording["channel"].values] == ["EMG 0", "EMG 1"]
    assert "sampled at 1259.26 Hz, the others at 2000 Hz" in note(recording, "dropped")["EMG 2"]


def test_a_stated_rate_that_contradicts_the_times_is_reported(tmp_path: Path) -> None:
    recording = read_recording(discover(tmp_path / "a.csv", [np.arange(4000) / 2000.0], [1925.926]))
    time = recording["time_emg"].values
    assert (time.size - 1) / (time[-1] - time[0]) == pytest.approx(2000.0)
    assert [finding.code for finding in findings_in(recording)] == ["rate"]


def test_a_sensor_that_began_later_is_placed_by_its_times(tmp_path: Path) -> None:
    clocks = [np.arange(4000) / 2000.0, 0.5 + np.arange(3000) / 2000.0]
    recording = read_recording(discover(tmp_path / "a.csv", clocks, [2000.0, 2000.0]))
    assert np.isnan(recording["emg"].values[1, :1000]).all()
    assert np.isfinite(recording["emg"].values[1, 1000:]).all()


def test_lost_packets_of_opensignals_are_gaps(tmp_path: Path) -> None:
    truth = made("OpenSignals", 1, tmp_path)
    lines = truth.path.read_bytes().decode("utf-8-sig", "replace").splitlines()
    if "nSeq" not in "".join(lines[:3]):
        lines = truth.path.read_text(encoding="utf-16").splitlines()
    truth.path.write_text("\n".join(lines[:203] + lines[208:]) + "\n")
    recording = read_recording(truth.path)
    missing = np.isnan(recording["emg"].values)
    assert recording["emg"].shape == truth.volts.shape
    assert missing[:, 200:205].all() and missing.sum() == 5 * len(missing)


def test_a_sequence_number_that_stands_still_is_refused(tmp_path: Path) -> None:
    """Without counts, lost packets cannot be noticed."""
    truth = made("OpenSignals", 1, tmp_path)
    lines = truth.path.read_bytes().decode("utf-8-sig", "replace").splitlines()
    if "nSeq" not in "".join(lines[:3]):
        lines = truth.path.read_text(encoding="utf-16").splitlines()
    rows = ["\t".join(["0", *line.split("\t")[1:]]) for line in lines[3:]]
    truth.path.write_text("\n".join(lines[:3] + rows) + "\n")
    with pytest.raises(DataError, match="sequence number 0 in every row"):
        read_recording(truth.path)


def test_counts_without_a_transfer_function_need_a_sidecar(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    header = {"x": {"sensor": ["RAW"], "column": ["nSeq", "DI", "CH1"], "label": ["CH1"],
                    "sampling rate": 1000, "resolution": [16], "device": "other"}}  # fmt: skip
    counts = np.random.default_rng(1).integers(20000, 40000, 300)
    rows = [f"{k}\t0\t{v}\t" for k, v in enumerate(counts)]
    path.write_text("\n".join([
        "# OpenSignals Text File Format", f"# {json.dumps(header)}", "# EndOfHeader", *rows,
    ]))  # fmt: skip
    with pytest.raises(DataError, match="specify step and zero in a sidecar"):
        read_recording(path)
    draft = describe(path)
    assert "unconfirmed" in draft and "emg.unit" in draft
    sidecar = tmp_path / "a.toml"
    sidecar.write_text(describe(path, rate=1000.0, confirmed=True))
    assert read_recording(sidecar).sizes["time_emg"] == 300


def test_the_reported_exports_are_read_whole(shared: Path) -> None:
    """Length, rate, labels and units of files that people reported."""
    folder = shared / REPORTED
    if not folder.is_dir():
        pytest.skip("the reported files are not there")
    for name in ("trigno.csv", "trigno_emg.csv"):
        recording = read_recording(folder / "24-trigno" / name)
        time = recording["time_emg"].values
        assert recording["emg"].shape == (3, 17185)
        assert time[-1] == pytest.approx(8.0, abs=1e-3)
        assert (time.size - 1) / (time[-1] - time[0]) == pytest.approx(2148.1481, rel=1e-6)
    recording = read_recording(folder / "25-biopac-text" / "femg.txt")
    assert [str(c) for c in recording["channel"].values] == ["Corr Raw", "Zyg Raw", "Lev Raw"]
    assert recording["time_emg"].values[1] == pytest.approx(1e-3)
    assert recording["emg"].shape == (3, 13150)
    assert recording["emg"].values[0, 0] == pytest.approx(-0.00384521e-3)
    assert recording["emg"].values[2, 0] == pytest.approx(0.000610352)
    dropped = note(recording, "dropped")
    assert "processed" in dropped["Lev Processed"] and len(dropped) == 12
    proposed = propose_for(recording, side="L")["channel"].set_index("label")["name"]
    assert proposed["Lev Raw"] == "LLSAN_L" and proposed["Zyg Raw"] == "ZYG_L"
    with pytest.raises(DataError, match=r"two columns of times 'X\[s\]' that differ"):
        read_recording(folder / "06-delsys-two-rates" / "trigno.toml")
