"""Transfer function and formants of a tube by products of transmission-line matrices.

Every section is a line with the matrix [cosh gl, Z0 sinh gl; sinh gl/Z0, cosh gl], g = sqrt(Z Y),
Z0 = sqrt(Z/Y) (Sondhi and Schroeter 1987). Formants are the poles of U_lips/U_glottis at complex
frequencies, so that close ones are not merged as maxima of a spectrum would be.
"""

from typing import Final

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.medium import LOSSLESS, Complex, Floats, LineBranch, Medium, shapes

LOWEST: Final = 40.0  #: lowest frequency at which formants are sought [Hz]
DEGREE: Final = 100
"""Degree of the Chebyshev polynomial whose roots are the first estimates of the formants."""


def _towards_glottis(
    s: Complex, p: Complex, u: Complex, areas: Floats, section: float, medium: Medium
) -> tuple[Complex, Complex]:
    """Pressure and flow at the beginning of a line from those at its end."""
    Z, Y = medium.line(s, areas[:, None])
    g = np.sqrt(Z * Y)
    Z0 = Z / g  # not sqrt(Z/Y), which may be of the other branch
    cosh, sinh = np.cosh(g * section), np.sinh(g * section)
    series, shunt = Z0 * sinh, sinh / Z0
    for k in range(len(areas) - 1, -1, -1):
        p, u = cosh[k] * p + series[k] * u, shunt[k] * p + cosh[k] * u
    return p, u


def _end(s: Complex, area: float, medium: Medium) -> tuple[Complex, Complex]:
    """Pressure and flow at an open end, without the pole of the radiation impedance."""
    if not medium.radiates:
        return np.zeros_like(s), np.ones_like(s)
    L, R = medium.load(area)
    return s * L, 1.0 + s * L / R


def _denominator(
    s: Complex, areas: Floats, length: float, medium: Medium, branch: LineBranch | None
) -> tuple[Complex, Complex, Complex]:
    """Flow at the glottis, at the lips and at the nostrils up to a common factor."""
    p, u = _end(s, float(areas[-1]), medium)
    lips, nose = u, np.zeros_like(s)
    section = length / len(areas)
    if branch is None:
        return _towards_glottis(s, p, u, areas, section, medium)[1], lips, nose
    side = shapes(branch.areas, branch.length)
    before = round(branch.position / section)
    if not 0 < before < len(areas):
        raise AcousticsError(
            f"the branch begins at {branch.position:.3g} m, expected a boundary of sections within the "
            f"tube of {length:.3g} m"
        )
    p, u = _towards_glottis(s, p, u, areas[before:], section, medium)
    q, v = _end(s, float(side.areas[0, -1]), medium)
    opening = v
    step = float(side.length[0]) / side.areas.shape[1]
    q, v = _towards_glottis(s, q, v, side.areas[0], step, medium)
    lips, nose = lips * q, opening * p  # both branches have the same pressure p q at the junction
    return _towards_glottis(s, p * q, u * q + v * p, areas[:before], section, medium)[1], lips, nose


def transfer(
    frequencies: ArrayLike,
    areas: ArrayLike,
    length: float,
    *,
    medium: Medium | None = None,
    branch: LineBranch | None = None,
) -> Complex:
    """Flow out of mouth and nose divided by the flow into the glottis.

    Parameters
    ----------
    frequencies : array_like, shape (n,)
        Above 0 [Hz].
    areas : array_like, shape (sections,)
        Areas of sections of equal length, from the glottis to the lips [m^2].
    length : float
        Of the tube [m].
    medium : Medium, optional
        With all losses by default.
    branch : LineBranch, optional
        Nasal tract.

    Returns
    -------
    ndarray of complex, shape (n,)
        (U_lips + U_nostrils)/U_glottis [1].

    Raises
    ------
    AcousticsError
        As `emgface.acoustics.medium.shapes`; a frequency is not above 0.
    """
    f = np.atleast_1d(np.asarray(frequencies, np.float64))
    if not (np.isfinite(f).all() and (f > 0.0).all()):
        raise AcousticsError(f"the lowest frequency is {f.min():.3g} Hz, expected above 0")
    tube = shapes(areas, length)
    s = np.asarray(2j * np.pi * f, np.complex128)
    glottis, lips, nose = _denominator(
        s, tube.areas[0], float(tube.length[0]), medium or Medium(), branch
    )
    return np.asarray((lips + nose) / glottis)


def formants(
    areas: ArrayLike,
    length: float,
    *,
    medium: Medium | None = None,
    branch: LineBranch | None = None,
    highest: float = 5000.0,
) -> tuple[Floats, Floats]:
    """Formants of a tube: the poles of its transfer function.

    The flow at the glottis for a unit flow at the lips is an analytic function of the frequency.
    Its roots are found from a Chebyshev interpolant (colleague matrix) and refined with the function
    itself by the secant method; a pole s = -pi B + 2 pi j F has the frequency F and the bandwidth B.

    Parameters
    ----------
    areas, length, medium, branch
        As in `transfer`.
    highest : float
        Highest frequency sought [Hz].

    Returns
    -------
    frequency, bandwidth : ndarray, shape (n,)
        [Hz], by ascending frequency; above 40 Hz, with bandwidths below 1 kHz.

    Raises
    ------
    AcousticsError
        As `transfer`.
    """
    tube, medium = shapes(areas, length), medium or Medium()
    S, L = tube.areas[0], float(tube.length[0])

    def flow(f: Complex) -> Complex:
        return _denominator(2j * np.pi * f, S, L, medium, branch)[0]

    middle, half = (highest + LOWEST) / 2.0, (highest - LOWEST) / 2.0
    points = chebyshev.chebpts1(DEGREE + 1)
    values = flow((middle + half * points).astype(np.complex128))
    # interpolation at Chebyshev points is a discrete cosine transform
    modes = np.cos(np.outer(np.arange(DEGREE + 1), np.arccos(points)))
    series = 2.0 / (DEGREE + 1) * (modes @ values)
    series[0] /= 2.0
    kept = np.flatnonzero(np.abs(series) > 1e-14 * np.abs(series).max())
    roots = middle + half * np.asarray(chebyshev.chebroots(series[: kept[-1] + 1]))
    near = (roots.real > 0.5 * LOWEST) & (roots.real < highest + 50.0)
    x = roots[near & (roots.imag > -20.0) & (roots.imag < 600.0)].astype(np.complex128)
    with np.errstate(all="ignore"):  # estimates that are not near a root may diverge
        before, a = x + 0.1, flow(x + 0.1)
        for _ in range(15):
            b = flow(x)
            step = np.where(b == a, 0.0, b * (x - before) / np.where(b == a, 1.0, b - a))
            before, a, x = x, b, x - step
            if not (np.abs(step) > 1e-7).any():
                break
        true = np.abs(flow(x)) < 1e-5 * np.abs(flow(x + 1.0))
    x = x[true & (x.real > LOWEST) & (x.real < highest) & (x.imag > -1e-3) & (x.imag < 500.0)]
    x = x[np.argsort(x.real)]
    x = x[[k for k in range(len(x)) if k == 0 or np.abs(x[k] - x[:k]).min() > 1e-3]]
    return np.asarray(x.real, np.float64), np.asarray(2.0 * x.imag, np.float64)


def lossless_formants(areas: ArrayLike, length: float, *, highest: float = 5000.0) -> Floats:
    """Formants [Hz] of `formants` without losses, with pressure 0 at the lips."""
    return formants(areas, length, medium=LOSSLESS, highest=highest)[0]
