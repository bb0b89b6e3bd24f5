"""From landmarks and a scan to a person's own face, treated, compared and seen live, by commands."""

import json

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from benchmarks.fit_inputs import person_of
from emgface.cli import app
from emgface.face.file import load_face, save_face
from emgface.schema.netcdf import read_netcdf, write_netcdf
from tests.api.test_odd_arguments import recording

PLAN = """
[[step]]
kind = "wedge"
lip = "lower"
width = 12
height = 15
"""
SMALL = (
    "--modes 30 --elements 100 --sequences 1 --calibration 19 --no-ramps --activations random "
    "--no-contact"
)


def done(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, (words, result.output)
    return result.output


@pytest.mark.slow
def test_the_face_of_a_person_is_treated_and_moves_live(generic, tmp_path, monkeypatch):
    """Every file that a command writes is accepted by the next one, with its origin."""
    monkeypatch.chdir(tmp_path)
    person_of(3, "coarse").write(tmp_path)
    save_face(generic, tmp_path / "generic.nc")
    (tmp_path / "plan.toml").write_text(PLAN)
    scan = ("--landmarks", "landmarks.csv", "--skin", "skin.ply", "--unit", "mm")
    done("fit", "--face", "generic.nc", *scan, "--out", "person.nc")
    done("treat", "plan.toml", "person.nc", "--out", "operated.nc")
    done("check", "operated.nc")
    operated = load_face(tmp_path / "operated.nc")
    assert "fit_frame" in operated.attrs
    assert json.loads(operated.attrs["treatment"])[0]["plan"]["step"][0]["width"] == 12.0
    done("reduce", "operated.nc", "--out", "operated.rom.nc", "--sigma-max", 50e3, *SMALL.split())
    assert read_netcdf(tmp_path / "operated.rom.nc", "reduced_face").attrs["origin"] == "simulated"
    write_netcdf(recording(), tmp_path / "semg.nc", "recording")
    live = ("live", "operated.nc", "--reduced", "operated.rom.nc", "--source", "semg.nc")
    done(*live, "--no-page", "--seconds", 1, "--log", "log.nc")
    assert np.isfinite(xr.open_dataset(tmp_path / "log.nc")["position"].values).all()
