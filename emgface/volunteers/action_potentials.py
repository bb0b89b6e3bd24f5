"""Surface potentials of single motor units at a pair of electrodes on a face."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

ANISOTROPY: Final = 5.0
"""Conductivity of muscle along its fibres over that across them (Andreassen and Rosenfalck 1981)."""
LENGTH: Final = 0.032  #: largest duration of a potential [s]
_STEP: Final = 0.25e-3  #: spacing of the points of a fibre [m]


@dataclass(frozen=True)
class FibreGeometry:
    """Fibres of motor units and the electrodes over them; arrays of shape (units,)."""

    depth: np.ndarray  #: depth of the fibres below the skin [m]
    #: distance along the fibres from the end plates to the middle between the two electrodes [m]
    offset: np.ndarray
    half_length: np.ndarray  #: distance from the end plates to either end of the fibres [m]
    velocity: np.ndarray  #: velocity of the action potential [m/s]
    spread: np.ndarray  #: standard deviation of the end plates of the fibres of one unit [m]
    #: distance along the skin, across the fibres, to the middle between the electrodes [m]
    aside: np.ndarray
    angle: np.ndarray  #: angle between the line through the electrodes and the fibres [rad]
    distance: float  #: distance of the electrodes [m]


def draw_geometry(rng: np.random.Generator, size: np.ndarray) -> FibreGeometry:
    """Draw the fibres of the units of one facial muscle, for electrodes at a distance of 12 mm.

    `size` (units,) is the relative size of the units; larger ones conduct faster. Depth U(1.5, 7)
    mm; end plates U(8, 16) mm from the middle of the electrodes, in a cluster away from the middle
    of the muscle (Lapatki et al. 2006, J Neurophysiol 95:342-354, found such clusters, often
    eccentric), those of one unit spread by U(1, 5) mm; half length U(18, 28) mm; velocity 2.4 to
    4.0 m/s from the smallest to the largest unit. Fibres of facial muscles interlace and are seldom
    in line with electrodes: angle N(0, 35) degrees, U(-8, 8) mm aside; with the depth, this
    reproduces the measured power below 100 Hz. The ranges are chosen to reproduce the spectrum of
    facial EMG (15 to 500 Hz, van Boxtel 2001, Psychophysiology 38:22-34).
    """
    n = size.size
    order = np.log(size) - np.log(size).min()
    share = order / order.max() if order.max() > 0 else np.zeros(n)
    return FibreGeometry(
        depth=rng.uniform(1.5e-3, 7e-3, n),
        offset=rng.uniform(8e-3, 16e-3, n),
        half_length=rng.uniform(18e-3, 28e-3, n),
        velocity=2.4 + 1.6 * share,
        spread=rng.uniform(1e-3, 5e-3, n),
        aside=rng.uniform(-8e-3, 8e-3, n),
        angle=np.deg2rad(rng.normal(0.0, 35.0, n)),
        distance=0.012,
    )


def action_potentials(geometry: FibreGeometry, sampling_rate: float) -> np.ndarray:
    """Bipolar surface potential of each unit for one discharge, in arbitrary units.

    A wave ``psi`` of the gradient of the intracellular potential travels from the end plate to both
    ends of the fibre, where it vanishes. Its current ``i(z) = d/dz [psi]`` (of opposite sign on the
    two sides) acts through ``1/r``, ``r^2 = (z - z_e)^2 + s (d^2 + y_e^2)`` with anisotropy s,
    depth d and the electrode at z_e along and y_e across the fibres, on two electrodes, the first
    nearer to the end plate: ``phi(t) = integral i(z, t) (1/r_1 - 1/r_2) dz``. The result (units,
    samples) has the duration `LENGTH`, with the discharge at time 0; `sampling_rate` is in Hz.

    Intracellular potential ``V(x) = 96 x^3 exp(-x) - 90`` mV, x in mm behind the front: Rosenfalck
    1969, Acta Physiol Scand Suppl 321. Source with end effects: Dimitrov and Dimitrova 1998, Med
    Eng Phys 20:374-381; Farina and Merletti 2001, IEEE Trans Biomed Eng 48:637-646, Eqs 1-4. The
    integral is evaluated by parts, which avoids numerical differentiation. The end plates of the
    fibres of a unit are spread along them; the resulting delays of their potentials are represented
    together by a Gaussian smoothing in time.
    """
    time = np.arange(round(LENGTH * sampling_rate)) / sampling_rate
    result = np.empty((geometry.depth.size, time.size))
    reach = float(geometry.half_length.max())
    # The middles of cells, none on the end plate: the wave is symmetric about it.
    z = _STEP * (np.arange(math.ceil(reach / _STEP) + 1) + 0.5)
    near = np.exp(1e3 * z)
    for unit in range(geometry.depth.size):
        half, velocity = geometry.half_length[unit], geometry.velocity[unit]
        along = 0.5 * geometry.distance * np.cos(geometry.angle[unit])
        across = 0.5 * geometry.distance * np.sin(geometry.angle[unit])
        slope = np.zeros_like(z)
        for sign in (1.0, -1.0):
            square = geometry.depth[unit] ** 2 + (geometry.aside[unit] + sign * across) ** 2
            for side in (1.0, -1.0):
                away = side * z - (geometry.offset[unit] + sign * along)
                slope -= side * sign * away * (away**2 + ANISOTROPY * square) ** -1.5
        # The cell in which the fibre ends is weighted by the fraction inside the fibre.
        slope *= np.clip((half - z) / _STEP + 0.5, 0.0, 1.0)
        # exp(-behind) is a product of two factors, which spares most of the time.
        travelled = 1e3 * velocity * time
        behind = np.maximum(travelled[:, None] - 1e3 * z, 0.0)
        wave = np.square(behind) * (3.0 - behind)
        result[unit] = np.exp(-travelled) * (wave @ (near * slope)) * (96.0 * _STEP)
        delay = geometry.spread[unit] / velocity * sampling_rate
        if delay > 0.0:
            result[unit] = gaussian_filter1d(result[unit], delay, mode="constant")
    return result
