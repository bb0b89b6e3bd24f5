"""Outline of an excision: the chart at its place on the lip, and its shape in the chart."""

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import TreatmentError
from emgface.face.check import sheet_nodes
from emgface.face.lip_shape import LipRim, lip_rim
from emgface.face.parts import OUTER
from emgface.face.surface import faces_among
from emgface.face.template.measures import MM
from emgface.treatment.columns import Chart
from emgface.treatment.lengths import SHORTEST_LENGTH_MM
from emgface.treatment.plan import WEDGE_NUMBERS, Incision, Tumour, Wedge

Floats = NDArray[np.float64]
Point = tuple[float, float]

ABOVE: Final = 6e-3  #: continuation of the sides beyond the margin, which it follows obliquely [m]
CORNER: Final = 2e-3  #: distance from the corner of the mouth within which nothing is cut [m]
DEEP: Final = {"all": None, "outer": 1, "outer and centre": 2}  #: layers that are removed
HIGHEST_WEDGE: Final = 40e-3  #: largest height of a wedge [m]
WIDEST_WEDGE_MM: Final = 80.0  #: largest width of a wedge [mm]
THICK: Final = 15e-3  #: largest distance of the tissue of a lip from its skin [m]
LARGEST_TUMOUR: Final = 0.2  #: largest extent of a tumour, above which it is in another unit [m]
TAPER: Final = 1.5  #: height of a V or shield that contains a tumour, over the depth of the tumour


@dataclass(frozen=True, eq=False)
class Outline:
    """Closed polygon in a chart, and the points at which its edges meet when it is closed.

    `corners` are those inside the lip, `sides` the segments along which is cut. The wound is closed
    from every one of the `tips` to its neighbours among the `peaks` and the margin. `layers` counts
    from the skin, None is all; `share` is the removed fraction of the margin [1].
    """

    chart: Chart
    polygon: tuple[Point, ...]
    corners: tuple[Point, ...]
    sides: tuple[tuple[Point, Point], ...]
    tips: tuple[Point, ...]
    peaks: tuple[Point, ...]
    layers: int | None
    share: float

    def contains(self, flat: Floats) -> NDArray[np.bool_]:
        """Mask of the points (n, 2) inside the polygon."""
        inside = np.zeros(len(flat), dtype=bool)
        if not self.polygon:
            return inside
        x, y = flat.T
        polygon = np.array(self.polygon)
        for (x0, y0), (x1, y1) in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            if y0 == y1:
                continue
            spans = (y0 > y) != (y1 > y)
            inside ^= spans & (x < x0 + (y - y0) * (x1 - x0) / (y1 - y0))
        return inside


def outline_of(face: xr.Dataset, step: Wedge | Incision) -> Outline:
    """Outline of a step on a face; TreatmentError if the place is at the corner of the mouth."""
    rim = lip_rim(face)
    margin = _margin_of(face, rim, step.lip)
    width = MM * step.width if isinstance(step, Wedge) else 0.0
    return _drawn(face, step, (rim, margin), step.place, (width, MM * step.height))


def _margin_of(face: xr.Dataset, rim: LipRim, lip: str) -> Floats:
    return np.asarray(face["position"].values[rim.upper if lip == "upper" else rim.lower])


def _along(margin: Floats) -> Floats:
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(margin, axis=0), axis=1)))


def _at(margin: Floats, s: Floats | float) -> Floats:
    length = _along(margin)
    return np.stack([np.interp(s, length, margin[:, k]) for k in range(3)], axis=-1)


def _drawn(
    face: xr.Dataset,
    step: Wedge | Incision,
    lip: tuple[LipRim, Floats],
    place: float,
    size: tuple[float, float],
) -> Outline:
    """Shape of a width and a height [m] at a place of the margin."""
    rim, margin = lip
    width, height = size
    total = float(_along(margin)[-1])
    s = place * total
    if s - width / 2.0 < CORNER or s + width / 2.0 > total - CORNER:
        raise TreatmentError(
            "at the commissure",
            f"the excision reaches from {1e3 * (s - width / 2):.1f} to {1e3 * (s + width / 2):.1f} mm "
            f"of the {step.lip} lip, whose margin is {1e3 * total:.1f} mm long: it is at the corner of "
            "the mouth, where no direct closure exists; choose another place or a smaller width",
        )
    # lateral ends in the order of the chart, which is right-handed with the normal outwards
    ends = _at(margin, np.array([s - width / 2.0, s + width / 2.0]))
    chart = chart_at(face, rim, step.lip, margin, s, max(width, 6e-3), max(height, 6e-3))
    a, b = chart.flat(ends if step.lip == "lower" else ends[::-1])
    shape = "slit" if isinstance(step, Incision) or width == 0.0 else step.shape
    layers = DEEP[step.layers] if isinstance(step, Wedge) else None
    return _shaped(shape, chart, (a, b), height, layers, width / total)


def chart_at(
    face: xr.Dataset,
    rim: LipRim,
    lip: str,
    margin: Floats,
    s: float,
    width: float,
    height: float,
) -> Chart:
    """Chart of the skin of a lip at the arc length s of its margin, over a width and a height [m]."""
    position = face["position"].values
    total = float(_along(margin)[-1])
    origin = _at(margin, s)
    one, two = _at(margin, np.clip(np.array([s - width / 2, s + width / 2]), 0.0, total))
    along = (two - one) if lip == "lower" else (one - two)
    along /= np.linalg.norm(along)
    faces, _ = faces_among(face["connectivity"].values, sheet_nodes(face, OUTER))
    middle = position[faces].mean(axis=1)
    corners = position[faces]
    normal = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    flat = faces[:, 2] == faces[:, 3]
    normal[flat] = 0.5 * np.cross(
        corners[flat, 1] - corners[flat, 0], corners[flat, 2] - corners[flat, 0]
    )
    away = np.linalg.norm(middle - origin, axis=1)
    mine = (away < max(height, 1.2 * float(away.min()))) & of_lip(position, rim, lip, middle)
    out = normal[mine].sum(axis=0)
    out = out - (out @ along) * along
    out /= np.linalg.norm(out)
    return Chart(origin, along, np.cross(out, along), out)


def of_lip(position: Floats, rim: LipRim, lip: str, points: Floats) -> NDArray[np.bool_]:
    """Mask of the points that are nearer to the margin of a lip than to that of the other."""
    upper, lower = (KDTree(position[nodes]).query(points)[0] for nodes in (rim.upper, rim.lower))
    return np.asarray(upper < lower if lip == "upper" else lower < upper)


def in_excision(face: xr.Dataset, outline: Outline, lip: str, points: Floats) -> NDArray[np.bool_]:
    """Mask of the points (n, 3) of a lip in an outline, up to `THICK` from the plane of its chart."""
    inside = outline.contains(outline.chart.flat(points))
    inside &= np.abs((points - outline.chart.origin) @ outline.chart.out) < THICK
    return inside & of_lip(face["position"].values, lip_rim(face), lip, points)


def _shaped(
    shape: str,
    chart: Chart,
    ends: tuple[Floats, Floats],
    h: float,
    layers: int | None,
    share: float,
) -> Outline:
    """Polygon of a shape between two points of the margin."""
    a, b = ends
    m, w = 0.5 * (a + b), float(b[0] - a[0])
    down = np.array([0.0, h])
    tips, peaks, inner = [m + down], list[Floats](), list[Floats]()
    up_a = up_b = np.array([0.0, -1.0])
    if shape == "V":
        inner = [*tips]
        up_a, up_b = ((p - tips[0]) / np.linalg.norm(p - tips[0]) for p in (a, b))
    elif shape == "slit":
        inner = [*tips]
    elif shape == "shield":
        inner = [a + 0.5 * down, tips[0], b + 0.5 * down]
    elif shape == "rectangle":
        inner = [a + down, tips[0], b + down]
    else:
        quarter = np.array([0.25 * w, 0.0])
        tips, peaks = [m - quarter + down, m + quarter + down], [m + 0.45 * down]
        inner = [tips[0], peaks[0], tips[1]]
    chain = [a + ABOVE * up_a, *inner, b + ABOVE * up_b]
    points = [(float(x), float(y)) for x, y in chain]
    sides = [*zip(points[:-1], points[1:], strict=True)]
    if shape == "slit":
        sides, points = sides[:1], []
    return Outline(
        chart,
        tuple(points),
        tuple((float(x), float(y)) for x, y in inner),
        tuple(sides),
        tuple((float(x), float(y)) for x, y in tips),
        tuple((float(x), float(y)) for x, y in peaks),
        layers,
        share,
    )


def wedge_around(face: xr.Dataset, step: Tumour, folder: Path) -> Wedge:
    """Smallest wedge that contains a tumour and its margin of healthy tissue.

    The surface of the tumour is read from `folder`. Raises TreatmentError if the tumour is not in the
    lip, or too deep for a wedge.
    """
    rim = lip_rim(face)
    margin = _margin_of(face, rim, step.lip)
    points = _tumour_points(step, folder)
    position = face["position"].values
    centre = points.mean(axis=0)
    skin = sheet_nodes(face, OUTER)
    away, _ = KDTree(position[skin]).query(centre)
    if away > THICK or not of_lip(position, rim, step.lip, centre[None])[0]:
        raise TreatmentError(
            "tumour",
            f"the centre of the tumour is {1e3 * away:.1f} mm from the skin or not in the {step.lip} "
            "lip, expected a tumour in this lip: check centre, unit and lip",
        )
    length = _along(margin)
    dense = np.linspace(0.0, length[-1], 2001)
    s = float(dense[np.argmin(np.linalg.norm(_at(margin, dense) - centre, axis=1))])
    chart = chart_at(face, rim, step.lip, margin, s, 12e-3, 12e-3)
    flat = chart.flat(points)
    flat = (
        flat
        + MM
        * step.margin
        * (flat - flat.mean(axis=0))
        / np.maximum(np.linalg.norm(flat - flat.mean(axis=0), axis=1), 1e-9)[:, None]
    )
    flat[:, 0] *= 1.0 if step.lip == "lower" else -1.0
    middle = 0.5 * (flat[:, 0].min() + flat[:, 0].max())
    depth = float(flat[:, 1].max())
    taper = 1.0 if step.shape == "rectangle" else TAPER
    if depth <= 0.0 or taper * depth > HIGHEST_WEDGE:
        raise TreatmentError(
            "tumour",
            f"the tumour with its margin is {1e3 * depth:.1f} mm below the margin of the lip, expected "
            f"0 to {1e3 * HIGHEST_WEDGE / taper:.1f} mm for this shape: check its centre",
        )
    height = taper * depth
    v = np.clip(flat[:, 1], 0.0, None) / height
    inside = {
        "V": 1.0 - v,
        "rectangle": np.ones_like(v),
        "shield": np.minimum(1.0, 2.0 * (1.0 - v)),
        "W": np.where(v < 0.45, 1.0, 0.5),
    }[step.shape]
    width = float(np.max(2.0 * np.abs(flat[:, 0] - middle) / inside))
    place = (s + middle) / length[-1]
    # one that is too wide or at the corner is refused where it is drawn
    drawn = float(np.clip(place, 0.0, 1.0)), min(1e3 * width, WIDEST_WEDGE_MM), 1e3 * height
    return step.wedge(dict(zip(WEDGE_NUMBERS, drawn, strict=True)))


def _tumour_points(step: Tumour, folder: Path) -> Floats:
    """Points (n, 3) of the surface of a tumour [m]."""
    if step.surface is None:
        golden = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(400)
        z = 1.0 - 2.0 * (np.arange(400) + 0.5) / 400
        r = np.sqrt(1.0 - z * z)
        sphere = np.stack([r * np.cos(golden), r * np.sin(golden), z], axis=1)
        return MM * (np.array(step.centre) + np.array(step.radii) * sphere)
    path = Path(step.surface)
    if path.is_absolute() or ".." in path.parts or path.suffix.lower() not in (".stl", ".obj"):
        raise TreatmentError(
            "surface",
            f"surface = {step.surface!r}: expected an .stl or .obj file in the folder of the plan",
        )
    try:
        load: Any = getattr(import_module("trimesh"), "load")  # noqa: B009  # an optional library
    except ImportError as error:
        raise TreatmentError(
            "surface",
            "the surface of a tumour is read by trimesh, which is not installed, expected it: install "
            "emgface[surgery], or state centre and radii",
        ) from error
    try:
        mesh = load(folder / path, force="mesh")
        points = np.asarray(mesh.vertices, dtype=np.float64)
    except (OSError, ValueError, AttributeError) as error:
        raise TreatmentError(
            "surface", f"the surface {path} cannot be read ({error}), expected .stl or .obj"
        ) from error
    if len(points) < 4 or not np.isfinite(points).all():
        raise TreatmentError(
            "surface", f"the surface {path} has {len(points)} points, expected a closed surface"
        )
    scale, other = (MM, "m") if step.unit == "mm" else (1.0, "mm")
    across = scale * float(np.ptp(points, axis=0).max())
    if not MM * SHORTEST_LENGTH_MM < across < LARGEST_TUMOUR:
        raise TreatmentError(
            "surface",
            f"the surface {path} is {1e3 * across:.3g} mm across, expected {SHORTEST_LENGTH_MM:g} to "
            f"{1e3 * LARGEST_TUMOUR:g} mm: if its lengths are in {other}, write unit = '{other}'",
        )
    if not mesh.is_watertight:  # a part of a tumour would be contained, and the rest not
        _, count = np.unique(np.sort(mesh.edges, axis=1), axis=0, return_counts=True)
        raise TreatmentError(
            "surface",
            f"the surface {path} has {int((count != 2).sum())} edges that do not join two triangles, "
            "expected a closed surface: close its holes, or state centre and radii",
        )
    return scale * points
