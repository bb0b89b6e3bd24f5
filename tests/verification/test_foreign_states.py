"""States belong to their scene: foreign ones are refused, those of the same recipe accepted."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import sim
from sim.recipe import digest, digest_of, names_of
from sim.terms.of_blocks import OfBlocks
from tests.bodies import crossed_muscles, grid
from tests.kinematics.scenes import INERTIA, swing

MESH = grid((2, 1, 1), (0.02, 0.01, 0.01))


def path(t):
    return MESH.X[[11]] + [0.0, 0.0, 1e-3 * t]


def scene(**more) -> sim.Scene:
    parts = {
        "law": sim.MooneyRivlin(), "density": 1040.0, "g": (0.0, 0.0, -9.8), "alpha": 19.0,
        "fixed": [0, 3], "path": path, "order": 1, "mass": 0.1, "kappa": 25e3, "X": MESH,
    } | more  # fmt: skip
    material = sim.Material(parts["law"], density=parts["density"])
    mesh = parts["X"]
    solid = sim.Solid((material,), muscles=crossed_muscles(mesh))
    terms = (solid, sim.ElementVolume(parts["kappa"]), sim.Gravity(parts["g"]))
    members = (sim.Fixed(parts["fixed"]), sim.PrescribedNodes([11], parts["path"]))
    body = sim.Body("b", parts["mass"], INERTIA)
    order = parts["order"]
    return sim.Scene(
        mesh, terms[::order], members[::order], sim.RestRayleigh(parts["alpha"]), bodies=(body,)
    )


def ran(system, initial=None):
    return sim.simulate(
        system,
        sim.resting(len(system.muscles)),
        duration=0.002,
        steps=sim.FixedStep(1e-3),
        every=1e-3,
        integrator=sim.LinearlyImplicitEuler(),
        initial=initial,
        probes=(),
    )[1]


@pytest.fixture(scope="module")
def state():
    return ran(sim.compile_scene(scene()))


def other_path(t):
    return MESH.X[[11]] + [0.0, 0.0, 2e-3 * t]


def moved_by(speed):
    return lambda t: MESH.X[[11]] + [0.0, 0.0, speed * t]


FOREIGN = {
    "law": sim.NeoHooke(), "density": 1041.0, "g": (0.0, 0.0, 9.8), "alpha": 20.0, "fixed": [0, 4],
    "path": other_path, "mass": 0.2, "kappa": 26e3, "X": grid((2, 1, 1), (0.02, 0.01, 0.011)),
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_a_state_of_another_scene_is_refused(state, name):
    with pytest.raises(sim.SceneError, match="belongs to another scene"):
        ran(sim.compile_scene(scene(**{name: FOREIGN[name]})), state)


def test_positions_and_velocities_alone_fit_every_scene(state):
    system = sim.compile_scene(scene(density=1041.0))
    bare = sim.State(state.t, state.q, state.v, frames=state.frames, twists=state.twists)
    assert ran(system, bare).t == pytest.approx(0.004)


def test_a_damaged_file_is_no_other_state(tmp_path, state):
    """Bytes that are lost, changed or never written: refused, or without influence."""
    file, rng = tmp_path / "state.nc", np.random.default_rng(0)
    sim.save_state(state, file)
    whole = file.read_bytes()
    ends = np.linspace(0, len(whole) - 1, 40).astype(int)
    damaged = [whole[:n] for n in ends] + [whole[:n] + bytes(len(whole) - n) for n in ends]
    for at in rng.integers(len(whole), size=150):
        damaged.append(whole[:at] + bytes([whole[at] ^ 1 << rng.integers(8)]) + whole[at + 1 :])
    refused = 0
    for content in damaged:
        file.write_bytes(content)
        try:
            again = sim.read_state(file)
        except sim.SceneError:
            refused += 1
            continue
        assert again.t == state.t and list(again.memory) == list(state.memory)
        for name in ("q", "v", "frames", "twists"):
            np.testing.assert_array_equal(getattr(again, name), getattr(state, name))
        for name, array in state.memory.items():
            np.testing.assert_array_equal(again.memory[name], array)
    assert refused > 80


@pytest.mark.parametrize("t", [np.nan, np.inf])
def test_a_state_without_a_time_is_refused(state, t):
    with pytest.raises(sim.SceneError, match="time of the initial state"):
        ran(sim.compile_scene(scene()), replace(state, t=t))


@pytest.mark.parametrize("name", ["q", "v", "frames", "twists"])
def test_states_of_another_size_are_refused(state, name):
    wrong = replace(state, **{name: getattr(state, name)[:-1]})
    with pytest.raises(sim.SceneError, match=f"has {name} of shape"):
        ran(sim.compile_scene(scene()), wrong)


def test_the_same_recipe_is_accepted_whatever_the_order(state):
    again = ran(sim.compile_scene(scene()), state)
    other = ran(sim.compile_scene(scene(order=-1)), state)
    np.testing.assert_allclose(other.q, again.q, rtol=0.0, atol=1e-12)
    same = {"density": 1040, "g": [0, 0, -9.8], "fixed": np.array([0, 3])}
    assert digest_of(scene(**same)) == digest_of(scene())


def test_the_same_recipe_is_accepted_in_another_process(tmp_path, state):
    sim.save_state(state, tmp_path / "state.nc")
    code = (
        "import sim; from tests.verification.test_foreign_states import ran, scene;"
        f"state = sim.read_state({str(tmp_path / 'state.nc')!r});"
        "end = ran(sim.compile_scene(scene()), state); print(end.q.tobytes().hex())"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    here = ran(sim.compile_scene(scene()), state)
    assert done.stdout.split()[-1] == here.q.tobytes().hex()


def test_functions_count_by_their_code_and_what_they_enclose():
    assert digest(moved_by(1e-3)) == digest(moved_by(1e-3))
    assert digest(moved_by(1e-3)) != digest(moved_by(2e-3))
    assert digest(swing) != digest(path)


def test_neighbours_are_not_confused():
    assert digest(("ab", "c")) != digest(("a", "bc"))
    assert digest([1, [2]]) != digest([1, 2])
    assert digest(np.zeros((2, 3))) != digest(np.zeros((3, 2)))
    assert digest(1) == digest(1.0) == digest(np.float64(1.0)) != digest("1")
    assert digest({"a": 1, "b": 2}) == digest({"b": 2, "a": 1})


def test_terms_are_named_by_type_and_content():
    one, two = sim.Gravity(), sim.Gravity((0.0, 0.0, 1.0))
    solid = sim.Solid()
    names = dict(zip((id(p) for p in (one, two, solid)), names_of((one, two, solid)), strict=True))
    turned = names_of((solid, two, one))
    assert turned == [names[id(solid)], names[id(two)], names[id(one)]]
    assert names[id(solid)] == "Solid[0]"


def test_terms_with_labels_are_named_by_them():
    """In a mesh of several parts, terms of one type are distinguished by their blocks."""
    parts = [OfBlocks(sim.ElementVolume(), k, k + 1) for k in (1, 0)]
    assert names_of((*parts, sim.ElementVolume(), parts[0])) == [
        "ElementVolume of blocks 1-1[0]",
        "ElementVolume of blocks 0-0[0]",
        "ElementVolume[0]",
        "ElementVolume of blocks 1-1[1]",
    ]
