"""Numbers of the parts of a scene and of simulations: real and whole, in every public class."""

import dataclasses
import re
from typing import Any, cast

import numpy as np
import pytest

import sim
import sim.inverse
import sim.joints
from sim.checks import many, number, types_of, whole
from sim.errors import ControlError, MeshError, SceneError, SimulationError
from tests.bodies import grid

#: classes whose numbers the package computes, or that check them by their shapes
COMPUTED = {
    "Activation", "Control", "Embedding", "Fit", "Line", "LinearTargets", "Linearised", "Mesh",
    "Minimum", "Quadratic", "Response", "Row", "State", "StepReport", "System",
}  # fmt: skip


def numeric_fields():
    for package in (sim, sim.joints, sim.inverse):
        for name in package.__all__:
            cls = getattr(package, name)
            if not (dataclasses.is_dataclass(cls) and isinstance(cls, type)) or name in COMPUTED:
                continue
            for field in dataclasses.fields(cls):
                types = types_of(field.type)
                if field.init and any(t in (float, int) or many(t) for t in types):
                    yield cls, field.name, types


FIELDS = list(numeric_fields())


def valid(cls, types):
    """A value of the type of a number, or None for fields that are checked later."""
    if float in types or int in types:
        return 1
    for t in types:
        if many(t):
            return np.ones(max(len(getattr(t, "__args__", ())), 1))
    return None


def with_one(cls, name, value):
    """The class with a value; other fields have their defaults, and numbers if they have none."""
    given = {
        field.name: valid(cls, types_of(field.type))
        for field in dataclasses.fields(cls)
        if field.init
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    }
    return cls(**{**given, name: value})


def test_many_classes_are_walked():
    assert len({cls for cls, _, _ in FIELDS}) > 50 and len(FIELDS) > 150


@pytest.mark.parametrize(
    ("cls", "name", "types"), FIELDS, ids=[f"{c.__name__}.{n}" for c, n, _ in FIELDS]
)
def test_what_is_no_real_number_is_refused_by_name(cls, name, types):
    wrong = [True, np.True_, "1", 1j, [[1.0], [1.0, 2.0]], {"a": 1.0}, np.datetime64("2020-01-01")]
    if float in types or int in types:
        wrong += [np.nan]
    else:
        wrong += [np.array([True, False, True]), ["a", "b", "c"], np.array([1j, 0, 0])]
    if type(None) not in types:
        wrong.append(None)
    for value in wrong:
        with pytest.raises(SimulationError, match=name) as raised:
            with_one(cls, name, value)
        assert "expected" in str(raised.value)


@pytest.mark.parametrize(
    ("cls", "name", "types"), FIELDS, ids=[f"{c.__name__}.{n}" for c, n, _ in FIELDS]
)
def test_numbers_of_all_kinds_pass_the_check_of_their_type(cls, name, types):
    """Whatever else a class refuses, it does not call a NumPy number or an integer no number."""
    values = [1, np.int64(1), np.float32(1.0), np.array(1.0), np.uint8(1)]
    for value in (
        values if float in types or int in types else [[1, 0, 0], np.array([1, 0, 0], "f4")]
    ):
        try:
            with_one(cls, name, value)
        except Exception as error:
            message = str(error)
            refused = f": {name} = " in message and re.search(
                "expected (a real|real|a whole)", message
            )
            assert not refused, message


def test_number_and_whole():
    assert number("p", "x", np.float32(0.5)) == 0.5 and number("p", "x", -np.inf) == -np.inf
    assert whole("p", "n", 3.0, least=3) == 3
    for bad in (2.5, np.inf, -1, True, None, "2"):
        with pytest.raises(ControlError, match=r"p: n = "):
            whole("p", "n", bad, error=ControlError)


@pytest.fixture(scope="module")
def system():
    mesh = grid((1, 1, 1), (0.01, 0.01, 0.01))
    solid = sim.Solid((sim.Material(sim.MooneyRivlin()),))
    return sim.compile_scene(sim.Scene(mesh, (solid,), (sim.Fixed(np.arange(4)),)))


@pytest.mark.parametrize(
    ("name", "values"),
    {
        "duration": ["1", None, True, np.nan, np.inf, -1.0, 1j, [0.1], np.timedelta64(1, "s")],
        "every": ["1", True, np.nan, np.inf, 0.0, [0.1]],
        "checkpoint": [2.5, True, "2", 0, -1, [2]],
        "solver_threads": [2.5, True, None, "2", 0, -1],
        "probes": [sim.Energies(), (5,), sim.Energies, (sim.Energies,), "ab", 3, None],
    }.items(),
)
def test_arguments_of_simulations_of_another_type_are_refused_by_name(system, name, values):
    for value in values:
        given = {"duration": 0.02, name: value}
        with pytest.raises((ControlError, SceneError), match=name):
            sim.simulate(system, sim.resting(0), **given)


def test_a_scene_or_recording_in_place_of_system_and_activation_is_refused(system):
    with pytest.raises(SceneError, match="system is a tuple"):
        sim.simulate(cast(Any, (system,)), sim.resting(0), duration=0.01)
    with pytest.raises(SceneError, match="activation is a list"):
        sim.simulate(system, cast(Any, [0.0]), duration=0.01)


def test_an_element_may_not_be_repeated_in_any_order_or_block():
    mesh = grid((2, 1, 1), (0.02, 0.01, 0.01))
    cells = mesh.blocks[0].nodes
    turned = cells[0][[1, 2, 3, 0, 5, 6, 7, 4]]  # the same hexahedron from its second corner
    for repeated in (cells[0], turned):
        with pytest.raises(MeshError, match="elements 0 and 2 have the same nodes"):
            sim.mesh_from_arrays(mesh.X, hex8=np.concatenate([cells, repeated[None]]))
    twice = sim.mesh_from_arrays(mesh.X, hex8=cells).blocks[0]
    with pytest.raises(MeshError, match="same nodes"):
        sim.Mesh(mesh.X, (twice, dataclasses.replace(twice, nodes=cells[1:])))
