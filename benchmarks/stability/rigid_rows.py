"""Row 12: rigid bodies with contact, friction and joints."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

import sim
from benchmarks.integrators import IMPLICIT
from benchmarks.stability.trial import Judge, Trial
from sim.contact import Pairing, body_surfaces
from sim.joints import Joint, Revolute
from sim.kinematics import Member

Floats = NDArray[np.float64]
Shape = tuple[sim.Body, Floats, NDArray[np.int64]]
G = 9.81


def cuboid(name: str, size: Sequence[float], corner: Sequence[float] = (0.0, 0.0, 0.0)) -> Shape:
    """Body of a box of 1000 kg/m^3, the vertices of its surface and its triangles."""
    axes = [np.array([a, a + s]) for a, s in zip(corner, size, strict=True)]
    mesh = sim.grid_mesh(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
    triangles = sim.boundary_surface(mesh).triangles
    return sim.body_of_surface(name, mesh.X, triangles, 1000.0), mesh.X, triangles


def floor() -> sim.RigidShell:
    """Box whose upper side is at z = 0."""
    _, X, triangles = cuboid("floor", (1.0, 1.0, 0.05), (-0.5, -0.5, -0.05))
    return sim.RigidShell(X, triangles, "floor")


def bodies_in_contact(
    shapes: Sequence[Shape],
    pairs: Sequence[tuple[str, str | sim.RigidShell]],
    gravity: tuple[float, float, float] | None = (0.0, 0.0, -G),
    friction: float = 0.0,
    joints: tuple[Joint, ...] = (),
    members: tuple[Member, ...] = (),
) -> sim.Scene:
    """Bodies that may touch each other and shells; `pairs` of names, or a name and a shell."""
    points, on, surface = body_surfaces({body.name: (X, faces) for body, X, faces in shapes})
    others: Mapping[str | sim.RigidShell, sim.NodeSurface] = {**surface}
    pairings = tuple(Pairing(surface[a], others.get(b, b)) for a, b in pairs)  # pyright: ignore[reportArgumentType]
    contact = (sim.ConstraintContact(pairings, friction=friction),) if pairings else ()
    weight = () if gravity is None else (sim.Gravity(gravity),)
    bodies = tuple(body for body, _, _ in shapes)
    return sim.Scene(
        sim.NO_TISSUE,
        (*weight, *contact),
        (*on, *members),
        bodies=bodies,
        points=points,
        joints=joints,
    )


def tower(n: int, shrink: float = 1e-3) -> sim.Scene:
    """Boxes on each other on a floor, each narrower than the one below by `shrink`; friction 0.5."""
    shapes = [
        cuboid(
            f"b{i}",
            (0.02 - shrink * i, 0.02 - shrink * i, 0.01),
            (0.5 * shrink * i, 0.5 * shrink * i, 0.01 * i),
        )
        for i in range(n)
    ]
    pairs = [("b0", floor()), *((f"b{i}", f"b{i + 1}") for i in range(n - 1))]
    return bodies_in_contact(shapes, pairs, friction=0.5)


def plate_on_tissue() -> tuple[sim.System, sim.State]:
    """Heavy plate on a soft block, at the instant at which it slides over it and sinks."""
    axes = np.meshgrid(*(np.linspace(0.0, a, n) for a, n in ((0.02, 3), (0.02, 3), (0.01, 2))),
                       indexing="ij")  # fmt: skip
    mesh = sim.grid_mesh(np.stack(axes, axis=-1))
    body, X, triangles = cuboid("plate", (0.03, 0.03, 0.01), (-0.005, -0.005, 0.01))
    points, on, surfaces = body_surfaces({"plate": (X, triangles)}, mesh.n_nodes)
    pairing = Pairing(sim.boundary_surface(mesh, "tissue"), surfaces["plate"])
    fixed = sim.Fixed(np.flatnonzero(mesh.X[:, 2] == 0.0))
    terms = sim.Solid(), sim.Gravity(), sim.ConstraintContact((pairing,))
    system = sim.compile_scene(
        sim.Scene(mesh, terms, (fixed, *on), sim.RestRayleigh(), bodies=(body,), points=points)
    )
    state = system.rest_state()
    for duration, h in ((0.2, 0.01), (0.002, 5e-4)):
        if h < 0.01:
            w = system.kinematics.velocities(state)
            w[-6:] += [0.02, 0.01, -0.01, 0.0, 0.0, 0.0]
            state = system.kinematics.state(state.pose, w, state.memory)
        state = sim.simulate(system, sim.resting(0), duration=duration, steps=sim.FixedStep(h),
                             every=duration, integrator=sim.LinearlyImplicitEuler(),
                             initial=state, probes=())[1]  # fmt: skip
    return system, state


def rigid() -> Iterator[Trial]:
    """Stacks that must stand still, blocks on inclines, and a pendulum whose energy must not grow."""
    title = "rigid bodies"

    def nothing(system: sim.System) -> sim.Activation:
        return sim.resting(0)

    def stands(most: float) -> Judge:
        def judge(system: sim.System, start: sim.State, end: sim.State, energy: Floats) -> str:
            moved = float(np.abs(end.frames - start.frames).max())
            return "" if moved < most else f"moved by {moved:.1e} m"

        return judge

    stiff = {name: IMPLICIT[name] for name in ("linearly implicit Euler", "Euler", "SDIRK2")}
    still = stands(1e-8)
    for n in (2, 5, 8):
        yield Trial(12, title, f"{n} boxes on each other, 1 s", lambda n=n: sim.compile_scene(tower(n)),
                    nothing, 1.0, sim.FixedStep(0.02), stiff, "boxes", n, judge=still)  # fmt: skip
    for degrees in (10.0, 26.0):
        a = np.radians(degrees)

        def inclined(a: float = a) -> sim.System:
            gravity = (G * np.sin(a), 0.0, -G * np.cos(a))
            block = cuboid("block", (0.02, 0.02, 0.01))
            return sim.compile_scene(bodies_in_contact([block], [("block", floor())], gravity, 0.5))

        yield Trial(12, title, "block below the angle of friction, 26.6 degrees", inclined, nothing,
                    0.5, sim.FixedStep(0.01), stiff, "incline [degrees]", degrees,
                    judge=still)  # fmt: skip

    def pendulum() -> sim.System:
        hinge = Revolute("hinge", None, "bob", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        bob = cuboid("bob", (0.02, 0.02, 0.02), (0.09, -0.01, -0.01))
        return sim.compile_scene(bodies_in_contact([bob], [], joints=(hinge,)))

    def hangs(system: sim.System, start: sim.State, end: sim.State, energy: Floats) -> str:
        drift = float(np.abs(system.rows.evaluate(end.pose).c).max()) if system.rows else 0.0
        return "" if drift < 1e-9 else f"the hinge drifted by {drift:.1e} m"

    for h in (0.002, 0.02):
        yield Trial(12, title, "pendulum that falls from the side, 2 s", pendulum, nothing, 2.0,
                    sim.FixedStep(h), dict(IMPLICIT), "step [s]", h, judge=hangs)  # fmt: skip
