"""Head of fitted parts: tongue carried by bones, one frame, what is refused; simulated persons."""

import json

import numpy as np
import pytest

from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import read_head, write_head
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.template.build import template_tongue
from emgface.errors import FitError, HeadError
from emgface.face.quality import element_quality
from emgface.face.surface import boundary_faces, triangles
from emgface.face.template import template_face
from emgface.fit.bones import fit_jaw, points_of_jaw, surfaces_of
from emgface.fit.inputs import points_of_face
from emgface.fit.person import fit_face
from emgface.fit.tongue import fit_tongue
from tests.fit.conftest import MOTION

SEED = 8


def _moved(points):
    return points @ MOTION[0].T + MOTION[1]


@pytest.fixture(scope="module")
def parts():
    """Face, jaw and tongue fitted to one simulated person, in the frame of the face."""
    own_face = template_face(resolution="coarse", seed=SEED)
    marks = {k: _moved(v) for k, v in points_of_face(own_face).items()}
    face = fit_face(template_face(resolution="coarse"), marks, simulated=True).face
    generic, own_jaw = template_jaw(), template_jaw(seed=SEED)
    scans = {
        k: (_moved(s.points), s.triangles)
        for k, s in surfaces_of(own_jaw).items()
        if k in ("jaw", "hyoid", "skull")
    }
    jaw = fit_jaw(
        generic, landmarks={k: _moved(v) for k, v in points_of_jaw(own_jaw).items()},
        surfaces=scans, frame=face, simulated=True,
    ).jaw  # fmt: skip
    return {"face": face, "jaw": jaw}, generic


@pytest.fixture(scope="module")
def tongues():
    return (
        template_tongue(resolution="coarse"),
        template_tongue(resolution="coarse", seed=SEED),
    )


def _truth(jaw, points):
    rows = np.array(json.loads(jaw.attrs["fit_frame"])).reshape(3, 4)
    return _moved(points) @ rows[:, :3].T + rows[:, 3]


def test_bones_and_a_surface_bring_the_tongue_to_that_of_the_person(parts, tongues):
    models, generic = parts
    tongue, own = tongues
    faces, _ = boundary_faces(own["connectivity"].values.astype(np.int64))
    skin = triangles(faces, own["position"].values)
    used, corner = np.unique(skin, return_inverse=True)
    scan = _moved(own["position"].values[used]), corner.reshape(-1, 3).astype(np.int64)
    by_bones = fit_tongue(tongue, generic, models["jaw"]).tongue
    fit = fit_tongue(tongue, generic, models["jaw"], surface=scan).tongue
    truth = _truth(models["jaw"], own["position"].values)
    errors = [
        np.median(np.linalg.norm(t["position"].values - truth, axis=1))
        for t in (tongue, by_bones, fit)
    ]
    assert errors[1] < 0.5 * errors[0] and errors[2] < 0.4 * errors[0], errors
    for one in (by_bones, fit):
        quality = element_quality(one["position"].values, one["connectivity"].values)
        assert (quality.smallest_det > 0).all()
        assert one.attrs["origin"] == "fitted" and one.attrs["fit_of"] == "simulated"
    for name in ("connectivity", "bundle_index", "attachment_node", "exciter_gain"):
        np.testing.assert_array_equal(fit[name].values, tongue[name].values)
    fibres = [t["fibre_position"].values for t in (tongue, fit, own)]
    start, end = (
        np.median(np.linalg.norm(f - _truth(models["jaw"], fibres[2]), axis=1)) for f in fibres[:2]
    )
    assert end < 0.5 * start


def test_a_head_of_fitted_parts_is_written_and_read(parts, tongues, tmp_path):
    models, generic = parts
    tongue = fit_tongue(tongues[0], generic, models["jaw"]).tongue
    head = build_head(models={**models, "tongue": tongue})
    assert head.lists.attrs["origin"] == "fitted" and "fitted face" in head.lists.attrs["name"]
    np.testing.assert_array_equal(
        head.parts["face"]["position"].values, models["face"]["position"].values
    )
    # the palate has moved with the upper teeth
    generic_palate = build_head(resolution="coarse").shell("palate").points
    assert np.abs(head.shell("palate").points - generic_palate).max() > 5e-4
    write_head(head, tmp_path / "head.nc")
    again = read_head(tmp_path / "head.nc")
    assert again.parts["jaw"].attrs["fit_of"] == "simulated"
    from emgface.anatomy.head.run import raised, simulate_head

    motion = simulate_head(again, raised({"bi_GGP": 0.1}), duration=0.01)
    assert np.isfinite(motion["body_position"].values).all()


def test_parts_that_do_not_belong_together_are_refused(parts):
    models, generic = parts
    with pytest.raises(
        HeadError, match="face, jaw are fitted to a person, but the tongue would be"
    ):
        build_head(models=models)
    text = "then the jaw with that face as --frame .* give --model jaw=FILE --model tongue=FILE"
    with pytest.raises(HeadError, match=f"{text}, or build only --parts face$"):
        build_head(models={"face": models["face"]})
    with pytest.raises(HeadError, match="the jaw would be generated"):  # it was built silently
        build_head(["face", "jaw"], models={"face": models["face"]})
    with pytest.raises(HeadError, match="but the given jaw not, with"):
        build_head(["face", "jaw"], models={"face": models["face"], "jaw": generic})
    elsewhere = models["jaw"].copy()
    frame = np.array(json.loads(elsewhere.attrs["fit_frame"]))
    elsewhere.attrs["fit_frame"] = json.dumps([float(v) for v in frame + 1e-3])
    with pytest.raises(HeadError, match="different frames"):
        build_head(["face", "jaw"], models={**models, "jaw": elsewhere})
    with pytest.raises(HeadError, match="a model of 'tongue'"):
        build_head(["face", "jaw"], models={"tongue": generic})
    with pytest.raises(FitError, match="no attribute fit_frame"):
        fit_jaw(generic, landmarks=points_of_jaw(generic), frame=template_face(resolution="coarse"))
    with pytest.raises(FitError, match="the jaw is not fitted"):
        fit_tongue(template_tongue(resolution="coarse"), generic, generic)


def test_commands_fit_every_part_and_build_the_head(tongues, tmp_path, monkeypatch):
    """From files alone: a face, the jaw in its frame, the tongue on the jaw, and the head of them."""
    import csv
    import shlex

    from typer.testing import CliRunner

    from emgface.cli import app
    from tests.fit.conftest import ply

    def write_marks(name, points):
        with (tmp_path / name).open("w", newline="") as stream:
            rows = [[key, *np.round(1e3 * _moved(p), 4)] for key, p in points.items()]
            csv.writer(stream).writerows([["name", "x_mm", "y_mm", "z_mm"], *rows])

    own_jaw, own = template_jaw(seed=SEED), tongues[1]
    write_marks("face.csv", points_of_face(template_face(resolution="coarse", seed=SEED)))
    write_marks("jaw.csv", points_of_jaw(own_jaw))
    for body, surface in surfaces_of(own_jaw).items():
        scan = ply(1e3 * _moved(surface.points), surface.triangles)
        (tmp_path / f"{body}.ply").write_text(scan)
    faces, _ = boundary_faces(own["connectivity"].values.astype(np.int64))
    used, corner = np.unique(triangles(faces, own["position"].values), return_inverse=True)
    scan = ply(1e3 * _moved(own["position"].values[used]), corner.reshape(-1, 3))
    (tmp_path / "tongue.ply").write_text(scan)
    monkeypatch.chdir(tmp_path)
    bones = "--surface jaw=jaw.ply --surface hyoid=hyoid.ply --surface skull=skull.ply --unit mm"
    lines = (
        "build tongue --resolution coarse --out generic.nc",
        "fit --landmarks face.csv --out person.nc --simulated",
        f"fit --model jaw --landmarks jaw.csv {bones} --frame person.nc --out j.nc --report j.html "
        "--simulated",
        "fit --model generic.nc --surface tongue=tongue.ply --unit mm --frame j.nc --out t.nc --report "
        "t.html",
        "build head --model face=person.nc --model jaw=j.nc --model tongue=t.nc --out head.nc",
    )
    for line in lines:
        done = CliRunner().invoke(app, shlex.split(line))
        assert done.exit_code == 0, (line, done.output, done.exception)
    for page in ("j.html", "t.html"):
        text = (tmp_path / page).read_text()
        assert "fitted to simulated data" in text and "<svg" in text and "Provenance" in text
        assert "http://" not in text.replace("http://www.w3.org", "")
    assert "jaw.ply" in (tmp_path / "j.html").read_text()
    head = read_head("head.nc")
    assert head.lists.attrs["origin"] == "fitted"
    for refused, why in (
        ("fit --model jaw --landmarks jaw.csv --thickness 1 --out x.nc", "has no thickness"),
        (
            "fit --model tongue --surface tongue=tongue.ply --unit mm --out x.nc",
            "no frame is given",
        ),
        ("fit --model head.nc --landmarks face.csv --out x.nc", "a head is not fitted as a whole"),
        ("fit --model jaw --surface nose=jaw.ply --unit mm --out x.nc", "no surface of nose"),
        ("fit --out x.nc", "no landmarks are given"),
        (
            "fit --model jaw --surface jaw=jaw.ply --unit mm --out jaw.ply",
            "file that the command reads",
        ),
    ):
        done = CliRunner().invoke(app, shlex.split(refused))
        sentence = " ".join(f"{done.output} {done.exception}".replace("│", "").split())
        assert done.exit_code != 0 and why in sentence, (refused, sentence)
        assert not (tmp_path / "x.nc").exists()


def test_the_command_builds_a_head_of_files(parts, tmp_path):
    from typer.testing import CliRunner

    from emgface.cli import app
    from emgface.face.file import save_face
    from emgface.schema.netcdf import write_netcdf

    models, _ = parts
    save_face(models["face"], tmp_path / "f.nc")
    write_netcdf(models["jaw"], tmp_path / "j.nc", "jaw_model")
    done = CliRunner().invoke(
        app,
        ["build", "head", "--parts", "face,jaw", "--model", f"face={tmp_path / 'f.nc'}", "--model",
         f"jaw={tmp_path / 'j.nc'}", "--out", str(tmp_path / "head.nc")],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert read_head(tmp_path / "head.nc").lists.attrs["origin"] == "fitted"
    done = CliRunner().invoke(app, ["build", "head", "--model", "face", "--out", "x.nc"])
    assert done.exit_code != 0 and "PART=FILE" in done.output
