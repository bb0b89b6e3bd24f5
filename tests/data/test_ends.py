"""Tables of numbers that were cut within their last line, by every reader of text."""

from pathlib import Path

import numpy as np
import pytest

from emgface.errors import EmgfaceError
from emgface.recordings.bids import write_bids
from emgface.recordings.dataset import read_recording
from emgface.recordings.ends import cut_line, repeated_line
from emgface.recordings.exports import EXPORTS as LAYOUTS
from emgface.recordings.findings import findings_in
from emgface.texts import decoded
from tests.data.conftest import recording
from tests.data.made_exports import EXPORTS
from tests.data.test_trc import content


def table(folder: Path) -> tuple[Path, Path, dict[str, str]]:
    rng = np.random.default_rng(1)
    rows = "\n".join(",".join(f"{v:.4f}" for v in row) for row in rng.normal(size=(30, 2)))
    (folder / "a.csv").write_text(f"E1,E2\n{rows}\n")
    path = folder / "a.toml"
    path.write_text('schema = "recording"\n[emg]\nfile = "a.csv"\nrate = 100.0\nunit = "mV"\n')
    return path, folder / "a.csv", {}


def trc(folder: Path) -> tuple[Path, Path, dict[str, str]]:
    (folder / "a.trc").write_text(content())
    return folder / "a.trc", folder / "a.trc", {}


def motion(folder: Path) -> tuple[Path, Path, dict[str, str]]:
    path, tsv = write_bids(recording(), folder)
    lines = [line.split("\t") for line in tsv.read_text().splitlines()]
    tsv.write_text(
        "".join(
            "\t".join(c if c == "n/a" else f"{float(c):.6f}" for c in row) + "\n" for row in lines
        )
    )
    return path, tsv, {}


def export(name: str, folder: Path) -> tuple[Path, Path, dict[str, str]]:
    """An export whose last line is complete; columns of several lengths end with empty cells."""
    for seed in range(50):
        path = folder / f"{seed}{'.txt' if name in ('AcqKnowledge', 'OpenSignals') else '.csv'}"
        made = EXPORTS[name](path, np.random.default_rng(seed))
        last = decoded(path.read_bytes(), fallback="latin-1").rstrip().splitlines()[-1]
        if last.strip()[-1].isdigit() and last == last.strip() and "," not in last[-3:]:
            return path, path, made.units
    raise AssertionError(name)


READERS = {
    "csv": table,
    "trc": trc,
    "bids motion": motion,
    **{one.NAME: lambda folder, name=one.NAME: export(name, folder) for one in LAYOUTS},
}


@pytest.mark.parametrize("name", READERS)
def test_a_line_that_ends_within_a_number_is_a_finding(name: str, tmp_path: Path) -> None:
    path, target, units = READERS[name](tmp_path)
    whole = read_recording(path, mapping={"units": units})
    assert "cut" not in [finding.code for finding in findings_in(whole)]
    text = decoded(target.read_bytes(), fallback="latin-1").rstrip("\r\n\t ;,")
    number = max(len(cell) for cell in text[-30:].replace(";", "\t").split("\t")[-1:])
    number = min(number, len(text.rpartition(",")[2])) if "," in text[-12:] else number
    cut = text[: -max(2, min(number - 1, 5))]
    target.write_bytes(cut.encode())
    try:
        opened = read_recording(path, mapping={"units": units})
    except EmgfaceError as error:
        assert "ends within a row" in str(error)
        return
    messages = [finding for finding in findings_in(opened) if finding.code == "cut"]
    assert len(messages) == 1
    assert (
        "without a line end" in messages[0].sentence
        and "copy or export it again" in messages[0].sentence
    )


ROWS = ["1.2500,-0.1250", "1.5000,0.2500", "1.7500,0.5000", "2.0000,0.7500"]


@pytest.mark.parametrize(
    ("last", "why"),
    [
        ("2.2500", "fewer cells"),
        ("2.2500,", "a shorter last number"),
        ("2.2500,1.", "a shorter last number"),
        ("2.2500,1", "a shorter last number"),
        ("2.2500,-", "a shorter last number"),
        ("2.2500,1.00", "a shorter last number"),
    ],
)
def test_what_is_missing_is_stated(last: str, why: str) -> None:
    (line,) = cut_line("\n".join([*ROWS, last]), ",")
    assert line.values["why"] == why


@pytest.mark.parametrize("last", ["2.2500,1.0000", "2.2500,-1.0000", "2.2500,123.0000"])
@pytest.mark.parametrize("end", ["", "\n", "\r\n"])
def test_complete_lines_are_no_finding(last: str, end: str) -> None:
    assert not cut_line("\n".join([*ROWS, last]) + end, ",")


def test_a_line_end_and_numbers_of_all_lengths_are_no_finding() -> None:
    assert not cut_line("\n".join([*ROWS, "2.25,1"]) + "\n", ",")
    rows = [f"{value!r},{2 * value!r}" for value in np.linspace(0.0, 1.0, 33)]
    assert not cut_line("\n".join([*rows, "0.5,1.0"]), ",")


def test_labels_that_look_like_exponents_are_no_numbers() -> None:
    assert cut_line("\n".join(["E1,E2", *ROWS, "2.2500,1."]), ",")


def test_exponents_count() -> None:
    rows = [f"{k},{1.5 * k:.6e}" for k in range(1, 9)]
    assert cut_line("\n".join([*rows, "9,1.350000e"]), ",")
    assert cut_line("\n".join([*rows, "9,1.350000"]), ",")
    assert not cut_line("\n".join([*rows, "9,1.350000e-05"]), ",")


@pytest.mark.parametrize("name", READERS)
def test_a_line_that_was_written_twice_is_a_finding_or_refused(name: str, tmp_path: Path) -> None:
    """Readers with a column of times or a counter refuse it, or find it by these."""
    path, target, units = READERS[name](tmp_path)
    assert "repeated_line" not in codes(read_recording(path, mapping={"units": units}))
    lines = decoded(target.read_bytes(), fallback="latin-1").splitlines(keepends=True)
    sign = max("\t,;", key=lines[-5].count)
    lines.insert(len(lines) - 5, lines[-5])
    target.write_bytes("".join(lines).encode())
    try:
        findings = codes(read_recording(path, mapping={"units": units}))
    except EmgfaceError as error:
        assert path.stem in str(error) or target.name in str(error)
        return
    several = len([c for c in lines[-5].strip().split(sign) if c.strip()]) > 2
    assert findings or not several, "a table of one signal may repeat a value"


def codes(data) -> set[str]:
    return {one.code for one in findings_in(data)} & {
        "repeated_line", "sample_count", "cut", "rate", "gap", "gap_of_markers", "uneven", "reordered",
    }  # fmt: skip


def test_values_that_stay_the_same_are_not_written_twice() -> None:
    rng = np.random.default_rng(0)
    fine = [",".join(f"{v:.6f}" for v in row) for row in rng.normal(size=(500, 3))]
    twice = [*fine[:200], fine[199], *fine[200:]]
    assert [f.values["line"] for f in repeated_line("\n".join(twice), ",")] == [201]
    assert not repeated_line("\n".join(fine), ",")
    dropout = [*fine[:200], *[fine[199]] * 5, *fine[200:]]  # a dropout, which is found as a filler
    assert not repeated_line("\n".join(dropout), ",")
    assert not repeated_line("\n".join(line.split(",")[0] for line in twice), ","), "one column"


def test_signals_of_few_levels_give_no_false_alarm() -> None:
    """Converters of 6 to 12 bits at rest: lines that repeat by chance are no finding."""
    rng = np.random.default_rng(1)
    alarms = 0
    for _ in range(200):
        levels = 2.0 ** rng.uniform(0.0, 6.0)  # standard deviation in steps of the converter
        values = np.round(levels * rng.normal(size=(1000, int(rng.integers(2, 6)))))
        text = "\n".join(",".join(f"{0.1 * v:.4f}" for v in row) for row in values)
        alarms += bool(repeated_line(text, ","))
    assert alarms <= 2


@pytest.mark.parametrize(("kept", "expected"), [(200, False), (199, True), (150, True)])
def test_numbers_of_samples_are_compared_with_those_stated(kept, expected, tmp_path: Path) -> None:
    """The header of AcqKnowledge states the number of samples of every channel."""
    rows = [f"{a:.6f}\t{b:.6f}" for a, b in np.random.default_rng(0).normal(size=(200, 2))]
    head = ["a.acq", "1 msec/sample", "2 channels", "ZYG_L", "mV", "ZYG_R", "mV", "CH1\tCH2"]
    del rows[kept:]
    (tmp_path / "a.txt").write_text("\n".join([*head, "200\t200", *rows]) + "\n")
    findings = [
        f for f in findings_in(read_recording(tmp_path / "a.txt")) if f.code == "sample_count"
    ]
    assert bool(findings) == expected
    assert not findings or (findings[0].values["held"], findings[0].values["stated"]) == (kept, 200)
