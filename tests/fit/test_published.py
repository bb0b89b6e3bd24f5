"""Fit of one published face to the other, from surfaces without correspondence and 30 landmarks.

Both have the same nodes, so that the error of every node is known. Limits: those asked of the method;
the published mesh of the second face has 175 hexahedra with a scaled Jacobian below 0.1.
"""

import csv
from pathlib import Path

import numpy as np
import pytest

from emgface.face.ansys import read_nodes
from emgface.face.artisynth import import_artisynth
from emgface.face.quality import element_quality
from emgface.fit.measures import distances
from emgface.fit.person import fit_face
from emgface.fit.targets import Target, sheets
from emgface.fit.triangulated import Surface

pytestmark = pytest.mark.slow


def _published(folder: Path):
    """Reference face, nodes of the other face in its axes, and landmarks by node."""
    face = import_artisynth(folder)
    nodes = read_nodes(folder / "face_badin" / "badinface_oop_csa_midsagittal.node")
    b = nodes.position[np.argsort(nodes.id)]
    other = np.column_stack([b[:, 1], -b[:, 0], b[:, 2]])
    with (folder / "face_reference" / "derived" / "landmarks.csv").open() as stream:
        marks = {row["name"]: int(row["node"]) - 1 for row in csv.DictReader(stream)}
    with (folder / "face_reference" / "derived" / "lip_ring_nodes.csv").open() as stream:
        lips = [int(r["node"]) - 1 for r in csv.DictReader(stream) if int(r["ring"]) <= 5]
    return face, other, marks, np.array(lips)


def _renumbered(points: np.ndarray, triangles: np.ndarray) -> Surface:
    used, corner = np.unique(triangles, return_inverse=True)
    order = np.random.default_rng(3).permutation(len(used))
    place = np.argsort(order)
    return Surface(points[used][order], place[corner.reshape(-1, 3)].astype(np.int64))


@pytest.mark.parametrize("way", ["to the other", "back"])
def test_published_faces_are_fitted_to_each_other(shared, way):
    face, other, marks, lips = _published(shared / "artisynth_models")
    X, B = face["position"].values.copy(), other
    if way == "back":
        X, B = B, X
        face = face.assign(position=(("node", "axis"), X, face["position"].attrs))
    own = sheets(face)
    scans = {name: _renumbered(B, sheet.triangles) for name, sheet in own.items()}
    fit = fit_face(
        face, {name: B[node] for name, node in marks.items()},
        on_face={name: X[node] for name, node in marks.items()}, rim=True,
        **{name: (s.points, s.triangles) for name, s in scans.items()},
    )  # fmt: skip
    q = fit.face["position"].values
    truth = fit.deformed.landmarks  # the frame of the fitted face is a rigid motion of that of B
    table = fit.distance[fit.distance["stage"] == "relaxed"].set_index("surface")
    assert (table["mean"] <= 0.2).all() and (table["q95"] <= 0.7).all()
    skin = own["skin"]
    mouth = skin.triangles[np.isin(skin.triangles, lips).all(axis=1)]
    moved = _in_frame(B, marks, truth)
    lip = Target("lips", skin, Surface(moved, mouth))
    near = lip.surface.nearest(q[lips])
    inside = ~lip.surface.at_border(near)
    assert 1e3 * near.distance[inside].mean() <= 0.12
    assert 1e3 * np.median(np.linalg.norm(q - moved, axis=1)) <= 1.9
    quality = element_quality(q, face["connectivity"].values)
    before = element_quality(X, face["connectivity"].values)
    assert (quality.smallest_det > 0).all()
    assert (quality.scaled_jacobian >= 0.1).all()
    assert quality.scaled_jacobian.min() >= before.scaled_jacobian.min()
    assert len(fit.fibres) and distances(lip, q)["covered"] > 0.0


def _in_frame(points, marks, landmarks):
    """Move points of the person into the frame of the fitted face, by the landmarks in both."""
    from emgface.fit.similarity import similarity

    there = np.array([points[marks[name]] for name in landmarks.names if name in marks])
    here = landmarks.target[[name in marks for name in landmarks.names]]
    return similarity(there, here, scaled=False)(points)
