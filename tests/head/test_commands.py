"""Refusals of the command that moves a head."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import write_head
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    head = build_head(["jaw", "hyoid"], preset="man", resolution="coarse")
    return write_head(head, tmp_path_factory.mktemp("head") / "head.nc")


@pytest.mark.parametrize("muscle", ["bi_open=3", "bi_open=-0.1", "bi_open=nan", "bi_open=much"])
def test_levels_of_muscles_are_between_zero_and_one(head: Path, muscle: str) -> None:
    out = head.with_name("motion.nc")
    found = CliRunner().invoke(
        app, ["head", "simulate", str(head), "--muscle", muscle, "--out", str(out)]
    )
    assert found.exit_code == 2 and "a level from 0 to 1" in found.output and not out.exists()


def test_muscles_beside_a_series_are_refused(head: Path) -> None:
    series, out = head.with_name("series.csv"), head.with_name("motion.nc")
    series.write_text("time,bi_open\n0,0\n0.1,0.3\n")
    options = ["--muscle", "bi_open=0.3", "--excitation", str(series), "--out", str(out)]
    found = CliRunner().invoke(app, ["head", "simulate", str(head), *options])
    assert found.exit_code == 2 and "both specified" in found.output and not out.exists()


@pytest.mark.parametrize("part", ["head", "jaw", "tongue"])
def test_series_in_milliseconds_are_refused(head: Path, part: str) -> None:
    """A head, jaw and tongue read the same files."""
    series, model = head.with_name("ms.csv"), head.with_name(f"{part}.nc")
    series.write_text("time,bi_open\n0,0\n100,0.3\n300,0\n")
    if part != "head":
        whole = build_head([part], preset="man", resolution="coarse")
        write_netcdf(whole.parts[part], model, f"{part}_model")
    given = [part, "run" if part == "jaw" else "simulate", str(model)]
    out = head.with_name("motion.nc")
    found = CliRunner().invoke(app, [*given, "--excitation", str(series), "--out", str(out)])
    said = " ".join(found.output.split())
    assert found.exit_code == 2 and "divide times in milliseconds by 1000" in said
    assert not out.exists()


def test_run_is_another_name_of_simulate(head: Path) -> None:
    """As `emgface jaw run`; help lists one name."""
    out = head.with_name("run.nc")
    given = ["head", "run", str(head), "--muscle", "bi_open=0.1", "--duration", "0.02"]
    found = CliRunner().invoke(app, [*given, "--out", str(out)])
    assert found.exit_code == 0 and out.is_file()
    listed = CliRunner().invoke(app, ["head", "--help"]).output
    assert "simulate" in listed and " run " not in listed


@pytest.mark.parametrize("duration", ["nan", "inf", "0", "-1"])
def test_durations_are_whole_numbers_of_outputs(head: Path, duration: str) -> None:
    out = head.with_name("motion.nc")
    given = ["head", "simulate", str(head), "--duration", duration, "--out", str(out)]
    found = CliRunner().invoke(app, given)
    assert found.exit_code == 2
    assert "expected a number from" in " ".join(found.output.replace("│", " ").split())
