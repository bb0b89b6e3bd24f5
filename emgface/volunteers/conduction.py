"""Transfer of muscle signals through the tissue to electrodes on a face.

Every muscle is one source (orbicularis oris has one source in each lip). The tissue attenuates high
frequencies of its potential, and conduction along the fibres delays it, so that cross-talk is a
filtered mixture of sources and not a scaled copy of another channel.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.special
import xarray as xr

from emgface.face.bundles import distance_to_fibres
from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER, fibres_of
from emgface.face.surface import boundary_faces, nearest_on_triangles, triangles
from emgface.muscles import CHANNELS, MODELLED, SIDES

VELOCITY: Final = 3.2
"""Conduction velocity of muscle fibres [m/s], the mean of 2.4 to 4.0 of the motor units."""
REFERENCE_DISTANCE: Final = 4e-3
"""Reference distance of the potentials of the motor units [m], the mean depth of their fibres."""
ELECTRODES: Final[Mapping[str, tuple[str, float]]] = {
    "OOS": ("OOP", 0.2),
    "OOI": ("OOP", 0.8),
    "RIS": ("RIS", 0.5),
    "ZYG": ("ZYG", 0.5),
    "LLSAN": ("LLSAN", 0.5),
    "DAO": ("DAO", 0.5),
    "MEN": ("MEN", 0.5),
}
"""Muscle, and position along its first fibre, under each pair of electrodes."""
_STEP: Final = 2.0
UNITS_OF_LIPS: Final = {"OOP": ("OOS", "OOI"), "OOM": ("OOS", "OOI")}
"""Muscles with separate units in the two lips, by the electrodes of each lip."""


@dataclass(frozen=True)
class CurrentSource:
    """A population of motor units of a `muscle` (with side).

    `home` is the channel of the nearest electrodes by name; it distinguishes the two lips.
    """

    muscle: str
    home: str


@dataclass(frozen=True, eq=False)
class Conduction:
    """Paths from every source to every pair of electrodes; arrays of shape (14, sources) [m].

    `distance` is measured from the middle between the electrodes to the nearest fibre, `along` from
    the middle of the fibre, along it, to the point nearest to the electrodes.
    """

    sources: tuple[CurrentSource, ...]
    distance: np.ndarray
    along: np.ndarray

    def attenuation(self, frequency: np.ndarray) -> np.ndarray:
        """Absolute value of `transfer`, shape (14, sources, n)."""
        wave = 2.0 * np.pi * np.where(frequency > 0, frequency, 1.0) / VELOCITY
        radius = np.maximum(self.distance, REFERENCE_DISTANCE)[..., None]
        # K0 underflows at large distances and frequencies; k0e is K0 times an exponential.
        fall = np.exp(-wave * (radius - REFERENCE_DISTANCE))
        size = (
            scipy.special.k0e(wave * radius) / scipy.special.k0e(wave * REFERENCE_DISTANCE) * fall
        )
        return np.where(frequency > 0, size, 0.0)

    def transfer(self, frequency: np.ndarray) -> np.ndarray:
        """Transfer function from every source to every channel, complex, shape (14, sources, n).

        ``H = K0(2 pi f r / v) / K0(2 pi f r_0 / v) exp(-2 pi i f s / v)`` with the frequencies f
        (n,) [Hz], the distance r, at least r_0 = `REFERENCE_DISTANCE`, the path s along the fibre
        and the velocity v = `VELOCITY`; 0 at f = 0. Source of the tissue filter: Lindstrom and
        Magnusson 1977, Proc IEEE 65:653-662.
        """
        # The attenuation is interpolated linearly between `_STEP` hertz; Bessel functions are slow.
        steps = np.arange(0.0, float(frequency.max()) + 2 * _STEP, _STEP)
        place = np.minimum((frequency / _STEP).astype(int), len(steps) - 2)
        share = frequency / _STEP - place
        known = self.attenuation(steps)
        size = (1.0 - share) * known[..., place] + share * known[..., place + 1]
        wave = 2.0 * np.pi * frequency / VELOCITY
        return size * np.exp(-1j * wave * self.along[..., None])


def face_conduction(face: xr.Dataset) -> Conduction:
    """Compute the paths from all sources to all electrodes of a face."""
    skin = _skin(face)
    sources = tuple(
        CurrentSource(f"{muscle}_{side}", f"{home}_{side}")
        for side in SIDES
        for muscle in MODELLED
        for home in UNITS_OF_LIPS.get(muscle, (_home(muscle),))
    )
    places = np.stack([_electrode(face, skin, channel) for channel in CHANNELS])
    shape = (len(CHANNELS), len(sources))
    distance, along = np.empty(shape), np.empty(shape)
    for column, source in enumerate(sources):
        fibres = [_resampled(f) for f in fibres_of(face, source.muscle)]
        if source.muscle[:-2] in UNITS_OF_LIPS:
            half = len(fibres[0]) // 2
            upper = source.home.startswith("OOS")
            fibres = [f[: half + 1] if upper else f[half:] for f in fibres]
        distance[:, column] = distance_to_fibres(places, fibres)
        along[:, column] = np.min([_along(places, fibre) for fibre in fibres], axis=0)
    return Conduction(sources, distance, along)


def _electrode(face: xr.Dataset, skin: np.ndarray, channel: str) -> np.ndarray:
    """Position of the electrodes of a channel on the skin [m]."""
    name, side = channel.split("_")
    over, where = ELECTRODES[name]
    first = _resampled(fibres_of(face, f"{over}_{side}")[0])
    place, _, _ = nearest_on_triangles(first[round(where * (len(first) - 1))], skin)
    return place


def _home(muscle: str) -> str:
    """Channel whose electrodes are over a muscle or next to it."""
    return {"LAO": "LLSAN", "BUC": "RIS", "DLI": "DAO"}.get(muscle, muscle)


def _skin(face: xr.Dataset) -> np.ndarray:
    """Corners of the triangles of the skin, shape (triangles, 3, 3) [m]."""
    position = face["position"].values
    faces, _ = boundary_faces(face["connectivity"].values)
    outer = np.isin(faces, sheet_nodes(face, OUTER)) | (faces < 0)
    return position[triangles(faces[outer.all(axis=1)], position)]


def _resampled(fibre: np.ndarray, points: int = 61) -> np.ndarray:
    """Points at equal distances along a polyline."""
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fibre, axis=0), axis=1))])
    at = np.linspace(0.0, length[-1], points)
    return np.stack([np.interp(at, length, fibre[:, k]) for k in range(3)], axis=1)


def _along(places: np.ndarray, fibre: np.ndarray) -> np.ndarray:
    """Distances (n,) along a fibre from its middle to the points closest to positions (n, 3) [m]."""
    nearest = np.argmin(np.linalg.norm(fibre - places[:, None], axis=2), axis=1)
    step = float(np.linalg.norm(fibre[1] - fibre[0]))
    return np.abs(nearest - (len(fibre) - 1) // 2) * step
