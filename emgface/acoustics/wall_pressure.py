"""Pressure of a steady flow on the walls of a tube."""

import numpy as np
from numpy.typing import ArrayLike

from emgface.acoustics.medium import Floats, shapes


def wall_pressure(
    areas: ArrayLike,
    lung: float,
    *,
    outside: float = 0.0,
    separation: float = 1.2,
    rho: float = 1.14,
) -> tuple[Floats, float]:
    """Pressure along a tube by Bernoulli's law, with separation behind the narrowest section.

    P(x) = lung - rho Q^2/(2 S(x)^2) up to the first section behind the narrowest one whose area is
    `separation` times as large, where the jet has the outside pressure, which remains constant
    beyond; hence Q = S_s sqrt(2 (lung - outside)/rho), with S_s = separation S_min, or the last area
    if the tube ends before. In a closed tube the lung pressure acts up to the closure.

    Parameters
    ----------
    areas : array_like, shape (sections,)
        From the glottis to the lips [m^2].
    lung, outside : float
        Pressures at both ends [Pa]; the flow goes from the higher to the lower.
    separation : float
        Area of separation over the smallest area [1].
    rho : float
        Density [kg/m^3].

    Returns
    -------
    pressure : ndarray, shape (sections,)
        On the walls [Pa].
    flow : float
        Q [m^3/s], positive towards the lips.

    Raises
    ------
    AcousticsError
        As `emgface.acoustics.medium.shapes`.
    """
    S = shapes(areas, 0.17).areas[0]
    if lung < outside:
        reverse, flow = wall_pressure(
            S[::-1], outside, outside=lung, separation=separation, rho=rho
        )
        return reverse[::-1], -flow
    narrow = int(np.argmin(S))
    beyond = np.flatnonzero(S[narrow:] >= separation * S[narrow])
    end = narrow + int(beyond[0]) if beyond.size else len(S)
    jet = min(separation * S[narrow], S[-1]) if not beyond.size else separation * S[narrow]
    flow = float(jet * np.sqrt(2.0 * (lung - outside) / rho))
    pressure = np.full(len(S), outside)
    pressure[:end] = lung - 0.5 * rho * (flow / S[:end]) ** 2
    return pressure, flow
