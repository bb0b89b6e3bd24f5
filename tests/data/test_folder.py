"""Nothing vanishes from a folder: capitals, links, marks, sidecars, other kinds of files."""

import codecs
import shutil
from pathlib import Path

import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.cli import app
from emgface.errors import EmgfaceError
from emgface.recordings.dataset import (
    find_recordings,
    read_recording,
    read_recordings,
    readers,
    write_recording,
)
from emgface.recordings.folder import left_out_files, left_out_sentence
from emgface.recordings.inventory import inventory_table
from emgface.study.configuration import RecordingsConfiguration
from emgface.study.intake import take_in
from tests.data.conftest import recording
from tests.data.test_mutations import FORMATS

TABLE = "E1,E2\n" + "\n".join(f"{k * k % 17}.5,{-(k % 7)}.5" for k in range(60)) + "\n"
SIDECAR = 'schema = "recording"\n[emg]\nfile = "{}"\nrate = 100.0\nunit = "mV"\n'


@pytest.mark.parametrize("name", ["netcdf", "c3d", "poly5", "edf", "trc", "xdf"])
def test_a_suffix_in_capitals_is_read(name: str, tmp_path: Path) -> None:
    folder = tmp_path / "made"
    folder.mkdir()
    path, _ = FORMATS[name](folder)
    upper = tmp_path / f"V1_A{path.suffix.upper()}"
    shutil.copy(path, upper)
    shutil.rmtree(folder)
    assert find_recordings(tmp_path) == [upper]
    assert isinstance(read_recording(upper), xr.Dataset)
    assert inventory_table(tmp_path)["file"].tolist() == [upper.name]


@pytest.mark.parametrize("suffix", sorted(set(readers()) - {".tsv"}))
def test_a_link_to_an_absent_file_is_listed_and_refused(suffix: str, tmp_path: Path) -> None:
    write_recording(recording(), tmp_path / "there.nc")
    link = tmp_path / f"gone{suffix}"
    link.symlink_to(tmp_path / "absent")
    assert link in find_recordings(tmp_path)
    refused = {p: r for p, r in read_recordings(tmp_path) if isinstance(r, EmgfaceError)}
    assert list(refused) == [link] and "is a link to" in str(refused[link])
    table = inventory_table(tmp_path).set_index("file")
    assert isinstance(table.loc[link.name, "refusal"], str) and len(table) == 2


def test_a_link_to_an_absent_file_is_unreadable_in_a_study(tmp_path: Path) -> None:
    write_recording(recording(), tmp_path / "there.nc")
    (tmp_path / "gone.nc").symlink_to(tmp_path / "absent")
    intake = take_in(RecordingsConfiguration(folder=tmp_path))
    assert len(intake.recordings) == 1
    assert [path.name for path in intake.unreadable] == ["gone.nc"]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize("suffix", [".toml", ".TOML"])
def test_a_sidecar_of_any_encoding_keeps_its_recording(
    encoding: str, suffix: str, tmp_path: Path
) -> None:
    (tmp_path / "b.csv").write_text(TABLE)
    sidecar = tmp_path / f"side{suffix}"
    sidecar.write_bytes(SIDECAR.format("b.csv").encode(encoding))
    ((path, recordings),) = read_recordings(tmp_path)
    assert path == sidecar and isinstance(recordings, xr.Dataset)
    assert not left_out_files(tmp_path)


def test_a_damaged_sidecar_is_listed(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text(TABLE)
    sidecar = tmp_path / "side.toml"
    sidecar.write_bytes(codecs.BOM_UTF8 + b'schema = "recording\n')
    ((path, recordings),) = read_recordings(tmp_path)
    assert path == sidecar and isinstance(recordings, EmgfaceError)


def test_files_that_are_left_out_are_named(tmp_path: Path) -> None:
    folder = tmp_path / "in"
    (folder / "sub").mkdir(parents=True)
    write_recording(recording(), folder / "a.nc")
    (folder / "notes.csv").write_text("name,age\nx,3\n")
    (folder / "sub" / "c.mat").write_bytes(b"MATLAB 5.0")
    (folder / ".d.nc").write_bytes(b"")
    (folder / "README.txt").write_text("what it is")
    (tmp_path / "more").mkdir()
    (folder / "linked").symlink_to(tmp_path / "more", target_is_directory=True)
    names = {
        path.relative_to(folder).as_posix(): why for path, why in left_out_files(folder).items()
    }
    assert names == {
        ".d.nc": "hidden",
        "linked": "a link to a folder, which is not followed",
        "notes.csv": "no sidecar describes it",
        "sub/c.mat": "no sidecar describes it",
    }
    for command in (["check", str(folder)], ["convert", str(folder), "--out", str(tmp_path / "o")]):
        said = " ".join(CliRunner().invoke(app, [*command]).output.split())
        assert "Not read in" in said and "notes.csv (no sidecar describes it)" in said
    assert left_out_sentence(tmp_path / "more") == ""


@pytest.mark.parametrize(
    ("name", "said"),
    [("a.sto", "OpenSim.*expected markers as .trc"), ("a.ACQ", "AcqKnowledge.*text export"),
     ("a.hpf", "EMGworks"), ("a.xlsx", "save the sheet as CSV"), ("a.c3", "did you mean '.c3d'")],
)  # fmt: skip
def test_files_of_other_programs_are_named_with_the_way_out(
    name: str, said: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(b"nSamples=3\n")
    with pytest.raises(EmgfaceError, match=said) as refused:
        read_recording(tmp_path / name)
    assert ".toml'?" not in str(refused.value)
