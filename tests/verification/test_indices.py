"""Indices of nodes, elements and others: numbers and masks, in every public class that takes them."""

import dataclasses

import numpy as np
import pytest

import sim
import sim.inverse
import sim.joints
from sim.errors import SimulationError
from sim.indices import count_of, index, index_rows, indices, whole_numbers
from tests.bodies import grid

MESH = grid((2, 1, 1), (0.02, 0.01, 0.01))  # 12 nodes, 2 elements
N, M, B = MESH.n_nodes, MESH.n_elements, len(MESH.blocks)
TIME = np.array([0.0, 1.0])
BODY = sim.Body("b", 0.1, 1e-5 * np.eye(3))
SOLID = sim.Solid((sim.Material(sim.MooneyRivlin()),))
#: triangles of the boundary and of a shell
FACES = sim.boundary_surface(MESH).triangles


def compiled(*terms, members=(), mesh=MESH, **more):
    """Forces on moved nodes, and the free unknowns, of a scene with one solid at least."""
    if not any(isinstance(term, sim.Solid) for term in terms):
        terms = (SOLID, *terms)
    system = sim.compile_scene(sim.Scene(mesh, terms, members, **more))
    q = system.rest_state().q
    q = q + 1e-4 * np.sin(np.arange(q.size)).reshape(q.shape)
    control = sim.Control(np.full(len(system.muscles), 0.5))
    return system.force(q, control).f, np.asarray(system.free)


def muscles(element, muscle=None):
    k = count_of(element) if np.ndim(element) else 1
    muscle = np.zeros(k, dtype=int) if muscle is None else muscle
    return sim.Muscles(("m",), element, muscle, np.tile([1.0, 0.0, 0.0], (k, 1)))


def active(element=None, muscle=None):
    element = np.array([0, 1]) if element is None else element
    return sim.Solid(SOLID.materials, muscles=muscles(element, muscle))


def stiffened(element=None, muscle=None):
    element = np.array([0, 1]) if element is None else element
    muscle = np.zeros(count_of(element), dtype=int) if muscle is None else muscle
    return compiled(active(), sim.Stiffening(("m",), element, muscle, SOLID))


def recorded(probe):
    system = sim.compile_scene(sim.Scene(MESH, (SOLID,)))
    return probe.record(system, system.rest_state(), system.control(np.zeros(0)), None)


def target(made):
    return made.value(MESH.X)


def on_points(joint):
    """A joint of a point of a body."""
    points = np.array([[0.05, 0.0, 0.0], [0.06, 0.0, 0.01]])
    attached = sim.OnBody("b", np.array([0, 1]))
    scene = sim.Scene(
        sim.NO_TISSUE, (), (attached,), bodies=(BODY,), points=points, joints=(joint,)
    )
    return sim.compile_scene(scene).rows.table.point


def controlled(nodes):
    """Positions after a step under error control."""
    system = sim.compile_scene(
        sim.Scene(MESH, (SOLID, sim.Gravity()), (sim.Fixed([0, 1, 2, 3]),), sim.RestRayleigh())
    )
    steps = sim.ErrorControlledStep(1e-2, nodes=nodes)
    _, end = sim.simulate(system, sim.resting(0), duration=1e-3, steps=steps, every=1e-3, probes=())
    return end.q


def hard(first, last):
    constraint = sim.HardElementVolume(first, last)
    soft = sim.Solid((sim.Material(sim.MooneyRivlin(), sim.QuadraticBulk(0.0)),))
    scene = sim.Scene(MESH, (soft,), constraints=(constraint,))
    return sim.compile_scene(scene).constraints.n


def three(k):
    return np.tile([0.0, 0.0, 1.0], (k, 1))


def still(x):
    return lambda t: x


def chosen(v):
    """Rest positions that numbers or a mask choose."""
    return MESH.X[np.asarray(v, dtype=None if np.asarray(v).dtype == bool else int)]


#: (class, field): what the scene becomes with a value, a good value, the size, and if masks are allowed
CASES = {
    ("Fixed", "nodes"): (lambda v: compiled(members=(sim.Fixed(v),)), [1, 4, 7], N, True),
    ("Fixed", "axes"): (lambda v: compiled(members=(sim.Fixed([0], v),)), [0, 2], 3, True),
    ("OnBody", "nodes"): (
        lambda v: compiled(members=(sim.OnBody("b", v),), bodies=(BODY,)), [1, 4, 7], N + 1, True
    ),
    ("InElement", "nodes"): (
        lambda v: sim.InElement(v).attach(MESH, {}).nodes, [1, 4, 7], N, True
    ),
    ("PrescribedNodes", "nodes"): (
        lambda v: compiled(members=(sim.PrescribedNodes(v, still(chosen([1, 4, 7]))),)),
        [1, 4, 7], N, True,
    ),
    ("NodeLoad", "nodes"): (
        lambda v: compiled(sim.NodeLoad(v, three(3))), [1, 4, 7], N, True
    ),
    ("Support", "nodes"): (lambda v: compiled(sim.Support(v, three(3))), [1, 4, 7], N, True),
    ("Crushable", "node"): (
        lambda v: compiled(sim.Crushable(v, np.zeros(3), np.array([0.0, 0, 1]))), 3, N, False
    ),
    ("Muscles", "element"): (lambda v: compiled(active(v)), [1], M, True),
    ("Muscles", "muscle"): (lambda v: compiled(active(muscle=v)), [0, 0], 1, False),
    ("Stiffening", "element"): (lambda v: stiffened(v), [1], M, True),
    ("Stiffening", "muscle"): (lambda v: stiffened(muscle=v), [0, 0], 1, False),
    ("Solid", "region"): (
        lambda v: compiled(sim.Solid(SOLID.materials * 2, v)), [0, 1], 2, False
    ),
    ("LineFibre", "muscle"): (
        lambda v: compiled(sim.LineMuscles(("m",), [sim.LineFibre(v, np.array([0, 5]))])),
        0, 1, False,
    ),
    ("LineFibre", "points"): (
        lambda v: compiled(sim.LineMuscles(("m",), [sim.LineFibre(0, v)])), [0, 5, 3], N, False
    ),
    ("AxialSprings", "paths"): (
        lambda v: compiled(sim.AxialSprings((v,), 10.0)), [0, 5, 3], N, False
    ),
    ("OfBlocks", "first"): (lambda v: compiled(sim.OfBlocks(SOLID, v, 1)), 0, 1, False),
    ("OfBlocks", "last"): (lambda v: compiled(sim.OfBlocks(SOLID, 0, v)), 1, B + 1, False),
    ("NodeSurface", "triangles"): (
        lambda v: sim.NodeSurface(v).check(MESH), FACES, N, False
    ),
    ("RigidShell", "triangles"): (lambda v: sim.RigidShell(MESH.X, v), FACES, N, False),
    ("Markers", "nodes"): (
        lambda v: recorded(sim.Markers(v, ("a", "b", "c"))), [1, 4, 7], N, True
    ),
    ("StepErrors", "nodes"): (
        lambda v: recorded(sim.StepErrors(v, ("a", "b", "c"))), [1, 4, 7], N, True
    ),
    ("Opening", "upper"): (lambda v: recorded(sim.Opening(v, 0, (0, 0, 1))), 3, N, False),
    ("Opening", "lower"): (lambda v: recorded(sim.Opening(0, v, (0, 0, 1))), 3, N, False),
    ("PointOnPlane", "point"): (
        lambda v: on_points(sim.joints.PointOnPlane("j", v, None, (0, 0, 0), (0, 0, 1))),
        1, 3, False,
    ),
    ("PointOnCurve", "point"): (
        lambda v: on_points(
            sim.joints.PointOnCurve(
                "j", v, None, (0.0, 0, 0), (0.0, 0, 1), (1.0, 0, 0), np.zeros(4), (0.0, 1.0)
            )
        ),
        1, 3, False,
    ),
    ("PointTarget", "nodes"): (
        lambda v: target(sim.inverse.PointTarget(v, TIME, np.zeros((2, 3, 3)))),
        [1, 4, 7], N, False,
    ),
    ("SeparationTarget", "upper"): (
        lambda v: target(sim.inverse.SeparationTarget(v, [0], TIME, np.zeros(2))),
        [1, 4, 7], N, False,
    ),
    ("SeparationTarget", "lower"): (
        lambda v: target(sim.inverse.SeparationTarget([0], v, TIME, np.zeros(2))),
        [1, 4, 7], N, False,
    ),
    ("ErrorControlledStep", "nodes"): (lambda v: controlled(v), [1, 4, 7], N, True),
    ("HardElementVolume", "first"): (lambda v: hard(v, 1), 0, 1, False),
    ("HardElementVolume", "last"): (lambda v: hard(0, v), 1, B + 1, False),
    ("AreaTarget", "nodes"): (
        lambda v: target(sim.inverse.AreaTarget(v, TIME, np.zeros(2))), [1, 4, 7], N, False
    ),
}  # fmt: skip
#: fields with indices that the package computes
RESULTS = {("Embedding", "element"), ("Embedding", "nodes")}
NAMES = {
    "node", "nodes", "point", "points", "element", "muscle", "region", "triangles", "upper",
    "lower", "first", "last", "paths", "axes",
}  # fmt: skip
#: of those names, fields that are numbers of another kind
OTHERS = {
    ("Limit", "upper"), ("Limit", "lower"), ("Scene", "points"), ("Solid", "axes"), ("Row", "axes"),
    ("Row", "point"),
}  # fmt: skip


def public_classes():
    for package in (sim, sim.joints, sim.inverse):
        for name in package.__all__:
            value = getattr(package, name)
            if dataclasses.is_dataclass(value) and isinstance(value, type):
                yield value


def test_every_public_class_with_indices_is_tested():
    classes = {
        (cls.__name__, field.name)
        for cls in public_classes()
        for field in dataclasses.fields(cls)
        if "int64" in str(field.type) or field.name in NAMES
    }
    assert classes - RESULTS - OTHERS == set(CASES)


def same(one, other):
    one, other = (x if isinstance(x, tuple) else (x,) for x in (one, other))
    for a, b in zip(one, other, strict=True):
        if a is not None and not isinstance(a, sim.RigidShell):
            np.testing.assert_array_equal(np.asarray(a), np.asarray(b))


@pytest.mark.parametrize("case", CASES, ids=".".join)
def test_numbers_lists_whole_floats_and_masks_mean_the_same(case):
    make, good, n, masks = CASES[case]
    values = np.asarray(good)
    expected = make(values)
    same(make(values.astype(float)), expected)
    same(make(values.astype(np.uint8)), expected)
    if values.ndim == 1:
        same(make(list(good)), expected)
    if masks:
        mask = np.zeros(n, dtype=bool)
        mask[values] = True
        same(make(mask), expected)


@pytest.mark.parametrize("case", CASES, ids=".".join)
def test_what_are_no_indices_is_refused(case):
    make, good, n, masks = CASES[case]
    values = np.asarray(good)

    def spoilt(value, dtype=None):
        out = np.array(values, dtype=dtype or values.dtype)
        out.reshape(-1)[-1] = value
        return out

    wrong = {
        "fraction": spoilt(0.5, float),
        "NaN": spoilt(np.nan, float),
        "negative": spoilt(-1),
        "too large": spoilt(n),
        "huge": spoilt(1e300, float),
        "text": spoilt("a", object),
    }
    if values.ndim:
        wrong["long mask"] = np.arange(n + 2) < len(values)
        if masks:
            wrong["short mask"] = np.arange(n - 2 if n > 2 else n + 1) < len(values)
        wrong["a column"] = values.reshape(-1, 1) if values.ndim == 1 else values[..., None]
    for name, value in wrong.items():
        with pytest.raises(SimulationError) as raised:
            make(value)
            pytest.fail(name)
        assert "expected" in str(raised.value), name


def test_masks_of_the_mesh_leave_points_of_bodies_out():
    """With bodies a scene has more points than the mesh."""
    lower = MESH.X[:, 2] < 1e-9
    for part in (sim.NodeLoad(lower, three(6)), sim.Support(lower, three(6))):
        numbered = dataclasses.replace(part, nodes=np.flatnonzero(lower))
        same(compiled(part, bodies=(BODY,)), compiled(numbered, bodies=(BODY,)))
    fixed = compiled(members=(sim.Fixed(lower),), bodies=(BODY,))
    same(fixed, compiled(members=(sim.Fixed(np.flatnonzero(lower)),), bodies=(BODY,)))


def test_masks_that_are_cast_no_longer_fix_nodes_0_and_1():
    """A mask of the nodes at the lower end fixes these nodes."""
    lower = MESH.X[:, 2] < 1e-9
    system = sim.compile_scene(sim.Scene(MESH, (SOLID,), (sim.Fixed(lower),)))
    free = np.unique(np.asarray(system.free) // 3)
    np.testing.assert_array_equal(free, np.flatnonzero(~lower))


CONNECTIVITY = {
    "floats that are not whole": [[0.5, 1, 2, 3]],
    "a mask": [[True, True, False, True]],
    "seven nodes": [[0, 1, 2, 3, 0, 1, 2]],
    "a flat list": [0, 1, 2, 3],
    "a negative node": [[0, 1, 2, -1]],
    "a node too many": [[0, 1, 2, 4]],
}


@pytest.mark.parametrize("name", CONNECTIVITY)
def test_connectivity_that_is_none_is_refused(name):
    X = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    sim.mesh_from_arrays(X, tet4=np.array([[0.0, 1, 2, 3]]))
    with pytest.raises(sim.MeshError, match="expected"):
        sim.mesh_from_arrays(X, tet4=CONNECTIVITY[name])


def test_a_block_with_other_arrays_is_refused():
    X = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    kind = sim.mesh_from_arrays(X, tet4=[[0, 1, 2, 3]]).blocks[0].kind
    from sim.mesh import Block  # noqa: PLC0415

    for nodes in (np.array([[0.0, 1, 2, 3]]), np.array([0, 1, 2, 3])):
        with pytest.raises(sim.MeshError, match="expected whole numbers"):
            sim.Mesh(X, (Block(kind, nodes),))


SHAPES = {
    "PrescribedNodes": lambda: sim.PrescribedNodes([0, 1], still(np.zeros((1, 3)))),
    "PrescribedNodes of one": lambda: sim.PrescribedNodes([0, 1], still(np.zeros(3))),
    "OnBody": lambda: sim.OnBody("b", [0, 1], np.zeros((1, 3))),
}


@pytest.mark.parametrize("name", SHAPES)
def test_positions_that_would_be_broadcast_are_refused(name):
    with pytest.raises(sim.SceneError, match=r"expected \(2, 3\)"):
        compiled(members=(SHAPES[name](),), bodies=(BODY,))


TERMS = {
    "NodeLoad": lambda: sim.NodeLoad([0, 1], np.zeros((1, 3))),
    "Support": lambda: sim.Support([0, 1], three(1)),
    "Gravity": lambda: sim.Gravity((9.8,)),
    "Muscles": lambda: sim.Solid(muscles=sim.Muscles(("m",), [0, 1], [0, 0], np.ones((1, 3)))),
    "region": lambda: sim.Solid(SOLID.materials * 2, [1]),
    "prestretch": lambda: sim.Solid(prestretch=np.eye(3)[None]),
    "kappa": lambda: sim.ElementVolume(np.array([1e4])),
    "rest lengths": lambda: sim.AxialSprings(([0, 1], [2, 3]), 1.0, rest=np.array([0.1])),
}


@pytest.mark.parametrize("name", TERMS)
def test_arrays_of_another_length_are_refused(name):
    with pytest.raises(sim.SceneError, match="expected|for 2"):
        compiled(TERMS[name]())


@pytest.mark.parametrize("law", [sim.Rayleigh, sim.PassiveRayleigh, sim.RestRayleigh])
@pytest.mark.parametrize("name", ["alpha", "beta"])
@pytest.mark.parametrize("n", [1, N - 1, N + 3])
def test_damping_of_another_number_of_nodes_is_refused(law, name, n):
    with pytest.raises(sim.SceneError, match=f"expected {N}, one per node"):
        compiled(damping=law(**{name: np.ones(n)}))
    compiled(damping=law(**{name: [1.0] * N}))


@pytest.mark.parametrize("values", [[], [[1.0]], [1.0, np.nan], [np.inf, 1.0], [-1.0, 1.0]])
def test_damping_that_is_no_number_is_refused(values):
    with pytest.raises(sim.SceneError, match="expected"):
        sim.RestRayleigh(alpha=np.array(values))


def test_one_function_checks():
    np.testing.assert_array_equal(indices("a", "node", [True, False, True], 3), [0, 2])
    np.testing.assert_array_equal(indices("a", "node", [], 3), np.empty(0))
    np.testing.assert_array_equal(whole_numbers("a", "code", [[-1.0, 3.0]]), [[-1, 3]])
    assert index("a", "node", np.float64(2.0), 3) == 2
    assert index_rows("a", "node", [], 3, 4).shape == (0, 4)
    with pytest.raises(sim.SceneError, match="place 1 is no whole number"):
        indices("a", "node", [0.0, 1.5], 3)
    with pytest.raises(sim.SceneError, match="a refers to node 7, expected 0..2 .at place 2"):
        indices("a", "node", [0, 1, 7], 3)
    with pytest.raises(sim.SceneError, match="one per node"):
        indices("a", "node", [True, False], 3)
