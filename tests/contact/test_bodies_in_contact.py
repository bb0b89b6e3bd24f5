"""Contact of rigid bodies with obstacles, each other and tissue, against closed forms."""

import numpy as np
import pytest

import sim
from benchmarks.stability.rigid_rows import G, bodies_in_contact, cuboid, plate_on_tissue, tower
from sim.contact import body_surfaces
from sim.contact.cone import Blocks, forces
from sim.contact.step import ContactStep
from sim.integrators import contact_stage
from sim.integrators.linear_rows import LinearRows
from sim.integrators.rows_of_step import RowsOfStep, dense
from sim.joints import Planar, Revolute
from tests.bodies import grid, rotation
from tests.contact.scenes import box, square

FLOOR = box([-0.5, -0.5, -0.05], [0.5, 0.5, 0.0])
FLOOR_BELOW = box([-0.5, -0.5, -0.06], [0.5, 0.5, -0.01])


def ball(name, radius, centre, pole=(1.0, 0.0, 0.0)):
    """Body of an octahedron refined twice, with a vertex at the pole."""
    X = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
    faces = np.array([[a, b, c] for a in (0, 1) for b in (2, 3) for c in (4, 5)])
    faces = np.array([f if np.linalg.det(X[f]) > 0.0 else f[::-1] for f in faces])
    for _ in range(2):
        new = []
        for a, b, c in faces:
            middle = [X[i] + X[j] for i, j in ((a, b), (b, c), (c, a))]
            k = len(X) + np.arange(3)
            X = np.vstack([X, [m / np.linalg.norm(m) for m in middle]])
            new += [[a, k[0], k[2]], [b, k[1], k[0]], [c, k[2], k[1]], k]
        X, inverse = np.unique(np.round(X, 12), axis=0, return_inverse=True)
        faces = inverse[np.array(new)]
    axis = np.asarray(pole)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= np.linalg.norm(side)
    X = X @ np.stack([axis, side, np.cross(axis, side)]) * radius + np.asarray(centre)
    return sim.body_of_surface(name, X, faces, 1000.0), X, faces


def scene(parts, pairs, gravity=(0.0, 0.0, -G), friction=0.0, **more) -> sim.System:
    return sim.compile_scene(bodies_in_contact(parts, pairs, gravity, friction, **more))


def moved(system, h, steps, twists=None, initial=None, integrator=None):
    """States of some steps, from rest or with twists of all bodies."""
    state = initial or system.rest_state()
    if twists is not None:
        state = system.kinematics.state(state.pose, np.ravel(twists).astype(float), {})
    work, control = sim.Workspace(system), system.control(np.zeros(0))
    states = [state]
    for _ in range(steps):
        stepped = (integrator or sim.LinearlyImplicitEuler()).step(
            system, states[-1], control, h, work
        )
        states.append(stepped[0])
    return states


def test_rows_that_an_indefinite_matrix_cannot_close_are_reported():
    """A force pulls the row on which it acts further in."""
    one = Blocks(np.empty(0, np.int64), np.array([0]), np.zeros(1))
    assert forces(np.array([[-2.0]]), np.array([-0.5]), one, np.zeros(1), 1e-12)[1] == 0.5
    assert forces(np.array([[2.0]]), np.array([-0.5]), one, np.zeros(1), 1e-12)[1] == 0.0


def test_a_penetration_that_no_forces_can_remove_is_reported():
    """The matrix of tissue that has lost its stability may move rows against their forces."""
    system = scene([cuboid("block", (0.02, 0.02, 0.01))], [("block", FLOOR)])
    start = system.rest_state()
    step = ContactStep(system.contact, start, 0.01)
    pose = system.kinematics.advance(start.pose, np.array([0.0, 0.0, -1e-4, 0.0, 0.0, 0.0]), 0.01)
    near = step.at(pose.q)
    assert near.gaps(pose.q - start.q).min() < -0.9e-4

    def rows(sign):
        return RowsOfStep(
            system, step, lambda r: sign * r, lambda G: sign * (G @ G.T).toarray(), 1.0
        )

    out, near_out = rows(1.0).remove_penetration(pose, near)
    assert near_out.gaps(out.q - start.q).min() > -step.tolerances.noticed
    with pytest.raises(sim.NotConverged, match="contact forces did not converge"):
        rows(-1.0).remove_penetration(pose, near)


def test_a_row_that_another_contact_closes_acts_in_the_same_step():
    """A bar that one end stops turns faster, so that its other end lands where it would not have."""
    _, X, faces = cuboid("bar", (0.1, 0.01, 0.002))
    ends = 1e-4, 1.2e-3  # heights of the lower edges on the left and on the right [m]
    X = X @ rotation_y((ends[0] - ends[1]) / 0.1).T
    X[:, 2] += ends[0] - X[:, 2].min()
    bar = sim.body_of_surface("bar", X, faces, 1000.0), X, faces
    system = scene([bar], [("bar", FLOOR)], (0.0, 0.0, 0.0))
    h, v = 5e-3, np.array([0.0, 0.0, -0.2, 0.0, 0.0, 0.0])
    left, right = (-z / h for z in ends)  # speeds with which the ends reach the floor
    assert right < v[2] < left  # the free motion closes one of them
    motion = moved(system, h, 1, v)[-1].twists[0]
    expected = [0.0, 0.0, 0.5 * (left + right), 0.0, (left - right) / 0.1, 0.0]
    np.testing.assert_allclose(motion, expected, atol=5e-3)
    # with a force on the left end alone the right one would land at 1.45 of the speed
    assert motion[2] - 0.05 * motion[4] == pytest.approx(right, abs=2e-4)


def rotation_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


CONVERGED = [sim.ConvergedEuler, sim.Sdirk2]
EULER_AND_CONVERGED = [sim.LinearlyImplicitEuler, *CONVERGED]


def momentum(system, state):
    """Linear momentum (3,), and angular momentum (3,) about the origin."""
    linear, angular = np.zeros(3), np.zeros(3)
    for body, frame, twist in zip(system.scene.bodies, state.frames, state.twists, strict=True):
        Q = sim.kinematics.rotations.matrices(frame[None, 3:])[0]
        p = body.mass * twist[:3]
        linear += p
        angular += np.cross(frame[:3], p) + Q @ body.inertia @ Q.T @ twist[3:]
    return linear, angular


def on_an_incline(degrees, friction, integrator):
    """Block on an incline after 0.05 s, and its acceleration."""
    a = np.radians(degrees)
    gravity = (G * np.sin(a), 0.0, -G * np.cos(a))
    system = scene([cuboid("block", (0.02, 0.02, 0.01))], [("block", FLOOR)], gravity, friction)
    end = moved(system, 0.005, 10, integrator=integrator)[-1]
    return end, max(0.0, G * (np.sin(a) - friction * np.cos(a)))


@pytest.mark.parametrize("integrator", EULER_AND_CONVERGED)
@pytest.mark.parametrize(("friction", "degrees"), [(0.0, 30.0), (0.5, 20.0), (0.5, 35.0)])
def test_a_block_on_an_incline_sticks_or_slides_as_coulomb_says(friction, degrees, integrator):
    """a = g (sin - mu cos) above the friction angle, rest below it: exact in every step."""
    end, expected = on_an_incline(degrees, friction, integrator())
    np.testing.assert_allclose(end.twists[0], [0.05 * expected, 0, 0, 0, 0, 0], atol=2e-9)
    np.testing.assert_allclose(end.frames[0, 2], 0.005, atol=1e-12)


@pytest.mark.parametrize("slope", [0.49, 0.51])
def test_a_slender_block_tips_where_its_centre_passes_the_edge(slope):
    """Width over height 0.5 and friction 1: it stands below the slope of 0.5 and tips above."""
    a = np.arctan(slope)
    gravity = (G * np.sin(a), 0.0, -G * np.cos(a))
    block = cuboid("block", (0.01, 0.01, 0.02))
    system = scene([block], [("block", FLOOR)], gravity, 1.0)
    t, n = 0.02, 20
    end = moved(system, t / n, n)[-1]
    if slope < 0.5:
        np.testing.assert_allclose(end.twists, 0.0, atol=1e-9)
        return
    # about the lower edge: I theta'' = m g (lever + rise theta) for small angles
    body, mass = block[0], block[0].mass
    about = body.inertia[1, 1] + mass * (0.005**2 + 0.01**2)
    lever = 0.01 * np.sin(a) - 0.005 * np.cos(a)
    rate = np.sqrt(mass * G * (0.01 * np.cos(a) + 0.005 * np.sin(a)) / about)
    expected = mass * G * lever / about * np.sinh(rate * t) / rate
    assert end.twists[0, 4] == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("integrator", EULER_AND_CONVERGED)
@pytest.mark.parametrize("offset", [0.0, 0.006])
def test_spheres_that_collide_keep_momentum_and_exchange_it_symmetrically(offset, integrator):
    """Two equal spheres; a perfectly inelastic impact, angular momentum to first order of the step.

    Head-on both stop. Off the centre each keeps its tangential velocity, as exactly as the normal of
    plane faces, which meet at 23 degrees, agrees with that of a sphere.
    """
    radius = 0.01
    normal = np.array([np.sqrt(4 * radius**2 - offset**2), offset, 0.0]) / (2 * radius)
    centre = 2 * radius * normal
    first = ball("a", radius, (0.0, 0.0, 0.0), normal)
    second = ball("b", radius, centre + 0.0031 * np.array([1.0, 0.0, 0.0]), -normal)
    system = scene([first, second], [("a", "b")], None)
    start = [[0.5, 0, 0, 0, 0, 0], [-0.5, 0, 0, 0, 0, 0]]
    states = moved(system, 0.0005, 20, start, integrator=integrator())
    before, after = (momentum(system, states[k]) for k in (0, -1))
    size = 0.5 * first[0].mass
    np.testing.assert_allclose(after[0], before[0], atol=1e-12 * size)
    np.testing.assert_allclose(after[1], before[1], atol=1e-2 * size * radius)
    a, b = states[-1].twists
    np.testing.assert_allclose(a[:3], -b[:3], atol=1e-9)
    tangential = np.array([0.5, 0.0, 0.0]) - 0.5 * normal[0] * normal
    allowed = 0.5 * np.sin(np.radians(12.0)) if offset else 1e-9
    np.testing.assert_allclose(a[:3], tangential, atol=allowed)


@pytest.mark.parametrize("shrink", [0.0, 1e-3])
def test_a_stack_of_five_boxes_stands_still_for_ten_seconds(shrink):
    """Every interface carries the weight of what is above it, and nothing moves [m, rad]."""
    system = sim.compile_scene(tower(5, shrink))
    end = moved(system, 0.1, 100)[-1]
    np.testing.assert_allclose(end.frames, system.rest_state().frames, atol=1e-11)
    force = sim.Contacts().record(system, end, system.control(np.zeros(0)), None)[2]
    weight = G * np.array([body.mass for body in system.scene.bodies])
    np.testing.assert_allclose(force, np.cumsum(weight[::-1])[::-1], rtol=1e-6)


def cone(height, radius, n=6):
    """Cone on its tip at the origin, along z."""
    angle = 2.0 * np.pi * np.arange(n) / n
    rim = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(n, height)], axis=1)
    X = np.vstack([np.zeros(3), [0.0, 0.0, height], rim])
    sides = [[0, 2 + (k + 1) % n, 2 + k] for k in range(n)]
    lid = [[1, 2 + k, 2 + (k + 1) % n] for k in range(n)]
    return X, np.array(sides + lid)


def test_a_gyroscope_on_a_plane_precesses_steadily():
    """M g l = W (I3 w3 - I1 W cos) about the tip, which friction holds; errors of first order."""
    X, triangles = cone(0.03, 0.02)
    tilt, spin, t = 0.4, 300.0, 0.05
    lean = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    upright = sim.body_of_surface("top", X, triangles, 1000.0)
    parts = [(sim.body_of_surface("top", X @ lean.T, triangles, 1000.0), X @ lean.T, triangles)]
    system = scene(parts, [("top", square(half=0.05))], friction=2.0)
    mass, arm = upright.mass, upright.centre[2]
    I3, I1 = upright.inertia[2, 2], upright.inertia[0, 0] + mass * arm**2
    # slow root of I1 cos W^2 - I3 w3 W + m g l = 0, with w3 = spin + W cos
    a, b, c = (I1 - I3) * np.cos(tilt), -I3 * spin, mass * G * arm
    W = (-b - np.sqrt(b * b - 4 * a * c)) / (2 * a)
    axis = lean[:, 2]
    omega = spin * axis + [0.0, 0.0, W]
    twist = np.r_[np.cross(omega, arm * axis), omega]
    errors = []
    for n in (60, 120):
        end = moved(system, t / n, n, [twist])[-1]
        now = sim.kinematics.rotations.matrices(end.frames[:, 3:])[0] @ axis
        turned = np.arctan2(now[1], now[0])
        tip = end.q[0]
        errors.append([turned / (W * t) - 1.0, np.arccos(now[2]) - tilt, np.linalg.norm(tip[:2])])
        assert abs(tip[2]) < 5e-6
    coarse, fine = np.array(errors)
    np.testing.assert_array_less(np.abs(fine), 0.65 * np.abs(coarse))
    np.testing.assert_array_less(np.abs(2.0 * fine - coarse), [0.01, 0.005, 2e-4])


def test_a_lever_on_a_hinge_and_the_floor_shares_its_weight():
    """Half of the weight of a bar on its hinge at one end, half on the floor at the other."""
    bar, under = cuboid("bar", (0.1, 0.01, 0.01)), square(half=0.05)
    foot = sim.RigidShell(under.vertices + [0.14, 0.0, 0.0], under.triangles, "foot")
    hinge = Revolute("hinge", None, "bar", (0.0, 0.005, 0.0), (0.0, 1.0, 0.0))
    system = scene([bar], [("bar", foot)], joints=(hinge,))
    end = moved(system, 0.01, 3)[-1]
    weight = G * bar[0].mass
    end_of = end.frames[None], end.q[None], end.memory["joints"][None]
    force = system.rows.reactions(*end_of)[0][0]
    on_foot = sim.Contacts().record(system, end, system.control(np.zeros(0)), None)[2]
    np.testing.assert_allclose(force[0], [0.0, 0.0, 0.5 * weight], atol=1e-6 * weight)
    np.testing.assert_allclose(on_foot, 0.5 * weight, rtol=1e-6)


def test_a_prescribed_body_drags_a_block_until_both_are_equally_fast():
    """v = mu g t until the speed V of the plate, then V."""
    block, plate = (
        cuboid("block", (0.01,) * 3),
        cuboid("plate", (0.4, 0.2, 0.05), (-0.2, -0.1, -0.05)),
    )
    speed, friction, h = 0.2, 0.1, 0.01
    centre = np.asarray(plate[0].centre)
    motion = sim.PrescribedBody(
        "plate", lambda t: (centre + [speed * t, 0.0, 0.01 * t], (1.0, 0.0, 0.0, 0.0))
    )
    system = scene([block, plate], [("block", "plate")], friction=friction, members=(motion,))
    states = moved(system, h, 25)
    v = np.array([state.twists[0, 0] for state in states])
    np.testing.assert_allclose(np.diff(v)[2:12] / h, friction * G, rtol=1e-6)
    np.testing.assert_allclose(v[-3:], speed, rtol=1e-9)
    assert states[-1].frames[0, 2] == pytest.approx(0.005 + 0.01 * 0.25, abs=1e-6)


@pytest.mark.parametrize("integrator", EULER_AND_CONVERGED)
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_tissue_and_a_free_body_keep_their_momentum_when_they_collide(friction, integrator):
    """A soft block flies against a heavier body."""
    mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
    body, X, triangles = cuboid("plate", (0.03, 0.03, 0.01), (-0.005, -0.005, -0.0105))
    n, tissue = mesh.n_nodes, sim.boundary_surface(mesh, "tissue")
    points, on, surfaces = body_surfaces({"plate": (X, triangles)}, n)
    pairing = sim.Pairing(tissue, surfaces["plate"])
    contact = sim.ConstraintContact((pairing,), friction=friction)
    terms = sim.Solid(), contact
    system = sim.compile_scene(sim.Scene(mesh, terms, on, bodies=(body,), points=points))
    w = np.zeros(system.pattern.n)
    # it does not land at the very end of a step, where rounding would determine the step
    w[: 3 * n].reshape(-1, 3)[:] = [0.1, 0.0, -0.47]
    start = system.kinematics.state(system.rest_state().pose, w, {})
    states = moved(system, 0.0005, 12, initial=start, integrator=integrator())
    before, after = (system.node_mass @ states[k].v for k in (0, -1))
    np.testing.assert_allclose(after, before, atol=1e-11 * np.abs(before).max())
    assert states[-1].twists[0, 2] < -0.05
    # the faces of the plate, which begins to turn because the block is not above its centre
    normals = sim.kinematics.rotations.matrices(np.array([s.frames[0, 3:] for s in states]))[
        :, :, 2
    ]
    kicks = np.diff([s.twists[0, :3] for s in states], axis=0)
    linear = integrator is sim.LinearlyImplicitEuler
    across = np.cross(normals[:-1] if linear else normals[1:], kicks)
    if friction == 0.0:
        # a converged step ends on turned faces, and Sdirk2 has two stages
        most = 1e-4 if integrator is sim.Sdirk2 else 1e-6
        np.testing.assert_allclose(across, 0.0, atol=most * np.abs(kicks).max())
    else:
        assert states[-1].twists[0, 0] > 0.002
    _, gap, _ = sim.Contacts().record(system, states[-1], system.control(np.zeros(0)), None)
    assert not gap[0] < -5e-6  # NaN where they are apart again


@pytest.mark.parametrize("integrator", [sim.ConvergedEuler, sim.Sdirk2])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_compliance_of_large_scenes_gives_the_motion_of_small_ones(
    friction, integrator, monkeypatch
):
    """A compliance with updates, as of large scenes, in place of the inverse matrix."""
    ends = []
    for most in (240, 0):
        monkeypatch.setattr(contact_stage, "MOST_DENSE", most)
        mesh = grid((2, 2, 1), (0.02, 0.02, 0.01))
        body, X, triangles = cuboid("plate", (0.03, 0.03, 0.01), (-0.005, -0.005, -0.0105))
        points, on, surfaces = body_surfaces({"plate": (X, triangles)}, mesh.n_nodes)
        pairing = sim.Pairing(sim.boundary_surface(mesh, "tissue"), surfaces["plate"])
        terms = sim.Solid(), sim.ConstraintContact((pairing,), friction=friction)
        system = sim.compile_scene(sim.Scene(mesh, terms, on, bodies=(body,), points=points))
        w = np.zeros(system.pattern.n)
        w[: 3 * mesh.n_nodes].reshape(-1, 3)[:] = [0.1, 0.0, -0.47]
        start = system.kinematics.state(system.rest_state().pose, w, {})
        ends.append(moved(system, 0.0005, 8, initial=start, integrator=integrator())[-1])
    assert sim.Contacts().record(system, ends[0], system.control(np.zeros(0)), None)[2][0] > 0.0
    assert np.abs(ends[0].q - start.q).max() > 1e-3
    np.testing.assert_allclose(ends[1].q, ends[0].q, rtol=0, atol=1e-7)


@pytest.mark.parametrize("integrator", EULER_AND_CONVERGED)
def test_tissue_on_a_body_is_not_in_contact_with_it_where_it_is_attached(integrator):
    """Nodes of the block lie 0.1 mm inside the plate that carries them; nothing can move them apart."""
    mesh = grid((2, 2, 2), (0.02, 0.02, 0.02))
    body, X, triangles = cuboid("plate", (0.03, 0.03, 0.01), (-0.005, -0.005, -0.0099))
    points, on, surfaces = body_surfaces({"plate": (X, triangles)}, mesh.n_nodes)
    attached = sim.OnBody("plate", np.flatnonzero(mesh.X[:, 2] == 0.0))
    pairing = sim.Pairing(sim.boundary_surface(mesh, "tissue"), surfaces["plate"])
    ends = []
    for contact in ((), (sim.ConstraintContact((pairing,), initial_penetration="removed"),)):
        more = {"bodies": (body,), "points": points}
        terms = sim.Solid(), sim.Gravity(), *contact
        system = sim.compile_scene(sim.Scene(mesh, terms, (attached, *on), **more))
        ends.append(moved(system, 0.005, 5, integrator=integrator())[-1])
    np.testing.assert_allclose(ends[1].q, ends[0].q, rtol=0, atol=1e-9)
    _, _, force = sim.Contacts().record(system, ends[1], system.control(np.zeros(0)), None)
    assert force[0] == 0.0


def leaning(name, turn, depth):
    """A cube of 10 mm in some orientation, whose lowest corner is at z = -depth."""
    _, X, triangles = cuboid(name, (0.01, 0.01, 0.01))
    X = X @ turn.T
    X = X - [0.0, 0.0, X[:, 2].min() + depth]
    return sim.body_of_surface(name, X, triangles, 1000.0), X, triangles


@pytest.mark.parametrize("depth", [0.0, 1e-9, 1e-4, 2e-3])
def test_bodies_that_start_inside_each_other_go_no_deeper(depth):
    """Without load they rest; pressed together their depth does not grow."""
    low = cuboid("low", (0.03, 0.03, 0.01), (-0.015, -0.015, -0.01))
    top = leaning("top", rotation(3), depth)
    pairs = [("low", FLOOR_BELOW), ("low", "top")]
    still = moved(scene([low, top], pairs, None), 0.005, 3)[-1]
    np.testing.assert_allclose(still.twists, 0.0, atol=1e-9)
    system = scene([low, top], pairs, friction=0.4)
    states = moved(system, 0.002, 10)
    lowest = min(state.q[8:16, 2].min() for state in states)
    assert lowest > -depth - 1e-5


@pytest.mark.parametrize("integrator", EULER_AND_CONVERGED)
def test_planar_joint_and_floor_repeat_each_other(integrator):
    """A block that a joint already keeps on the floor: the forces are not unique, the motion is."""
    joint = Planar("plane", None, "block", (0.0, 0.0, 0.0))
    system = scene([cuboid("block", (0.02, 0.02, 0.01))], [("block", FLOOR)], joints=(joint,))
    end = moved(system, 0.01, 5, integrator=integrator())[-1]
    np.testing.assert_allclose(end.twists, 0.0, atol=1e-9)


@pytest.mark.parametrize("cls", EULER_AND_CONVERGED)
def test_order_with_a_body_that_slides_on_tissue(cls):
    """Motion of the plate and the tissue while no contact opens or closes."""
    system, start = plate_on_tissue()
    tight = cls() if cls not in CONVERGED else cls(tolerance=1e-11, residual_tolerance=1e-9)
    ends = [moved(system, 0.008 / n, n, initial=start, integrator=tight)[-1] for n in (4, 8, 16)]
    pairs = zip(ends, ends[1:], strict=False)
    change = [np.linalg.norm(system.kinematics.between(b.pose, a.pose)) for a, b in pairs]
    assert abs(np.log2(change[0] / change[1]) - cls.order) < 0.15
    forces = [e.memory["contact"][:, 1] > 0.0 for e in (start, *ends)]
    for now in forces[1:]:
        np.testing.assert_array_equal(now, forces[0])


def test_equilibria_and_inverse_tracking_refuse_contact_of_bodies():
    system = scene([cuboid("block", (0.02, 0.02, 0.01))], [("block", FLOOR)])
    with pytest.raises(sim.SceneError, match="does not support contact in scenes with bodies"):
        moved(system, 0.01, 1, integrator=sim.Static())


def contact_and_saddle():
    """Velocities, forces of a joint and of contacts in a step, and those of the dense saddle system.

    A hinged plate lies on a block of tissue; the second system is [A -h G'; h G 0] of the rows that act.
    """
    mesh, h = grid((2, 2, 1), (0.02, 0.02, 0.01)), 0.005
    body, X, triangles = cuboid("plate", (0.03, 0.03, 0.01), (-0.005, -0.005, 0.01))
    points, on, surfaces = body_surfaces({"plate": (X, triangles)}, mesh.n_nodes)
    pairing = sim.Pairing(sim.boundary_surface(mesh, "tissue"), surfaces["plate"])
    hinge = Revolute("hinge", None, "plate", (-0.005, 0.01, 0.01), (0.0, 1.0, 0.0))
    terms = sim.Solid(), sim.Gravity(), sim.ConstraintContact((pairing,))
    members = (sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0)), *on)
    more = {"bodies": (body,), "points": points, "joints": (hinge,)}
    system = sim.compile_scene(sim.Scene(mesh, terms, members, sim.RestRayleigh(), **more))
    state, integrator = moved(system, h, 10)[-1], sim.LinearlyImplicitEuler()
    work = sim.Workspace(system)
    line = system.control(np.zeros(0)).chord(state.t, h)
    equation = integrator.equation(system, state, line, work)
    step = ContactStep(system.contact, state, state.t + h)
    rows = step.entering(step.at_start(np.full(len(state.q), 1e-3)))
    at, w, f = LinearRows(system, state, equation, h, 1e-12, work).under(rows)
    on, n = f != 0.0, system.pattern.n
    assert on[:5].all() and on[5:].sum() > 3
    G, A = at.G.toarray()[on], dense(system.pattern, equation.A.values)
    saddle = np.block([[A, -h * G.T], [h * G, np.zeros((len(G), len(G)))]])
    exact = np.linalg.lstsq(saddle, np.r_[equation.rhs, -at.value[on]], rcond=None)[0]
    return (w, exact[:n]), (at.G.T @ f, G.T @ exact[n:])


def test_contact_and_joint_by_the_schur_complement_equal_the_full_saddle_system():
    """Forces are compared by their effect, because those of coplanar contacts are not unique."""
    for computed, expected in contact_and_saddle():
        np.testing.assert_allclose(computed, expected, atol=1e-9 * np.abs(expected).max())
