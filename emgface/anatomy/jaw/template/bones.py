"""Surfaces of the generated bones and cartilages: closed tubes along curves through landmarks.

They give each body its distribution of mass and are drawn; attachments are landmarks, not vertices.
Thicknesses are chosen.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PchipInterpolator

from emgface.anatomy.jaw.template.landmarks import CONDYLE
from emgface.anatomy.jaw.template.measures import JawMeasures
from emgface.face.parts import SKULL, Arch

Floats = NDArray[np.float64]
Index = NDArray[np.integer]

SECTIONS, SECTION_POINTS = 22, 12
"""Sections of half a tube and points of each."""
_MIRROR = np.array([-1.0, 1.0, 1.0])


class BoneSurface(NamedTuple):
    """Triangles of a body: its name, vertices (n, 3) [m], and triangles (m, 3), outward."""

    body: str
    points: Floats
    triangles: Index


class _Station(NamedTuple):
    """Centre of a section [m], and its half sizes across and along the surface of the tube [mm]."""

    centre: ArrayLike
    across: float
    along: float


def surfaces(
    places: Mapping[str, Floats], jaw: JawMeasures, arches: tuple[Arch, Arch]
) -> list[BoneSurface]:
    """Surfaces of all bodies; the first of each body is the one whose volume has its mass."""
    p = places
    hyoid, horn = p["hyoid"], p["horn"]
    notch, low = p["notch"], p["thyroid_low"]
    half = 0.5 * jaw.thyroid_width
    behind = notch[1] - jaw.thyroid_depth
    middle = 0.5 * (notch + low)
    tall = 5e2 * float(np.linalg.norm(notch - low))
    ring = 5e2 * jaw.cricoid_diameter
    cricoid = p["cricoid"]
    bones = [
        BoneSurface("jaw", *_arched(_mandible(p))),
        BoneSurface(
            "hyoid",
            *_arched(
                [
                    _Station(horn, 2.0, 2.5),
                    _Station(0.4 * hyoid + 0.6 * horn + [3e-3, 0.0, -1e-3], 2.0, 3.0),
                    _Station(hyoid + [9e-3, -3e-3, 0.0], 3.0, 4.5),
                    _Station(hyoid + [0.0, -1e-3, 0.0], 3.5, 5.5),
                ]
            ),
        ),
        BoneSurface(
            "thyroid",
            *_arched(
                [
                    _Station([half, behind, middle[2]], 1.5, 1.35 * tall),
                    _Station(
                        [0.62 * half, 0.5 * (behind + middle[1]), middle[2]], 1.6, 1.25 * tall
                    ),
                    _Station(middle - [0.0, 1.5e-3, 0.0], 2.0, tall),
                ]
            ),
        ),
        BoneSurface(
            "cricoid",
            *_arched(
                [
                    _Station(
                        cricoid
                        + 0.92e-3 * ring * np.array([np.sin(t), -np.cos(t), 0.0])
                        + [0.0, 0.0, 4e-3 * np.cos(0.5 * t) ** 2],
                        2.0,
                        3.0 + 8.0 * np.cos(0.5 * t) ** 2,
                    )
                    for t in np.linspace(0.0, np.pi, 7)
                ]
            ),
        ),
    ]
    for arch in arches:
        bones.append(
            BoneSurface("skull" if arch.bone == SKULL else "jaw", arch.points, arch.triangles)
        )
    for body, stations in (
        ("jaw", _coronoid(p)),
        ("skull", _cheek(p)),
        ("skull", _eminence(p, jaw)),
    ):
        points, triangles = _tube(*_sections(stations))
        bones.append(BoneSurface(body, points, triangles))
        bones.append(BoneSurface(body, points * _MIRROR, triangles[:, ::-1]))
    return bones


def _mandible(p: Mapping[str, Floats]) -> list[_Station]:
    """Condyle, neck, ramus, angle, body and symphysis."""
    condyle, gonion, molar = p["condyle"], p["gonion"], p["molar"]
    wide, deep, high = 1e3 * CONDYLE
    bottom = p["menton"][2]

    def body(x: float, y: float, share: float) -> Floats:
        """Middle between the teeth and the lower border, which rises to the angle."""
        border = bottom + share * (gonion[2] - bottom)
        crest = molar[2] - 9e-3
        return np.array([x, y, 0.5 * (border + crest)])

    tall = 5e2 * (molar[2] - 9e-3 - bottom)
    return [
        _Station(condyle + [0.0, 0.0, 1e-3 * high], 0.55 * wide, 0.5 * deep),
        _Station(condyle, 0.9 * wide, deep),
        _Station(condyle + [-2e-3, 2e-3, -14e-3], 4.0, 6.0),
        _Station(0.55 * condyle + 0.45 * gonion + [-1e-3, 14e-3, 0.0], 4.0, 16.0),
        _Station(gonion + [-1e-3, 15e-3, 13e-3], 5.0, 16.5),
        _Station(body(molar[0] + 11e-3, molar[1] - 12e-3, 0.62), 6.0, 0.75 * tall),
        _Station(body(molar[0] + 3e-3, molar[1] + 2e-3, 0.3), 6.5, 0.9 * tall),
        _Station(body(0.62 * molar[0], p["menton"][1] - 9e-3, 0.05), 6.0, tall),
        _Station([0.0, p["menton"][1] - 1e-3, 0.5 * (bottom + molar[2] - 9e-3)], 6.5, tall),
    ]


def _coronoid(p: Mapping[str, Floats]) -> list[_Station]:
    tip = p["coronoid"]
    root = 0.5 * (p["condyle"] + p["gonion"]) + [-1e-3, 22e-3, 2e-3]
    return [
        _Station(tip, 1.5, 2.0),
        _Station(0.5 * (tip + root), 3.0, 6.0),
        _Station(root, 3.5, 9.0),
    ]


def _cheek(p: Mapping[str, Floats]) -> list[_Station]:
    """Zygomatic arch."""
    back = p["condyle"] + [7e-3, 2e-3, 7e-3]
    return [
        _Station(back, 2.5, 4.0),
        _Station(p["arch"], 2.5, 4.5),
        _Station(p["zygoma"] + [0.0, 0.0, 3e-3], 4.0, 7.0),
        _Station(p["zygoma"] + [-12e-3, 9e-3, 4e-3], 5.0, 9.0),
    ]


def _eminence(p: Mapping[str, Floats], jaw: JawMeasures) -> list[_Station]:
    """Roof of the joint along the path of the condyle."""
    from emgface.anatomy.jaw.template.joints import path_depth

    top = p["condyle"] + [0.0, 0.0, 1e-3 + CONDYLE[2]]
    ways = np.linspace(-5e-3, 1.25 * jaw.eminence_length, 6)
    return [
        _Station(top + [0.0, s, 2.5e-3 - path_depth(max(s, 0.0), jaw.eminence_length)], 9.0, 1.5)
        for s in ways
    ]


def _sections(stations: list[_Station]) -> tuple[Floats, Floats]:
    """Centres (k, 3) and half sizes (k, 2) [m] at equal distances along a smooth curve."""
    centres = np.array([np.asarray(s.centre, dtype=np.float64) for s in stations])
    sizes = 1e-3 * np.array([(s.across, s.along) for s in stations])
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))])
    at = np.linspace(0.0, way[-1], SECTIONS)
    return PchipInterpolator(way, centres)(at), PchipInterpolator(way, sizes)(at)


def _arched(stations: list[_Station]) -> tuple[Floats, Index]:
    """Tube of a right half that ends in the midline, and of its mirror image."""
    centres, sizes = _sections(stations)
    centres[-1, 0] = 0.0
    rings = _rings(centres, sizes)
    rings[-1, :, 0] = 0.0
    return _closed(np.concatenate([rings, rings[-2::-1] * _MIRROR]))


def _tube(centres: Floats, sizes: Floats) -> tuple[Floats, Index]:
    return _closed(_rings(centres, sizes))


def _rings(centres: Floats, sizes: Floats) -> Floats:
    """Sections (k, AROUND, 3): ellipses across the curve, with one axis horizontal."""
    along = np.gradient(centres, axis=0)
    if centres[-1, 0] == 0.0:
        along[-1] = [-1.0, 0.0, 0.0]  # the mirror image continues it
    t = along / np.linalg.norm(along, axis=1)[:, None]
    outward = np.column_stack([-t[:, 1], t[:, 0], np.zeros(len(t))])
    outward *= np.where(outward @ [1.0, 1e-3, 0.0] < 0.0, -1.0, 1.0)[:, None]
    steep = np.linalg.norm(outward, axis=1)
    n = np.where((steep > 0.5)[:, None], outward, [1.0, 0.0, 0.0] * np.ones((len(t), 3)))
    for k in range(1, len(n)):  # the axes turn steadily
        blend = n[k - 1] - (n[k - 1] @ t[k]) * t[k]
        wanted = n[k] - (n[k] @ t[k]) * t[k]
        n[k] = 0.5 * blend + wanted if wanted @ blend > 0.0 else blend
        n[k] /= np.linalg.norm(n[k])
    n[0] -= (n[0] @ t[0]) * t[0]
    n[0] /= np.linalg.norm(n[0])
    b = np.cross(t, n)
    angle = np.linspace(0.0, 2.0 * np.pi, SECTION_POINTS, endpoint=False)
    return (
        centres[:, None]
        + (sizes[:, :1] * np.cos(angle))[..., None] * n[:, None]
        + (sizes[:, 1:] * np.sin(angle))[..., None] * b[:, None]
    )


def _closed(rings: Floats) -> tuple[Floats, Index]:
    """Triangles of a tube with both ends closed, its volume positive."""
    k, m = rings.shape[:2]
    index = np.arange(k * m).reshape(k, m)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    points = np.concatenate([rings.reshape(-1, 3), rings[0].mean(0)[None], rings[-1].mean(0)[None]])
    second = np.roll(quads, 1, axis=1)
    quads = np.where((points[quads, 0].mean(axis=1) < 0.0)[:, None], second, quads)
    caps = [
        np.column_stack([index[0], after[0], np.full(m, k * m)]),
        np.column_stack([after[-1], index[-1], np.full(m, k * m + 1)]),
    ]
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], *caps])
    corners = points[triangles]
    if np.linalg.det(corners - points.mean(0)).sum() < 0.0:
        triangles = triangles[:, ::-1]
    return points, triangles
