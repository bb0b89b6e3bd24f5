"""Estimated error of the motions of tongue and head, against motions with shorter steps."""

import numpy as np
import pytest
import xarray as xr

import sim
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.run import raised, simulate_head
from emgface.anatomy.step_error import MOST_STEP_HALVINGS, repeated_motion, with_step_error
from emgface.anatomy.tongue.actions import raised_muscles
from emgface.anatomy.tongue.parameters import variant
from emgface.anatomy.tongue.run import simulate_tongue
from emgface.models.kinds import error_of
from sim.outputs import intervals
from tests.tongue.small import small_tongue


def distance(motion, reference):
    """Largest distance of a point from a reference [m]."""
    away = motion["position"] - reference["position"]
    return float(((away**2).sum("axis") ** 0.5).max())


def of_tongue(muscles="elements", **options):
    drive = raised_muscles("bi_GGP", level=0.002, duration=0.2)
    still = variant(muscles, gravity=False)
    return simulate_tongue(
        small_tongue(), drive, duration=0.2, output=1e-2, parameters=still, **options
    )


@pytest.fixture(scope="module")
def of_head():
    head = build_head(["jaw"], preset="man", contacts=[])

    def moved(**options):
        return simulate_head(head, raised({"bi_open": 0.1}), duration=0.1, **options)

    return moved


@pytest.mark.parametrize("muscles", ["elements", "lines"])
@pytest.mark.parametrize("step", [5e-3, 1e-2, 2e-2])  # repeated with longer and with shorter steps
def test_the_estimate_is_near_the_error_of_a_tongue(step, muscles):
    motion = of_tongue(muscles, step=step)
    exact = of_tongue(muscles, step=step / 32.0, check=False)
    assert 0.8 < motion.attrs["numerical_error"] / distance(motion, exact) < 1.25
    assert motion.attrs["numerical_error"] == motion["numerical_error"].values[-1] > 1e-5
    plain = of_tongue(muscles, step=step, check=False)
    assert "numerical_error" not in plain
    xr.testing.assert_equal(plain["node_position"], motion["node_position"])


def test_steps_that_outputs_shorten_are_not_compared_with_themselves():
    """Lines keep volumes at the ends of steps, which outputs of 10 ms shorten from 20 and 40 ms."""
    errors = [of_tongue("lines", step=h)["numerical_error"] for h in (1e-2, 2e-2, 4e-2)]
    assert float(errors[0][-1]) > 1e-5
    for longer in errors[1:]:
        np.testing.assert_array_equal(longer, errors[0])


@pytest.mark.parametrize("output", [5e-3, 1e-2])  # shorter than twice the step, or not
def test_the_estimate_is_near_the_error_of_a_head(of_head, output):
    motion = of_head(step=5e-3, output=output)
    exact = of_head(step=2.5e-4, output=output, check=False)
    assert 0.5 < motion.attrs["numerical_error"] / distance(motion, exact) < 2.0


def test_steps_of_a_tongue_are_shortened_until_the_desired_error():
    rough = of_tongue(step=1e-2)
    desired = rough.attrs["numerical_error"] / 5.0
    motion = of_tongue(step=1e-2, tolerance=desired)
    assert motion.attrs["numerical_error"] <= desired
    assert motion.attrs["step_s"] < 5e-3 and "node_position" in motion


class Run:
    """Motion x = h of one point with the steps that a scene would take, which are recorded."""

    def __init__(self, output, at_ends, fails_above=np.inf):
        self.output, self.at_ends, self.fails_above = output, at_ends, fails_above
        self.steps = []

    def __call__(self, h, whole):
        taken = min(h, self.output) if self.at_ends else h
        intervals(0.0, 30 * self.output, taken, self.output)  # ControlError if they do not fit
        self.steps.append(taken)
        if taken > self.fails_above:
            raise sim.NotConverged((), 0.0, "too long")
        x = np.full((1, 3, 2), taken / 3.0**0.5)
        motion = xr.Dataset({"position": (("marker", "axis", "time"), x)}, attrs={"step_s": taken})
        return motion.assign(whole=whole)


@pytest.mark.parametrize("shorter", [False, True])
@pytest.mark.parametrize("at_ends", [False, True])
@pytest.mark.parametrize("multiple", [1 / 6, 1 / 5, 1 / 4, 1 / 3, 1 / 2, 1, 2, 3, 5, 6, 15])
def test_the_error_is_that_of_the_steps_taken(multiple, at_ends, shorter):
    run = Run(0.01, at_ends)
    motion = with_step_error(run, multiple * 0.01, 0.01, 1, None, shorter=shorter)
    assert len(set(run.steps)) == 2 == len(run.steps)
    assert motion.attrs["numerical_error"] == pytest.approx(motion.attrs["step_s"], rel=1e-9)
    if not shorter and multiple in (1 / 6, 1 / 4, 1 / 2):
        assert run.steps[1] == 2.0 * run.steps[0]  # the cheaper repetition


@pytest.mark.parametrize("shorter", [False, True])
def test_a_desired_error_is_reached_or_the_shortest_steps_are_stated(shorter):
    for desired, halvings in ((1.1e-3, 3), (1e-9, MOST_STEP_HALVINGS)):
        run = Run(0.01, True)
        motion = with_step_error(run, 5e-3, 0.01, 1, desired, shorter=shorter)
        assert motion.attrs["step_s"] == pytest.approx(5e-3 / 2**halvings)
        assert motion.attrs["numerical_error"] == pytest.approx(motion.attrs["step_s"])
        assert bool(motion["whole"])


def test_a_repetition_that_fails_with_long_steps_has_short_ones():
    run = Run(0.01, True, fails_above=5e-3)
    pair = repeated_motion(run, 5e-3, 0.01, 1)
    assert run.steps == [5e-3, 1e-2, 2.5e-3] and pair.shorter
    np.testing.assert_allclose(pair.error(), 5e-3)


def test_a_motion_whose_repetition_fails_is_kept_without_an_error():
    class Longest(Run):
        def __call__(self, h, whole):
            if h < 5e-3:
                raise sim.NotConverged((), 0.0, "too short")
            return super().__call__(h, whole)

    alone = with_step_error(Longest(0.01, True), 1e-2, 0.01, 1, 1e-9)
    assert alone.attrs["numerical_error"] == pytest.approx(1e-2)  # 5 ms are its repetition
    assert "too short" in alone.attrs["repetition_failed"]
    lost = with_step_error(Longest(0.01, True), 5e-3, 5e-3, 1, None)
    assert "numerical_error" not in lost and "too short" in lost.attrs["repetition_failed"]
    assert "is not known" in error_of(lost, None)
    with pytest.raises(sim.NotConverged):
        with_step_error(Longest(0.01, True), 1e-3, 0.01, 1, None)
