"""Courses of muscles from tractography: bundles about known courses, radius, files, what is refused."""

import numpy as np
import pytest

from emgface.errors import FitError
from emgface.face.parts import elements_of, fibres_of
from emgface.face.template import template_face
from emgface.fit.courses import mean_courses, with_course
from emgface.fit.inputs import points_of_face
from emgface.fit.readers.tracts import tracts_of

streamlines = pytest.importorskip("nibabel.streamlines")
RADIUS = 4e-3


@pytest.fixture(scope="module")
def face():
    return template_face(resolution="coarse")


def _course(face, muscle="ZYG_L", bend=2e-3):
    """The course of a muscle, bent away from that of the face."""
    line = fibres_of(face, muscle)[0]
    s = np.linspace(0.0, 1.0, 40)
    t = np.linspace(0.0, 1.0, len(line))
    points = np.stack([np.interp(s, t, line[:, k]) for k in range(3)], axis=1)
    return points + bend * np.sin(np.pi * s)[:, None] * np.array([0.0, 0.0, 1.0])


def _bundle(course, radius=RADIUS, n=400, seed=1):
    """Streamlines that fill a disc about a course evenly, half of them in the other direction."""
    rng = np.random.default_rng(seed)
    along = np.gradient(course, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    u = np.cross(along, [0.3, 0.5, 0.8])
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(along, u)
    r, angle = radius * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    lines = [course + a * np.cos(b) * u + a * np.sin(b) * v for a, b in zip(r, angle, strict=True)]
    lines = [line[:: rng.integers(1, 4)] for line in lines]
    return [line[::-1] if k % 2 else line for k, line in enumerate(lines)]


def test_a_bundle_replaces_the_course_and_its_spread_is_the_radius(face):
    course = _course(face)
    replaced = with_course(face, "ZYG_L", _bundle(course))
    from emgface.face.bundles import distance_to_fibres

    assert distance_to_fibres(replaced.fibres[0], [course]).max() < 0.5e-3
    assert replaced.radius == pytest.approx(RADIUS, rel=0.06)
    assert 1e-3 < replaced.away < 4e-3
    for muscle in face["muscle"].values:
        same = np.array_equal(
            np.sort(elements_of(face, str(muscle))),
            np.sort(elements_of(replaced.face, str(muscle))),
        )
        assert same == (muscle != "ZYG_L")
    assert fibres_of(replaced.face, "ZYG_R")[0] == pytest.approx(fibres_of(face, "ZYG_R")[0])
    own = replaced.face["bundle_muscle"].values == list(face["muscle"].values).index("ZYG_L")
    chord = course[-1] - course[0]
    cosine = replaced.face["bundle_direction"].values[own] @ (chord / np.linalg.norm(chord))
    assert np.abs(cosine).min() > 0.8


def test_the_radius_follows_from_a_volume(face):
    course = _course(face)
    lines = _bundle(course)
    by_radius = with_course(face, "ZYG_L", lines, radius=3e-3)
    by_volume = with_course(face, "ZYG_L", lines, volume=by_radius.volume)
    assert by_volume.radius == pytest.approx(3e-3, abs=2e-5)
    length = np.linalg.norm(np.diff(by_radius.fibres[0], axis=0), axis=1).sum()
    # the tube may leave the tissue, and has round ends
    tube = np.pi * 3e-3**2 * length
    assert 0.5 * tube < by_radius.volume < tube + 4.2 * 3e-3**3
    for wrong in ({"volume": 1e-3}, {"radius": 0.5}, {"radius": 3e-3, "volume": 1e-6}):
        with pytest.raises(FitError, match="expected"):
            with_course(face, "ZYG_L", lines, **wrong)


def test_two_heads_of_a_bundle_are_two_fibres(face):
    course = _course(face)
    apart = np.array([0.0, 0.0, 8e-3])
    lines = _bundle(course, 1e-3, 60) + _bundle(course + apart, 1e-3, 60)
    fibres = mean_courses(lines, 2)
    heights = sorted(f[:, 2].mean() for f in fibres)
    assert heights[1] - heights[0] == pytest.approx(8e-3, rel=0.05)


@pytest.mark.parametrize("ending", ["trk", "tck"])
def test_files_are_read_in_the_frame_of_the_patient(face, ending, tmp_path):
    """Oblique voxels of the header do not move the points; RAS mm become LPS m."""
    import json

    lines = _bundle(_course(face), n=40)
    ras = [1e3 * line * [-1.0, -1.0, 1.0] for line in lines]
    affine = np.array([[1.5, 0.2, 0, -30], [-0.2, 1.5, 0, 20], [0, 0, 2.0, 10], [0, 0, 0, 1]])
    bundle = streamlines.Tractogram(ras, affine_to_rasmm=np.eye(4))
    header = {
        "voxel_to_rasmm": affine,
        "voxel_sizes": [1.51, 1.51, 2.0],
        "dimensions": [90, 90, 60],
    }
    path = tmp_path / f"zyg.{ending}"
    streamlines.save(bundle, str(path), **({"header": header} if ending == "trk" else {}))
    read = tracts_of(path)
    for one, two in zip(read.lines, lines, strict=True):
        assert np.abs(one - two).max() < 1e-5
    fitted = face.assign_attrs(
        fit_frame=json.dumps([*np.column_stack([np.eye(3), np.zeros(3)]).ravel()])
    )
    replaced = with_course(fitted, "ZYG_L", path)
    assert read.digest in replaced.face.attrs["fit_inputs"]
    with pytest.raises(FitError, match="no attribute fit_frame"):
        with_course(face, "ZYG_L", path)
    whole = path.read_bytes()
    for kept in (len(whole) // 2, len(whole) - 7, 900, 20):
        path.write_bytes(whole[:kept])
        with pytest.raises(FitError, match="expected"):
            tracts_of(path)


def test_bundles_of_another_place_are_refused(face):
    lines = _bundle(_course(face), n=30)
    with pytest.raises(FitError, match="mirrored, or of the other side"):
        with_course(face, "ZYG_L", [line * [-1.0, 1.0, 1.0] for line in lines])
    with pytest.raises(FitError, match="mirrored, or of the other side"):
        with_course(face, "ZYG_R", lines)
    with pytest.raises(FitError, match="from ZYG_L of the face"):
        with_course(face, "ZYG_L", [line + [0.0, 0.0, 0.06] for line in lines])
    with pytest.raises(FitError, match="check the unit"):
        with_course(face, "ZYG_L", [1e3 * line for line in lines])
    with pytest.raises(FitError, match="no muscle 'ZYG'"):
        with_course(face, "ZYG", lines)
    with pytest.raises(FitError, match="expected at least 5"):
        with_course(face, "ZYG_L", lines[:3])
    with pytest.raises(FitError, match="streamline 0"):
        with_course(face, "ZYG_L", [np.full((4, 3), np.nan), *lines])


def test_the_command_replaces_courses_of_a_fitted_face(face, tmp_path, monkeypatch):
    """In the fit itself or afterwards: the same muscle; nothing is written if a course is refused."""
    import json
    import shlex

    from typer.testing import CliRunner

    from emgface.cli import app
    from emgface.face.file import load_face, save_face

    monkeypatch.chdir(tmp_path)
    lines = _bundle(_course(face), n=60)
    save = {"l.tck": lines, "r.tck": [line * [-1.0, 1.0, 1.0] for line in lines]}
    for name, kept in save.items():
        ras = [1e3 * line * [-1.0, -1.0, 1.0] for line in kept]
        streamlines.save(streamlines.Tractogram(ras, affine_to_rasmm=np.eye(4)), name)
    marks = points_of_face(face)
    rows = [f"{name},{x:.6f},{y:.6f},{z:.6f}" for name, (x, y, z) in marks.items()]
    (tmp_path / "l.csv").write_text("\n".join(["name,x_m,y_m,z_m", *rows]))
    save_face(face, tmp_path / "face.nc")

    def run(line):
        done = CliRunner().invoke(app, shlex.split(line))
        return done.exit_code, " ".join(f"{done.output} {done.exception}".replace("│", "").split())

    fit = "fit --face face.nc --landmarks l.csv --simulated"
    for line in (
        f"{fit} --out whole.nc --course ZYG_L=l.tck --course ZYG_R=r.tck --volume ZYG_L=0.5",
        f"{fit} --out plain.nc",
        "fit --face plain.nc --course ZYG_L=l.tck --course ZYG_R=r.tck --volume ZYG_L=0.5 --out "
        "later.nc",
    ):
        code, text = run(line)
        assert code == 0, text
    assert "The course of ZYG_R is that of its bundle" in text
    whole, plain, later = (
        load_face(tmp_path / f"{name}.nc") for name in ("whole", "plain", "later")
    )
    for name in ("bundle_index", "bundle_muscle"):
        assert np.array_equal(whole[name], later[name])
    assert np.allclose(whole["fibre_position"], later["fibre_position"], atol=1e-12)
    changed = [
        str(m)
        for m in plain["muscle"].values
        if not np.array_equal(*(np.sort(elements_of(one, str(m))) for one in (plain, later)))
    ]
    assert changed == ["ZYG_L", "ZYG_R"]
    assert json.loads(later.attrs["fit_inputs"])["course of ZYG_L"].startswith("l.tck ")
    for line, why in (
        ("fit --face plain.nc --course ZYG_L=r.tck --out x.nc", "of the other side"),
        ("fit --face face.nc --course ZYG_L=l.tck --out x.nc", "no attribute fit_frame"),
        (f"{fit} --volume ZYG_L=2 --out x.nc", "volume is given for ZYG_L"),
        (f"{fit} --course ZYG_L=l.tck --volume ZYG_L=much --out x.nc", "expected a volume in cm3"),
        (f"{fit} --course ZYG_L=l.tck --volume ZYG_L=500 --out x.nc", "the volume is 500 cm3"),
        (f"{fit} --course ZYG_L=l.tck --volume ZYG_L=nan --out x.nc", "the volume is nan cm3"),
        ("fit --face plain.nc --course ZYG_L=l.tck --report x.html --out x.nc", "leave the report"),
        ("fit --model jaw --landmarks l.csv --course ZYG_L=l.tck --out x.nc", "has no courses"),
        ("fit --face plain.nc --course ZYG_L=none.tck --out x.nc", "none.tck"),
    ):
        code, text = run(line)
        assert code != 0 and why in text, (line, text)
        assert not (tmp_path / "x.nc").exists() and not (tmp_path / "x.html").exists(), line
