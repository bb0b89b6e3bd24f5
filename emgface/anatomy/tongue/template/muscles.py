"""Muscles of the generated tongue: elements with directions, and fibres that are drawn.

Courses: Standring (ed.), Gray's Anatomy, chapter Oral cavity, muscles of the tongue; Takemoto 2001, J
Speech Lang Hear Res 44:95-107 (interdigitating laminae of genioglossus, verticalis and transversus,
with longitudinals in the rind); as commonly described. A muscle fills a region of the block (u from
the front to the hyoid, v from floor to dorsum, |w| from the midline to the side) and a fraction of
every element there; the fractions of interdigitating muscles add up to at most 1.
"""

from collections.abc import Callable, Mapping
from typing import Final, NamedTuple

import numpy as np

from emgface.anatomy.tongue.template.shape import Floats, TongueMesh
from emgface.face.parts import Bundle, Fibre
from emgface.face.quality import element_centres, element_quality

STRESS: Final = 100e3
"""Largest active stress for the forces of line muscles [Pa] (Stavness et al., chapter on the coupled
model, section 11.2.2.3)."""
GENIAL: Final = ("chin_back", 0.0, 2.0, 7.0)
"""Origin of genioglossus: landmark and displacement [mm], that of the geniohyoid of the jaw model above
it."""
STYLOID: Final = np.array([-14e-3, -7e-3, -28e-3])
"""Tip of the styloid process from the right condyle, as the ligament of the jaw model [m]."""
FIRST_PART, SECOND_PART, ALL = (0.0, 0.42), (0.42, 1.0), (0.0, 1.0)
_Range = tuple[float, float]
_Course = Callable[["_Here"], Floats]


class _Here(NamedTuple):
    """Centres, and unit vectors along u, v, w, of elements on one side; landmarks of that side [m]."""

    centre: Floats
    along: Floats
    genial: Floats
    horn: Floats


class TongueMuscle(NamedTuple):
    """Region u, v, |w| of a muscle, fraction of its elements, course, and drawn lines of nodes.

    ``lines`` has the direction of the lines (0, 1, 2 along u, v, w) and two coordinates of each.
    """

    title: str
    u: _Range
    v: _Range
    w: _Range
    share: float
    course: _Course
    lines: tuple[int, tuple[tuple[float, float], ...]]


def _from(name: str) -> _Course:
    return lambda here: here.centre - getattr(here, name)


def _along(axis: int) -> _Course:
    return lambda here: here.along[:, axis]


# fmt: off
TONGUE_MUSCLES: Final = {
    "GGA": TongueMuscle("anterior genioglossus", (0.0, 0.34), (0.2, 0.86), FIRST_PART, 0.45,
                        _from("genial"), (1, ((0.1, 0.2), (0.25, 0.2)))),
    "GGM": TongueMuscle("middle genioglossus", (0.34, 0.62), (0.2, 0.86), FIRST_PART, 0.45,
                        _from("genial"), (1, ((0.4, 0.2), (0.55, 0.2)))),
    "GGP": TongueMuscle("posterior genioglossus", (0.62, 1.0), (0.2, 1.0), FIRST_PART, 0.45,
                        _from("genial"), (1, ((0.7, 0.2), (0.85, 0.2)))),
    "GH": TongueMuscle("geniohyoid", ALL, (0.0, 0.2), FIRST_PART, 0.6, _along(0), (0, ((0.0, 0.2),))),
    "MH": TongueMuscle("mylohyoid", ALL, (0.0, 0.2), ALL, 0.35, _along(2),
                  (2, ((0.25, 0.0), (0.55, 0.0)))),
    "HG": TongueMuscle("hyoglossus", (0.5, 1.0), (0.0, 0.86), SECOND_PART, 0.3, _from("horn"),
                  (1, ((0.7, 0.8), (0.85, 0.8)))),
    "STY": TongueMuscle("styloglossus", (0.1, 0.8), (0.6, 0.86), (0.6, 1.0), 0.25, _along(0),
                  (0, ((0.75, 1.0),))),
    "IL": TongueMuscle("inferior longitudinal", (0.05, 0.9), (0.2, 0.5), (0.3, 0.7), 0.35, _along(0),
                 (0, ((0.4, 0.5),))),
    "VERT": TongueMuscle("verticalis", (0.0, 0.7), (0.5, 0.86), (0.2, 1.0), 0.2, _along(1),
                   (1, ((0.2, 0.6), (0.4, 0.6)))),
    "TRANS": TongueMuscle("transversus", (0.0, 0.85), (0.5, 0.86), ALL, 0.25, _along(2),
                    (2, ((0.2, 0.7), (0.4, 0.7), (0.6, 0.7)))),
    "SL": TongueMuscle("superior longitudinal", ALL, (0.86, 1.0), ALL, 0.5, _along(0),
                 (0, ((1.0, 0.0), (1.0, 0.5)))),
}
# fmt: on
"""Muscles of a side by their usual abbreviation."""


def place_tongue_muscles(
    mesh: TongueMesh, places: Mapping[str, Floats]
) -> tuple[list[Fibre], list[Bundle], dict[str, float]]:
    """Fibres, bundles and largest forces [N] of the muscles of both sides, exact mirror images.

    The force is `STRESS` times the physiological cross-section, the volume of the muscle over the mean
    length of its drawn fibres.
    """
    u, v, w = mesh.places.T
    centre = element_centres(mesh.position, mesh.connectivity)
    volume = element_quality(mesh.position, mesh.connectivity).volume
    layer = 1.0 / mesh.shape[1]
    fibres, bundles, force = list[Fibre](), list[Bundle](), dict[str, float]()
    for name, muscle in TONGUE_MUSCLES.items():
        inside = _in(u, muscle.u) & _in(np.abs(w), muscle.w)
        inside &= _in(_even(v, layer), muscle.v)
        for side, sign in (("_L", -1.0), ("_R", 1.0)):
            element = np.flatnonzero(inside & (sign * w > 0.0))
            mirror = np.array([sign, 1.0, 1.0])
            horn = 0.5 * (places["hyoid"] + places["horn"]) + [4e-3, 0.0, 0.0]
            genial = places[GENIAL[0]] + 1e-3 * np.array(GENIAL[1:])
            here = _Here(centre[element], mesh.directions[element], genial, horn * mirror)
            direction = muscle.course(here)
            direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
            share = np.full(len(element), muscle.share)
            bundles.append(Bundle(name + side, element, direction, share))
            own = _lines(mesh, name + side, muscle, sign, places["condyle"] * mirror)
            fibres += own
            inner = [f.position[f.node >= 0] for f in own if f.node is not None]
            way = [np.linalg.norm(np.diff(x, axis=0), axis=1).sum() for x in inner]
            force[name + side] = STRESS * muscle.share * float(volume[element].sum() / np.mean(way))
    return fibres, bundles, force


def _in(x: Floats, bounds: _Range) -> np.ndarray:
    return (x > bounds[0]) & (x <= bounds[1])


def _even(v: Floats, layer: float) -> Floats:
    """Heights at which the first and the last layer belong to the floor and to the rind."""
    return np.where(v < layer, 0.1, np.where(v > 1.0 - layer, 0.93, np.clip(v, 0.21, 0.85)))


def _lines(
    mesh: TongueMesh, name: str, muscle: TongueMuscle, sign: float, condyle: Floats
) -> list[Fibre]:
    """Lines of nodes through the region; those of styloglossus go on to the styloid process."""
    axis, at = muscle.lines
    fibres = list[Fibre]()
    low, high = (muscle.u, muscle.v, muscle.w)[axis]
    for place in at:
        other = iter(place)
        index: list[int | np.ndarray] = []
        for k, n in enumerate(mesh.shape):
            if k == axis:
                x = np.arange(n + 1) / n if k < 2 else np.abs(np.arange(n // 2 + 1) * 2.0 / n)
                inner = np.flatnonzero((x >= low - 1e-9) & (x <= high + 1e-9))
                index.append(inner if k < 2 else n // 2 + (sign * inner).astype(int))
            elif k < 2:
                index.append(round(next(other) * n))
            else:
                index.append(n // 2 + int(sign) * round(next(other) * (n // 2)))
        node = np.asarray(mesh.node[tuple(index)])
        position = mesh.position[node]
        if name.startswith("STY"):
            tip = condyle + STYLOID * [sign, 1.0, 1.0]
            fibres.append(
                Fibre(name, np.concatenate([position, tip[None]]), np.append(node, -1), "skull")
            )
        else:
            fibres.append(Fibre(name, position, node))
    return fibres
