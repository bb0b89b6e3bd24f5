"""Comparison with reduced faces: one of each face, whose bounds are reported, or a refusal."""

import json

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.cli import app
from emgface.errors import FaceError
from emgface.face.file import load_face, save_face
from emgface.reduced import training
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.treatment.motions import compared_motions
from emgface.treatment.reduced_pair import reduced_pair
from tests.reduced.test_face import PARAMETERS, SMALL, activation, short


@pytest.fixture(scope="module")
def pair(coarse, operated, tmp_path_factory):
    """Folder with both faces and their reduced faces."""
    folder = tmp_path_factory.mktemp("pair")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(training, "training_plan", short)
        for name, face in (("a", coarse), ("b", operated)):
            path = save_face(face, folder / f"{name}.nc")
            made = training.reduce_face(
                load_face(path), PARAMETERS, SMALL, Store(folder / f"{name}.motions")
            )
            write_netcdf(made, folder / f"{name}.rom.nc", "reduced_face")
    return folder


def test_both_faces_are_reduced_with_their_bounds_and_full_order_where_it_is_not_trusted(pair):
    faces = [load_face(pair / f"{name}.nc") for name in "ab"]
    files = reduced_pair([pair / "b.rom.nc", pair / "a.rom.nc"], *faces, PARAMETERS)
    assert files == (pair / "a.rom.nc", pair / "b.rom.nc")
    drives = {"A": activation(faces[0], 0.5, 0.4), "D": activation(faces[0], 1.0, 0.0)}
    given = {"source": "", "store": Store(pair / "store")}
    small = compared_motions(*faces, drives, PARAMETERS, **given, reduced=files)
    full = compared_motions(*faces, drives, PARAMETERS, **given)  # from the same store
    for when in ("intact", "treated"):
        one, whole = getattr(small, when), getattr(full, when)
        assert one["A"].attrs["reduced"] == 1 and one["D"].attrs["reduced"] == 0
        assert "reduced" not in whole["A"].attrs
        away = one["A"]["position"] - whole["A"]["position"]
        largest = float(np.sqrt((away**2).sum("axis")).max())
        assert 0.0 < largest <= one["A"].attrs["reduction_error"]
        xr.testing.assert_equal(one["D"]["position"], whole["D"]["position"])
        assert set(one["A"].data_vars) >= {"mouth_area", "lip_protrusion", "surface_position"}
        bound = f"{1e3 * one['A'].attrs['reduction_error']:.2g} mm (A)"
        word = {"intact": "before", "treated": "after"}[when]
        messages = [note for note in small.notes if f"The face {word} is reduced in A:" in note]
        assert len(messages) == 1 and f"at most {bound}" in messages[0]
        reason = one["D"].attrs["reduction_doubt"]
        assert f"The movement D {word} was simulated at full order: {reason}." in small.notes
    assert not full.notes


def test_a_reduced_face_is_used_for_no_other_face_than_that_of_its_training(pair, tmp_path):
    faces = [load_face(pair / f"{name}.nc") for name in "ab"]
    a, b = pair / "a.rom.nc", pair / "b.rom.nc"
    for files, refused in (
        ([a], "belongs to the face after the treatment"),
        ([b], "belongs to the face before the treatment"),
    ):
        with pytest.raises(FaceError, match=refused):
            reduced_pair(files, *faces, PARAMETERS)
    with pytest.raises(FaceError, match=r"b.rom.nc is not used"):
        reduced_pair([a, b], faces[0], faces[0], PARAMETERS)
    with pytest.raises(FaceError, match="trained with sigma_max = 50000 Pa"):
        reduced_pair([a, b], *faces, PARAMETERS.model_copy(update={"sigma_max": 300e3}))
    # its bound was calibrated with other contact than that of the other face
    other = read_netcdf(b, "reduced_face")
    mechanics = json.loads(other.attrs["mechanics"])
    mechanics["contact"]["method"] = "constraint"
    touching = tmp_path / "touching.rom.nc"
    write_netcdf(other.assign_attrs(mechanics=json.dumps(mechanics)), touching, "reduced_face")
    for files in ([a, touching], [touching, a]):
        with pytest.raises(
            FaceError, match="trained with contact.method = 'constraint', found 'none'"
        ):
            reduced_pair(files, *faces, PARAMETERS)


@pytest.mark.parametrize(
    "words, message",
    [
        (("a.rom.nc", "b.nc"), "specify the face of its training"),
        (("a.nc", "b.rom.nc"), "specify the face of its training"),
        (("a.nc", "b.nc", "--reduced", "a.rom.nc"), "belongs to the face after the treatment"),
        (("a.nc", "b.nc", "--reduced", "a.rom.nc", "--both-cuts"), "no effect without full order"),
    ],
)
def test_the_command_refuses_reduced_faces_in_the_place_of_others(pair, words, message):
    words = [str(pair / word) if word.endswith(".nc") else word for word in words]
    more = ["--no-contact", "--sigma-max", "50e3", "--out", str(pair / "page.html")]
    result = CliRunner().invoke(app, ["compare", *words, *more])
    assert result.exit_code == 2
    shown = " ".join(f"{result.output} {result.exception}".replace("│", " ").split())
    assert message in shown and not (pair / "page.html").exists() and not (pair / "page").exists()
