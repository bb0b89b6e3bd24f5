"""Pursing in contact against the other simulator: the effect of each rule of its contact.

    python -m benchmarks contact_rules --out FOLDER [--rule NAME ...]

The case is `X_contact_demo_nogravity_OOP0.1`: hard element volumes, trapezoidal rule, h = 5 ms,
orbicularis oris peripheralis rising to 0.1 in 0.1 s, no gravity, contact of the lips and with both
bones. Rows of the table:

kept        contact of this package: tissue that starts inside bone may remain there
published   all published rules (`published_contact`)
NAME        all published rules but NAME, which is replaced by that of this package, or left out:
            direction, released, mass, volumes, corners, bones

With --symmetric, the input is replaced by its mean with its mirror image: nodes, fibre directions,
surfaces of the lips and bones. Its differences from its mirror image are printed first.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import KDTree

import sim
from benchmarks.other_simulator import FAR, RAMP, SHARED, TRAPEZOIDAL, Case, their_face
from benchmarks.published_contact import PublishedContact, Rules
from benchmarks.report import finish, markdown, say
from emgface.face.artisynth import import_artisynth
from emgface.face.contact import contact_pairings
from emgface.face.parts import FREE
from emgface.face.penetration import depths
from sim.contact import NodeSurface, Pairing, RigidShell

CASE = Case("X_contact_demo_nogravity_OOP0.1", "hard", "OOP", 0.1, TRAPEZOIDAL, sim.Generic(100e3))
H = 5e-3
UNTIL = 0.1  # s
MIRROR = np.array([-1.0, 1.0, 1.0])
CHANGED = {
    "published": {},
    "direction": {"direction": "point"},
    "released": {"released": False},
    "mass": {"mass": False},
    "volumes": {"volumes": False},
    "corners": {"corners": False},
    "bones": {"bones": True},
}
RULES = ("kept", *CHANGED)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


def partners(points: Floats) -> Integers:
    """Number of the mirror image of each point (n, 3)."""
    return np.asarray(KDTree(points).query(points * MIRROR)[1], dtype=np.int64)


def mean_with_mirror(points: Floats) -> Floats:
    """Points (n, 3), each the mean of itself and of the mirror image of its partner."""
    return 0.5 * (points + points[partners(points)] * MIRROR)


def mirrored_triangles(triangles: Integers, points: Floats) -> Integers:
    """Triangles of one side with their mirror images, and those across the middle."""
    mirror = partners(points)
    side = np.where(mirror == np.arange(len(points)), 0.0, np.sign(points[:, 0]))[triangles]
    right, left = (side > 0.0).any(axis=1), (side < 0.0).any(axis=1)
    one = triangles[right & ~left]
    return np.concatenate([one, mirror[one][:, ::-1], triangles[right == left]])


def symmetric_pairing(pairing: Pairing, X: Floats) -> Pairing:
    """Pairing of symmetric surfaces; X (n_nodes, 3) are the nodes before they were mirrored."""

    def symmetric(surface: NodeSurface | RigidShell) -> NodeSurface | RigidShell:
        if isinstance(surface, NodeSurface):
            return NodeSurface(mirrored_triangles(surface.triangles, X), surface.name)
        points = surface.vertices
        found = mirrored_triangles(surface.triangles, points)
        return RigidShell(mean_with_mirror(points), found, surface.name)

    return Pairing(*(symmetric(surface) for surface in pairing.surfaces))


def asymmetric_triangles(triangles: Integers, points: Floats) -> int:
    """Number of triangles whose mirror image is not a triangle of the surface."""
    image = partners(points)[triangles]
    known = {tuple(sorted(row)) for row in triangles.tolist()}
    return sum(tuple(sorted(row)) not in known for row in image.tolist())


def symmetric_model(model: dict[str, Any]) -> list[dict[str, object]]:
    """Replace nodes and fibre directions of a recorded model by symmetric ones; list the changes."""
    X = np.array(model["rest_positions"])
    mirror = partners(X)
    apart = float(np.linalg.norm(X - X[mirror] * MIRROR, axis=1).max() * 1e3)
    found: list[dict[str, object]] = [{"input": "nodes (mm)", "from its mirror image": apart}]
    number = {tuple(sorted(e["nodes"])): k for k, e in enumerate(model["elements"])}
    other = [number[tuple(sorted(mirror[e["nodes"]].tolist()))] for e in model["elements"]]
    for name, bundle in model["muscles"].items():
        if not bundle["element_indices"]:
            continue
        at = {element: k for k, element in enumerate(bundle["element_indices"])}
        own = np.array(bundle["directions"]).reshape(-1, 3)
        image = own[[at[other[element]] for element in at]] * MIRROR
        image *= np.where((own * image).sum(axis=1) < 0.0, -1.0, 1.0)[:, None]
        apart = float(np.linalg.norm(own - image, axis=1).max())
        found.append({"input": f"directions of {name} (1)", "from its mirror image": apart})
        mean = own + image
        size = np.linalg.norm(mean, axis=1, keepdims=True)
        bundle["directions"] = (mean / np.where(size > 0.0, size, 1.0)).tolist()
    model["rest_positions"] = mean_with_mirror(X).tolist()
    return found


class Compared:
    """The case, and the differences of motions from the recorded one.

    `folder` contains the recorded runs; the input is made symmetric if `symmetric` is True.
    """

    def __init__(self, folder: Path, symmetric: bool) -> None:
        model = json.loads((folder / "refmodel_model.json").read_text())
        face = import_artisynth(folder.parent / "artisynth_models")
        pairings = contact_pairings(face)
        if symmetric:
            nodes = face["position"].values
            found = symmetric_model(model)
            for surface in {s.name: s for p in pairings for s in p.surfaces}.values():
                points = surface.vertices if isinstance(surface, RigidShell) else nodes
                odd = asymmetric_triangles(surface.triangles, points)
                found.append(
                    {
                        "input": f"triangles of the {surface.name}, of {len(surface.triangles)}",
                        "from its mirror image": str(odd),
                    }
                )
                if isinstance(surface, RigidShell):
                    apart = np.linalg.norm(points - points[partners(points)] * MIRROR, axis=1)
                    of = f"vertices of the {surface.name} (mm)"
                    found.append({"input": of, "from its mirror image": float(apart.max() * 1e3)})
            print(markdown(pd.DataFrame(found), ".2g"), flush=True)
            pairings = tuple(symmetric_pairing(p, nodes) for p in pairings)
        self.system, self.pairings = their_face(folder, CASE, model), pairings
        X = self.X = self.system.scene.mesh.X
        shells = [s for p in pairings for s in p.surfaces if isinstance(s, RigidShell)]
        self._bones = [shell.vertices[shell.triangles] for shell in shells]
        free = face["fixed"].values == FREE
        self._inside = free & (np.max([depths(X, bone) for bone in self._bones], axis=0) > 0.0)
        self._far = KDTree(X[self._inside]).query(X)[0] > FAR
        self._markers, self._mirror = face["marker_node"].values, partners(X)
        self._recorded = np.load(folder / f"{CASE.name}.npz")

    def row(self, t: float, q: Floats) -> dict[str, float]:
        """Differences from the recorded run at a recorded time, in mm."""
        theirs = self._recorded[f"pos_t{t:g}"]
        away = np.linalg.norm(q - theirs, axis=1) * 1e3
        deep = [
            max(depths(at[self._inside], bone).max() * 1e3 for bone in self._bones)
            for at in (q, theirs)
        ]
        return {
            "time_s": t,
            "rms_mm": float(np.sqrt((away**2).mean())),
            "largest_mm": float(away.max()),
            "largest_far_mm": float(away[self._far].max()),
            "markers_mm": float(away[self._markers].max()),
            "depth_mm": deep[0],
            "depth_theirs_mm": deep[1],
            "asymmetry_mm": self._asymmetry(q),
            "asymmetry_theirs_mm": self._asymmetry(theirs),
            "moved_mm": float(np.linalg.norm(q - self.X, axis=1).max() * 1e3),
        }

    def _asymmetry(self, q: Floats) -> float:
        u = q - self.X
        return float(np.linalg.norm(u - u[self._mirror] * MIRROR, axis=1).max() * 1e3)

    def activation(self, t: float) -> Floats:
        """Activation of every muscle at a time [s]."""
        level = CASE.level * min(t / RAMP, 1.0)
        return np.array([level if name == CASE.group else 0.0 for name in self.system.muscles])

    def stepper(self, rule: str) -> Callable[[sim.State, float], sim.State]:
        """A step from a state to a time by a rule."""
        if rule in CHANGED:
            step = PublishedContact(self.system, self.pairings, Rules(**CHANGED[rule])).step
            return lambda state, t: step(state, self.activation(t), t - state.t)
        scene = self.system.scene
        terms = (*scene.terms, sim.ConstraintContact(self.pairings))
        system = sim.compile_scene(replace(scene, terms=terms))
        work = sim.Workspace(system)

        def step_of(state: sim.State, t: float) -> sim.State:
            control = system.control(self.activation(t), t)
            return TRAPEZOIDAL.step(system, state, control, t - state.t, work)[0]

        return step_of


def main(
    out: Path | None = None,
    rule: list[str] = list(RULES),  # noqa: B006
    symmetric: bool = False,
) -> None:
    """Compare after 0.1 s, print and store."""
    compared, rows = Compared(SHARED / "artisynth_reference", symmetric), []
    for name in rule:
        step, state = compared.stepper(name), compared.system.rest_state()
        for k in range(1, round(UNTIL / H) + 1):
            state = step(state, k * H)
        rows.append({"rule": name, **compared.row(UNTIL, state.q)})
        say(str(rows[-1]))
    finish("contact-rules", pd.DataFrame(rows), out)
