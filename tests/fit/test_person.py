"""Faces fitted to simulated persons: accuracy, what is carried, and inputs that are refused."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import emgface as ef
from emgface.errors import FitError
from emgface.face.file import load_face
from emgface.face.quality import element_quality
from emgface.face.template import template_face
from emgface.face.validity import check_face
from emgface.fit.measures import distances
from emgface.fit.person import fit_face
from emgface.fit.targets import Target, sheets


@pytest.fixture(scope="module")
def fitted(generic, person):
    skin, inner = person.surface(), person.surface("inner")
    return fit_face(
        generic, person.landmarks, skin=(skin.points, skin.triangles),
        inner=(inner.points, inner.triangles), rim=True, simulated=True,
    )  # fmt: skip


def _last(fitted, surface):
    table = fitted.distance.set_index(["stage", "surface"])["mean"]
    return table["relaxed", surface], table["similarity", surface]


def test_surfaces_are_reached_and_no_corner_inverts(fitted, person):
    """The triangles of the person's own coarse face, with edges of 8 mm, are 0.5 mm from the scan."""
    own, places = template_face(resolution="coarse", seed=5), person.face["position"].values
    for surface in ("skin", "inner"):
        scan = sheets(person.face)[surface].at(places)
        target = Target(surface, sheets(own)[surface], scan)
        end, start = _last(fitted, surface)
        assert end < 1.05 * distances(target, own["position"].values)["mean"] and end < start
    quality = element_quality(fitted.face["position"].values, fitted.face["connectivity"].values)
    assert (quality.smallest_det > 0).all()
    assert quality.scaled_jacobian.min() > 0.1
    check_face(fitted.face)


def test_a_notebook_shows_the_figure(fitted):
    assert fitted._repr_png_().startswith(b"\x89PNG")
    assert fitted.face.attrs["name"] in repr(fitted)


def test_sets_are_kept_and_points_follow(fitted):
    for name in ("connectivity", "fixed", "bundle_index", "bundle_muscle", "marker_node", "layer"):
        np.testing.assert_array_equal(fitted.face[name].values, fitted.source[name].values)
    norm = np.linalg.norm(fitted.face["bundle_direction"].values, axis=1)
    np.testing.assert_allclose(norm, 1.0)
    assert "muscle_radius" not in fitted.face.attrs
    assert (np.abs(fitted.fibres["change"]) < 0.3).all()
    assert fitted.face.attrs["origin"] == "fitted"
    assert fitted.face.attrs["fit_of"] == "simulated"


def test_the_frame_of_the_person_can_be_recovered(fitted, person):
    motion = np.array(json.loads(fitted.face.attrs["fit_frame"])).reshape(3, 4)
    marker = person.landmarks["pronasale"]
    there = motion[:, :3] @ marker + motion[:, 3]
    table = fitted.deformed.landmarks
    np.testing.assert_allclose(there, table.target[table.names.index("pronasale")], atol=1e-12)


def test_a_face_fitted_to_itself_does_not_move(generic):
    from emgface.fit.inputs import points_of_face
    from emgface.fit.targets import sheets

    X = generic["position"].values
    own = sheets(generic)
    fit = fit_face(
        generic, points_of_face(generic), skin=(X, own["skin"].triangles),
        inner=(X, own["inner"].triangles), simulated=True,
    )  # fmt: skip
    moved = np.linalg.norm(fit.face["position"].values - X, axis=1)
    # contours are polygons with corners, and may slide along themselves
    assert np.median(moved) < 1e-4 and np.quantile(moved, 0.95) < 3e-4


def test_landmarks_alone_give_a_face(generic, person):
    fit = fit_face(generic, person.landmarks, simulated=True)
    check_face(fit.face)
    assert fit.landmarks["error"].median() < 1.5
    assert not len(fit.distance)


def test_thickness_follows_the_prior_without_an_inner_surface(generic, person):
    skin = person.surface()
    fit = fit_face(generic, person.landmarks, skin=(skin.points, skin.triangles), simulated=True)
    assert fit.prior is not None
    ratio = fit.thickness["after"] / (1e3 * fit.prior.mean)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
    assert (fit.thickness["low"] < fit.thickness["high"]).all()


def _mirrored(marks):
    return {k: v * [-1.0, 1.0, 1.0] for k, v in marks.items()}


def _exchanged(marks):
    a, b = "pronasale", "pogonion"
    return marks | {a: marks[b], b: marks[a]}


def _far(marks):
    return marks | {"pogonion": marks["pogonion"] + [0.06, 0.0, 0.0]}


def _few(marks):
    return {k: marks[k] for k in ("pogonion", "nasion", "temple_left")}


def _flat(marks):
    return {k: v * [1.0, 1.0, 1e-3] for k, v in marks.items()}


REFUSED = {
    "mirrored": (_mirrored, "is mirrored"),
    "exchanged": (_exchanged, "pronasale and pogonion seem to be exchanged|exchanged"),
    "far": (_far, "pogonion lies"),
    "coincident": (lambda m: m | {"corner_left": m["corner_right"]}, "at one place"),
    "few": (_few, "3 of 3 landmarks have a counterpart"),
    "flat": (_flat, "in one plane"),
    "large": (lambda m: {k: 2.0 * v for k, v in m.items()}, "as far apart|check the unit"),
    "unnamed": (lambda m: {f"p{i}": v for i, v in enumerate(m.values())}, "0 of"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_landmarks_that_cannot_be_right_are_named(generic, person, name):
    change, why = REFUSED[name]
    with pytest.raises(FitError, match=why):
        fit_face(generic, change(person.landmarks))


def test_a_scan_in_another_frame_or_inside_out_is_noticed(generic, person):
    skin = person.surface()
    with pytest.raises(FitError, match="landmarks lie off"):
        fit_face(generic, person.landmarks, skin=(skin.points * [-1, -1, 1], skin.triangles))
    fit = fit_face(generic, person.landmarks, skin=(skin.points, skin.triangles[:, ::-1]))
    assert any("turned" in note for note in fit.notes)


def test_command_and_function_give_the_same_face(tmp_path, generic, person):
    pytest.importorskip("trimesh")
    from emgface.cli import app
    from emgface.face.file import save_face

    save_face(generic, tmp_path / "face.nc")
    marks, skin = person.write(tmp_path)
    out, page = tmp_path / "p.nc", tmp_path / "p.html"
    done = CliRunner().invoke(
        app,
        ["fit", "--face", str(tmp_path / "face.nc"), "--landmarks", str(marks), "--skin", str(skin),
         "--unit", "mm", "--out", str(out), "--report", str(page), "--simulated"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    text = page.read_text()
    assert "fitted to simulated data" in text and "<svg" in text and "skin.ply" in text
    assert "src=" not in text and "http-equiv" in text
    same = ef.fit(tmp_path / "face.nc", landmarks=marks, skin=skin, unit="mm", simulated=True)
    np.testing.assert_array_equal(load_face(out)["position"], same["position"])


def test_an_interrupted_command_leaves_no_file(tmp_path, person, monkeypatch):
    from emgface.cli import app
    from emgface.fit.mechanics import FitTissue

    def interrupt(*args, **kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr(FitTissue, "settle", interrupt)
    marks, _ = person.write(tmp_path)
    before = set(tmp_path.iterdir())
    done = CliRunner().invoke(
        app, ["fit", "--landmarks", str(marks), "--out", str(tmp_path / "p.nc")]
    )
    assert done.exit_code != 0
    assert set(tmp_path.iterdir()) == before
