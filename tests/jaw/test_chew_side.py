"""Side of the morsel in chewing, from the series or asked for; times of published series."""

import numpy as np
import pytest
from typer.testing import CliRunner

from emgface.anatomy.jaw.series import morsel_side, read_probe
from emgface.anatomy.jaw.tasks import with_series
from emgface.anatomy.tongue.published import GESTURE, read_gesture
from emgface.cli import app
from emgface.errors import JawError, TongueError
from emgface.schema.netcdf import read_netcdf, write_netcdf
from tests.jaw.conftest import TO_MM, here

FLAT = "0 1000000000 1.0\nLinear 1 explicit\n0 0.0\n1 0.0\n"
INCLINED = "0 1000000000 1.0\nLinear 1 explicit\n0 -0.05\n1 0.0\n"


def series(folder, **sides):
    """Folder of one muscle and the inclination of the bite plane."""
    folder.mkdir(exist_ok=True)
    (folder / "lsm.txt").write_text("0 1000000000 1.0\nLinear 1 explicit\n0 0.1\n1 0.2\n")
    for letter, text in sides.items():
        (folder / f"{letter}bitecant.txt").write_text(text)
    return folder


@pytest.mark.parametrize(
    ("sides", "side"),
    [({"l": INCLINED, "r": FLAT}, "L"), ({"l": FLAT, "r": INCLINED}, "R"), ({"r": INCLINED}, "R")],
)
def test_the_series_state_the_side(tmp_path, sides, side):
    folder = series(tmp_path / "chew", **sides)
    assert morsel_side(folder) == side
    assert with_series("chew", folder)[0].morsel == side
    assert with_series("chew", folder, morsel="L")[0].morsel == "L"
    assert with_series("chew", folder, morsel="none")[0].morsel is None


@pytest.mark.parametrize("sides", [{}, {"l": FLAT, "r": FLAT}])
def test_the_side_is_asked_for_if_the_series_do_not_state_it(tmp_path, sides):
    folder = series(tmp_path / "chew", **sides)
    with pytest.raises(JawError, match="specify the setting morsel=L, R or none"):
        with_series("chew", folder)
    assert with_series("chew", folder, morsel="R")[0].morsel == "R"


def test_sides_that_are_none_are_refused(tmp_path):
    both = series(tmp_path / "both", l=INCLINED, r=INCLINED)
    with pytest.raises(JawError, match="on both sides"):
        with_series("chew", both)
    with pytest.raises(JawError, match="expected one of L, R, none"):
        with_series("chew", both, morsel="left")
    with pytest.raises(JawError, match="has no morsel"):
        with_series("open", None, morsel="L")
    with pytest.raises(JawError, match="expected no other side without the setting series"):
        with_series("chew", None, morsel="R")


@pytest.mark.slow
@pytest.mark.parametrize(("chew", "side"), [("rightchew", "right"), ("leftchew", "left")])
def test_both_chews_of_the_command_follow_the_recording(
    chew, side, published, recorded, shared, tmp_path
):
    """The left chew is compared with the mirror image of the recorded right one, within 0.8 mm."""
    folder = shared / "artisynth_models" / "jaw_larynx" / "probes" / chew
    write_netcdf(published("larynx"), tmp_path / "jaw.nc", "jaw_model")
    given = ["jaw", "run", str(tmp_path / "jaw.nc"), "--task", "chew", "--series", str(folder)]
    done = CliRunner().invoke(app, [*given, "--out", str(tmp_path / "motion.nc")])
    assert done.exit_code == 0, done.output
    assert f"The morsel is on the {side} side." in done.output
    motion = read_netcdf(tmp_path / "motion.nc", "jaw_motion")
    case, arrays = recorded("larynx_rightchew_probes")
    k = case["markers"].index("lowerincisor")
    theirs = arrays["marker_pos_mm"][:, k].copy()
    if side == "left":
        theirs[:, 0] *= -1.0
    ours = motion["position"].sel(marker="lower_incisor").transpose("time", "axis").values * TO_MM
    at = np.interp(motion["time"].values, arrays["t"], np.arange(len(arrays["t"])))
    k = np.round(at).astype(int)
    assert np.abs(at - k).max() < 1e-6
    apart = np.linalg.norm(ours - theirs[k], axis=1)
    assert apart.max() < 0.8
    assert here("lsm") == "sm_L"


ROWS = "\n".join(f"{t} " + " ".join(["0.1"] * len(GESTURE)) for t in (0.0, 0.5, 1.0))


@pytest.mark.parametrize(
    ("head", "begin", "end"),
    [
        ("0.0 1.0 1.0", 0.0, 1.0),
        ("2000000 1000000000 0.204", 0.002, 0.206),
        ("478000000 1252000000 0.1788", 0.478, 0.6568),
        ("0.5 1.5 1.0", 0.5, 1.5),
    ],
)
def test_gestures_and_series_have_the_same_times(tmp_path, head, begin, end):
    """Whole numbers in the first line are nanoseconds in both kinds of files."""
    (tmp_path / "g.txt").write_text(f"{head}\nLinear {len(GESTURE)} explicit\n{ROWS}\n")
    (tmp_path / "p.txt").write_text(f"{head}\nLinear 1 explicit\n0.0 0.0\n0.5 0.5\n1.0 1.0\n")
    time = read_gesture(tmp_path / "g.txt").time
    np.testing.assert_allclose([time[0], time[-1]], [begin, end], atol=1e-12)
    middle = np.array([0.5 * (begin + end)])
    np.testing.assert_allclose(read_probe(tmp_path / "p.txt", middle), [0.5], atol=1e-12)


@pytest.mark.parametrize(
    "head",
    ["0 nan 1.0", "0 1000000000 0.0", "0 1000000000 -1", "2.0 1000000000 1.0", "0 1", "x y z"],
)
def test_times_that_are_none_are_refused_in_both(tmp_path, head):
    (tmp_path / "g.txt").write_text(f"{head}\nLinear {len(GESTURE)} explicit\n{ROWS}\n")
    (tmp_path / "p.txt").write_text(f"{head}\nLinear 1 explicit\n0.0 0.0\n0.5 0.5\n1.0 1.0\n")
    with pytest.raises(TongueError, match="expected"):
        read_gesture(tmp_path / "g.txt")
    with pytest.raises(JawError, match="expected"):
        read_probe(tmp_path / "p.txt", np.zeros(1))


def test_every_published_series_can_be_read(shared):
    read = 0
    for path in sorted((shared / "artisynth_models").glob("jaw_larynx/probes/**/*.txt")):
        first = path.read_text().split("\n")[1:2]
        if first and first[0].split()[1:2] == ["1"]:
            assert np.isfinite(read_probe(path, np.linspace(0.0, 1.0, 11))).all()
            read += 1
    assert read > 50
