"""Outputs between steps, and several steps per output."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import sim
from sim.outputs import between, intervals
from tests.bodies import fixed_block, grid

TIGHT = {"tolerance": 1e-10, "residual_tolerance": 1e-8}
DURATION = 0.08


@pytest.fixture(scope="module")
def block():
    law, damping = sim.NeoHooke(2500.0), sim.RestRayleigh(19.0, 0.01)
    return fixed_block(grid((2, 2, 2)), sim.Constant(5e3), law, damping=damping)


def motion(system, steps, every=None, duration=DURATION, integrator=None):
    t = np.linspace(0.0, DURATION, 801)
    a = 0.5 - 0.5 * np.cos(np.pi * t / DURATION)
    return sim.simulate(
        system,
        sim.Activation(t, np.stack([a, 0.3 * a], axis=1)),
        duration=duration,
        integrator=integrator or sim.Sdirk2(**TIGHT),
        steps=steps,
        every=every,
        probes=(sim.Positions(), sim.Iterations()),
    )[0]


def test_a_cubic_motion_is_interpolated_exactly():
    a, b, c, d = np.random.default_rng(1).normal(size=(4, 5, 3))

    def state(t):
        return sim.State(t, a + b * t + c * t**2 + d * t**3, b + 2 * c * t + 3 * d * t**2)

    for t in (0.3, 0.41, 0.9):
        interpolated = between(state(0.3), state(0.9), t)
        np.testing.assert_allclose(interpolated.q, state(t).q, atol=1e-13)
        np.testing.assert_allclose(interpolated.v, state(t).v, atol=1e-12)


def test_outputs_inside_steps_are_as_accurate_as_their_ends(block, monkeypatch):
    monkeypatch.setattr(
        sim.outputs, "STRAIGHT_ACTIVATION", np.inf
    )  # the cubic is also exact for a varying acceleration
    fine = motion(block, sim.FixedStep(2.5e-4), 0.005)["node_position"]
    errors = []
    for h in (0.02, 0.01):
        trajectory = motion(block, sim.FixedStep(h), 0.005)["node_position"]
        np.testing.assert_allclose(trajectory["time"], fine["time"], atol=1e-15)
        gap = np.linalg.norm(trajectory - fine, axis=trajectory.dims.index("axis")).max(axis=0)
        per = round(h / 0.005)
        inside = np.arange(len(gap)) % per != 0
        errors.append((gap[inside].max(), gap[~inside].max()))
        assert errors[-1][0] < 1.5 * errors[-1][1]
    assert np.log2(errors[0][0] / errors[1][0]) == pytest.approx(2.0, abs=0.4)


def test_fewer_outputs_are_a_selection_with_the_counts_of_all_their_steps(block):
    every_step = motion(block, sim.FixedStep(0.005))
    fewer = motion(block, sim.FixedStep(0.005), 0.02)
    np.testing.assert_array_equal(fewer["node_position"], every_step["node_position"][..., ::4])
    assert (fewer["steps"].values[1:] == 4).all()
    assert fewer["iterations"].sum() == every_step["iterations"].sum()


def test_divided_steps_are_interpolated_piece_by_piece(block, monkeypatch):
    """An interval of error control is interpolated between the ends of its steps."""
    monkeypatch.setattr(sim.outputs, "STRAIGHT_ACTIVATION", np.inf)
    nodes = np.flatnonzero(block.scene.mesh.X[:, 2] > 0.0)
    fine = motion(block, sim.FixedStep(2.5e-4), 0.005)["node_position"]
    steps = sim.ErrorControlledStep(1e-5, 0.04, nodes)
    trajectory = motion(block, steps, 0.005)
    assert trajectory["steps"].max() > 2
    gap = np.linalg.norm(
        trajectory["node_position"] - fine, axis=trajectory["node_position"].dims.index("axis")
    )
    assert gap.max() < 1e-5


def test_a_duration_of_half_steps_ends_with_a_shorter_one(block):
    whole = motion(block, sim.FixedStep(0.02), 0.01)["node_position"]
    short = motion(block, sim.FixedStep(0.02), 0.01, duration=0.07)["node_position"]
    assert short["time"].values[-1] == pytest.approx(0.07, abs=1e-15)
    np.testing.assert_allclose(short[..., :7], whole[..., :7], atol=1e-13)


@pytest.mark.parametrize(("h", "every", "duration"), [(0.01, 0.004, 0.08), (0.01, 0.01, 0.083)])
def test_instants_that_do_not_fit_are_refused(h, every, duration):
    with pytest.raises(sim.ControlError, match="whole"):
        intervals(0.0, duration, h, every)


# Stress [Pa] for which the cubic inverts an element within a step of 20 ms, but not at its ends.
INVERTING = {"Trapezoidal": 5e4, "Sdirk2": 3e5, "ConvergedEuler": 3e5}


def jerked(sigma_max, integrator, steps, probes, every=0.005):
    """A block whose muscles are fully active after 20 ms, and its motion."""
    system = fixed_block(grid((2, 2, 2)), sim.Constant(sigma_max), sim.NeoHooke(2500.0))
    rise = sim.Activation(np.array([0.0, 0.02]), np.array([[0.0, 0.0], [1.0, 1.0]]))
    simulated, _ = sim.simulate(
        system,
        rise,
        duration=0.08,
        integrator=integrator,
        steps=steps,
        every=every,
        probes=(sim.Positions(), *probes),
    )
    return system, simulated, simulated["node_position"].transpose("time", "node", "axis").values


@pytest.mark.parametrize("name", INVERTING)
@pytest.mark.parametrize(
    "control", [sim.FixedStep(0.02), sim.HalvingStep(0.02), sim.ErrorControlledStep(1.0, 0.02)]
)
def test_no_output_is_inverted_if_the_interpolating_cubic_is(name, control):
    """An element is inverted only between the ends of a step; a step then ends at the output."""
    if name == "Trapezoidal" and isinstance(control, sim.ErrorControlledStep):
        pytest.skip("without an estimate every step is taken in two halves, whose ends are upright")
    integrator = getattr(sim, name)()
    ends = []

    def kept(system, state, *_):
        ends.append(state)
        return ()

    watcher = type("Ends", (), {"variables": lambda self: (), "record": lambda self, *a: kept(*a)})
    system, _, at_ends = jerked(INVERTING[name], integrator, control, (watcher(),), every=0.02)
    cubic = [between(a, b, a.t + 0.005 * k) for a, b in pairwise(ends) for k in (1, 2, 3)]
    assert min(system.smallest_J(state.q)[0] for state in cubic) < 0.0
    assert min(system.smallest_J(q)[0] for q in at_ends) > 0.0

    system, motion, written = jerked(
        INVERTING[name], integrator, control, (sim.SmallestJ(), sim.Iterations())
    )
    least = np.array([system.smallest_J(q)[0] for q in written])
    assert (least > 0.0).all()
    np.testing.assert_array_equal(motion["smallest_J"], least)
    assert motion["rejected"].sum() > 0


@pytest.mark.parametrize("kind", sim.integrators.INTEGRATORS)
@pytest.mark.parametrize("control", [sim.FixedStep, sim.HalvingStep, sim.ErrorControlledStep])
@pytest.mark.parametrize(("h", "every"), [(0.004, 0.001), (0.001, 0.002)])
def test_probes_record_the_stored_state(block, kind, control, h, every):
    """Values at all outputs are those of the recorded positions."""
    if kind.stability == "conditional":
        h, every = 0.01 * h, 0.01 * every
    steps = control(h=h) if control is not sim.ErrorControlledStep else control(1.0, h)
    t = np.array([0.0, 4.0 * max(h, every)])
    drive = sim.Activation(t, np.array([[0.0, 0.2], [1.0, 0.6]]))
    nodes = np.array([26, 25])
    simulated, _ = sim.simulate(
        block,
        drive,
        duration=t[1],
        integrator=kind(),
        steps=steps,
        every=every,
        probes=(
            sim.Positions(),
            sim.Markers(nodes, ("a", "b")),
            sim.SmallestJ(),
            sim.Energies(),
        ),
    )
    written = simulated["node_position"].transpose("time", "node", "axis").values
    for k, q in enumerate(written):
        control_then = block.control(drive.at(simulated["time"].values[k]))
        now = block.force(q, control_then)
        assert simulated["smallest_J"].values[k] == pytest.approx(now.smallest_J, abs=1e-14)
        assert simulated["potential_energy"].values[k] == pytest.approx(now.energy, rel=1e-12)
        np.testing.assert_array_equal(simulated["position"].transpose("time", ...)[k], q[nodes])
    assert np.ptp(simulated["smallest_J"].values) > 0.0


def test_constraints_hold_in_every_output():
    """Volumes of elements are constant also at outputs within the requested steps."""
    mesh, damping = grid((2, 2, 2)), sim.RestRayleigh(19.0, 0.01)
    constant = (sim.HardElementVolume(),)
    system = fixed_block(mesh, sim.Constant(1e4), damping=damping, constraints=constant)
    trajectory = motion(system, sim.FixedStep(0.02), 0.005, integrator=sim.Sdirk2(tolerance=1e-9))
    assert trajectory.attrs["step_s"] == 0.005
    written = trajectory["node_position"].transpose("time", "node", "axis").values
    volume, start = mesh.volumes().mean(), system.rest_state().pose
    missed = [np.abs(system.constraints.evaluate(replace(start, q=q))[0]).max() for q in written]
    assert max(missed) < 1e-8 * volume
    assert np.abs(written[-1] - written[0]).max() > 1e-4


def test_an_opening_has_a_sign_and_goes_through_zero_without_a_jump(block):
    """One node passes next to the other; their distance would not be zero."""
    probe = sim.Opening(26, 0, (0.0, 0.0, 2.0))
    X = block.rest_state().q
    openings = []
    for height in (0.003, 0.001, 0.0, -0.001, -0.003):
        q = X.copy()
        q[26] = q[0] + [0.002, 0.001, height]
        state = sim.State(0.0, q, np.zeros_like(q))
        openings.append(probe.record(block, state, block.control(np.zeros(2)), None)[0])
    np.testing.assert_allclose(openings, [0.003, 0.001, 0.0, -0.001, -0.003], atol=1e-17)
    for direction in ((0.0, 0.0, 0.0), (0.0, np.nan, 1.0), (1.0, 0.0)):
        with pytest.raises(sim.SceneError, match="three numbers that are not all zero"):
            sim.Opening(26, 0, direction)
