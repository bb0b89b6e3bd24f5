"""Tables with a TOML sidecar."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from emgface import texts
from emgface.errors import ConfigurationError, DataError, EmgfaceError, UnitsError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.check import check_recording
from emgface.recordings.dataset import find_recordings, read_recording
from emgface.recordings.labels import note

MARKERS = FACE_MARKERS + LIP_MARKERS
RATE, FRAME_RATE = 2048.0, 100.0


def make_tables(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Write a study trial in mV and mm; return the tables."""
    rng = np.random.default_rng(9)
    emg = pd.DataFrame({f"EMG {i}": rng.normal(size=64) for i in range(1, 16)})
    position = pd.DataFrame(
        {f"{m}_{axis}": rng.uniform(-50, 50, size=12) for m in MARKERS for axis in "xyz"}
    )
    position.loc[4:5, ["nasion_x", "nasion_y", "nasion_z"]] = np.nan
    emg.to_csv(folder / "emg.csv", index=False)
    position.to_csv(folder / "markers.csv", index=False)
    return emg, position


def sidecar(folder: Path, **changes: str) -> Path:
    """Write the sidecar of the tables, with lines replaced (or removed if empty)."""
    lines = {
        "schema": 'schema = "recording"',
        "who": 'volunteer = "V02"\ninstruction = "B"\nrepetition = 4',
        "emg": '[emg]\nfile = "emg.csv"\nunit = "mV"',
        "emg_clock": "rate = 2048.0",
        "channels": "[emg.channels]\n"
        + "\n".join(f'"EMG {i}" = "{name}"' for i, name in enumerate(CHANNELS, start=1)),
        "position": '[position]\nfile = "markers.csv"\nunit = "mm"',
        "position_clock": "rate = 100",
        "axes": "",
    }
    lines.update(changes)
    path = folder / "trial.toml"
    path.write_text("\n".join(lines.values()) + "\n", encoding="utf-8")
    return path


def test_tables_are_a_study_recording(tmp_path: Path) -> None:
    emg, position = make_tables(tmp_path)
    trial = read_recording(sidecar(tmp_path), study=True)
    assert tuple(trial["channel"].values) == CHANNELS
    assert tuple(trial["marker"].values) == MARKERS
    np.testing.assert_array_equal(trial["emg"], emg.to_numpy().T[:14] / 1e3)
    expected = position.to_numpy().T.reshape(16, 3, 12) / 1e3
    np.testing.assert_array_equal(trial["position"], expected)
    assert np.isnan(trial["position"].sel(marker="nasion")).sum() == 6
    np.testing.assert_array_equal(trial["time_emg"], np.arange(64) / RATE)
    np.testing.assert_array_equal(trial["time_marker"], np.arange(12) / FRAME_RATE)
    named = ("volunteer", "instruction", "repetition", "origin", "source")
    assert [trial.attrs[n] for n in named] == ["V02", "B", 4, "measured", "trial.toml"]
    assert note(trial, "original_names")["OOS_L"] == "EMG 1"
    assert note(trial, "original_units") == {"emg": "mV", "position": "mm"}
    assert note(trial, "dropped") == {"EMG 15": "not in the mapping"}


def test_a_column_of_instants_replaces_the_rate(tmp_path: Path) -> None:
    emg, _ = make_tables(tmp_path)
    emg.insert(0, "t", np.arange(64) / 2.0 + 100)
    emg.to_csv(tmp_path / "emg.csv", index=False)
    trial = read_recording(sidecar(tmp_path, emg_clock='time = "t"\ntime_unit = "ms"'))
    np.testing.assert_array_equal(trial["time_emg"], (np.arange(64) / 2.0 + 100) / 1000)
    assert "t" not in trial["channel"].values


def test_one_table_alone_is_a_recording(tmp_path: Path) -> None:
    make_tables(tmp_path)
    trial = read_recording(sidecar(tmp_path, position="", position_clock=""))
    assert "position" not in trial and trial.sizes == {"channel": 14, "time_emg": 64}


def test_columns_keep_their_labels_without_a_table_of_names(tmp_path: Path) -> None:
    make_tables(tmp_path)
    path = sidecar(tmp_path, channels="")
    assert list(read_recording(path)["channel"].values) == [f"EMG {i}" for i in range(1, 16)]
    mapped = read_recording(path, mapping={"channels": {"EMG 3": "RIS_L"}})
    assert list(mapped["channel"].values) == ["RIS_L"]


def test_a_second_mapping_keeps_the_label_of_the_file(tmp_path: Path) -> None:
    make_tables(tmp_path)
    trial = read_recording(sidecar(tmp_path), mapping={"channels": {"OOS_L": "upper lip"}})
    assert note(trial, "original_names")["upper lip"] == "EMG 1"
    assert "EMG 2" in note(trial, "dropped")


def test_semicolons_and_decimal_commas(tmp_path: Path) -> None:
    emg, _ = make_tables(tmp_path)
    emg.to_csv(tmp_path / "emg.csv", index=False, sep=";", decimal=",")
    clock = 'rate = 2048\ndelimiter = ";"\ndecimal = ","'
    trial = read_recording(sidecar(tmp_path, emg_clock=clock))
    np.testing.assert_array_equal(trial["emg"], emg.to_numpy().T[:14] / 1e3)
    with pytest.raises(DataError, match="check 'delimiter'"):
        read_recording(sidecar(tmp_path))


def comma_table(folder: Path, *cells: str, **changes: str) -> Path:
    """Write a table of one column with decimal commas, and its sidecar."""
    (folder / "emg.csv").write_text("\n".join(["E1", *cells, ""]))
    clock = 'rate = 2048\ndelimiter = ";"\ndecimal = ","'
    plain = {"channels": "", "position": "", "position_clock": ""}
    return sidecar(folder, emg_clock=clock, **plain, **changes)


@pytest.mark.parametrize("cell", ["1.234", "1.234,5", "1 234", "1'234", "1_234", "0x1F", "\uff11"])
def test_a_number_with_a_sign_between_thousands_is_refused(tmp_path: Path, cell: str) -> None:
    """Read as 1.234 it would be wrong by a factor of a thousand."""
    path = comma_table(tmp_path, "0,5", "2", cell)
    with pytest.raises(
        DataError, match=r"row 4, column 'E1' contains .*without a thousands separator"
    ):
        read_recording(path)


def test_decimal_commas_hold_exponents_signs_and_empty_cells(tmp_path: Path) -> None:
    path = comma_table(tmp_path, "0,5", "-1,25e-3", "+2", ",75", "NaN", "3,")
    recording = read_recording(path)["emg"].values[0]
    np.testing.assert_array_equal(
        recording, np.array([0.5, -1.25e-3, 2.0, 0.75, np.nan, 3.0]) / 1e3
    )


def test_thousands_are_refused_with_a_decimal_point_too(tmp_path: Path) -> None:
    (tmp_path / "emg.csv").write_text("E1;E2\n1.5;2\n1,234;3\n")
    path = sidecar(tmp_path, emg_clock='rate = 2048\ndelimiter = ";"', channels="",
                   position="", position_clock="")  # fmt: skip
    with pytest.raises(DataError, match=r"row 3, column 'E1' contains '1,234'"):
        read_recording(path)


def test_the_row_named_counts_lines_of_the_file(tmp_path: Path) -> None:
    (tmp_path / "emg.csv").write_text("made by x\n\n1.5\n1_000\n")
    clock = 'rate = 2048\nskip_rows = 2\ncolumns = ["E1"]'
    path = sidecar(tmp_path, emg_clock=clock, channels="", position="", position_clock="")
    with pytest.raises(DataError, match=r"row 4, column 'E1' contains '1_000'"):
        read_recording(path)


@pytest.mark.parametrize("encoding", ["latin-1", "utf-16", "utf-16-le", "cp1252", "utf-8-sig"])
def test_encodings_are_specified_or_detected_by_a_byte_order_mark(
    tmp_path: Path, encoding: str
) -> None:
    (tmp_path / "emg.csv").write_bytes("Größe mV\n1.5\n2.5\n".encode(encoding))
    plain = {"channels": "", "position": "", "position_clock": ""}
    # Python writes a byte order mark for two of these; the zeros of UTF-16 show it without one.
    marked = encoding in ("utf-16", "utf-8-sig", "utf-16-le")
    if not marked:
        with pytest.raises(DataError, match="emg.csv.*'encoding' in trial.toml"):
            read_recording(sidecar(tmp_path, **plain))
    named = "rate = 2048" + ("" if marked else f'\nencoding = "{encoding}"')
    trial = read_recording(sidecar(tmp_path, emg_clock=named, **plain))
    assert list(trial["channel"].values) == ["Größe mV"]
    np.testing.assert_array_equal(trial["emg"].values[0], [1.5e-3, 2.5e-3])


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ('delimiter = ","\ndecimal = ","', "delimiter and decimal are both ','"),
        ('decimal = ";"', "decimal"),
        ('encoding = "klingon"', "encoding = 'klingon' is unknown"),
    ],
)
def test_impossible_settings_are_refused(tmp_path: Path, line: str, match: str) -> None:
    make_tables(tmp_path)
    with pytest.raises(ConfigurationError, match=match):
        read_recording(sidecar(tmp_path, emg_clock=f"rate = 2048\n{line}"))


def test_other_endings_of_marker_columns(tmp_path: Path) -> None:
    _, position = make_tables(tmp_path)
    position.columns = [c[:-2] + f" [{c[-1].upper()}]" for c in position.columns]
    position["frame"] = np.arange(12)
    position.to_csv(tmp_path / "markers.csv", index=False)
    trial = read_recording(sidecar(tmp_path, axes='axes = [" [X]", " [Y]", " [Z]"]'), study=True)
    assert note(trial, "dropped")["frame"] == "no column for each axis of a marker"
    with pytest.raises(DataError, match="markers.csv has no marker with columns ending in _x, _y"):
        read_recording(sidecar(tmp_path))


def test_a_delimiter_at_the_end_of_lines_makes_no_channel(tmp_path: Path) -> None:
    emg, _ = make_tables(tmp_path)
    text = (tmp_path / "emg.csv").read_text()
    (tmp_path / "emg.csv").write_text("".join(f"{line},\n" for line in text.splitlines()))
    trial = read_recording(sidecar(tmp_path, channels=""))
    np.testing.assert_array_equal(trial["emg"], emg.to_numpy().T / 1e3)


CHANGES: list[tuple[dict[str, str], type[EmgfaceError], str]] = [
    ({"emg": '[emg]\nfile = "emg.csv"\nunit = "furlong"'}, UnitsError, "emg is in 'furlong'"),
    ({"emg": '[emg]\nfile = "emg.csv"\nunit = "mm"'}, UnitsError, "which is not a unit of voltage"),
    ({"emg": '[emg]\nfile = "egm.csv"\nunit = "mV"'}, DataError, "specifies egm.csv, which is not"),
    ({"emg_clock": ""}, ConfigurationError, "emg.csv requires either rate, in Hz, or time"),
    ({"emg_clock": "rate = 0"}, ConfigurationError, "'emg.rate' = 0: .* greater than 0"),
    ({"emg_clock": "rat = 2048"}, ConfigurationError, "unknown parameter 'emg.rat'"),
    ({"emg_clock": 'time = "T"'}, DataError, "emg.csv has no column 'T'"),
    ({"who": 'voluntear = "V02"'}, ConfigurationError, "'voluntear', did you mean 'volunteer'"),
    ({"schema": ""}, DataError, "trial.toml does not contain schema = \"recording\""),
    ({"who": "volunteer = V02"}, ConfigurationError, "trial.toml is not valid TOML"),
    ({"channels": '[emg.channels]\n"EMG 99" = "OOS_L"'}, DataError, "no channel 'EMG 99' .did"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "error", "text"), CHANGES)
def test_a_faulty_sidecar_is_explained(
    tmp_path: Path, changes: dict[str, str], error: type[EmgfaceError], text: str
) -> None:
    make_tables(tmp_path)
    with pytest.raises(error, match=text) as caught:
        read_recording(sidecar(tmp_path, **changes))
    assert "trial.toml" in str(caught.value)


def test_a_cell_that_is_not_a_number_is_located(tmp_path: Path) -> None:
    emg, _ = make_tables(tmp_path)
    spoilt = emg.astype(object)
    spoilt.loc[6, "EMG 2"] = "bad"
    spoilt.to_csv(tmp_path / "emg.csv", index=False)
    with pytest.raises(DataError, match="emg.csv, row 8, column 'EMG 2' contains 'bad'"):
        read_recording(sidecar(tmp_path))


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("", "emg.csv is not a table"),
        ("EMG 1,EMG 2\n", "emg.csv has no row of numbers"),
        ("EMG 1,EMG 2\n1,2\n1,2,3\n", "emg.csv is not a table"),
        ("EMG 1,EMG 2\n1,2,3\n4,5,6\n", "emg.csv is not a table"),
    ],
)
def test_a_broken_table_is_refused(tmp_path: Path, content: str, text: str) -> None:
    make_tables(tmp_path)
    (tmp_path / "emg.csv").write_text(content)
    with pytest.raises(DataError, match=text):
        read_recording(sidecar(tmp_path))


def test_only_sidecars_count_as_recordings(tmp_path: Path) -> None:
    make_tables(tmp_path)
    path = sidecar(tmp_path)
    (tmp_path / "study.toml").write_text('name = "study"\n')
    assert find_recordings(tmp_path) == [path]
    with pytest.raises(DataError, match="emg.csv does not specify its contents, rate and units"):
        read_recording(tmp_path / "emg.csv")


@pytest.mark.parametrize(
    ("table", "columns", "match"),
    [
        ("ZYG_L,ZYG_L\n1,2\n3,4\n", "", "several columns 'ZYG_L'"),
        ("1,2\n3,4\n", 'columns = ["ZYG_L", "ZYG_L"]', "lists 'ZYG_L' more than once"),
    ],
)
def test_repeated_labels_are_refused(tmp_path: Path, table: str, columns: str, match: str) -> None:
    """pandas renames the second column, which was then ignored without a message."""
    (tmp_path / "emg.csv").write_text(table)
    sidecar = tmp_path / "emg.toml"
    sidecar.write_text(
        f'schema = "recording"\n[emg]\nfile = "emg.csv"\nunit = "uV"\nrate = 1000\n{columns}\n'
    )
    with pytest.raises(EmgfaceError, match=match):
        read_recording(sidecar)


@pytest.mark.parametrize("start", [0.0, 738000.0])
def test_times_in_days_that_were_stated_in_seconds_are_an_error_of_the_check(tmp_path, start):
    """Date numbers of MATLAB: 172.8 MHz, at which the search for fillers failed."""
    days = start + np.arange(4000) / 2000.0 / 86400.0
    values = np.random.default_rng(3).normal(scale=0.05, size=4000)
    rows = [f"{day:.12f},{value:.5f}" for day, value in zip(days, values, strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,ZYG_L", *rows]) + "\n")
    (tmp_path / "a.toml").write_text(
        'schema = "recording"\n[emg]\nfile = "a.csv"\ntime = "time"\nunit = "mV"\n'
    )
    (row,) = check_recording(read_recording(tmp_path / "a.toml")).to_dict("records")
    assert row["verdict"] == "error" and "check the rate, or the unit of the times" in row["reason"]


def test_the_text_of_a_table_with_lines_before_it_is_decoded_once(tmp_path, monkeypatch) -> None:
    lines = ["# Unit: uV", "# Sample rate = 1000 Hz", "E1", *(f"{k % 7}" for k in range(2000))]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    path = tmp_path / "a.toml"
    path.write_text(
        'schema = "recording"\n[emg]\nfile = "a.csv"\nskip_rows = 2\nunit = "uV"\nrate = 1000\n'
    )
    calls: list[int] = []
    decode = texts.decoded
    monkeypatch.setattr(
        texts, "decoded", lambda data, *a, **k: calls.append(len(data)) or decode(data, *a, **k)
    )
    assert read_recording(path).sizes["time_emg"] == 2000
    assert calls.count((tmp_path / "a.csv").stat().st_size) == 1
