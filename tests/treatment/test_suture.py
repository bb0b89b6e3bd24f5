"""Pictures of a treated face: its suture, and places that are picked on it."""

import numpy as np
import xarray as xr

import emgface as ef
from emgface.face.file import save_face
from emgface.face.motion import simulate_face
from emgface.face.parts import arches_of
from emgface.pictures.body import body_of, make_body, skin_of
from emgface.pictures.page import face_page, motion_page
from emgface.pictures.picking import LIPS, pick_data
from emgface.pictures.surface import SurfaceProbe, with_surface
from emgface.pictures.suture import STITCH, SUTURE_SENTENCE
from emgface.report.results import Results
from emgface.report.write import _of_treatment
from emgface.study.configuration import FaceConfiguration
from emgface.treatment.outline import outline_of
from emgface.treatment.plan import NOT_VALIDATED, read_plan
from emgface.view.page import live_page
from tests.treatment.plans import QUICK, wedge
from tests.view.sessions import Shifted


def test_a_picture_of_a_treated_face_shows_its_suture(coarse, operated):
    """On the skin along the nodes of the suture, and nowhere else."""
    skin = skin_of(operated)
    rest = operated["position"].values[skin.node]
    body, plain = body_of(operated), make_body(rest, skin, arches_of(operated))
    changed = np.flatnonzero((body.colour != plain.colour).any(axis=1))
    assert len(changed) > 30 and changed.max() < body.tissue
    suture = operated["position"].values[operated["suture_node"].values]
    points = body.points(rest)
    away = np.linalg.norm(points[changed, None] - suture[None], axis=2).min(axis=1)
    assert away.max() < 5e-3
    low, high = (np.array(colour) for colour in STITCH)
    share = (body.colour[changed] - low) @ (high - low) / ((high - low) ** 2).sum()
    assert 0.0 <= share.min() < 0.5 < share.max() <= 1.0
    assert SUTURE_SENTENCE in face_page(operated) and SUTURE_SENTENCE not in face_page(coarse)
    own = skin_of(coarse)
    intact = make_body(coarse["position"].values[own.node], own, arches_of(coarse))
    np.testing.assert_array_equal(body_of(coarse).colour, intact.colour)


def test_every_suture_keeps_its_forces(coarse, operated):
    """Of two wedges, only the nodes and forces of the last suture were kept."""
    twice = ef.treat(operated, wedge(lip="upper", width=8.0, place=0.6))
    cut = twice["suture_cut"].values
    assert set(cut) == {0, 1} and set(operated["suture_cut"].values) == {0}
    first = cut == 0
    np.testing.assert_array_equal(
        np.sort(twice["suture_traction"].values[first], axis=0),
        np.sort(operated["suture_traction"].values, axis=0),
    )
    position, node = twice["position"].values, twice["suture_node"].values
    earlier = operated["position"].values[operated["suture_node"].values]
    away = np.linalg.norm(position[node[first], None] - earlier[None], axis=2).min(axis=1)
    assert away.max() < 4e-3  # the second closure moves the first suture a little
    assert position[node[first], 2].max() < position[node[~first], 2].mean()
    # without the number of the cut, as in files of an earlier version
    again = ef.treat(operated.drop_vars("suture_cut"), wedge(lip="upper", width=8.0, place=0.6))
    np.testing.assert_array_equal(again["suture_cut"].values, cut)


def test_places_picked_on_a_treated_face_are_accepted_by_another_treatment(operated, tmp_path):
    """Its nodes, elements and lips are numbered anew."""
    skin = skin_of(operated)
    table = pick_data(operated, skin)
    np.testing.assert_allclose(
        np.array(table["position"]) / 1e3, operated["position"].values[table["node"]], atol=1e-7
    )
    connectivity = operated["connectivity"].values
    for node, element in zip(table["node"], table["element"], strict=True):
        assert node in connectivity[element]
    assert set(table["muscle"]) - {""} <= set(map(str, operated["muscle"].values))
    for lip in LIPS:
        node, place = next(
            (n, p) for n, own, p in zip(table["node"], table["lip"], table["place"], strict=True)
            if own == lip and 0.3 < p < 0.7
        )  # fmt: skip
        path = tmp_path / f"{lip}.toml"
        path.write_text(
            f'name = "again"\n\n[[step]]\nkind = "wedge"\nlip = "{lip}"\nplace = {place}\n'
            "width = 8.0\nheight = 8.0\n"
        )
        chart = outline_of(operated, read_plan(path).step[0]).chart
        away = np.linalg.norm(chart.origin - operated["position"].values[node])
        assert away < 0.02


def test_every_page_of_a_treated_face_states_what_it_is_not_for(coarse, operated):
    """Of the face, also one with a palsy alone, of its motion, and of the live face; no other page."""
    weak = ef.treat(coarse, {"step": [{"kind": "palsy", "degree": 0.5}]})
    said = f"{NOT_VALIDATED.capitalize()}."
    for face, treated in ((coarse, False), (operated, True), (weak, True)):
        skin = skin_of(face)
        moving = Shifted(face, skin)
        levels = xr.DataArray(
            np.zeros((face.sizes["muscle"], 2)),
            {"muscle": face["muscle"].values, "time": [0.0, 0.02]}, ("muscle", "time"),
        )  # fmt: skip
        motion = simulate_face(face, levels, QUICK, further=(SurfaceProbe(skin.node),))
        pages = [
            face_page(face),
            motion_page(with_surface(motion, face, skin)),
            live_page(face, skin, moving, words="sliders", sliders=True, edits=False),
        ]
        assert [said in page for page in pages] == [treated] * len(pages)


def test_the_report_of_a_study_names_its_treated_faces(coarse, operated, tmp_path):
    """Also those of an axis; a file that is no longer there is passed over."""
    faces = []
    for name, face in (("a", coarse), ("b", operated), ("c", None)):
        if face is not None:
            save_face(face, tmp_path / f"{name}.nc")
        faces.append(FaceConfiguration(path=tmp_path / f"{name}.nc"))
    sentence = _of_treatment(Results(tmp_path, xr.Dataset(), faces=faces))
    assert sentence == f"{operated.attrs['name']}: {NOT_VALIDATED}."
    assert not _of_treatment(Results(tmp_path, xr.Dataset(), faces=faces[:1]))
