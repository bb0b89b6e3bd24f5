"""Where the motion of a fitted published face differs from that of the published mesh.

Both carry the muscles of the reference by the same elements. One ingredient of the fitted mesh at a time
is replaced by the true one, and the markers under orbicularis oris peripheralis are compared again.
"""

import csv
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.face.ansys import read_nodes
from emgface.face.artisynth import import_artisynth
from emgface.face.parts import INNER, OUTER
from emgface.face.quality import element_quality
from emgface.fit.carry import carry
from emgface.fit.corners import Corners
from emgface.fit.deform import RELAXED_JACOBIAN, STIFFENING
from emgface.fit.mechanics import FINE_TOLERANCE, FitTissue
from emgface.fit.person import Fitted, fit_face
from emgface.fit.similarity import Floats, similarity
from emgface.fit.springs import at_nodes
from emgface.fit.targets import Sheet, sheets

Motion = Callable[[xr.Dataset], Floats]


def fitted_published(further: int) -> tuple[Fitted, Floats]:
    """Reference fitted to the other published face, and the true nodes in the frame of the fit.

    `further` nodes of the rings of the lips are landmarks in addition to the 30.
    """
    folder = Path(os.environ["EMGFACE_SHARED"]) / "artisynth_models"
    face = import_artisynth(folder)
    nodes = read_nodes(folder / "face_badin" / "badinface_oop_csa_midsagittal.node")
    b = nodes.position[np.argsort(nodes.id)]
    B = np.column_stack([b[:, 1], -b[:, 0], b[:, 2]])
    with (folder / "face_reference" / "derived" / "landmarks.csv").open() as stream:
        marks = {row["name"]: int(row["node"]) - 1 for row in csv.DictReader(stream)}
    if further:
        with (folder / "face_reference" / "derived" / "lip_ring_nodes.csv").open() as stream:
            ring = [int(r["node"]) - 1 for r in csv.DictReader(stream) if int(r["ring"]) == 5]
        for k in np.linspace(0, len(ring) - 1, further).round().astype(int):
            marks[f"lip_{k}"] = ring[k]
    X, own = face["position"].values, sheets(face)
    fit = fit_face(
        face, {name: B[node] for name, node in marks.items()},
        on_face={name: X[node] for name, node in marks.items()}, rim=True,
        **{name: (B, sheet.triangles) for name, sheet in own.items()},
    )  # fmt: skip
    there = np.array([B[marks[name]] for name in fit.deformed.landmarks.names])
    return fit, similarity(there, fit.deformed.landmarks.target, scaled=False)(B)


def gap(motion: Motion, further: int = 40) -> list[tuple[str, float]]:
    """Print and return the rms difference of the markers [mm] with each true ingredient."""
    fit, truth = fitted_published(further)
    face, q = fit.source, fit.face["position"].values
    true = carry(face, truth).face
    nodes = face["marker_node"].values
    field, fitted = motion(true), motion(fit.face)
    wanted, own = field[nodes], fitted[nodes]
    rows: list[tuple[str, float]] = []

    def tell(what: str, here: Floats, there: Floats) -> None:
        apart = 1e3 * float(np.sqrt(((here - there) ** 2).sum(axis=1).mean()))
        rows.append((what, apart))
        print(f"  {what:58s} {apart:.2f} mm rms", flush=True)

    tell("fitted mesh", own, wanted)
    tell("compared at equal places", own, at_places(face, truth, field, q[nodes]))
    known = fit.face.copy(deep=True)
    known["bundle_direction"].values[:] = true["bundle_direction"].values
    tell("with the true directions of the fibres", motion(known)[nodes], wanted)
    for what, weight in ingredients(face).items():
        mixed = q + weight[:, None] * (truth - q)
        quality = element_quality(mixed, face["connectivity"].values)
        if not (quality.smallest_det > 0.0).all():
            print(f"  {what}: elements inverted where true and fitted nodes meet")
            continue
        tell(f"with true nodes {what}", motion(carry(face, mixed).face)[nodes], wanted)
    better = carry(face, relaxed(face, truth)).face
    tell("true skin and inner surface, elements relaxed inside", motion(better)[nodes], wanted)
    return rows


def at_places(face: xr.Dataset, q: Floats, moved: Floats, places: Floats) -> Floats:
    """Displacements (n, 3) of the skin at its points nearest to places, from those of all nodes."""
    skin = sheets(face)["skin"].at(q)
    near = skin.nearest(places)
    return np.einsum("nk,nki->ni", near.weights, moved[skin.triangles[near.triangle]])


def ingredients(face: xr.Dataset) -> dict[str, Floats]:
    """Weights (n_nodes,) of the true positions: 1 in a part of the mesh, falling smoothly to 0."""
    from scipy.spatial import KDTree

    X = face["position"].values
    skin, inner = (
        KDTree(X[Sheet.from_face(face, layer).nodes]).query(X)[0] for layer in (OUTER, INNER)
    )
    mouth = X[face["marker_node"].values].mean(axis=0)
    away = np.linalg.norm(X - mouth, axis=1)

    def near(a: float, b: float) -> Floats:
        s = np.clip((b - away) / (b - a), 0.0, 1.0)
        return s * s * (3.0 - 2.0 * s)

    across = inner / np.maximum(skin + inner, 1e-9)
    return {
        "of the skin": across,
        "of the inner surface": 1.0 - across,
        "within 30 mm of the mouth": near(30e-3, 50e-3),
        "beyond 50 mm of the mouth": 1.0 - near(30e-3, 50e-3),
    }


def relaxed(face: xr.Dataset, truth: Floats) -> Floats:
    """True nodes after the relaxation of elements of a fit; nodes of both surfaces are held."""
    corners = Corners.from_elements(face["connectivity"].values.astype(np.int64))
    prescribed = np.unique(np.concatenate([sheet.nodes for sheet in sheets(face).values()]))
    springs = at_nodes(
        prescribed, truth[prescribed], np.tile(1e3 * np.eye(3), (len(prescribed), 1, 1))
    )
    q = truth
    for _ in range(2):
        tissue = FitTissue.toward_rectangles(
            corners, q, below=RELAXED_JACOBIAN, stiffening=STIFFENING
        )
        q = tissue.settle(springs, 0.5 * FINE_TOLERANCE)
    return q
