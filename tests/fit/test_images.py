"""Images of phantoms: bias, three stacks, registration, contours and regions with known truth."""

from importlib.util import find_spec

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.fit_phantoms import CENTRE, PLANES, RADII, UNMOVED, image_of, intensity, stack
from emgface.errors import FitError
from emgface.fit.images import (
    combined_stacks,
    contour_through,
    region_around,
    registered_images,
    without_bias,
)
from emgface.fit.readers.volumes import surfaces_of_labels, toolkit

if find_spec("SimpleITK") is None:
    pytest.skip("SimpleITK is not installed", allow_module_level=True)
SimpleITK = toolkit()


def _values(image):
    return SimpleITK.GetArrayFromImage(image)


def test_bias_is_removed():
    image, points = stack(np.full(3, 2e-3), np.eye(3))
    x = (points - CENTRE) / RADII
    field = np.exp(0.35 * x[..., 0] + 0.2 * x[..., 1] ** 2)
    biased = image * 1.0
    wrong = SimpleITK.GetImageFromArray((_values(image) * field).astype(np.float32))
    wrong.CopyInformation(biased)
    corrected = _values(without_bias(wrong))
    tissue = np.abs(intensity(points) - 100.0) < 2.0
    before, after = (v[tissue].std() / v[tissue].mean() for v in (_values(wrong), corrected))
    assert after < 0.4 * before and after < 0.08, (before, after)
    with pytest.raises(FitError, match="negative or no values"):
        without_bias(wrong - 1e4)


def test_three_stacks_are_combined_by_fiducials():
    """Slices of 2 mm in three planes; the combination is nearer to the truth than any stack."""
    rng = np.random.default_rng(3)
    points = CENTRE + rng.uniform(-1.0, 1.0, (6, 3)) * RADII
    stacks, marks, truth = [], [], []
    for k, axes in enumerate(PLANES.values()):
        turn = Rotation.from_rotvec(0.05 * rng.standard_normal(3)).as_matrix() if k else np.eye(3)
        shift = 2e-3 * rng.standard_normal(3) if k else np.zeros(3)
        image, _ = stack(np.array([0.6e-3, 0.6e-3, 2e-3]), axes, (turn, shift), seed=k)
        stacks.append(image)
        noisy = points @ turn.T + shift + 0.1e-3 * rng.standard_normal(points.shape)
        marks.append({f"f{i}": p for i, p in enumerate(noisy)})
        truth.append((turn, shift))
    combined, motions = combined_stacks(stacks, marks, 0.6e-3)
    inner = CENTRE + rng.uniform(-1.0, 1.0, (200, 3)) * RADII
    for motion, (turn, shift) in zip(motions, truth, strict=True):
        off = np.linalg.norm(motion(inner @ turn.T + shift) - inner, axis=1)
        assert 1e3 * off.mean() < 0.2  # target registration error
    one = SimpleITK.Resample(stacks[0], combined, SimpleITK.Transform(), SimpleITK.sitkLinear, 0.0)
    size = combined.GetSize()
    index = np.stack(np.meshgrid(*(np.arange(n) for n in size[::-1]), indexing="ij"), axis=-1)[
        ..., ::-1
    ]
    D = np.array(combined.GetDirection()).reshape(3, 3) * np.array(combined.GetSpacing())
    wanted = intensity(1e-3 * (index @ D.T + np.array(combined.GetOrigin())))
    core = tuple(slice(n // 6, -n // 6) for n in wanted.shape)
    errors = [np.sqrt(((_values(v) - wanted)[core] ** 2).mean()) for v in (combined, one)]
    assert errors[0] < 0.85 * errors[1], errors
    mirrored = {k: p * [-1.0, 1.0, 1.0] for k, p in marks[0].items()}
    with pytest.raises(FitError, match="are mirrored, or differ"):
        combined_stacks(stacks[:2], [marks[0], mirrored], 1e-3)
    with pytest.raises(FitError, match="2 fiducials in common"):
        combined_stacks(stacks[:2], [marks[0], dict(list(marks[1].items())[:2])], 1e-3)


def test_mutual_information_finds_a_motion_and_the_inverse_contrast():
    """Target registration error at points that were not used."""
    turn = Rotation.from_rotvec([0.06, -0.04, 0.08]).as_matrix()
    shift = np.array([3e-3, -2e-3, 2e-3]) + CENTRE - turn @ CENTRE
    fixed, _ = stack(np.full(3, 1.5e-3), np.eye(3))
    moving, _ = stack(np.full(3, 1.5e-3), np.eye(3), (turn, shift), seed=1)
    contrast = (moving - 120.0) * (moving - 120.0) * 0.01
    registered = registered_images(fixed, contrast)
    points = CENTRE + np.random.default_rng(1).uniform(-1.0, 1.0, (200, 3)) * RADII
    off = np.linalg.norm(registered.motion(points @ turn.T + shift) - points, axis=1)
    before = np.linalg.norm(points @ turn.T + shift - points, axis=1)
    assert 1e3 * off.mean() < 0.5 and off.mean() < 0.2 * before.mean(), 1e3 * off.mean()
    far = image_of(_values(fixed), np.diag([1.5e-3, 1.5e-3, 1.5e-3, 1.0]) + np.eye(4, k=3) * 5.0)
    with pytest.raises(FitError, match="expected"):
        registered_images(fixed, far)


def test_a_contour_follows_the_edge_between_few_clicks():
    image, points = stack(np.full(3, 1e-3), np.eye(3))
    k = len(points) // 2
    values = _values(image)[k]
    x = points[k][0, :, 0], points[k][:, 0, 1]
    angles = np.linspace(0.0, 2 * np.pi, 8, endpoint=False)
    z = (points[k][0, 0, 2] - CENTRE[2]) / (1.5 * RADII[2])
    rim = 1.5 * RADII[:2] * np.sqrt(1.0 - z**2)
    edge = CENTRE[:2] + rim * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    clicks = np.stack(
        [np.searchsorted(x[1], edge[:, 1]), np.searchsorted(x[0], edge[:, 0])], axis=1
    )
    contour = contour_through(values, clicks)
    at = np.stack([x[0][contour[:, 1]], x[1][contour[:, 0]]], axis=1)
    off = np.abs(np.linalg.norm((at - CENTRE[:2]) / rim, axis=1) - 1.0) * rim.mean()
    assert 1e3 * off.mean() < 1.0 and 1e3 * off.max() < 2.5
    with pytest.raises(FitError, match="outside the slice"):
        contour_through(values, clicks + 1000)
    with pytest.raises(FitError, match="at least three clicks"):
        contour_through(values, clicks[:2])


def _points(path, points):
    rows = [f"{name},{','.join(f'{1e3 * v:.3f}' for v in p)}" for name, p in points.items()]
    path.write_text("\n".join(["name,x_mm,y_mm,z_mm", *rows]))


CLICKS = {
    "head 1": CENTRE + [0.0, 0.025, 0.0],
    "head 2": CENTRE + [0.0, -0.02, -0.005],
    "cavity": CENTRE + [0.005, -0.02, 0.012],
}


def _dice(one, two):
    return 2.0 * (one & two).sum() / (one.sum() + two.sum())


def test_the_command_labels_parts_of_three_stacks(tmp_path, monkeypatch):
    """Stacks in three planes, moved between the scans, become labels in the frame of the first."""
    from typer.testing import CliRunner

    from emgface.cli import app

    monkeypatch.chdir(tmp_path)
    markers = {f"f{k}": p for k, p in enumerate(CENTRE + 0.04 * np.vstack([np.eye(3), [1, 1, 0]]))}
    moved = Rotation.from_rotvec([0.05, -0.08, 0.04]).as_matrix(), np.array([2e-3, -3e-3, 1e-3])
    line = ["segment"]
    for k, (plane, axes) in enumerate(PLANES.items()):
        motion = moved if k else UNMOVED
        image, _ = stack(np.array([1e-3, 1e-3, 2e-3]), axes, motion, seed=k)
        SimpleITK.WriteImage(image, f"{plane}.nii.gz")
        _points(
            tmp_path / f"{plane}.csv", {n: motion[0] @ p + motion[1] for n, p in markers.items()}
        )
        line += [f"{plane}.nii.gz"]
    for plane in PLANES:
        line += ["--fiducials", f"{plane}.csv"]
    _points(tmp_path / "clicks.csv", CLICKS)
    line += (
        "--clicks clicks.csv --label head=1 --label cavity=7 --picture p.png --out l.nii.gz".split()
    )
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 0, done.output
    assert "coronal.nii.gz was turned by 5.9 degrees" in " ".join(done.output.split())
    labels = SimpleITK.ReadImage("l.nii.gz")
    values = SimpleITK.GetArrayFromImage(labels)
    index = np.argwhere(np.ones_like(values))[:, ::-1]
    at = [labels.TransformIndexToPhysicalPoint([0, 0, 0]), labels.GetSpacing()]
    points = 1e-3 * (np.array(at[0]) + index * np.array(at[1])).reshape(*values.shape, 3)
    assert _dice(values == 1, intensity(points) > 50.0) >= 0.95
    hole = (np.linalg.norm((points - CLICKS["cavity"]) / (0.25 * RADII), axis=-1)) < 1.0
    assert _dice(values == 7, hole) >= 0.95, _dice(values == 7, hole)
    assert (tmp_path / "p.png").stat().st_size > 10_000
    head = surfaces_of_labels("l.nii.gz", {"skin": [1, 7]})["skin"].surface
    r = np.linalg.norm((head.points - CENTRE) / (1.5 * RADII), axis=1)
    assert np.median(r) == pytest.approx(1.0, abs=0.02)


def test_a_small_part_keeps_its_size_in_noise_and_next_to_another():
    """A cavity of 10 mm in cubes of 1 mm, with the noise of a fifth of its contrast."""
    image, points = stack(np.full(3, 1e-3), np.eye(3), noise=18.0)
    r = np.linalg.norm((points - CLICKS["cavity"]) / (0.25 * RADII), axis=-1)
    region = region_around(image, [CLICKS["cavity"].tolist()])
    assert _dice(region, r < 1.0) > 0.9, _dice(region, r < 1.0)
    assert region.sum() == pytest.approx((r < 1.0).sum(), rel=0.1)


def test_clicks_and_labels_that_cannot_be_are_refused(tmp_path, monkeypatch):
    from typer.testing import CliRunner

    from emgface.cli import app

    monkeypatch.chdir(tmp_path)
    image, _ = stack(np.full(3, 2e-3), np.eye(3), margin=1.8)
    SimpleITK.WriteImage(image, "a.nrrd")
    _points(tmp_path / "clicks.csv", CLICKS)
    _points(tmp_path / "metres.csv", {n: 1e3 * p for n, p in CLICKS.items()})
    _points(tmp_path / "away.csv", {n: p + [0.2, 0, 0] for n, p in CLICKS.items()})
    _points(
        tmp_path / "same.csv", {**CLICKS, "more 1": CLICKS["head 1"], "more 2": CLICKS["head 2"]}
    )
    unknown = SimpleITK.GetArrayFromImage(image)
    unknown[0, 0, 0] = np.nan
    with pytest.raises(FitError, match="not finite"):
        region_around(image_of(unknown, np.diag([2e-3, 2e-3, 2e-3, 1.0])), [[0.01, 0.01, 0.01]])
    both = "--label head=1 --label cavity=7"
    for line, why in (
        (f"--clicks metres.csv {both} --out x.nrrd", "expected 0 to 600 mm"),
        (f"--clicks away.csv {both} --out x.nrrd", "outside the image"),
        ("--clicks clicks.csv --label head=1 --out x.nrrd", "points of no part: cavity"),
        (f"--clicks clicks.csv {both} --label tongue=2 --out x.nrrd", "no click in tongue"),
        ("--clicks clicks.csv --label head=1 --label cavity=1 --out x.nrrd", "one label each"),
        ("--clicks clicks.csv --label head=1 --label head=2 --out x.nrrd", "given twice"),
        ("--clicks clicks.csv --label head=0 --label cavity=7 --out x.nrrd", "expected 1 to 65535"),
        ("--clicks clicks.csv --label head=one --out x.nrrd", "expected a number"),
        (f"--clicks same.csv {both} --label more=3 --out x.nrrd", "overlap by"),
        (f"a.nrrd --clicks clicks.csv {both} --out x.nrrd", "0 files of fiducials"),
        (f"--clicks clicks.csv {both} --out x.stl", "the ending of no volume"),
        (f"--clicks clicks.csv {both} --out a.nrrd", "file that the command reads"),
    ):
        done = CliRunner().invoke(app, ["segment", "a.nrrd", *line.split()])
        text = " ".join(f"{done.output} {done.exception}".replace("│", "").split())
        assert done.exit_code != 0 and why in text, (line, text)
        assert {p.name for p in tmp_path.iterdir()} == {
            "a.nrrd", "away.csv", "clicks.csv", "metres.csv", "same.csv",
        }, line  # fmt: skip
