"""Activation curves: interpolation, editing, files, and what is refused."""

import numpy as np
import pytest
import xarray as xr
from scipy.interpolate import CubicHermiteSpline

from emgface.errors import DataError
from emgface.muscles import MUSCLES
from emgface.view.curves import (
    MOST_KNOTS,
    Curves,
    curves_from,
    curves_of,
    mirrored,
    read_curves,
    write_curves,
)

KNOTS = {"ZYG_L": [[0.1, 0.0], [0.3, 0.8], [0.9, 1 / 3]], "OOP_R": [[0.0, 0.25]]}


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "step"])
def test_values_between_knots(interpolation):
    curves = Curves(KNOTS, 1.0, interpolation)
    t = np.array([0.0, 0.1, 0.2, 0.3, 0.6, 0.9, 1.0])
    (x, y) = np.array(KNOTS["ZYG_L"]).T
    slopes = [(y[1] - y[0]) / 0.2, (y[2] - y[0]) / 0.8, (y[2] - y[1]) / 0.6]
    expected = {
        "linear": np.interp(t, x, y),
        "cubic": np.clip(CubicHermiteSpline(x, y, slopes)(np.clip(t, 0.1, 0.9)), 0, 1),
        "step": [0.0, 0.0, 0.0, 0.8, 0.8, 1 / 3, 1 / 3],
    }[interpolation]
    np.testing.assert_allclose(curves.at("ZYG_L", t), expected, rtol=1e-14)
    np.testing.assert_array_equal(curves.at("OOP_R", t), 0.25)
    np.testing.assert_array_equal(curves.at("MEN_L", t), 0.0)
    time, values = curves.activation(MUSCLES)
    assert time[0] == 0.0 and time[-1] == 1.0 and values.shape == (len(time), 20)
    between = np.interp(t, time, values[:, MUSCLES.index("ZYG_L")])
    tolerance = {"linear": 1e-14, "cubic": 1e-5, "step": 1e-14}[interpolation]
    np.testing.assert_allclose(between, expected, atol=tolerance)


def test_values_outside_the_range_are_limited_and_counted():
    curves = Curves({"ZYG_L": [[0.0, -0.5], [0.5, 0.5], [1.0, 1.5]]}, 1.0)
    assert curves.clipped == 2
    np.testing.assert_allclose(curves.at("ZYG_L", np.array([0.0, 0.25, 1.0])), [0.0, 0.0, 1.0])


def test_editing():
    curves = Curves(KNOTS, 1.0)
    other = curves.mirrored()
    assert set(other.knots) == {"ZYG_R", "OOP_L"} and mirrored("jaw") == "jaw"
    assert other.mirrored().knots.keys() == curves.knots.keys()
    moved = curves.moved(shift=0.02, stretch=2.0)
    np.testing.assert_allclose(moved.knots["ZYG_L"][:, 0], [0.22, 0.62, 1.82], rtol=1e-14)
    np.testing.assert_array_equal(moved.knots["ZYG_L"][:, 1], curves.knots["ZYG_L"][:, 1])


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "step"])
def test_files_return_the_same_curves(tmp_path, interpolation):
    curves = Curves(KNOTS, 1.25, interpolation)
    table = read_curves(write_curves(curves, tmp_path / "curves.csv"))
    folder = tmp_path / "probes"
    folder.mkdir()
    for name, knots in KNOTS.items():
        rows = "".join(f"{t!r} {v!r}\n" for t, v in knots)
        head = f"0 1250000000 1.0\n{interpolation.title()} 1 explicit\n"
        (folder / f"{name}.txt").write_text(head + rows)
    for read in (table, read_curves(folder)):
        assert read.interpolation == interpolation and read.duration == 1.25
        assert read.knots.keys() == curves.knots.keys()
        for name in KNOTS:
            np.testing.assert_array_equal(read.knots[name], curves.knots[name])


def test_an_activation_has_a_knot_at_each_sample():
    time = np.array([2.0, 2.1, 2.3])
    values = np.random.default_rng(0).uniform(size=(2, 3))
    activation = xr.Dataset(
        {"activation": (("muscle", "time"), values)}, {"muscle": ["ZYG_L", "MEN_R"], "time": time}
    )
    curves = curves_of(activation)
    assert curves.duration == pytest.approx(0.3)
    np.testing.assert_array_equal(curves.at("MEN_R", time - 2.0), values[1])


def test_published_probe_files_are_evaluated_as_by_another_reader(shared):
    """Start and scale of the times, and values held after the last knot."""
    from emgface.anatomy.jaw.series import read_probe

    folder = shared / "artisynth_models" / "jaw_larynx" / "probes" / "larynx"
    paths = sorted(folder.glob("probe_*.txt"))
    assert paths
    for path in paths:
        one = path.parent / "alone"
        content = path.read_text()
        time = np.linspace(0.0, 1.0, 101)
        expected = read_probe(path, time)
        kind = content.splitlines()[1].split()[0].lower()
        lines = [line.split() for line in content.splitlines()[2:] if line.strip()]
        rows = np.array(lines, dtype=float)
        start, _, scale = content.splitlines()[0].split()
        rows[:, 0] = int(start) / 1e9 + float(scale) * rows[:, 0]
        curves = Curves({"ZYG_L": rows}, 1.0, kind)
        after = time >= rows[0, 0]
        np.testing.assert_allclose(
            curves.at("ZYG_L", time)[after],
            np.clip(expected[after], 0, 1),
            atol=1e-12,
            err_msg=str(one),
        )


@pytest.mark.parametrize(
    ("knots", "expected"),
    [
        ({"ZYG_L": [[0.0, float("nan")]]}, "not a number"),
        ({"ZYG_L": [[0.0, 1e300]]}, "not a number"),
        ({"ZYG_L": [[0.5, 0.0], [0.5, 1.0]]}, "do not ascend: 0.5 s follows 0.5 s at knot 2"),
        ({"ZYG_L": []}, "no pairs of time and value"),
        ({"ZYG_L": [[0.0, 0.1, 0.2]]}, "no pairs of time and value"),
        ({"ZYG_L": "text"}, "no pairs of time and value"),
        ({"ZYG_L": [[k * 1e-3, 0.0] for k in range(MOST_KNOTS + 1)]}, "expected at most"),
        ({"<img src=x>": [[0.0, 0.0]]}, "the face has no muscle <img src=x>"),
        ({"../escaped": [[0.0, 0.0]]}, "the face has no muscle ../escaped"),
        (None, "no knots by muscle"),
    ],
)
def test_curves_that_a_page_must_not_send(knots, expected):
    with pytest.raises(DataError, match=expected.replace("(", r"\(")):
        curves_from({"knots": knots, "duration": 1.0}, MUSCLES)


@pytest.mark.parametrize("duration", [0.0, -1.0, float("nan"), 1e9, "1", None, True])
def test_durations_that_a_page_must_not_send(duration):
    if duration is True:
        assert Curves(KNOTS, duration).duration == 1
        return
    with pytest.raises(DataError, match="the duration is"):
        curves_from({"knots": KNOTS, "duration": duration}, MUSCLES)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        ("a.csv", "x,y\n1,2\n", "has the columns x, y, expected time"),
        ("a.csv", "", "contains no table of curves"),
        ("a.csv", "muscle,time,value\nZYG_L,0,high\n", "no pairs of time and value"),
        ("p/ZYG_L.txt", "0 1000000000\nLinear 1 explicit\n0 0\n", "is not a probe file"),
        ("p/ZYG_L.txt", "0 1000000000 1.0\nLinear 2 explicit\n0 0 0\n", "is not a probe file"),
        ("p/notes.md", "none", "contains no probe files"),
        ("p/ZYG_L.txt", "0 1000000000 1.0\nLinear 1 explicit\n", "no rows of time and value"),
        ("p/ZYG_L.txt", f"0 {'9' * 400} 1.0\nLinear 1 explicit\n0 0\n", "is not a probe file"),
        ("p/ZYG_L.txt", f"{'9' * 400} 1 1.0\nLinear 1 explicit\n0 0\n", "is not a probe file"),
        ("a.csv", "muscle,time,value\nZYG_L,0,0\n,1,1\n", "names no muscle in row 3"),
        (
            "a.csv",
            "muscle,time,value,interpolation\nZYG_L,0,0,linear\nZYG_R,1,1,cubic\n",
            "several values of interpolation \\(linear and cubic\\)",
        ),
        (
            "a.csv",
            "muscle,time,value,duration\nZYG_L,0,0,1\nZYG_R,1,1,2\n",
            "several values of duration \\(1 and 2\\)",
        ),
    ],
)
def test_files_without_curves_are_refused(tmp_path, name, content, expected):
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(content)
    with pytest.raises(DataError, match=expected):
        read_curves(path.parent if path.parent != tmp_path else path)
