"""Refusals of the command that moves a head."""

from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import write_head
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf


@pytest.fixture(scope="module")
def head(tmp_path_factory: pytest.TempPathFactory) -> Path:
    head = build_head(["jaw", "hyoid"], preset="man", resolution="coarse")
    return write_head(head, tmp_path_factory.mktemp("head") / "head.nc")


def moved(model: Path, source: str, out: Path, *options: str) -> Result:
    given = ["simulate", source, "--model", str(model), "--out", str(out), *options]
    return CliRunner().invoke(app, given)


@pytest.mark.parametrize("level", ["bi_open=3", "bi_open=-0.1", "bi_open=nan", "bi_open=much"])
def test_levels_of_muscles_are_between_zero_and_one(head: Path, level: str) -> None:
    out = head.with_name("motion.nc")
    motion = moved(head, level, out)
    assert motion.exit_code == 2 and "levels from 0 to 1" in motion.output and not out.exists()


def test_muscles_with_a_series_are_refused(head: Path) -> None:
    series, out = head.with_name("series.csv"), head.with_name("motion.nc")
    series.write_text("time,bi_open\n0,0\n0.1,0.3\n")
    motion = moved(head, f"{series},bi_open=0.3", out)
    assert motion.exit_code == 2 and "names with levels" in motion.output and not out.exists()


@pytest.mark.parametrize("part", ["head", "jaw", "tongue"])
def test_series_in_milliseconds_are_refused(head: Path, part: str) -> None:
    """A head, jaw and tongue read the same files."""
    series, model = head.with_name("ms.csv"), head.with_name(f"{part}.nc")
    series.write_text("time,bi_open\n0,0\n100,0.3\n300,0\n")
    if part != "head":
        whole = build_head([part], preset="man", resolution="coarse")
        write_netcdf(whole.parts[part], model, f"{part}_model")
    out = head.with_name("motion.nc")
    motion = moved(model, str(series), out)
    said = " ".join(motion.output.split())
    assert motion.exit_code == 2 and "divide times in milliseconds by 1000" in said
    assert not out.exists()


@pytest.mark.parametrize("verb", ["run", "simulate"])
def test_former_commands_move_a_head_with_a_warning(head: Path, verb: str) -> None:
    out = head.with_name("run.nc")
    given = ["head", verb, str(head), "--muscle", "bi_open=0.1", "--duration", "0.02"]
    result = CliRunner().invoke(app, [*given, "--out", str(out)])
    assert result.exit_code == 0 and out.is_file()
    assert "is called 'emgface simulate' since version 0.3" in result.output


@pytest.mark.parametrize("duration", ["nan", "inf", "0", "-1"])
def test_durations_are_whole_numbers_of_outputs(head: Path, duration: str) -> None:
    out = head.with_name("motion.nc")
    motion = moved(head, "rest", out, "--duration", duration)
    assert motion.exit_code == 2
    assert "expected a number from" in " ".join(motion.output.replace("│", " ").split())
