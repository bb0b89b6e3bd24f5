"""Files of landmarks and surfaces: what is read, and the located error of what is not."""

import json
import struct

import numpy as np
import pytest

from emgface.errors import FitError
from emgface.fit.readers.landmarks import landmarks_of, read_landmarks
from emgface.fit.readers.surfaces import read_surface, surface_of
from tests.fit.conftest import ply

POINTS = np.array([[10.0, 20.0, 30.0], [-50.0, 5.0, 1.5], [60.0, -70.0, 0.25]])
NAMES = ("nasion", "corner_left", "chin")

pytest.importorskip("trimesh")


def _csv(unit: str, sep: str = ",") -> str:
    head = sep.join(["name", *(f"{a}{unit}" for a in "xyz")])
    rows = [sep.join([n, *map(str, p)]) for n, p in zip(NAMES, POINTS, strict=True)]
    return "\n".join([head, *rows])


def _markups(system: str) -> str:
    points = [{"label": n, "position": p.tolist(), "positionStatus": "defined"}
              for n, p in zip(NAMES, POINTS, strict=True)]  # fmt: skip
    return json.dumps({"markups": [{"coordinateSystem": system, "controlPoints": points}]})


def _fcsv() -> str:
    rows = [f"id{k},{p[0]},{p[1]},{p[2]},0,0,0,1,1,1,0,{n},,"
            for k, (n, p) in enumerate(zip(NAMES, POINTS, strict=True))]  # fmt: skip
    return "\n".join(["# Markups fiducial file version = 4.11", "# CoordinateSystem = LPS",
                      "# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID",
                      *rows])  # fmt: skip


def _amira() -> str:
    rows = "\n".join(" ".join(map(str, p)) for p in POINTS)
    return (
        "# AmiraMesh 3D ASCII 2.0\ndefine Markers 3\nParameters { NumSets 1 }\n"
        f"Markers {{ float[3] Coordinates }} @1\n# Data section follows\n@1\n{rows}\n"
    )


READABLE = {
    "a.csv": (_csv("_mm"), None), "b.csv": (_csv(" [mm]", ";"), None), "c.csv": (_csv(""), "mm"),
    "d.mrk.json": (_markups("LPS"), None), "e.fcsv": (_fcsv(), None),
    "f.landmarkAscii": (_amira(), "mm"),
}  # fmt: skip


@pytest.mark.parametrize("name", READABLE)
def test_every_format_gives_the_same_points(tmp_path, name):
    text, unit = READABLE[name]
    (tmp_path / name).write_text(text)
    landmarks = read_landmarks(tmp_path / name, unit=unit)
    np.testing.assert_allclose(landmarks.position, 1e-3 * POINTS)
    assert landmarks.names == (NAMES if "landmark" not in name else ("1", "2", "3"))
    assert len(landmarks.digest) == 64


def test_ras_is_turned_into_lps(tmp_path):
    (tmp_path / "r.mrk.json").write_text(_markups("RAS"))
    landmarks = read_landmarks(tmp_path / "r.mrk.json")
    np.testing.assert_allclose(landmarks.position, 1e-3 * POINTS * [-1.0, -1.0, 1.0])


REFUSED = {
    "unit.csv": (_csv(""), "does not state its unit.*likely in mm"),
    "text.csv": (_csv("_mm").replace("20.0", "about 20"), "line 2"),
    "twice.csv": (_csv("_mm").replace("chin", "nasion"), "twice"),
    "header.csv": ("a,b,c\n1,2,3", "expected the columns name, x, y, z"),
    "nan.csv": (_csv("_mm").replace("20.0", "nan"), "point 0 of 3 is not finite"),
    "size.csv": (_csv("_m"), "check the unit"),
    "two.csv": (_csv("_mm").replace("z_mm", "z_cm"), "different units"),
    "empty.csv": ("  \n", "is empty"),
    "bad.mrk.json": ('{"markups": []}', "no markups file"),
    "deep.mrk.json": ("[" * 100_000, "no markups file"),
    "frame.mrk.json": (_markups("left"), "coordinate system"),
    "bad.fcsv": ("# columns = id,x\n1,2", "line 2"),
    "bad.landmarkAscii": ("# AmiraMesh\ndefine Markers 9\n@1 a\n@1\n1 2 3", "declares 9"),
    "binary.csv": ("\udcff", "not text in UTF-8"),
    "x.docx": ("1", "unknown ending"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_unusable_landmarks_are_refused_with_the_place(tmp_path, name):
    text, why = REFUSED[name]
    (tmp_path / name).write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(FitError, match=why):
        read_landmarks(tmp_path / name)


def test_contradicting_units_are_refused(tmp_path):
    (tmp_path / "a.csv").write_text(_csv("_mm"))
    with pytest.raises(FitError, match="states the unit mm, and m was given"):
        read_landmarks(tmp_path / "a.csv", unit="m")


def test_numbers_are_in_metres():
    landmarks = landmarks_of({"Corner left": (0.01, 0.02, 0.03), "b": (0.1, 0, 0)})
    assert landmarks.names == ("corner_left", "b")
    with pytest.raises(FitError, match="three numbers"):
        landmarks_of({"a": ("x", "y", "z")})


def _sphere(n: int = 16) -> tuple[np.ndarray, np.ndarray]:
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, n, endpoint=False), np.linspace(0.3, 2.8, n))
    points = 100 * np.stack([np.sin(v) * np.cos(u), np.sin(v) * np.sin(u), np.cos(v)], -1)
    i, j = np.meshgrid(np.arange(n - 1), np.arange(n), indexing="ij")
    a, b, c, d = (r * n + s % n for r, s in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)))
    t = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)]).reshape(-1, 3)
    return points.reshape(-1, 3), t


def _stl(points: np.ndarray, triangles: np.ndarray) -> bytes:
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *points[t].astype(np.float32).ravel(), 0) for t in triangles
    )
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + body


def _obj(points: np.ndarray, triangles: np.ndarray) -> str:
    rows = [f"v {p[0]} {p[1]} {p[2]}" for p in points]
    return "\n".join(
        ["mtllib ../../secret.mtl", *rows, *(f"f {a} {b} {c}" for a, b, c in triangles + 1)]
    )


@pytest.mark.parametrize("ending", ["ply", "stl", "obj"])
def test_every_format_gives_the_same_surface(tmp_path, ending):
    points, triangles = _sphere()
    data = {"ply": ply(points, triangles).encode(), "stl": _stl(points, triangles),
            "obj": _obj(points, triangles).encode()}[ending]  # fmt: skip
    (tmp_path / f"s.{ending}").write_bytes(data)
    scan = read_surface(tmp_path / f"s.{ending}", unit="mm")
    assert len(scan.surface.triangles) == len(triangles)
    assert len(scan.surface.points) == len(points)
    assert scan.surface.areas.sum() == pytest.approx(1e-6 * _area(points, triangles), rel=1e-6)
    assert not scan.notes
    with pytest.raises(FitError, match="does not state its unit"):
        read_surface(tmp_path / f"s.{ending}")


def _area(points: np.ndarray, triangles: np.ndarray) -> float:
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())


def test_turned_triangles_follow_their_neighbours():
    points, triangles = _sphere()
    mixed = triangles.copy()
    mixed[::7] = mixed[::7, ::-1]
    scan = surface_of(1e-3 * points, mixed)
    np.testing.assert_allclose(
        np.sort(np.roll(scan.surface.normals, 0), axis=0),
        np.sort(surface_of(1e-3 * points, triangles).surface.normals, axis=0), atol=1e-9,
    )  # fmt: skip
    assert "turned" in scan.notes[0]


DAMAGED = {
    "cut.ply": (lambda p, t: ply(p, t).encode()[:900], "cannot be read|refers|triangles"),
    "count.ply": (lambda p, t: ply(p, t).replace(f"vertex {len(p)}", "vertex 999999999999").encode(),
                  "cannot be read|triangles of shape"),
    "cut.stl": (lambda p, t: _stl(p, t)[:300], "cannot be read|triangles"),
    "nan.ply": (lambda p, t: ply(np.where(p > 99, np.nan, p), t).encode(), "not finite"),
    "few.obj": (lambda p, t: _obj(p, t[:3]).encode(), "at least 50 triangles"),
    "empty.stl": (lambda p, t: b"", "is empty"),
    "what.vtk": (lambda p, t: b"x", "unknown ending"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_surfaces_are_refused(tmp_path, name):
    write, why = DAMAGED[name]
    (tmp_path / name).write_bytes(write(*_sphere()))
    with pytest.raises(FitError, match=why):
        read_surface(tmp_path / name, unit="mm")
