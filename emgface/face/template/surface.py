"""Skin and inner surface of the template, as maps from the chart to space.

The head is a stack of half ellipses about the axis between the ears, one for every tau on the
midline profile; nose, lips, chin and cheekbones are added to it as relief. The inner surface is
below it by the thickness of the tissue. Frame: y = 0 at the tragia, z = 0 between the lips.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from emgface.errors import FaceError
from emgface.face.template.measures import Measures
from emgface.face.template.outline import chart
from emgface.face.template.relief import (
    CHIN_PAD,
    LIP_DEPTH,
    LIP_PROFILE,
    LIP_ROLL,
    MOUTH_BACK,
    NOSE_DEPTH,
    lip_protrusion,
    lip_roll,
    nose,
    nose_lift,
    philtrum,
    relief,
    sulcus_back,
    thickness,
)

Floats = NDArray[np.float64]

_NORMAL_WINDOW: Final = 0.014
"""Half length of the profile over which directions through the tissue are averaged [m]."""

_NEWTON_STEPS: Final = 12

_NEWTON_CHANGE: Final = 1e-12
"""Change of the ring and ray coordinates at which Newton's method ends."""

_PLACE_TOLERANCE: Final = 1e-5  #: largest error of a position found in the chart [m]


@dataclass(frozen=True)
class Surfaces:
    """Both surfaces of the left half of a face, from its measures."""

    measures: Measures

    @cached_property
    def _profile(self) -> tuple[CubicSpline, Floats]:
        """Midline of the head without relief: (y, z) over tau, and the tau of its knots."""
        m = self.measures
        top, low = m.upper_lip_height, -m.chin_height
        chin = m.face_depth + m.chin_protrusion - CHIN_PAD
        points = np.array(
            [
                (m.face_depth - 0.07 * m.face_depth, top + 1.25 * m.nose_height),
                (m.face_depth - 0.06 * m.face_depth, top + m.nose_height),
                (m.face_depth - 0.02 * m.face_depth, top + 0.4 * m.nose_height),
                (m.face_depth, top),
                (m.face_depth - MOUTH_BACK, 0.0),
                (m.face_depth - sulcus_back(m), -m.lower_lip_height),
                (chin + 0.022 * low, 0.70 * low),
                (chin + 0.18 * low, 0.90 * low),
                (chin + 0.47 * low, 1.00 * low),
                (chin + 0.85 * low, 1.04 * low),
                (chin + 1.28 * low, 1.04 * low),
            ]
        )[::-1]
        length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        tau = length - length[6]
        return CubicSpline(tau, points), tau

    @cached_property
    def _half_widths(self) -> PchipInterpolator:
        m = self.measures
        low = self.tau_gnathion
        top = m.upper_lip_height
        cheek, jaw = 0.5 * m.face_width, 0.5 * m.jaw_width
        return PchipInterpolator(
            [low - 0.05, low, 0.6 * low, 0.0, top + 0.45 * m.nose_height, top + 2 * m.nose_height],
            [
                0.85 * jaw,
                1.0 * jaw,
                jaw + 0.25 * (cheek - jaw),
                jaw + 0.65 * (cheek - jaw),
                cheek,
                cheek,
            ],
        )

    @cached_property
    def _angle(self) -> tuple[Floats, Floats]:
        """Arc length over angle of the half ellipse at the mouth: knots of angle and length [m]."""
        a, b = float(self._half_widths(0.0)), self.measures.face_depth
        angle = np.linspace(0.0, 0.5 * np.pi, 400)
        middle = 0.5 * (angle[1:] + angle[:-1])
        speed = np.hypot(a * np.cos(middle), b * np.sin(middle))
        return angle, np.concatenate([[0.0], np.cumsum(speed * np.diff(angle))])

    @property
    def tau_gnathion(self) -> float:
        """Chart coordinate of the lowest point of the chin [m]."""
        return float(self._profile[1][2])

    @cached_property
    def mouth_half_width(self) -> float:
        """Half width of the mouth along the skin [m]."""
        angle, length = self._angle
        ratio = 0.5 * self.measures.mouth_width / float(self._half_widths(0.0))
        return float(np.interp(np.arcsin(ratio), angle, length))

    def places(self, q: Floats, lip: Floats, s: Floats) -> Floats:
        """Chart coordinates of rays and rings, shape (rays, rings, 2) [m]."""
        return chart(self.measures, self.mouth_half_width, q, lip, s)

    def head(self, place: Floats) -> Floats:
        """Points (..., 3) of the head without relief, x positive to the left [m]."""
        xi, tau = place[..., 0], place[..., 1]
        m = self.measures
        y, z = np.moveaxis(self._profile[0](tau), -1, 0)
        angle = np.interp(np.abs(xi), self._angle[1], self._angle[0]) * np.sign(xi)
        # The jaw begins to rise below the mouth in the midline, and above it towards the ear.
        begin = 0.012 + 0.028 * np.clip(np.abs(xi) / (0.75 * m.face_width), 0.0, 1.0) ** 2
        fade = _smooth_step((begin - tau) / (begin - self.tau_gnathion))
        rise = m.jaw_rise * (np.abs(xi) / (0.75 * m.face_width)) ** 1.8 * fade
        return np.stack([self._half_widths(tau) * np.sin(angle), y * np.cos(angle), z + rise], -1)

    def normals(self, place: Floats) -> Floats:
        """Outward unit directions (..., 3) through the tissue.

        They are normals of the head without relief, averaged along the profile, because true
        normals would intersect within the tissue at the curvature of the chin.
        """
        window = _NORMAL_WINDOW * np.linspace(-1.0, 1.0, 5)
        mean = sum(self._normals(place + [0.0, shift]) for shift in window)
        return mean / np.linalg.norm(mean, axis=-1, keepdims=True)

    def _normals(self, place: Floats) -> Floats:
        step = 1e-5
        along = [
            self.head(place + step * np.eye(2)[k]) - self.head(place - step * np.eye(2)[k])
            for k in (0, 1)
        ]
        normal = np.cross(along[0], along[1])
        # With x to the left the frame is left-handed; outward normals point away from the axis.
        outward = self.head(place) * [1.0, 1.0, 0.0]
        normal *= np.sign(np.einsum("...i,...i", normal, outward))[..., None]
        return normal / np.linalg.norm(normal, axis=-1, keepdims=True)

    def sheets(self, q: Floats, lip: Floats, s: Floats) -> tuple[Floats, Floats]:
        """Skin and inner surface (rays, rings, 3) at rays and rings, with x positive to the left [m]."""
        m = self.measures
        lips, roll = lip_protrusion(m, q, lip)[:, None], lip_roll(m, q, lip)[:, None]
        return self._layers(self.places(q, lip, s), lips, roll, s)

    def _layers(
        self, place: Floats, lips: Floats, roll: Floats, s: Floats
    ) -> tuple[Floats, Floats]:
        """Skin and inner surface (..., 3) at places (..., 2), with protrusion and roll of the lips."""
        head, normal = self.head(place), self.normals(place)
        m, corner = self.measures, self.mouth_half_width
        bulge, forward = relief(m, place, corner), nose(m, place)
        outward = bulge + lips * LIP_PROFILE(s) - roll * LIP_ROLL(s)
        skin = head + (outward + philtrum(m, place))[..., None] * normal + forward
        depth = thickness(m, place, corner, self.tau_gnathion) - lips * LIP_DEPTH(s)
        inner = head + (bulge - depth)[..., None] * normal + NOSE_DEPTH * forward
        inner[..., 2] += nose_lift(m, place)
        return skin, inner

    def points(self, place: Floats, depth: Floats) -> Floats:
        """Points (n, 3) [m] of the left half at positions (n, 2) in the chart, with x to the right.

        `depth` (n,) is 0 on the inner surface and 1 on the skin. Raises FaceError if a position is
        outside the tissue.
        """
        q, lip, s = self._find(place)
        m, own = self.measures, np.arange(len(place))
        in_chart = self.places(q, lip, s)[own, own]
        skin, inner = self._layers(in_chart, lip_protrusion(m, q, lip), lip_roll(m, q, lip), s)
        points = inner + depth[:, None] * (skin - inner)
        return points * [-1.0, 1.0, 1.0]

    def _find(self, place: Floats) -> tuple[Floats, Floats, Floats]:
        """Ray and ring of positions in the chart, by Newton's method from the nearest lattice point."""
        lip = np.where(place[:, 1] >= 0.0, 1.0, -1.0)
        q_lattice, s_lattice = np.linspace(0.0, 1.0, 49), np.linspace(0.0, 1.0, 49)
        lattices = {
            side: self.places(q_lattice, np.full(49, side), s_lattice) for side in (1.0, -1.0)
        }
        gap = np.stack([lattices[side] for side in lip]) - place[:, None, None]
        nearest = np.argmin((gap**2).sum(axis=-1).reshape(len(place), -1), axis=1)
        q, s = q_lattice[nearest // 49], s_lattice[nearest % 49]
        own, step = np.arange(len(place)), 1e-6
        for _ in range(_NEWTON_STEPS):
            # One-sided differences towards the interior, because the chart ends at 0 and 1.
            dq, ds = np.where(q > 0.5, -step, step), np.where(s > 0.5, -step, step)
            here = self.places(q, lip, s)[own, own]
            by_q = (self.places(q + dq, lip, s)[own, own] - here) / dq[:, None]
            by_s = (self.places(q, lip, s + ds)[own, own] - here) / ds[:, None]
            miss = place - here
            move = np.linalg.solve(np.stack([by_q, by_s], axis=-1), miss[..., None])[..., 0]
            before = q, s
            q, s = np.clip(q + move[:, 0], 0.0, 1.0), np.clip(s + move[:, 1], 0.0, 1.0)
            if max(np.abs(q - before[0]).max(), np.abs(s - before[1]).max()) < _NEWTON_CHANGE:
                break
        miss = np.linalg.norm(place - self.places(q, lip, s)[own, own], axis=1)
        if (miss > _PLACE_TOLERANCE).any():
            k = int(np.argmax(miss))
            raise FaceError(
                f"the point {k + 1} of {len(place)}, {1e3 * place[k, 0]:.1f} mm from the midline "
                f"and {1e3 * place[k, 1]:.1f} mm above the mouth along the skin, lies "
                f"{1e3 * miss[k]:.1f} mm outside the tissue: expected it inside, change the measures"
            )
        return q, lip, s


def _smooth_step(t: Floats) -> Floats:
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
