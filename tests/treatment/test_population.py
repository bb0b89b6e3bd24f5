"""A population of treated persons: volunteers of a treated face, and treated faces of volunteers."""

import numpy as np
import pytest
import xarray as xr

import emgface as ef
from emgface.choices import configure
from emgface.face.motion import settle_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.recordings.dataset import read_recording
from emgface.volunteers.person import person_face
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import world_of
from tests.treatment.plans import FREE

SCALE = 1.07
QUICKEST = {"solver": "linearly_implicit", "step": 0.02, "output": 0.02, "sigma_max": 50e3, **FREE}


def plan(scale=1.0):
    """Return a wedge with its suture, all lengths times a factor."""
    return {
        "kind": "wedge", "place": 0.42, "width": 12.0 * scale, "height": 11.0 * scale,
        "retraction": 6.0 * scale, "scar": {"radius": 3.0 * scale},
    }  # fmt: skip


def test_a_scaled_treated_face_is_the_treated_scaled_face(coarse):
    """Every length grows with the face, and forces with its areas, as those of a closure do."""
    one = person_face(ef.treat(coarse, {"step": [plan()]}), SCALE)
    two = ef.treat(person_face(coarse, SCALE), {"step": [plan(SCALE)]})
    for name in one.data_vars:
        if one[name].attrs["units"] == "m" and name in coarse:  # as the teeth
            assert np.isclose(
                np.ptp(one[name].values), SCALE * np.ptp(coarse[name].values), rtol=0.01
            ), name
        largest = float(np.abs(one[name]).max())
        np.testing.assert_allclose(one[name], two[name], atol=1e-9 * largest, err_msg=str(name))


@pytest.mark.parametrize("volume", ["pointwise", "element", "nodal"])
def test_the_tissue_of_a_treated_face_has_its_volume_before_the_closure(coarse, operated, volume):
    """With every volume law, the incision that removes nothing keeps the equilibrium."""
    given = {"incompressibility": volume, "bulk_potential": "quadratic", "sigma_max": 100e3, **FREE}
    p = configure(SimulationParameters, given)
    rest = {"incision": ef.treat(coarse, {"step": [{"kind": "incision", "scar": False}]})}
    rest |= {"wedge": operated, "intact": coarse}
    moved = {
        name: np.linalg.norm(
            settle_face(face, p)["node_position"].values - face["position"].values, axis=1
        ).max()
        for name, face in rest.items()
    }
    # of a shape that is not that before the closure, the tissue would expand by millimetres
    assert moved["incision"] == pytest.approx(moved["intact"], abs=0.05e-3)
    assert moved["wedge"] == pytest.approx(moved["intact"], abs=1e-3)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
def test_volunteers_of_a_treated_face_are_recorded_in_every_world(coarse, operated, tmp_path):
    parameters = configure(SimulationParameters, QUICKEST)
    for world in ("matched", "mismatched"):
        settings = configure(VolunteerParameters, {"world": world_of(world), "emg": "noise"})
        lips = []
        for name, face in (("intact", coarse), ("treated", operated)):
            (path,) = make_volunteers(
                face, tmp_path / world / name, n=1, instructions=("C",), parameters=parameters,
                settings=settings,
            )  # fmt: skip
            recording = read_recording(path)
            assert recording.attrs["origin"] == "simulated"
            lips.append(recording["position"])
        assert float(np.abs(lips[0] - lips[1]).max()) > 1e-4, world
        xr.testing.assert_equal(lips[0]["marker"], lips[1]["marker"])
