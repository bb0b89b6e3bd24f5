"""Onset of oscillation of the folds by linear stability, independent of the time scheme."""

import numpy as np
from scipy.optimize import fsolve

from emgface.acoustics import Folds

WIDE = np.full(4, 0.01), 0.02
"""So short and wide that the folds do not notice it."""


def onset(source: Folds, inertance: float = 0.0) -> float:
    """Lowest lung pressure [Pa] at which the equilibrium of the folds is unstable.

    Eigenvalues of the linearised equations of Ishizaka and Flanagan before a mass of air of some
    inertance [kg/m^4], written independently of the time scheme.
    """
    size = np.array([1e-4, 1.0, 1e-4, 1.0, 1e-4])
    state = np.array([0.3, 0.0, 0.3, 0.0, 0.5])
    for lung in np.arange(40.0, 1000.0, 2.0):
        state = fsolve(lambda x, P=lung: _motion(source, inertance, P, size * x) / size, state)
        jacobian = np.empty((5, 5))
        for k in range(5):
            d = np.zeros(5)
            d[k] = 1e-5 * size[k]
            ahead = _motion(source, inertance, lung, size * state + d)
            jacobian[:, k] = (ahead - _motion(source, inertance, lung, size * state - d)) / (
                2 * d[k]
            )
        rates = np.linalg.eigvals(jacobian)
        if (rates[rates.imag > 10.0].real > 0.0).any():
            return float(lung)
    return float("nan")


def _motion(f: Folds, inertance: float, lung: float, state: np.ndarray) -> np.ndarray:
    """Rates of change of x1, v1, x2, v2 and the flow U, with 0 pressure behind the mass of air."""
    rho, mu, q, length = 1.14, 1.86e-5, f.tension, f.length
    x1, v1, x2, v2, U = state
    a1, a2 = float(f.rest_area) + 2 * length * x1, float(f.rest_area) + 2 * length * x2
    R1, R2 = 12 * mu * length**2 * f.d1 / a1**3, 12 * mu * length**2 * f.d2 / a2**3
    L1, L2 = rho * f.d1 / a1, rho * f.d2 / a2
    drop = 0.5 * rho * (0.37 / a1**2 + 1.0 / a2**2) * U * abs(U) + (R1 + R2) * U
    rate = (lung - drop) / (L1 + L2 + inertance)
    p1 = lung - 0.685 * rho * (U / a1) ** 2 - 0.5 * (R1 * U + L1 * rate)
    p2 = p1 - 0.5 * ((R1 + R2) * U + (L1 + L2) * rate)
    p2 -= 0.5 * rho * U * abs(U) * (1 / a2**2 - 1 / a1**2)
    rates = [v1, 0.0, v2, 0.0, rate]
    for at, m, k, zeta, x, v, other, p, d in (
        (1, f.m1 / q, f.k1 * q, f.zeta1, x1, v1, x2, p1, f.d1),
        (3, f.m2 / q, f.k2 * q, f.zeta2, x2, v2, x1, p2, f.d2),
    ):
        spring = k * x * (1 + f.cubic * x**2) + f.kc * q * (x - other)
        rates[at] = (length * d * p - 2 * zeta * np.sqrt(m * k) * v - spring) / m
    return np.array(rates)
