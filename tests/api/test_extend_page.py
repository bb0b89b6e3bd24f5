"""The parts of docs/extend.md are executed, and do what the page says."""

import math
import re

import numpy as np
import pytest

import sim
from sim.kinematics import rotations
from tests.bodies import grid

SHORT = 40  #: most lines of an example


@pytest.fixture(scope="module")
def parts(root):
    """Names that the examples define."""
    page = (root / "docs" / "extend.md").read_text()
    examples = re.findall(r"^( *)```python\n(.*?)^ *```", page, re.M | re.S)
    assert len(examples) >= 5
    names = {"inner": lambda f: f, "math": math}
    for indent, text in examples:
        lines = [line.removeprefix(indent) for line in text.splitlines()]
        assert len(lines) <= SHORT
        exec("\n".join(lines), names)  # the page is part of the package
    return names


def block(*constraints, **more):
    mesh = grid((2, 1, 2), (0.02, 0.01, 0.02))
    terms = sim.Solid(), sim.Gravity(), *more.pop("terms", ())
    return sim.compile_scene(sim.Scene(mesh, terms, constraints=constraints, **more))


def end_of(system, integrator, duration, steps, initial=None):
    h = duration / steps
    about = {"integrator": integrator, "steps": sim.FixedStep(h), "every": duration}
    motion = sim.simulate(system, sim.resting(0), duration=duration, initial=initial, **about)
    return motion[1]


def test_law(parts):
    """Slope and curvature are the derivatives of the energy."""
    law, p, h = parts["exponential"], (2e3, 1.5), 1e-5
    for I1 in (3.0, 3.4):
        below, here, above = (law(p, I1 + d) for d in (-h, 0.0, h))
        assert (above[0] - below[0]) / (2 * h) == pytest.approx(here[1], rel=1e-6)
        assert (above[1] - below[1]) / (2 * h) == pytest.approx(here[2], rel=1e-6)


def test_term(parts):
    """Tissue on a bed sinks by m g/k in total, in every kind of step."""
    system = block(terms=(parts["MyBed"](10.0),))
    control, q = system.control(np.zeros(0)), system.mesh.X + 1e-4
    here, K = system.tangent(q, control)
    way, h = np.random.default_rng(0).normal(size=q.shape), 1e-7
    ends = [system.force(q + s * h * way, control) for s in (1.0, -1.0)]
    slope = (ends[0].energy - ends[1].energy) / (2.0 * h)
    assert slope == pytest.approx(-float((here.f * way).sum()), rel=1e-6)
    state, _ = sim.Static().step(
        system,
        system.rest_state(),
        control,
        1.0,
        sim.Workspace(system),
    )
    sunk = float((state.q - system.mesh.X)[:, 2].sum())
    assert sunk == pytest.approx(-9.8 * system.node_mass.sum() / 10.0, rel=1e-6)


@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler(), sim.Sdirk2()])
def test_joint(parts, integrator):
    """The body swings about x and y, and does not turn about z."""
    inertia = np.diag([2e-4, 3e-4, 1e-4])
    bob = sim.Body("bob", 0.2, inertia, (0.03, 0.01, -0.1))
    joint = parts["MyUniversal"]("cardan", None, "bob", (0.0, 0.0, 0.0))
    system = sim.compile_scene(
        sim.Scene(sim.NO_TISSUE, (sim.Gravity(),), bodies=(bob,), joints=(joint,))
    )
    state = end_of(system, integrator, 0.1, 20)
    assert np.abs(state.frames[0, :3] - system.rest_state().frames[0, :3]).max() > 5e-3
    assert np.abs(system.rows.evaluate(state.pose).c).max() < 1e-9
    R = rotations.matrices(state.frames[:, 3:])[0]
    assert abs(R[0, 1]) < 1e-9  # x of space, y of the body
    assert np.abs(R - np.eye(3)).max() > 0.01


def test_method(parts):
    """The order is 2."""
    fixed = sim.Fixed(np.flatnonzero(grid((2, 1, 2), (0.02, 0.01, 0.02)).X[:, 0] == 0.0))
    system = block(reductions=(fixed,))
    method = parts["MyMidpoint"](tolerance=1e-12, residual_tolerance=1e-11)
    ends = [end_of(system, method, 0.01, n).q for n in (10, 20, 40)]
    d = [np.abs(b - a).max() for a, b in zip(ends, ends[1:], strict=False)]
    assert abs(np.log2(d[0] / d[1]) - 2.0) < 0.1


@pytest.mark.parametrize("integrator", [sim.LinearlyImplicitEuler(), sim.Sdirk2()])
def test_rows(parts, integrator):
    """A block falls until the link of its corner is tense, which it remains."""
    system = block(parts["MyLink"](0, (0.05, 0.0, 0.0)))
    state = end_of(system, integrator, 0.05, 25)
    length = np.linalg.norm(state.q[0] - [0.05, 0.0, 0.0])
    assert np.abs(state.q[0] - system.mesh.X[0]).max() > 5e-3
    assert length == pytest.approx(np.linalg.norm(system.mesh.X[0] - [0.05, 0.0, 0.0]), abs=1e-6)
