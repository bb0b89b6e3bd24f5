"""Commands of treatments: what they state, which recordings they use, and what they leave behind."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.anatomy.jaw.template import template_jaw
from emgface.choices import configure
from emgface.cli import app
from emgface.errors import DataError
from emgface.face.file import load_face, save_face
from emgface.run.digest import dataset_digest
from emgface.schema.netcdf import write_netcdf
from emgface.treatment import dose, jaw_outcomes
from emgface.treatment.motions import recorded
from emgface.treatment.outcomes import OUTCOMES
from emgface.treatment.plan import NOT_VALIDATED, Incision, Plan, Tumour, Wedge

ZERO = '[[step]]\nkind = "wedge"\nwidth = 0.0\n\n[[step]]\nkind = "palsy"\ndegree = 0.0\n'


def done(*words):
    return CliRunner().invoke(app, [*map(str, words)])


def test_a_plan_without_effect_is_reported_and_leaves_the_face_as_it_is(coarse, tmp_path):
    face = save_face(coarse, tmp_path / "face.nc")
    for name, text in (("zero", ZERO), ("empty", 'name = "nothing"\n')):
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
        result = done("treat", tmp_path / f"{name}.toml", face, "--out", tmp_path / f"{name}.nc")
        assert result.exit_code == 0, result.output
        assert f"The plan {name}.toml changes nothing" in " ".join(result.output.split())
        # every consumer has the same face, bit for bit
        written = load_face(tmp_path / f"{name}.nc")
        assert dataset_digest(written) == dataset_digest(load_face(face))


def test_lengths_that_may_be_in_cm_are_reported(coarse, tmp_path):
    face = save_face(coarse, tmp_path / "face.nc")
    text = '[[step]]\nkind = "change"\ncentre = [0.0, 105.0, 0.0]\nradius = 0.9\nstiffness = 2.0\n'
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    result = done("treat", tmp_path / "plan.toml", face, "--out", tmp_path / "stiff.nc")
    sentence = "Warning: step 1: radius = 0.9 is in mm; if it is in cm, write radius = 9."
    assert result.exit_code or sentence in " ".join(result.output.split())
    for step in (Wedge(width=1.2), Wedge(height=1.2), Incision(height=2.9), Tumour(
            centre=(0.0, 50.0, 0.0), margin=0.5), Wedge(scar={"radius": 0.3})):  # fmt: skip
        assert len(step.doubts()) == 1, step
    assert not Wedge(width=3.0).doubts() and not Wedge(width=0.0, scar=None).doubts()


def test_the_stress_of_tissue_is_refused_for_a_jaw(tmp_path):
    """The function refused it, and the command left it out without a word."""
    jaw = write_netcdf(template_jaw(), tmp_path / "jaw.nc", "jaw_model")
    (tmp_path / "plan.toml").write_text('[[step]]\nkind = "resection"\n', encoding="utf-8")
    words = ("treat", tmp_path / "plan.toml", jaw, "--out", tmp_path / "resected.nc")
    result = done(*words, "--sigma-max", "1e5")
    assert "sigma_max was specified for a jaw" in str(result.exception) + result.output
    assert not (tmp_path / "resected.nc").exists()
    assert done(*words).exit_code == 0


def test_a_step_is_reported_with_the_muscles_that_it_weakens(coarse, tmp_path):
    face = save_face(coarse, tmp_path / "face.nc")
    text = '[[step]]\nkind = "palsy"\nbranch = "mandibular"\nside = "right"\ndegree = 0.5\n'
    (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
    result = done("treat", tmp_path / "plan.toml", face, "--out", tmp_path / "weak.nc")
    assert "muscles DAO_R DLI_R MEN_R" in " ".join(result.output.split())
    strength = load_face(tmp_path / "weak.nc")["muscle_strength"]
    weak = np.isin(strength["muscle"].values, ["DAO_R", "DLI_R", "MEN_R"])
    np.testing.assert_array_equal(strength.values, np.where(weak, 0.5, 1.0))


def test_every_table_of_a_treatment_states_that_it_is_not_for_decisions(monkeypatch, tmp_path):
    """Of a population, and of jaws, whose results are invented here."""
    values = dict.fromkeys((o.name for o in OUTCOMES), 1.0)
    monkeypatch.setattr(dose, "computed", lambda case, setting: dose._row(values, "reached"))
    result = done("dose", "--out", tmp_path / "doses.csv", "--persons", 1, "--draws", 0,
                  "--shapes", "V", "--shares", "0.2", "--workers", 1)  # fmt: skip
    assert result.exit_code == 0, result.output
    table = pd.DataFrame(
        {"outcome": ["gape"], "unit": "mm", "before": 1.0, "after": 1.0, "change": 0.0}
    )
    monkeypatch.setattr(jaw_outcomes, "jaw_outcome_table", lambda *jaws, **given: table)
    from emgface.anatomy.jaw.template import template_jaw
    from emgface.schema.netcdf import write_netcdf

    jaw = write_netcdf(template_jaw(), tmp_path / "jaw.nc", "jaw_model") or tmp_path / "jaw.nc"
    result = done("compare", jaw, jaw, "--table", tmp_path / "jaw.csv")
    assert result.exit_code == 0, result.output
    for name in ("doses.csv", "jaw.csv"):
        head = (tmp_path / name).read_text(encoding="utf-8").splitlines()[0]
        assert head == f"# simulated; {NOT_VALIDATED}"


def test_a_refused_comparison_leaves_no_folder_behind(coarse, operated, tmp_path):
    first, second = (
        save_face(one, tmp_path / f"{name}.nc") for one, name in ((coarse, "a"), (operated, "b"))
    )
    result = done("compare", second, first, "--out", tmp_path / "page.html")
    assert result.exit_code == 2
    assert isinstance(result.exception, (DataError, SystemExit))
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.nc", "b.nc"]


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """Folder of invented recordings, whose name is VOLUNTEER_INSTRUCTION; x cannot be read."""

    def read(path, mapping=None):
        if path.stem.startswith("x"):
            raise DataError("it is damaged")
        volunteer, instruction = path.stem.split("_")[:2]
        return xr.Dataset(attrs={"volunteer": volunteer, "instruction": instruction})

    monkeypatch.setattr(ef, "read", read)
    monkeypatch.setattr(ef, "activate", lambda recording: {"activation": recording.attrs})
    return tmp_path


def test_recordings_that_are_not_used_are_named(folder):
    for name in ("V1_A.nc", "V1_A_2.nc", "V1_D.nc", "V1_Z.nc", "x_E.nc"):
        (folder / name).touch()
    recordings, notes = recorded(folder)
    assert list(recordings) == ["A", "D"]
    text = "\n".join(notes)
    assert "V1_A_2.nc is another recording of A and was not used." in text
    assert "V1_Z.nc: its instruction is Z" in text and "x_E.nc: it is damaged" in text
    assert "No recording of B, C, E, F was found: their outcomes are absent." in notes
    assert len(notes) == 4


def test_what_is_no_folder_of_recordings_is_named(folder):
    (folder / "V1_A.nc").touch()
    for path, message in (("V1_A.nc", "is a file"), ("other", "does not exist")):
        with pytest.raises(DataError, match=f"{message}, expected a folder"):
            recorded(folder / path)


@pytest.mark.parametrize("option", ["--shapes", "--rejoin", "--movements"])
def test_unknown_words_of_a_dose_are_refused_before_anything_is_computed(option, tmp_path):
    result = done("dose", "--out", tmp_path / "doses.csv", option, "V,unheard")
    assert result.exit_code == 2
    assert "expected some of" in " ".join(result.output.replace("│", " ").split())
    assert not list(tmp_path.iterdir())


def test_recordings_of_several_persons_are_refused(folder):
    for name in ("V1_A.nc", "V2_D.nc"):
        (folder / name).touch()
    with pytest.raises(DataError, match=r"several volunteers, V1 \(V1_A.nc\) and V2 \(V2_D.nc\)"):
        recorded(folder)


def test_the_strength_of_a_muscle_is_multiplied_once_per_step_and_only_where_named(coarse):
    """Also on the other side, where a mirrored plan weakens the mirrored muscle."""
    names = [str(m) for m in coarse["muscle"].values]
    for side, other in (("L", "R"), ("R", "L")):
        step = {"kind": "change", "muscles": [f"ZYG_{side}"], "strength": 0.5}
        palsy = {"kind": "palsy", "muscles": ["ZYG", "OOP"], "degree": 0.5,
                 "side": "left" if side == "L" else "right"}  # fmt: skip
        treated = ef.treat(coarse, configure(Plan, {"step": [step, palsy]}))
        factor = dict(zip(names, treated["muscle_strength"].values, strict=True))
        assert factor.pop(f"ZYG_{side}") == 0.25 and factor.pop(f"OOP_{side}") == 0.5
        assert set(factor.values()) == {1.0} and f"ZYG_{other}" in factor
        np.testing.assert_array_equal(treated["bundle_weight"], coarse["bundle_weight"])
        assert "tissue_factor" not in treated
