"""Faces that were fitted to a person, and treated ones: every command that takes a face takes them."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.face.file import load_face, save_face
from emgface.face.template import template_face
from emgface.fit.inputs import points_of_face
from emgface.fit.person import fit_face
from emgface.fit.targets import sheets
from tests.treatment.plans import wedge
from tests.treatment.test_zero_plan import CONSUMERS

LONG = {"reduce", "invert"}
VERBS = [
    pytest.param(verb, marks=pytest.mark.slow if verb in LONG else ())
    for verb in sorted(CONSUMERS)
    if verb != "treat"
]


@pytest.fixture(scope="module")
def folder(coarse, tmp_path_factory):
    """Files of a face, of one fitted to a simulated person, and of that one with a closed wedge."""
    folder = tmp_path_factory.mktemp("fitted")
    person = template_face(resolution="coarse", preset="woman", seed=3)
    skin = person["position"].values, sheets(person)["skin"].triangles
    fitted = fit_face(
        coarse, points_of_face(person), skin=skin, simulated=True, name="a person"
    ).face
    for name, face in (
        ("face", coarse),
        ("fitted", fitted),
        ("treated", ef.treat(fitted, wedge())),
    ):
        save_face(face, folder / f"{name}.nc")
    return folder


def test_a_fitted_face_is_another_one_with_its_name(folder):
    faces = [load_face(folder / f"{name}.nc") for name in ("face", "fitted", "treated")]
    names = [str(face.attrs["name"]) for face in faces]
    assert names[1] == "a person" and names[2].startswith("a person, simulated treatment")
    moved = np.linalg.norm(faces[0]["position"].values - faces[1]["position"].values, axis=1)
    assert np.median(moved) > 1e-3


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
@pytest.mark.parametrize("name", ["fitted", "treated"])
@pytest.mark.parametrize("verb", VERBS)
def test_a_command_takes_it_and_computes_something_else(folder, verb, name):
    one, other = (CONSUMERS[verb](folder, which) for which in ("face", name))
    if isinstance(one, xr.Dataset):
        assert not one.equals(other)
    else:
        assert one != other and other


def test_a_treated_face_has_a_suture(folder):
    fitted, treated = (load_face(folder / f"{name}.nc") for name in ("fitted", "treated"))
    assert "suture_node" in treated and "suture_node" not in fitted
