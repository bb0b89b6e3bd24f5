"""Estimated error of the motions of a jaw, against motions with much shorter steps."""

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.anatomy.jaw.run import simulate_jaw
from emgface.anatomy.jaw.series import ramps
from emgface.anatomy.step_error import Repeated
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf
from tests.jaw.small import small_jaw

CORNER = 1e-5  # s
FINE = 2.5e-5  # s


def burst(start, length, level=1.0):
    """Full activation for a time, between the ends of steps."""
    return ramps(
        {
            "bi_all": [
                (0.0, 0.0),
                (start, 0.0),
                (start + CORNER, level),
                (start + length, level),
                (start + length + CORNER, 0.0),
            ]
        }
    )


def missed(motion, drive, **options):
    """True error (time,) of a motion until every instant [m]."""
    exact = simulate_jaw(small_jaw(), drive, step=FINE, check=False, **options)
    away = motion["position"].values - exact["position"].values  # (marker, axis, time)
    return np.maximum.accumulate(np.linalg.norm(away, axis=1).max(axis=0))


@pytest.mark.parametrize("step", [1e-3, 2.5e-4])
@pytest.mark.parametrize(
    "drive", [burst(0.0503, 0.002), burst(0.0507, 0.0007), burst(0.0302, 0.03)]
)
def test_the_estimate_covers_bursts_and_jumps_between_steps(drive, step):
    options = {"duration": 0.1, "output": 5e-3}
    motion = simulate_jaw(small_jaw(), drive, step=step, **options)
    error, estimate = missed(motion, drive, **options), motion["numerical_error"].values
    assert error[-1] > 1e-6
    assert (estimate >= error).all()
    assert motion.attrs["numerical_error"] == estimate[-1]


def test_steps_are_halved_until_the_desired_error():
    drive, options = burst(0.0302, 0.03), {"duration": 0.1, "output": 5e-3}
    rough = simulate_jaw(small_jaw(), drive, step=1e-3, **options)
    motion = simulate_jaw(small_jaw(), drive, step=1e-3, tolerance=1e-4, **options)
    assert rough.attrs["numerical_error"] > 1e-4 >= motion.attrs["numerical_error"]
    assert motion.attrs["step_s"] < 1e-3
    assert missed(motion, drive, **options)[-1] < 1e-4


@pytest.mark.parametrize("other", [0.5, 1.0 / 3.0, 2.0])
@pytest.mark.parametrize("order", [1, 2])
def test_the_estimate_of_a_known_error(order, other):
    """x = t + c h^p: the part of the series is exact, and the largest jump so far is added to it."""
    t, h, c = np.linspace(0.0, 1.0, 5), 0.1, 3.0
    motions = []
    for step in (h, other * h):
        x = np.zeros((2, 3, 5)) + t
        x[1, 2] += c * step**order * np.array([0.0, 1.0, -2.0, 1.0, 0.0])
        jump = ("time", np.array([0.0, 0.0, 0.0, 7.0, 1.0]))
        position = (("marker", "axis", "time"), x)
        motions.append(xr.Dataset({"position": position, "jump": jump}, attrs={"step_s": step}))
    expected = c * h**order * np.array([0.0, 1.0, 2.0, 2.0, 2.0]) + [0.0, 0.0, 0.0, 7.0, 7.0]
    np.testing.assert_allclose(Repeated(*motions, order).error(), expected, atol=1e-13)


def test_a_repetition_does_not_change_the_motion():
    drive, options = burst(0.0102, 0.005), {"duration": 0.02, "output": 1e-3, "step": 1e-3}
    plain = simulate_jaw(small_jaw(), drive, check=False, **options)
    assert "numerical_error" not in plain
    xr.testing.assert_equal(
        plain["position"], simulate_jaw(small_jaw(), drive, **options)["position"]
    )


def test_command_tells_the_error_and_reaches_a_desired_one(tmp_path):
    write_netcdf(small_jaw(), tmp_path / "jaw.nc", "jaw_model")
    table = "time,bi_all\n0,0\n0.03,0\n0.0301,1\n0.06,1\n0.0601,0\n0.1,0\n"
    (tmp_path / "drive.csv").write_text(table)
    run = ["jaw", "run", str(tmp_path / "jaw.nc"), "--excitation", str(tmp_path / "drive.csv")]
    out = ["--out", str(tmp_path / "motion.nc")]
    result = CliRunner().invoke(app, [*run, *out])
    assert result.exit_code == 0
    assert "Estimated error of the time steps" in " ".join(result.output.split())
    result = CliRunner().invoke(app, [*run, *out, "--accuracy", "0.1 mm"])
    assert result.exit_code == 0
    with xr.open_dataset(tmp_path / "motion.nc") as motion:
        assert motion.attrs["numerical_error"] <= 1e-4
    wrong = CliRunner().invoke(app, [*run, *out, "--accuracy", "study"])
    assert wrong.exit_code != 0
