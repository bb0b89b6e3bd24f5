"""Inputs of a fit for checks: simulated persons, and damage that occurs with scans and landmarks."""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from emgface.face.template import template_face
from emgface.fit.inputs import points_of_face
from emgface.fit.loops import length
from emgface.fit.targets import sheets
from emgface.fit.triangulated import Surface

MOTION = Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix(), np.array([0.1, -0.3, 0.2])


@dataclass(frozen=True)
class Person:
    """Generated face, and its landmarks [m] in a frame of their own."""

    face: xr.Dataset
    landmarks: dict[str, np.ndarray]

    def moved(self, points: np.ndarray) -> np.ndarray:
        """Points (n, 3) of the face in the frame of the person [m]."""
        return points @ MOTION[0].T + MOTION[1]

    def surface(self, name: str = "skin") -> Surface:
        """Surface of the skin, or of the inner side, in the frame of the person."""
        own = sheets(self.face)[name]
        used, corner = np.unique(own.triangles, return_inverse=True)
        points = self.moved(self.face["position"].values[used])
        return Surface(points, corner.reshape(-1, 3).astype(np.int64))

    def write(self, folder: Path) -> tuple[Path, Path]:
        """Landmarks [mm] and skin [mm] as files."""
        marks, skin = folder / "landmarks.csv", folder / "skin.ply"
        with marks.open("w", newline="") as stream:
            out = csv.writer(stream)
            out.writerow(["name", "x_mm", "y_mm", "z_mm"])
            out.writerows([name, *np.round(1e3 * p, 5)] for name, p in self.landmarks.items())
        surface = self.surface()
        skin.write_text(ply(1e3 * surface.points, surface.triangles))
        return marks, skin


def ply(points: np.ndarray, triangles: np.ndarray) -> str:
    head = [
        "ply", "format ascii 1.0", f"element vertex {len(points)}", "property float x",
        "property float y", "property float z", f"element face {len(triangles)}",
        "property list uchar int vertex_indices", "end_header",
    ]  # fmt: skip
    rows = [" ".join(f"{v:.6f}" for v in p) for p in points]
    return "\n".join([*head, *rows, *(f"3 {a} {b} {c}" for a, b, c in triangles)]) + "\n"


def person_of(seed: int, resolution: str = "medium") -> Person:
    face = template_face(resolution=resolution, seed=seed)
    marks = {k: v @ MOTION[0].T + MOTION[1] for k, v in points_of_face(face).items()}
    return Person(face, marks)


Marks = dict[str, np.ndarray]
Damage = Callable[
    [np.random.Generator, Marks, np.ndarray, np.ndarray], tuple[Marks, np.ndarray, np.ndarray]
]


def holes(rng, marks, x, t):
    centre = x[rng.choice(len(x), rng.integers(1, 6))]
    radius = rng.uniform(0.003, 0.03, len(centre))
    apart = np.linalg.norm(x[t].mean(axis=1)[:, None] - centre[None], axis=2)
    return marks, x, t[(apart > radius).all(axis=1)]


def flipped_part(rng, marks, x, t):
    own = rng.random(len(t)) < rng.uniform(0.05, 0.5)
    t = t.copy()
    t[own] = t[own][:, ::-1]
    return marks, x, t


def flipped_all(rng, marks, x, t):
    return marks, x, t[:, ::-1].copy()


def wrong_unit(rng, marks, x, t):
    factor = rng.choice([1e3, 1e-3, 10.0, 0.1, 25.4, 100.0])
    if rng.random() < 0.5:
        return marks, factor * x, t
    return {k: factor * v for k, v in marks.items()}, x, t


def wrong_side(rng, marks, x, t):
    name = str(rng.choice([k for k in marks if k.endswith(("left", "right"))]))
    other = name.replace("left", "*").replace("right", "left").replace("*", "right")
    return marks | {name: marks[other]}, x, t


def sides_exchanged(rng, marks, x, t):
    swap = {k: k.replace("left", "*").replace("right", "left").replace("*", "right") for k in marks}
    return {k: marks[swap[k]] for k in marks}, x, t


def mirrored(rng, marks, x, t):
    sign = np.ones(3)
    sign[rng.integers(3)] = -1.0
    turned = t[:, ::-1].copy() if rng.random() < 0.5 else t
    return {k: v * sign for k, v in marks.items()}, x * sign, turned


def scan_mirrored(rng, marks, x, t):
    sign = np.ones(3)
    sign[rng.integers(3)] = -1.0
    return marks, x * sign, t


def noise(rng, marks, x, t):
    return marks, x + rng.uniform(1e-4, 4e-3) * rng.standard_normal(x.shape), t


def landmark_noise(rng, marks, x, t):
    s = rng.uniform(1e-3, 8e-3)
    return {k: v + s * rng.standard_normal(3) for k, v in marks.items()}, x, t


def self_intersection(rng, marks, x, t):
    centre = x[rng.integers(len(x))]
    weight = np.exp(-((np.linalg.norm(x - centre, axis=1) / rng.uniform(0.005, 0.02)) ** 2))
    return marks, x + weight[:, None] * rng.uniform(0.01, 0.05) * rng.standard_normal(3), t


def doubled(rng, marks, x, t):
    """A second layer of the scan, shifted."""
    return (
        marks,
        np.concatenate([x, x + 3e-3 * rng.standard_normal(3)]),
        np.concatenate([t, t + len(x)]),
    )


def exchanged(rng, marks, x, t):
    a, b = rng.choice(list(marks), 2, replace=False)
    return marks | {a: marks[b], b: marks[a]}, x, t


def cut(rng, marks, x, t):
    along = x @ rng.standard_normal(3)
    return marks, x, t[along[t].mean(axis=1) < np.quantile(along, rng.uniform(0.05, 0.9))]


def cropped(rng, marks, x, t):
    """A scan that ends up to 25 mm within the rim of the face, without the landmarks beyond it."""
    surface = Surface(x, t)
    rim = x[max(surface.loops, key=lambda loop: length(x[loop]))]
    within = KDTree(rim).query(x)[0] >= rng.uniform(0.0, 0.025)
    t = t[within[t].all(axis=1)]
    near = KDTree(x[np.unique(t)])
    return {k: v for k, v in marks.items() if near.query(v)[0] < 0.01}, x, t


def empty(rng, marks, x, t):
    return (marks, x, t[:0]) if rng.random() < 0.5 else ({}, x, t)


def huge(rng, marks, x, t):
    hit = rng.random(x.shape) < 1e-3
    size = rng.choice([1e9, 1e300, np.inf, np.nan])
    hit[rng.integers(len(x)), 0] = True  # at least one
    return marks, np.where(hit, size, x), t


def debris(rng, marks, x, t):
    """Many small loose triangles around the scan."""
    n = int(rng.integers(50, 800))
    at = x[rng.choice(len(x), n)] + 0.02 * rng.standard_normal((n, 3))
    loose = at[:, None] + 2e-3 * rng.standard_normal((n, 3, 3))
    new = len(x) + np.arange(3 * n).reshape(n, 3)
    return marks, np.concatenate([x, loose.reshape(-1, 3)]), np.concatenate([t, new])


def other_pose(rng, marks, x, t):
    """A scan that was moved against its landmarks."""
    return marks, x + rng.uniform(0.002, 0.04) * rng.standard_normal(3), t


DAMAGES: tuple[Damage, ...] = (
    holes, flipped_part, flipped_all, wrong_unit, wrong_side, sides_exchanged, mirrored, scan_mirrored,
    noise, landmark_noise, self_intersection, doubled, exchanged, cut, empty, huge, debris, other_pose,
    cropped,
)  # fmt: skip


def damaged(person: Person, number: int, damage: Damage | None = None):
    """Kind, landmarks, points and triangles of one damaged input, by default of all kinds in turn."""
    rng = np.random.default_rng(number)
    surface = person.surface()
    damage = damage or DAMAGES[number % len(DAMAGES)]
    given = {k: v.copy() for k, v in person.landmarks.items()}
    return damage.__name__, *damage(rng, given, surface.points.copy(), surface.triangles.copy())
