"""Inventory of folders with valid and invalid files."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.cli import app
from emgface.errors import DataError
from emgface.recordings import dataset, inventory
from emgface.recordings.check import check_recording, problems
from emgface.recordings.dataset import read_recording, read_recordings, write_recording
from emgface.recordings.inventory import inventory_table


def table_of(folder: Path, name: str, rate: float, seconds: float = 10.0) -> Path:
    rng = np.random.default_rng(0)
    rows = rng.normal(scale=0.01, size=(max(int(rate * seconds), 2), 2))
    text = "\n".join(",".join(f"{value:.6f}" for value in row) for row in rows)
    (folder / f"{name}.csv").write_text(f"E1,E2\n{text}\n")
    path = folder / f"{name}.toml"
    path.write_text(
        f'schema = "recording"\n[emg]\nfile = "{name}.csv"\nrate = {rate}\nunit = "mV"\n'
    )
    return path


@pytest.mark.parametrize("rate", [0.2, 0.5, 1.0, 2.0, 10.0, 30.0, 33.0, 34.0, 66.0, 67.0, 100.0])
@pytest.mark.parametrize("seconds", [0.5, 10.0])
def test_slow_recordings_are_examined(tmp_path: Path, rate: float, seconds: float) -> None:
    """A channel with less than an octave of the pass-band cannot be used."""
    table = check_recording(read_recording(table_of(tmp_path, "a", rate, seconds)))
    if rate * seconds < 2 or rate >= 67.0:
        return
    assert set(table["verdict"]) == {"error"}
    assert all("at least an octave of the pass-band" in text for text in problems(table))


@pytest.mark.parametrize(("rate", "verdict"), [(1000.0, "warning"), (2048.0, "ok")])
def test_the_check_reports_a_narrowed_band(tmp_path: Path, rate: float, verdict: str) -> None:
    table = check_recording(read_recording(table_of(tmp_path, "a", rate, 2.0)))
    narrowed = table["reason"].str.contains("pass-band ends at 450 Hz, not 500 Hz")
    assert narrowed.tolist() == [verdict == "warning"] * 2


def test_an_inventory_continues_after_a_slow_file(tmp_path: Path, trial: xr.Dataset) -> None:
    write_recording(trial, tmp_path / "a.nc")
    table_of(tmp_path, "b", 20.0)
    write_recording(trial, tmp_path / "c.nc")
    table = inventory_table(tmp_path).set_index("file")
    assert table.loc[["a.nc", "b.toml", "c.nc"], "refusal"].isna().all()
    assert "octave of the pass-band" in table.loc["b.toml", "findings"]


@pytest.mark.parametrize("failure", [RuntimeError("two\nlines"), RecursionError(), MemoryError()])
def test_any_error_of_a_reader_becomes_a_sentence(
    tmp_path: Path, trial: xr.Dataset, monkeypatch: pytest.MonkeyPatch, failure: Exception
) -> None:
    write_recording(trial, tmp_path / "a.nc")
    (tmp_path / "b.trc").write_text("x")
    write_recording(trial, tmp_path / "c.nc")

    def fail(*_: object) -> None:
        raise failure

    monkeypatch.setattr(dataset.readers()[".trc"], "read", fail)
    monkeypatch.setattr(dataset.readers()[".trc"], "is_recording", fail, raising=False)
    results = dict(read_recordings(tmp_path))
    assert [isinstance(one, Exception) for one in results.values()] == [False, True, False]
    text = str(results[tmp_path / "b.trc"])
    assert isinstance(results[tmp_path / "b.trc"], DataError)
    assert "b.trc" in text and type(failure).__name__ in text and "\n" not in text
    assert inventory_table(tmp_path)["refusal"].notna().tolist() == [False, True, False]


def test_any_error_of_a_check_becomes_a_sentence(
    tmp_path: Path, trial: xr.Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_recording(trial, tmp_path / "a.nc")

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("of something")

    monkeypatch.setattr(inventory, "check_recording", fail)
    (refusal,) = inventory_table(tmp_path)["refusal"]
    assert refusal == "a.nc could not be examined (ZeroDivisionError: of something)."


@pytest.mark.parametrize("text", ["no toml", "emg = 5", "[emg]\nfile = 3", "\ufffe"])
def test_an_inventory_continues_after_an_invalid_sidecar(
    tmp_path: Path, trial: xr.Dataset, text: str
) -> None:
    data, sidecars = tmp_path / "data", tmp_path / "sidecars"
    data.mkdir()
    sidecars.mkdir()
    write_recording(trial, data / "a.nc")
    (sidecars / "bad.toml").write_text(text, encoding="utf-16")
    (sidecars / "other.toml").write_text(text if text != "\ufffe" else "[x]", encoding="utf-8")
    table = inventory_table(data, sidecars=sidecars).set_index("file")
    assert isinstance(table.loc["bad.toml", "refusal"], str)
    assert table.loc[["a.nc"], "refusal"].isna().all()


def test_a_check_continues_after_an_invalid_file(tmp_path: Path, trial: xr.Dataset) -> None:
    first = write_recording(trial, tmp_path / "a.nc")
    bad = tmp_path / "b.c3d"
    bad.write_bytes(b"no C3D")
    last = write_recording(trial, tmp_path / "c.nc")
    result = CliRunner().invoke(app, ["check", str(first), str(bad), str(last)])
    assert result.exit_code == 2
    assert "\na.nc," in result.output and "\nc.nc," in result.output and "b.c3d" in result.output


def test_the_band_is_an_option_of_the_command(tmp_path: Path) -> None:
    path = table_of(tmp_path, "a", 1000.0, 2.0)
    narrowed = CliRunner().invoke(app, ["features", str(path)])
    assert "15-450 Hz" in narrowed.output and "instead of 500 Hz" in narrowed.output
    named = CliRunner().invoke(app, ["features", str(path), "--band", "20", "400"])
    assert "20-400 Hz" in named.output and "instead of" not in named.output
    wrong = CliRunner().invoke(app, ["features", str(path), "--band", "400", "20"])
    assert wrong.exit_code == 2 and "is not below" in wrong.output
