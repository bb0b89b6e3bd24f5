"""Simulated persons: landmarks and surfaces of generated faces in a frame of their own."""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.face.template import template_face
from emgface.fit.inputs import points_of_face
from emgface.fit.targets import sheets
from emgface.fit.triangulated import Surface

MOTION = Rotation.from_rotvec([0.3, -0.2, 0.4]).as_matrix(), np.array([0.1, -0.3, 0.2])


@dataclass(frozen=True)
class Person:
    face: xr.Dataset
    landmarks: dict[str, np.ndarray]

    def moved(self, points: np.ndarray) -> np.ndarray:
        return points @ MOTION[0].T + MOTION[1]

    def surface(self, name: str = "skin") -> Surface:
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


@pytest.fixture(scope="session")
def person() -> Person:
    return person_of(5)


@pytest.fixture(scope="session")
def generic() -> xr.Dataset:
    return template_face(resolution="coarse")
