"""Coupled scenes: parts alone, rigid motion, momentum, attachments, files and pages."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

import sim
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import Head, build_lists, read_head, write_head
from emgface.anatomy.head.picture import head_geometry, head_page
from emgface.anatomy.head.run import raised, read_motion, simulate_head, write_motion
from emgface.anatomy.head.scene import TONGUE, head_scene
from emgface.anatomy.jaw.scene import jaw_scene
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.scene import tongue_scene
from emgface.errors import HeadError
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from sim.state import State

FULL_NAMES = ("posterior genioglossus", "orbicularis oris peripheralis", "anterior digastric")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-3d-apis")


@pytest.fixture(scope="module")
def head() -> Head:
    """Small head of all parts."""
    return build_head(preset="man", resolution=400, tongue_resolution=150, contacts=[])


@pytest.fixture(scope="module")
def still(head: Head) -> sim.System:
    """The coupled scene without gravity."""
    return sim.compile_scene(head_scene(head, gravity=False).scene)


def _forces(system: sim.System, q: np.ndarray) -> np.ndarray:
    return system.tangent(q, system.control(np.zeros(len(system.muscles))))[0].f


def test_one_part_has_exactly_its_own_scene() -> None:
    """Forces and stiffness of a head of one part equal those of the part without a head, bit for bit."""
    face, tongue, jaw = (
        build_head([p], preset="man", resolution=400, tongue_resolution=150, contacts=[])
        for p in ("face", "tongue", "jaw")
    )
    p = SimulationParameters(contact={"method": "none"})  # pyright: ignore[reportArgumentType]
    alone = (
        (head_scene(face, face=p).scene, compose_scene(face.parts["face"], p)),
        (head_scene(tongue).scene, tongue_scene(tongue.parts["tongue"], TONGUE)),
        (head_scene(jaw).scene, jaw_scene(jaw.parts["jaw"]).scene),
    )
    for ours, theirs in alone:
        one, other = sim.compile_scene(ours), sim.compile_scene(theirs)
        rng = np.random.default_rng(1)
        q = one.rest_state().q + 1e-4 * rng.standard_normal(one.rest_state().q.shape)
        control = one.control(rng.uniform(size=len(one.muscles)))
        assert one.muscles == other.muscles
        for a, b in zip(one.tangent(q, control), other.tangent(q, control), strict=True):
            x, y = (getattr(e, "f", e) for e in (a, b))
            np.testing.assert_array_equal(x, y)


def test_coupled_tissues_have_the_forces_of_each_part(head: Head, still: sim.System) -> None:
    """The joined scene has the tissue forces of face and tongue alone."""
    q = still.rest_state().q.copy()
    n = still.mesh.n_nodes
    q += 1e-4 * np.random.default_rng(2).standard_normal(q.shape)
    f = _forces(still, q)
    face = compose_scene(
        head.parts["face"],
        SimulationParameters(contact={"method": "none"}, gravity=False),  # pyright: ignore[reportArgumentType]
    )
    faces = sim.compile_scene(face)
    k = head.parts["face"].sizes["node"]
    own = _forces(faces, np.ascontiguousarray(q[:k]))
    np.testing.assert_allclose(f[:k], own, rtol=0, atol=1e-13 * np.abs(own).max())
    part = sim.compile_scene(
        tongue_scene(head.parts["tongue"], TONGUE.model_copy(update={"gravity": False}))
    )
    m = head.parts["tongue"].sizes["node"]
    points = len(part.rest_state().q) - m
    own = _forces(part, np.ascontiguousarray(q[k : k + m + points]))[:m]
    np.testing.assert_allclose(f[k : k + m], own, rtol=0, atol=1e-13 * np.abs(own).max())
    assert n > k + m


def test_rigid_motion_of_the_whole_scene_causes_no_force(still: sim.System) -> None:
    """Rotation and translation leave the tissue free of stress, and the lines with turned forces."""
    X = still.rest_state().q
    angle = 0.7
    R = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0.0, 0.0, 1.0]]
    )
    before, after = _forces(still, X), _forces(still, np.ascontiguousarray(X @ R.T + [0.1, 0, 0.2]))
    np.testing.assert_allclose(after, before @ R.T, rtol=0, atol=1e-9)
    tissue = [t for t in still.terms if hasattr(t, "smallest_J")]
    f = np.zeros_like(X)
    control = still.control(np.zeros(len(still.muscles)))
    for term in tissue:
        term.add(np.ascontiguousarray(X @ R.T), control, f)
    assert np.abs(f).max() < 1e-9  # N; a force of 1 Pa on an element is about 1e-5 N


def test_free_head_keeps_its_momentum(head: Head) -> None:
    """Internal forces of muscles, attachments and joints do not accelerate a head that nothing holds."""
    parts = head_scene(head, gravity=False).scene
    free = replace(
        parts,
        reductions=tuple(m for m in parts.reductions if not isinstance(m, sim.Fixed)),
        damping=None,
    )
    # tissue, jaw and hyoid alone; lines to the skull would be external forces
    tissue = (t for t in free.terms if isinstance(t, sim.OfBlocks))
    system = sim.compile_scene(
        replace(
            free,
            terms=tuple(t for t in tissue if not isinstance(t.term, sim.LineMuscles)),
            joints=(),
            reductions=(*free.reductions, sim.Fixed(_unheld(free))),
            bodies=tuple(replace(b, damping=(0.0, 0.0)) for b in free.bodies),
        )
    )
    a = np.full(len(system.muscles), 0.2)
    motion, end = sim.simulate(
        system,
        sim.Activation(np.array([0.0, 0.02]), np.array([0.0 * a, a])),
        duration=0.02,
        steps=sim.FixedStep(2e-3),
        probes=(),
    )
    mass = system.node_mass[:, None]
    assert isinstance(end, State)
    momentum = (mass * end.v).sum(axis=0)
    scale = (mass * np.abs(end.v)).sum()
    assert scale > 1e-3
    assert np.abs(momentum).max() < 1e-6 * scale


def _unheld(scene: sim.Scene) -> np.ndarray:
    """Points that no body holds."""
    attached = [m.nodes for m in scene.reductions if isinstance(m, sim.OnBody)]
    points = scene.mesh.n_nodes + np.arange(len(scene.points))
    return np.setdiff1d(points, np.concatenate(attached))


def test_file_keeps_lists_and_parts_and_page_holds_all(head: Head, tmp_path: Path) -> None:
    again = read_head(write_head(head, tmp_path / "head.nc"))
    assert again.lists.identical(head.lists)
    assert all(again.parts[name].equals(part) for name, part in head.parts.items())
    motion = simulate_head(again, raised({"bi_GGP": 0.1}), duration=0.01)
    moved, parts = read_motion(write_motion(motion, again, tmp_path / "motion.nc"))
    assert motion.attrs["origin"] == "simulated"
    page = tmp_path / "motion.html"
    page.write_text(head_page(moved, parts), encoding="utf-8")
    assert "Content-Security-Policy" in page.read_text(encoding="utf-8")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser")
    if chromium is None:
        pytest.skip("no Chromium found (Debian: chromium)")
    shown = subprocess.run(
        [chromium, *FLAGS, "--virtual-time-budget=8000", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stdout
    # both are written by the script of the page, after it has decoded the motion
    assert f'aria-live="polite">{motion.attrs["head"]}' in shown
    assert all(f">{muscle}</b>" in shown for muscle in FULL_NAMES)
    # both halves are drawn, the left one first, which the section shows alone
    section = json.loads(re.search(r'"section": ?(\d+|null)', page.read_text(encoding="utf-8"))[1])
    left = len(head_geometry(moved.isel(time=[0]), parts)[1])
    assert section == left and page.stat().st_size < 8e6


def test_what_is_not_named_costs_nothing() -> None:
    jaw = build_head(["jaw"], preset="man").parts["jaw"]
    whole = template_jaw(preset="man")
    assert [str(b) for b in jaw["body"].values[jaw["body_moves"].values > 0]] == ["jaw"]
    assert jaw.sizes["muscle"] < whole.sizes["muscle"]
    scene = head_scene(build_head(["tongue"], resolution=150)).scene
    assert not scene.bodies
    with pytest.raises(HeadError, match="contact lip-lip needs the face"):
        build_head(["jaw"], contacts=["lip-lip"])
    with pytest.raises(HeadError, match="expected different names of face, jaw, tongue, hyoid"):
        build_head(["ear"])


def test_nodes_of_the_face_follow_the_tongue(head: Head) -> None:
    """Attached nodes keep their places at rest, and move with the adjacent elements.

    The tongue is shifted until it is 1 mm from the nearest node, because none is near it.
    """
    face, tongue = (head.parts[name]["position"].values for name in ("face", "tongue"))
    free = np.flatnonzero(head.parts["face"]["fixed"].values == 0)
    away, carrier = KDTree(tongue).query(face[free])
    near = free[[np.argmin(away)]]
    gap = face[near[0]] - tongue[carrier[np.argmin(away)]]
    drawn = head.parts["tongue"].copy(deep=True)
    for name in ("position", "fibre_position"):
        drawn[name].values[:] += gap * (1.0 - 1e-3 / np.linalg.norm(gap))
    parts = {**head.parts, "tongue": drawn}
    own = {str(p): head.attached(str(p)) for p in head.lists["pair"].values}
    attached = build_lists(
        parts=parts,
        named=head.named,
        attachments={**own, "face-tongue": near},
        contacts=[],
        shells={},
        name="attached",
    )
    scene = head_scene(attached, gravity=False)
    system = scene.system
    embedded = next(m for m in scene.scene.reductions if isinstance(m, sim.InElement))
    assert embedded.nodes.tolist() == near.tolist() and embedded.embedding is not None
    np.testing.assert_allclose(system.rest_state().q[near], face[near], rtol=0, atol=1e-12)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    turned = (
        embedded.embedding.weights
        @ (drawn["position"].values @ turn.T)[embedded.embedding.nodes[0] - len(face)]
    )
    np.testing.assert_allclose(turned, face[near] @ turn.T, rtol=0, atol=1e-12)
    n = len(face)
    assert (embedded.embedding.nodes >= n).all()
    motion = simulate_head(attached, raised({"bi_GGP": 0.3}, rise=0.02), duration=0.04, scene=scene)
    q = motion["node_position"].transpose("time", "node", "axis").values[-1]
    moved = np.einsum("ka,kai->ki", embedded.embedding.weights, q[embedded.embedding.nodes])
    np.testing.assert_allclose(q[near], moved, rtol=0, atol=1e-9)
    assert np.linalg.norm(q[near] - face[near], axis=1).min() > 1e-5
    with pytest.raises(HeadError, match="expected one of face-jaw"):
        build_lists(
            parts=head.parts,
            named=head.named,
            attachments={"tongue-face": near},
            contacts=[],
            shells={},
            name="refused",
        )
    upper = free[np.argsort(face[free, 2])[-1:]]
    far = {"face-tongue": upper}
    with pytest.raises(HeadError, match="attachment face-tongue: .* mm from the tongue"):
        head_scene(
            build_lists(
                parts=head.parts,
                named=head.named,
                attachments=far,
                contacts=[],
                shells={},
                name="far",
            )
        )


def test_symmetric_drive_keeps_the_head_symmetric(head: Head) -> None:
    """Equal muscles of both sides move mirrored nodes alike to 1e-9 m; those of one side do not."""
    scene = head_scene(head)

    def sides(levels: dict[str, float]) -> float:
        motion = simulate_head(head, raised(levels, rise=0.02), duration=0.03, scene=scene)
        q = motion["node_position"].transpose("time", "node", "axis").values
        mirror = np.array([-1.0, 1.0, 1.0])
        worst = 0.0
        for first, tissue in ((0, "face"), (head.parts["face"].sizes["node"], "tongue")):
            X = head.parts[tissue]["position"].values
            away, image = KDTree(X).query(X * mirror)
            assert away.max() < 1e-12
            own = q[-1, first : first + len(X)]
            worst = max(worst, float(np.abs(own[image] * mirror - own).max()))
        return worst

    both = {"bi_ZYG": 0.3, "bi_GGP": 0.3, "bi_open": 0.2}
    assert sides(both) < 1e-9
    assert sides({**both, "ZYG_L": 0.3}) > 1e-5


def test_properties_with_a_scene_are_refused(head: Head) -> None:
    """They would be ignored."""
    scene = head_scene(head)
    with pytest.raises(
        HeadError, match="gravity specified in addition to a scene, which already contains it"
    ):
        simulate_head(head, raised({}), duration=0.02, scene=scene, gravity=False)
    with pytest.raises(HeadError, match="tongue and law specified in addition"):
        other = TONGUE.model_copy(update={"sigma_max": 3e5})
        simulate_head(head, raised({}), duration=0.02, scene=scene, tongue=other, law="hill")
