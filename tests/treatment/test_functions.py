"""Treatment and comparison in Python: the results of the commands, and the doubts of a plan."""

import warnings

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import emgface as ef
from emgface.anatomy.jaw.template import template_jaw
from emgface.cli import app
from emgface.errors import ConfigurationError, DataError, TreatmentWarning
from emgface.face.file import save_face
from emgface.face.quality import element_centres
from emgface.schema.netcdf import write_netcdf
from emgface.treatment import comparison
from emgface.treatment.motions import gestures
from emgface.treatment.plan import NOT_VALIDATED

WEAK = {"step": [{"kind": "palsy", "branch": "mandibular", "side": "right", "degree": 0.5}]}


def test_a_comparison_in_python_is_that_of_the_command(coarse, monkeypatch, tmp_path):
    monkeypatch.setattr(comparison, "gestures", lambda face, names=(): gestures(face, ("D",)))
    weak = ef.treat(coarse, WEAK)
    given = {"page": tmp_path / "a.html", "progress": False, "contact": {"method": "none"}}
    compared = ef.compare(coarse, weak, plain=tmp_path / "b.html", **given)
    files = [save_face(one, tmp_path / f"{k}.nc") for k, one in enumerate((coarse, weak))]
    command = ["compare", *files, "--out", tmp_path / "c.html", "--table", tmp_path / "t.csv"]
    result = CliRunner().invoke(app, [*map(str, command), "--no-contact", "--workers", "1"])
    assert result.exit_code == 0, result.output
    table = pd.read_csv(tmp_path / "t.csv", comment="#")
    assert table["outcome"].tolist() == compared.outcomes["outcome"].tolist()
    np.testing.assert_allclose(table["change"], compared.outcomes["change"], rtol=1e-5, atol=1e-9)
    assert np.abs(table["change"]).max() > 0.01
    assert list(compared.motions.intact) == ["D"] == list(compared.movement["movement"])
    assert (tmp_path / "a.html").read_text() == (tmp_path / "c.html").read_text()
    assert "mouth width" in repr(compared) and f"simulated; {NOT_VALIDATED}" in repr(compared)
    assert len(repr(compared)) < 5000
    for page in ("a.html", "b.html"):
        assert NOT_VALIDATED.lower() in (tmp_path / page).read_text(encoding="utf-8").lower()
    again = ef.compare(
        coarse, weak, page=tmp_path / "a.html", progress=False, contact={"method": "none"}
    )
    pd.testing.assert_frame_equal(again.outcomes, compared.outcomes)
    with pytest.raises(DataError, match="treat"):
        ef.compare(weak, coarse, store=tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_doubts_of_a_plan_are_warnings(coarse):
    centre = element_centres(coarse["position"].values, coarse["connectivity"].values[:1])[0]
    step = {"kind": "change", "centre": (1e3 * centre).tolist(), "radius": 0.9, "stiffness": 2.0}
    with pytest.warns(TreatmentWarning, match="step 1: radius = 0.9 is in mm; if it is in cm"):
        ef.treat(coarse, {"step": [step]})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ef.treat(coarse, WEAK)


def test_a_jaw_is_treated_in_python(tmp_path):
    jaw = template_jaw()
    plan = {"step": [{"kind": "resection", "side": "left"}]}
    treated = ef.treat(jaw, plan)
    path = write_netcdf(jaw, tmp_path / "jaw.nc", "jaw_model") or tmp_path / "jaw.nc"
    np.testing.assert_array_equal(
        ef.treat(path, plan)["muscle_force_max"], treated["muscle_force_max"]
    )
    assert "treatment" in " ".join(treated.attrs)
    with pytest.raises(ConfigurationError, match="sigma_max was specified for a jaw"):
        ef.treat(jaw, plan, sigma_max=1e5)
