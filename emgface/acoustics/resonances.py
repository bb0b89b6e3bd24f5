"""Resonances of a decaying signal, by the rotational invariance of its shifts (ESPRIT)."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import hankel, svd
from scipy.signal import firwin, upfirdn

from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.medium import Floats


def resonances(
    signal: ArrayLike,
    rate: float,
    *,
    highest: float = 5000.0,
    order: int | None = None,
    skip: float = 0.0,
    duration: float | None = None,
) -> tuple[Floats, Floats]:
    """Frequencies and bandwidths of a sum of decaying oscillations.

    The signal is reduced to twice the highest frequency and a quarter; the dominant left singular
    vectors U of its Hankel matrix satisfy U[1:] = U[:-1] A, and the eigenvalues of A are
    exp((-pi B + 2 pi j F)/rate) (Roy and Kailath 1989). Close resonances are separated, unlike maxima
    of a spectrum.

    Parameters
    ----------
    signal : array_like, shape (n,)
        Response to an impulse.
    rate : float
        Samples per second [Hz].
    highest : float
        Highest frequency returned [Hz].
    order : int, optional
        Number of exponentials; 32 by default.
    skip, duration : float
        Part of the signal used [s]; 500 reduced samples by default.

    Returns
    -------
    frequency, bandwidth : ndarray, shape (m,)
        [Hz], ascending; with at least 1e-4 of the strongest amplitude.

    Raises
    ------
    AcousticsError
        The signal is silent, not finite or too short.
    """
    x = np.asarray(signal, np.float64)
    factor = max(1, int(rate / (2.5 * highest)))
    if factor > 1:
        taps = np.asarray(firwin(40 * factor + 1, 1.1 * highest, fs=rate))
        x = np.asarray(upfirdn(taps, x, 1, factor))[20:]
    r = rate / factor
    first = round(skip * r) + 1
    x = x[first : first + (500 if duration is None else round(duration * r))]
    count = order or 32
    if len(x) < 4 * count or not np.isfinite(x).all() or not x.any():
        raise AcousticsError(
            f"the signal has {len(x)} samples at {r:.0f} Hz, expected at least {4 * count} that are "
            "finite and not all 0"
        )
    H = hankel(x[: len(x) // 2], x[len(x) // 2 - 1 :])
    U = np.asarray(svd(H, full_matrices=False)[0])[:, :count]
    z = np.linalg.eigvals(np.linalg.lstsq(U[:-1], U[1:], rcond=None)[0])
    z = z[(np.abs(z) > 0.1) & (np.abs(z) < 1.1)]
    amplitude = np.linalg.lstsq(z[None, :] ** np.arange(len(x))[:, None], x + 0j, rcond=None)[0]
    strong = np.abs(amplitude) > 1e-4 * np.abs(amplitude).max()
    f = np.angle(z) * r / (2.0 * np.pi)
    kept = strong & (f > 20.0) & (f < highest)
    z, f = z[kept], f[kept]
    ascending = np.argsort(f)
    width = np.asarray(-np.log(np.abs(z)) * r / np.pi, np.float64)
    return np.asarray(f, np.float64)[ascending], width[ascending]
