"""Area function of a generated head: length, closures, and the action of tongue and jaw."""

import numpy as np
import pytest
import xarray as xr

from emgface.anatomy.airway.area_function import equal_sections
from emgface.anatomy.airway.head import TEETH_GAP, head_tract
from emgface.anatomy.airway.sound import with_formants
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import read_head, write_head
from emgface.anatomy.head.run import raised, read_motion, simulate_head, write_motion
from emgface.errors import DataError, HeadError


@pytest.fixture(scope="module")
def head():
    return build_head(preset="man", resolution="coarse", contacts=())


def moved(head, *, tongue=(0.0, 0.0), jaw=0.0):
    """Motion of two instants: rest, then tongue moved forward and up and jaw lowered [m]."""
    rest = [head.parts[name]["position"].values for name in ("face", "tongue")]
    shift = [np.zeros(3), np.array([0.0, *tongue])]
    after = np.concatenate([x + d for x, d in zip(rest, shift, strict=True)])
    place = np.stack([np.concatenate(rest), after])
    body = np.tile(head.parts["jaw"]["body_centre"].sel(body="jaw").values, (2, 1, 1))
    body[1, 0, 2] -= jaw
    return xr.Dataset(
        {
            "node_position": (("time", "node", "axis"), place),
            "body_position": (("time", "body", "axis"), body),
            "body_quaternion": (("time", "body", "part"), np.tile([1.0, 0, 0, 0], (2, 1, 1))),
        },
        {"time": [0.0, 0.1], "body": ["jaw"]},
    )


def test_the_tract_of_a_man_has_the_length_and_formants_of_adults(head):
    tract = with_formants(head_tract(head))
    assert 0.15 < float(tract["length"][0]) < 0.18
    F = tract["formant_frequency"].values[0]
    assert 200.0 < F[0] < 700.0 < F[1] < 2000.0 < F[2] < 3500.0
    assert tract["area"].values.max() < 10e-4
    assert "pharynx" in tract.attrs["assumptions"]


def test_tongue_and_jaw_change_the_formants_as_in_speech(head):
    """A lower jaw raises F1, a forward tongue widens the pharynx: F2 rises and F1 falls."""
    rest, lower = with_formants(head_tract(head, moved(head, jaw=8e-3)))["formant_frequency"].values
    assert lower[0] > rest[0]
    forward = with_formants(head_tract(head, moved(head, tongue=(5e-3, 0.0))))
    assert np.diff(forward["formant_frequency"].values[:, 0]) < 0.0
    assert np.diff(forward["formant_frequency"].values[:, 1]) > 0.0
    assert forward["area"].values[1, 12:20].mean() > forward["area"].values[0, 12:20].mean() + 5e-5


def test_a_tongue_on_the_palate_closes_the_tract(head):
    closed = head_tract(head, moved(head, tongue=(0.0, 9e-3)))
    assert closed["area"].values[0].min() >= 0.9 * TEETH_GAP
    assert closed["area"].values[1, 10:].min() < 1e-7
    assert np.isfinite(with_formants(closed)["formant_frequency"].values[1, 0])


def test_the_width_of_known_sections_is_kept():
    area, length = np.array([[1e-4, 2e-4, 4e-4]]), np.array([[0.05, 0.05, 0.05]])
    S, L = equal_sections(area, length, count=6)
    assert pytest.approx(np.repeat(area, 2, axis=1)) == S and pytest.approx([0.15]) == L
    coarse, _ = equal_sections(area, length, count=2)
    assert coarse[0, 0] == pytest.approx(0.075 / (0.05 / 1e-4 + 0.025 / 2e-4))


def test_heads_and_motions_without_what_is_needed_are_refused(head):
    face = build_head(["face"], preset="man", resolution="coarse")
    with pytest.raises(DataError, match="no jaw"):
        head_tract(face)
    with pytest.raises(DataError, match="positions of nodes"):
        head_tract(head, moved(head).drop_vars("node_position"))


def test_the_tract_at_an_instant_does_not_depend_on_the_others(head):
    """A motion that follows a recording does not begin at rest."""
    whole = moved(head, jaw=8e-3)
    last = head_tract(head, whole.isel(time=[1]))
    assert (last["area"].values[0] == head_tract(head, whole)["area"].values[1]).all()
    assert (head_tract(head, whole)["area"].values[0] == head_tract(head)["area"].values[0]).all()


@pytest.mark.parametrize("earlier", [False, True])
def test_a_motion_belongs_to_its_head(head, tmp_path, earlier):
    """Also after both have been written and read; another person has the same numbers of nodes."""
    motion = simulate_head(head, raised({}), duration=0.01)
    if earlier:
        del motion.attrs["head_digest"]
    write_motion(motion, head, tmp_path / "motion.nc")
    write_head(head, tmp_path / "head.nc")
    read, _ = read_motion(tmp_path / "motion.nc")
    again = head_tract(read_head(tmp_path / "head.nc"), read)
    assert (again["area"].values == head_tract(head, motion)["area"].values).all()
    other = build_head(preset="woman", resolution="coarse", contacts=())
    with pytest.raises(
        HeadError, match="is of the head 'template head .man.*with digest .*, found"
    ):
        head_tract(other, read)
    with pytest.raises(HeadError, match="the motion has 7 nodes"):
        head_tract(head, moved(head).isel(node=slice(0, 7)))
