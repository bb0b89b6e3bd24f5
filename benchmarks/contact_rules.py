"""Pursing in contact against the other simulator: what each rule of its contact is worth.

    python -m benchmarks contact_rules --shared ../shared --out FOLDER --rule kept --rule removed

The case is `X_contact_demo_nogravity_OOP0.1` (hard element volumes, trapezoidal rule, h = 5 ms,
orbicularis oris peripheralis rising to 0.1 in 0.1 s, no gravity). Rules, each with those before it:

kept      contact as it is here: what starts inside bone may stay
removed   what starts inside is moved out at once
nodes     nodes of the tissue against the bones, and no vertices of the bones against the tissue
plain     the direction of the nearest face, without rounded edges, further walls and slow turning
inside    only nodes that lie inside at the start of a step, held for the step whether pushed or pulled
lumped    what is inside at the end moved out as nodes of their mass alone, not as the tissue gives way
"""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

import sim
from benchmarks.other_simulator import FAR, RAMP, SHARED, TRAPEZOIDAL, Case, their_face
from benchmarks.report import finish
from emgface.face.artisynth import import_artisynth
from emgface.face.parts import FREE, arches_of
from emgface.face.penetration import depths
from sim.contact import direction as directions
from sim.contact.compiled import CompiledContact
from sim.contact.multipliers import Acting, Multipliers
from sim.contact.rows import Rows
from sim.contact.signed_distance import SignedFaces
from sim.contact.step import ContactStep
from sim.integrators import contact_linear
from sim.integrators.contact_equation import LINEAR_ERROR, ContactEquation, Solve
from sim.integrators.contact_linear import LinearContact

CASE = "X_contact_demo_nogravity_OOP0.1"
RULES = ("kept", "removed", "nodes", "plain", "inside", "lumped")
AT_ONCE = 1.0  # m/s: 5 mm in a step
H = 5e-3
TOLERANCE = 1e-5  # depth that is left where nodes are held only while inside [m]
MIRROR = np.array([-1.0, 1.0, 1.0])


def without_shells(contact: CompiledContact) -> None:
    """Leave out the directions of a shell's vertices."""
    for one in contact._directions:
        if (one.nodes < 0).all():
            one.near = lambda move, allowed, way, one=one: _none(
                directions.Direction.near(one, move, allowed, way)
            )  # type: ignore[method-assign]
            one.entered = lambda move, allowed, one=one: _none(
                directions.Direction.entered(one, move, allowed)
            )  # type: ignore[method-assign]


def _none(rows: Rows) -> Rows:
    return rows.take(np.empty(0, dtype=np.int64))


def no_walls(self: SignedFaces, points, found, x, near):  # type: ignore[no-untyped-def]
    """No further faces of grooves."""
    nothing = np.empty(0, dtype=np.int64)
    return found.take(nothing), np.empty(0), np.empty((0, 3))


class Held(LinearContact):
    """Rows of nodes inside at the start alone, held both ways, then moved out to a tolerance."""

    lumped = False

    def solve(self) -> contact_linear.Touched:
        """One solution; positions are corrected afterwards."""
        step, equation = self._step, self._equation
        near = step.at_start(np.zeros(len(self._state.q)))
        inside = near.take(np.flatnonzero(near.gap < 0.0))
        multipliers = self._multipliers_of(replace(inside, gap=np.zeros(len(inside))))
        x, acting, solve = held(equation, multipliers, self._h * self._v0)
        q = self._positions(x)
        pattern, mass = self._system.point_pattern, self._system.node_mass
        kinematics, pose = self._system.kinematics, self._state.pose
        for _ in range(4):
            rows = step.at(q)
            gap = rows.gaps(q - step.q0) + TOLERANCE
            deep = rows.take(np.flatnonzero(gap < 0.0))
            wanted = -gap[gap < 0.0]
            if not len(deep):
                break
            if self.lumped:
                move = lumped(deep, wanted, mass, pattern.n_nodes)
                move = kinematics.displacements(kinematics.generalised_force(move, pose), pose)
            else:
                push = contact_linear.pressed(
                    deep, wanted, multipliers.pushing(acting), pattern, equation.diagonal, 30.0
                )
                push = equation.scale * kinematics.generalised_force(push, pose)
                move = equation.displacement(solve(push, 1e-6))
                moved = deep.gaps(move) - deep.gaps(np.zeros_like(q))
                move *= min(max(float(moved @ wanted) / float(moved @ moved), 0.0), 2.0)
            q = q + move
        memory = step.memory(
            q, step.at(q), multipliers, replace(acting, force=np.maximum(acting.force, 0.0))
        )
        return contact_linear.Touched(
            x / self._h, q, memory, equation.solutions, equation.factorisations, equation.definite
        )


def lumped(
    rows: Rows, wanted: NDArray[np.float64], mass: NDArray[np.float64], n: int
) -> NDArray[np.float64]:
    """Displacements (n, 3) that open rows one after the other, each by its nodes' masses."""
    out = np.zeros((n, 3))
    for _ in range(20):
        for k in range(len(rows)):
            nodes, weight, normal = rows.nodes[k], rows.weight[k], rows.normal[k]
            left = wanted[k] - float(normal @ (weight @ out[nodes]))
            if left > 0.0:
                share = weight / mass[nodes]
                move = (left / float(weight @ share)) * share[:, None] * normal
                np.add.at(out, nodes, move)
    return out


def held(
    equation: ContactEquation, multipliers: Multipliers, x: NDArray[np.float64]
) -> tuple[NDArray[np.float64], Acting, Solve]:
    """Solution in which all rows are closed, whether they push or pull."""
    rows, system = multipliers.rows, equation._system
    if not len(rows):
        return equation.settle(multipliers, x)
    every = np.ones(len(rows), dtype=bool)
    places = equation._step.places(system.point_pattern, rows)
    acting = multipliers.at(equation.displacement(x))
    solve = equation._solver(places, rows, multipliers.stiffness(acting, every))
    for _ in range(40):
        force = multipliers.held(acting, every)
        f = rows.spread(force[:, None] * rows.normal, len(equation._state.q))
        pushed = system.kinematics.generalised_force(f, equation._state.pose)
        missing = equation._b + equation.scale * pushed - equation._A.times(x)
        x = x + solve(missing, LINEAR_ERROR)
        acting = multipliers.at(equation.displacement(x))
        multipliers.normal = multipliers.held(acting, every)
        if float(np.abs(acting.gap).max()) < 1e-7:
            break
    return x, replace(acting, force=multipliers.normal), solve


@contextmanager
def rule(name: str) -> Iterator[Callable[[sim.System], None]]:
    """Contact by a rule, and what is to be done to a compiled scene."""
    level = RULES.index(name)
    with ExitStack() as stack:
        if level >= RULES.index("plain"):
            stack.enter_context(patch.object(directions, "BLUR", 1e-6))
            stack.enter_context(patch.object(SignedFaces, "beside", no_walls))
            stack.enter_context(patch.object(ContactStep, "_steadied", lambda self, rows: rows))
        if level >= RULES.index("inside"):
            kind = type("Rule", (Held,), {"lumped": name == "lumped"})
            stack.enter_context(patch("sim.integrators.linearly_implicit.LinearContact", kind))

        def prepare(system: sim.System) -> None:
            contact = system.contact
            assert contact is not None
            if level >= 1:
                contact._removal_speed = AT_ONCE
            if level >= RULES.index("nodes"):
                without_shells(contact)
            if level >= RULES.index("inside"):
                # what is inside, however deep, is found, and nothing may stay
                for one in contact._directions:
                    one._approach = 3e-3
                    nothing = np.zeros(len(one.vertices))
                    one.depths = lambda q, t, d=nothing: d  # type: ignore[method-assign]

        yield prepare


def run(folder: Path, name: str, until: float) -> list[dict[str, object]]:
    """Differences from the recorded run at its times, in mm."""
    case = Case(CASE, "hard", "OOP", 0.1, TRAPEZOIDAL, sim.Generic(100e3), contact=True)
    system = their_face(folder, case)
    face = import_artisynth(folder.parent / "artisynth_models")
    X, free = system.scene.mesh.X, face["fixed"].values == FREE
    arches = [arch.points[arch.triangles] for arch in arches_of(face)]
    inside = free & (np.max([depths(X, arch) for arch in arches], axis=0) > 0.0)
    far = KDTree(X[inside]).query(X)[0] > FAR
    mirror = KDTree(X).query(X * MIRROR)[1]
    markers = face["marker_node"].values
    recorded = np.load(folder / f"{CASE}.npz")
    model = json.loads((folder / "refmodel_model.json").read_text())
    assert len(model["rest_positions"]) == len(X)
    peak = np.array([case.level if muscle == case.group else 0.0 for muscle in system.muscles])
    activation = sim.Activation(np.array([0.0, RAMP]), np.stack([0.0 * peak, peak]))
    rows: list[dict[str, object]] = []
    with rule(name) as prepare:
        prepare(system)
        state, work = system.rest_state(), sim.Workspace(system)
        for t in (0.1, 0.2):
            if t > until + 1e-9:
                break
            _, state = sim.simulate(
                system,
                activation,
                duration=t - state.t,
                integrator=case.integrator,
                steps=sim.FixedStep(H),
                initial=state,
                work=work,
            )
            theirs = recorded[f"pos_t{t}"]
            away, u, v = np.linalg.norm(state.q - theirs, axis=1) * 1e3, state.q - X, theirs - X
            deepest = [
                max(depths(q[inside], arch).max() for arch in arches) * 1e3
                for q in (state.q, theirs)
            ]
            rows.append(
                {
                    "rule": name,
                    "time_s": t,
                    "rms": float(np.sqrt((away**2).mean())),
                    "largest": float(away.max()),
                    "largest_far": float(away[far].max()),
                    "markers": float(away[markers].max()),
                    "markers_moved": float(np.linalg.norm(v[markers], axis=1).max() * 1e3),
                    "deepest_start": deepest[0],
                    "deepest_start_theirs": deepest[1],
                    "asymmetry": float(np.linalg.norm(u - u[mirror] * MIRROR, axis=1).max() * 1e3),
                    "asymmetry_theirs": float(
                        np.linalg.norm(v - v[mirror] * MIRROR, axis=1).max() * 1e3
                    ),
                }
            )
            print(rows[-1], flush=True)
    return rows


def main(
    shared: Path = SHARED,
    out: Path | None = None,
    until: float = 0.2,
    rule: list[str] = list(RULES),  # noqa: B006
) -> None:
    """Compare up to the time `until`, print and store."""
    folder = shared / "artisynth_reference"
    rows = [row for name in rule for row in run(folder, name, until=until)]
    finish("contact-rules", pd.DataFrame(rows), out)
