"""Text files in every encoding, TOML of any depth and size, and compressed texts that expand."""

import ast
import codecs
import gzip
import io
from pathlib import Path

import pytest
import xarray as xr

import emgface
from emgface.errors import ConfigurationError, DataError
from emgface.recordings.dataset import read_recording
from emgface.recordings.exclusions import read_exclusions
from emgface.recordings.labels import read_label_map
from emgface.study.file import load_study, study_template
from emgface.texts import DEEPEST_TABLES, EXPANDED, labelled, read_text, read_toml
from tests.data.test_mutations import FORMATS

TEXTS = ("trc", "bids motion", "bids json", "bids channels", "csv", "toml", "brainvision header",
         "brainvision markers", "motion alone")  # fmt: skip
SAVED = {
    "mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-16 big": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
    "utf-16 without mark": lambda text: text.encode("utf-16-le"),
    "utf-32": lambda text: text.encode("utf-32"),
    "crlf": lambda text: text.replace("\r\n", "\n").replace("\n", "\r\n").encode(),
}


@pytest.mark.parametrize("saved", SAVED)
@pytest.mark.parametrize("name", TEXTS)
def test_a_text_file_is_read_whatever_encoding_it_was_saved_in(
    name: str, saved: str, tmp_path: Path
) -> None:
    path, target = FORMATS[name](tmp_path)
    before = read_recording(path)
    target.write_bytes(SAVED[saved](target.read_text(encoding="utf-8")))
    after = read_recording(path)
    for part in (before, after):
        part.attrs.pop("source_digest", None)
    xr.testing.assert_identical(before, after)


@pytest.mark.parametrize("saved", SAVED)
def test_settings_are_read_whatever_encoding_they_were_saved_in(saved: str, tmp_path: Path) -> None:
    mapping, study, left_out = (tmp_path / name for name in ("m.toml", "s.toml", "x.toml"))
    mapping.write_bytes(SAVED[saved]('[channels]\n"Mündung" = "OOS_L"\n'))
    study.write_bytes(SAVED[saved](study_template()))
    left_out.write_bytes(SAVED[saved]('[[exclude]]\nvolunteer = "V1"\nreason = "läuft"\n'))
    assert read_label_map(mapping).channels == {"Mündung": "OOS_L"}
    plain = tmp_path / "plain.toml"
    plain.write_text(study_template(), encoding="utf-8")
    assert load_study(study) == load_study(plain)
    assert read_exclusions(left_out)[0].reason == "läuft"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = " + "[" * 3000 + "]" * 3000, "not valid TOML"),
        (".".join("a" * 5000) + " = 1", "deep"),
        ("[" + ".".join("a" * (DEEPEST_TABLES + 2)) + "]\nx = 1", "deep"),
        ("x = " + "9" * 10000, "not valid TOML"),
        ("# " + "x" * (9 << 20), "MiB"),
        ("name = 'Mündung'", "not valid TOML"),
    ],
    ids=["nested arrays", "dotted key", "nested table", "huge integer", "huge file", "latin-1"],
)
def test_a_deep_or_huge_toml_file_is_refused(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(text.encode("latin-1"))
    for read in (read_toml, read_label_map, load_study, read_exclusions):
        with pytest.raises(ConfigurationError, match=message):
            read(path)
    with pytest.raises((ConfigurationError, DataError)):
        read_recording(path)


def test_a_decimal_comma_in_a_toml_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text('name = "a, b"\nwidth = 12,5  # mm\n', encoding="utf-8")
    with pytest.raises(ConfigurationError, match=r"write 12\.5, with a point"):
        read_toml(path)
    path.write_text("width = 12 5\n", encoding="utf-8")
    with pytest.raises(ConfigurationError, match="repair it"):
        read_toml(path)


def test_a_compressed_text_that_expands_beyond_reason_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    row = b"0.0,0.0,0.0,0.0\n"
    path.write_bytes(gzip.compress(row * (3 * EXPANDED // len(row)), 9))
    with pytest.raises(DataError, match="expands to more than"):
        read_text(path)
    (tmp_path / "a.toml").write_text(
        'schema = "recording"\n[emg]\nfile = "a.csv.gz"\nrate = 100.0\nunit = "mV"\n'
    )
    with pytest.raises(DataError, match="expands to more than"):
        read_recording(tmp_path / "a.toml")


OPENED = ("open_text(", "labelled(", "StringIO(", "io.", "stream")
"""Starts of the first argument of a reader of tables that has the text of one place."""

OWN = {  # files that the package writes itself, or ships
    "emgface/texts.py", "emgface/cli/data_describe.py", "emgface/recordings/readers/_isolated.py",
    "emgface/cli/study.py", "emgface/pictures/page.py", "emgface/view/page.py",
    "emgface/report/kept.py", "emgface/schema/validation.py", "emgface/schema/older.py",
    "emgface/face/waypoints.py", "emgface/treatment/dose.py",
}  # fmt: skip


def test_every_text_file_of_a_user_is_opened_in_one_place() -> None:
    """No other module decodes a file, except those that read what the package wrote."""
    root = Path(__file__).parents[2]
    calls = []
    for path in sorted((root / "emgface").rglob("*.py")):
        name = path.relative_to(root).as_posix()
        if name in OWN or name.startswith(("emgface/run/", "emgface/study/")):
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            called = ast.unparse(node.func)
            first = ast.unparse(node.args[0]) if node.args else ""
            decodes = called.endswith((".read_text", "tomllib.loads", "tomllib.load"))
            table = called in ("pd.read_csv", "pandas.read_csv")
            if decodes or (table and not first.startswith(OPENED)):
                calls.append(f"{name}: {ast.unparse(node)[:60]}")
    assert not calls


@pytest.mark.parametrize(
    ("text", "delimiter"),
    [
        ("a,b,a\n1,2,3\n", ","),
        ("# a comment\n\n a , b,a\n1,2,3\n", ","),
        ("a\tb\ta\n", "\t"),
        ('"a",b,"a"\r\n', ","),
    ],
)
def test_two_columns_of_one_label_are_refused(text: str, delimiter: str) -> None:
    with pytest.raises(ValueError, match="two columns are called 'a'"):
        labelled(io.StringIO(text, newline=""), delimiter)


@pytest.mark.parametrize("text", ["", "a,b\n1,1\n", "a,,\n1,,\n", "# a,a\na,b\n"])
def test_other_tables_are_read_from_their_begin(text: str) -> None:
    assert labelled(io.StringIO(text)).read() == text


STATES_BOTH = ("emgface/recordings/bids/sidecars.py", "emgface/recordings/readers/_tables.py")
"""Readers that state the places of both columns; their tests are those of the formats."""


def test_every_table_with_labels_is_read_without_renamed_columns() -> None:
    """pandas renames the second of two equal labels, which would then be an unknown or unused one."""
    root = Path(emgface.__file__).parents[1]
    calls = 0
    for path in (root / "emgface").rglob("*.py"):
        place = path.relative_to(root).as_posix()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) in (
                "pd.read_csv",
                "pd.read_table",
            ):
                calls += 1
                named = any(
                    key.arg == "header" and ast.unparse(key.value) == "None"
                    for key in node.keywords
                )
                checked = ast.unparse(node.args[0]).startswith("labelled(")
                assert named or checked or place in STATES_BOTH, f"{place}, line {node.lineno}"
    assert calls >= 10
