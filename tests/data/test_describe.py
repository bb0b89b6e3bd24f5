"""Drafts of sidecars: facts, guesses, and their use after confirmation."""

import gzip
import tomllib
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

from emgface.errors import DataError
from emgface.recordings.dataset import read_recording
from emgface.recordings.describe import describe
from emgface.recordings.layout import text_layout, unit_in

RATE, N = 1000.0, 2500
TIME = np.arange(N) / RATE
EMG = 20e-6 * np.random.default_rng(5).standard_normal((2, N)) * (1 + np.sin(2 * np.pi * TIME) ** 2)


def rows(columns, delimiter: str, decimal: str = ".", digits: int = 6) -> list[str]:
    lines = [delimiter.join(f"{v:.{digits}f}" for v in row) for row in np.array(columns).T]
    return [line.replace(".", decimal) for line in lines] if decimal != "." else lines


def table(case: str) -> tuple[str, bytes]:
    """Name and content of a table in the format of some laboratory."""
    uv, mv, ms = 1e6 * EMG, 1e3 * EMG, 1e3 * TIME
    if case == "decimal commas":
        lines = ["Zeit [ms];Zyg L [mV];Zyg R [mV]", *rows([ms, *mv], ";", ",")]
        return "a.csv", "\n".join(lines).encode()
    if case == "no labels":
        return "a.txt", "\n".join(rows([TIME, *mv], "\t")).encode()
    if case == "preamble and units":
        head = ["# device 7", "exported on a Monday, at noon", "", "t,Zyg L,Zyg R", "s,uV,uV"]
        return "a.csv", "\n".join([*head, *rows([TIME, *uv], ",")]).encode()
    if case == "latin-1, last delimiter":
        lines = ["time (s);Zyg L (µV);Zyg R (µV);", *(f"{r};" for r in rows([TIME, *uv], ";"))]
        return "a.csv", "\n".join(lines).encode("latin-1")
    if case == "utf-16":
        lines = ["time\tZyg L\tZyg R", *rows([TIME, *uv], "\t")]
        return "a.txt", "\n".join(lines).encode("utf-16")
    if case == "blanks":
        return "a.asc", "\n".join(["  t  L  R", *rows([TIME, *mv], "   ")]).encode()
    if case == "same label twice, compressed":
        lines = ["time,EMG,EMG,marker", *rows([TIME, *uv, (TIME > 1) * 5.0], ",")]
        return "a.csv.gz", gzip.compress("\r\n".join(lines).encode())
    assert case == "volts and samples"
    lines = ["sample,time,L,R", *rows([np.arange(N), TIME, *EMG], ",", digits=9)]
    return "a.csv", "\n".join(lines).encode()


@pytest.mark.parametrize(
    "case",
    ["decimal commas", "no labels", "preamble and units", "latin-1, last delimiter", "utf-16",
     "blanks", "same label twice, compressed", "volts and samples"],
)  # fmt: skip
def test_a_confirmed_draft_reads_the_original_signals(tmp_path: Path, case: str) -> None:
    name, content = table(case)
    (tmp_path / name).write_bytes(content)
    draft = describe(tmp_path / name)
    sidecar = tmp_path / "a.toml"
    sidecar.write_text(draft, encoding="utf-8")
    guesses = tomllib.loads(draft).get("unconfirmed", [])
    if guesses:
        with pytest.raises(DataError, match="unconfirmed, which are guesses"):
            read_recording(sidecar)
    assert draft.count("UNCONFIRMED") == len(guesses)
    lines = [line for line in draft.splitlines() if not line.startswith("unconfirmed")]
    sidecar.write_text("\n".join(lines), encoding="utf-8")
    recording = read_recording(sidecar)
    assert recording["emg"].dims == ("channel", "time_emg") and recording.sizes["channel"] == 2
    np.testing.assert_allclose(recording["emg"].values, EMG, atol=1e-9)
    np.testing.assert_allclose(recording["time_emg"].values, TIME, atol=1e-9)


@pytest.mark.parametrize(
    ("case", "guesses"),
    [
        ("decimal commas", []),
        ("no labels", ["emg.columns", "emg.time", "emg.unit"]),
        ("preamble and units", []),
        ("utf-16", ["emg.unit"]),
    ],
)
def test_only_values_missing_in_the_file_are_guesses(
    tmp_path: Path, case: str, guesses: list[str]
) -> None:
    name, content = table(case)
    (tmp_path / name).write_bytes(content)
    assert tomllib.loads(describe(tmp_path / name)).get("unconfirmed", []) == guesses


def test_given_values_are_not_guesses(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("\n".join(rows(1e3 * EMG, "\t")))
    draft = describe(tmp_path / "a.txt", rate=500.0, unit="uV", columns=["left", "right"])
    assert "UNCONFIRMED" not in draft
    (tmp_path / "a.toml").write_text(draft)
    recording = read_recording(tmp_path / "a.toml")
    assert list(recording["channel"].values) == ["left", "right"]
    np.testing.assert_allclose(recording["emg"].values, 1e-3 * EMG, atol=1e-12)
    assert float(recording["time_emg"][1]) == 0.002
    with pytest.raises(DataError, match="has 2 columns and 1 labels"):
        describe(tmp_path / "a.txt", columns=["left"])
    # Without an instant or a rate the entry is left open, and such a draft cannot be confirmed.
    open_draft = describe(tmp_path / "a.txt")
    assert "# rate = ...  # UNCONFIRMED" in open_draft and '"emg.rate"' in open_draft
    with pytest.raises(DataError, match="cannot be described completely.*--rate"):
        describe(tmp_path / "a.txt", confirmed=True)


def test_markers_in_threes_become_a_table_of_positions(tmp_path: Path) -> None:
    xyz = 100.0 + 30.0 * np.arange(6)[:, None] + np.sin(TIME + np.arange(6)[:, None])
    lines = ["t,A_x,A_y,A_z,B_x,B_y,B_z", *rows([TIME, *xyz], ",")]
    (tmp_path / "m.csv").write_text("\n".join(lines))
    (tmp_path / "m.toml").write_text(describe(tmp_path / "m.csv", confirmed=True))
    recording = read_recording(tmp_path / "m.toml")
    assert list(recording["marker"].values) == ["A", "B"] and "emg" not in recording
    np.testing.assert_allclose(recording["position"].values.reshape(6, N), 1e-3 * xyz, atol=1e-8)


def test_columns_of_other_signals_are_commented_out(tmp_path: Path) -> None:
    force = 20.0 + 50.0 * np.sin(2 * np.pi * 0.8 * TIME)  # mV, like a force plate
    switch = 5.0 * (TIME % 1 > 0.5)
    lines = ["t,zyg,plate signal,Fz,nothing,pedal,note"]
    lines += [f"{r},word" for r in rows([TIME, 1e3 * EMG[0], force, force, 0 * TIME, switch], ",")]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    draft = describe(tmp_path / "a.csv")
    assert tomllib.loads(draft)["emg"]["channels"] == {"zyg": "zyg"}
    assert '# "Fz" = "Fz"  # force plate' in draft and '"pedal"  # switch' in draft
    assert (
        '# "nothing" = "nothing"  # unused' in draft and 'The column "note" contains text' in draft
    )


def test_an_uneven_clock_is_no_signal(tmp_path: Path) -> None:
    late = np.where(np.arange(len(TIME)) < 1000, TIME, TIME + 0.5)
    (tmp_path / "a.csv").write_text("\n".join(["time,zyg", *rows([late, 1e3 * EMG[0]], ",")]))
    draft = describe(tmp_path / "a.csv")
    assert tomllib.loads(draft)["emg"]["channels"] == {"zyg": "zyg"}
    assert tomllib.loads(draft)["emg"]["time"] == "time"
    assert "are uneven" in draft and "become gaps" in draft


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_every_column_has_its_own_unit_and_lines_any_end(end: str, tmp_path: Path) -> None:
    table = rows([TIME, 1e6 * EMG[0], 1e3 * EMG[1]], ",")
    text = end.join(["time [s],zyg [uV],oos [mV]", *table]) + end
    (tmp_path / "a.csv").write_bytes(text.encode())
    draft = describe(tmp_path / "a.csv")
    assert tomllib.loads(draft)["emg"]["units"] == {"oos [mV]": "mV"}
    (tmp_path / "a.toml").write_text(draft)
    recording = read_recording(tmp_path / "a.toml")["emg"]
    np.testing.assert_allclose(recording, EMG[:2], atol=2e-6 * float(np.abs(EMG).max()) + 1e-9)
    (tmp_path / "a.toml").write_text(draft.replace('"oos [mV]" = "mV"', '"oos" = "mV"'))
    with pytest.raises(DataError, match="'units' names 'oos'; expected columns of a.csv"):
        read_recording(tmp_path / "a.toml")


def test_arrays_are_described(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"data": 1e6 * EMG, "fs": RATE, "other": np.zeros((3, 3))})
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["device/raw"] = 1e6 * EMG.T
        file["device/counter"] = np.arange(N)
        file["device"].attrs["sampling rate"] = RATE
    for name, columns in (("a.mat", None), ("b.h5", ["left", "right"])):
        path = tmp_path / f"{name}.toml"
        path.write_text(describe(tmp_path / name, columns=columns, confirmed=True))
        recording = read_recording(path)
        np.testing.assert_allclose(recording["emg"].values, EMG, rtol=1e-12)
        assert float(recording["time_emg"][1]) == 1 / RATE


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", b"one two\nthree four\n", "no rows of numbers"),
        ("a.txt", bytes(range(256)) * 20, "binary data"),
        ("a.c3d", b"x", "state their rates and units themselves"),
        ("a.mat", b"nothing", "cannot be read"),
        ("a.csv.gz", b"not compressed", "cannot be decompressed"),
        ("a.csv", b"", "no rows of numbers"),
    ],
)
def test_files_that_are_not_tables_are_refused(
    tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(DataError, match=said):
        describe(tmp_path / name)
    with pytest.raises(DataError, match="No file"):
        describe(tmp_path / "none.csv")


def test_ambiguous_commas_are_a_guess(tmp_path: Path) -> None:
    """ "1,5" may be one decimal number or two integers."""
    (tmp_path / "a.csv").write_text("\n".join(f"{k % 7},{k % 5}" for k in range(300)))
    layout = text_layout(tmp_path / "a.csv")
    assert (layout.delimiter, layout.decimal, layout.sure) == (",", ".", False)


def test_units_in_labels() -> None:
    labels = ["a [µV]", "b (mV)", "c/V", "d_uV", "marker_m", "e", "time s", "Force [N]", "x (mm)"]
    assert [unit_in(label) for label in labels] == ["uV", "mV", "V", "uV", "", "", "", "", "mm"]


@pytest.mark.parametrize(("between", "labelled"), [("", True), ("V,V\n", False)])
def test_labels_count_as_those_of_the_file_directly_above_the_numbers(
    tmp_path: Path, between: str, labelled: bool
) -> None:
    rows = "".join(f"{0.25 * k},{-0.5 * k}\n" for k in range(20))
    (tmp_path / "a.csv").write_text(f"left,right\n{between}{rows}")
    layout = text_layout(tmp_path / "a.csv")
    assert (layout.labels, layout.labelled) == (("left", "right"), labelled)
