"""Sources of sound: two-mass vocal folds, the pulse of Rosenberg, sampled flow, and turbulence."""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import butter, sosfilt

from analysis.arguments import count
from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.medium import Floats

HIGHEST_PITCH: Final = 5000.0  #: pitch [Hz] above which the pulses of a voice are not sampled
TENSEST: Final = 10.0
"""Tension of the folds above which a step does not resolve their vibration; voices have 0.5 to 2."""


class Source(Protocol):
    """Source at the glottis, evaluated at the instants of the steps."""

    def flow(self, t: Floats) -> Floats:
        """Flow into the tract at the instants t [m^3/s]; 0 where folds determine it."""
        ...

    def pressure(self, t: Floats) -> Floats:
        """Lung pressure [Pa]."""
        ...

    def rest(self, t: Floats) -> Floats:
        """Area of the glottis at rest [m^2]; 0 without folds."""
        ...

    def folds(self) -> Floats:
        """Parameters of vocal folds for the kernel; empty without folds."""
        ...


@dataclass(frozen=True, eq=False)
class Flow:
    """Sampled flow of the glottis, interpolated linearly; 0 outside its samples."""

    values: Floats  #: (n,) flow [m^3/s]; sample k is at k/rate
    rate: float  #: samples per second [Hz]

    def flow(self, t: Floats) -> Floats:
        """Flow at the instants t."""
        given = np.asarray(self.values, np.float64)
        if given.ndim != 1 or given.size == 0 or not np.isfinite(given).all() or self.rate <= 0.0:
            raise AcousticsError(
                f"the source has the shape {given.shape} at {self.rate:g} Hz, expected finite samples "
                "at a positive rate"
            )
        return np.interp(t, np.arange(given.size) / self.rate, given, left=0.0, right=0.0)

    def pressure(self, t: Floats) -> Floats:
        """Return 0: the flow is given."""
        return np.zeros_like(t)

    def rest(self, t: Floats) -> Floats:
        """Return 0: the flow is given."""
        return np.zeros_like(t)

    def folds(self) -> Floats:
        """Return no parameters."""
        return np.empty(0)


def rosenberg(
    t: ArrayLike,
    *,
    pitch: float = 100.0,
    open_quotient: float = 0.5,
    slope: float = 4.0,
    peak: float = 3e-4,
) -> Floats:
    """Glottal flow of Rosenberg 1971 (pulse C).

    g = (1 - cos(pi t/Tp))/2 while the glottis opens, cos(pi (t - Tp)/(2 Tn)) while it closes, 0 else,
    with Tp + Tn = open_quotient/pitch and Tp/Tn = slope.

    Parameters
    ----------
    t : array_like, shape (n,)
        Instants [s].
    pitch : float
        Pulses per second [Hz].
    open_quotient : float
        Part of a period in which the glottis is open [1].
    slope : float
        Duration of opening over that of closing [1].
    peak : float
        Largest flow [m^3/s].

    Returns
    -------
    ndarray, shape (n,)
        Flow [m^3/s].

    Raises
    ------
    AcousticsError
        A parameter is not above 0, the pitch exceeds `HIGHEST_PITCH`, or the open quotient is above 1.
    """
    if not (0.0 < pitch <= HIGHEST_PITCH and 0.0 < open_quotient <= 1.0 and slope > 0.0):
        raise AcousticsError(
            f"pitch {pitch:g} Hz, open quotient {open_quotient:g}, slope {slope:g}: expected values "
            f"above 0, a pitch of at most {HIGHEST_PITCH:g} Hz and an open quotient of at most 1"
        )
    phase = np.mod(np.asarray(t, np.float64) * pitch, 1.0)
    closing = open_quotient / (1.0 + slope)
    opening = open_quotient - closing
    rise = 0.5 * (1.0 - np.cos(np.pi * phase / opening))
    fall = np.cos(0.5 * np.pi * (phase - opening) / closing)
    return peak * np.where(phase < opening, rise, np.where(phase < open_quotient, fall, 0.0))


@dataclass(frozen=True, eq=False)
class Folds:
    """Two-mass vocal folds of Ishizaka and Flanagan 1972 (Bell Syst Tech J 51:1233), in SI units."""

    lung: float | Floats = 785.0  #: lung pressure [Pa], or its samples (n,)
    rate: float = (
        1000.0  #: samples per second of lung pressure and area at rest [Hz], if not constant
    )
    tension: float = 1.0  #: q: divides the masses and multiplies the springs [1]
    #: area of the glottis at rest [m^2], or its samples (n,); negative: pressed
    rest_area: float | Floats = 5e-6
    #: masses [kg], springs and coupling [N/m]
    m1: float = 1.25e-4
    m2: float = 2.5e-5
    k1: float = 80.0
    k2: float = 8.0
    kc: float = 25.0
    #: damping ratios while open [1]; 1 larger in contact
    zeta1: float = 0.1
    zeta2: float = 0.6
    #: coefficients of the cubic springs [1/m^2]; contact springs are 3 k
    cubic: float = 1e6
    contact: float = 5e6
    #: length of the glottis, thickness of the masses [m]
    length: float = 1.4e-2
    d1: float = 2.5e-3
    d2: float = 5e-4
    rise: float = 0.02  #: time in which a constant lung pressure is raised linearly [s]

    def flow(self, t: Floats) -> Floats:
        """Return 0: the folds determine the flow."""
        return np.zeros_like(t)

    def pressure(self, t: Floats) -> Floats:
        """Lung pressure at the instants t."""
        given = np.asarray(self.lung, np.float64)
        if not (np.isfinite(given).all() and (given >= 0.0).all() and (given <= 1e4).all()):
            raise AcousticsError(
                "the lung pressure is not between 0 and 10 kPa: check its unit [Pa]"
            )
        if given.ndim == 0:
            return float(given) * np.minimum(1.0, t / self.rise)
        return np.interp(t, np.arange(given.size) / self.rate, given)

    def rest(self, t: Floats) -> Floats:
        """Area of the glottis at rest at the instants t."""
        given = np.asarray(self.rest_area, np.float64)
        if not (np.isfinite(given).all() and (np.abs(given) <= 1e-4).all()):
            raise AcousticsError(
                "the area of the glottis at rest is not between -1 and 1 cm^2: check its unit [m^2]"
            )
        if given.ndim == 0:
            return np.full_like(t, float(given))
        return np.interp(t, np.arange(given.size) / self.rate, given)

    def folds(self) -> Floats:
        """Return the parameters in the order of the kernel."""
        given = np.array(
            [self.tension, self.m1, self.m2, self.k1, self.k2, self.kc, self.zeta1, self.zeta2,
             self.cubic, self.contact, self.length, self.d1, self.d2]
        )  # fmt: skip
        if not (np.isfinite(given).all() and (given > 0.0).all() and self.tension <= TENSEST):
            raise AcousticsError(
                f"a parameter of the folds is not above 0, or their tension is {self.tension:g}, "
                f"expected positive constants and a tension of at most {TENSEST:g}"
            )
        return given


@dataclass(frozen=True)
class Turbulence:
    """Noise at the narrowest section and at the glottis, after Sondhi and Schroeter 1987.

    Pressure gain max(0, Re^2 - critical^2) n(t), Re = 2 rho |U|/(mu sqrt(pi S)), acting one cell
    behind the narrowest section; n is band-limited noise of the same power at every rate.
    """

    gain: float = 2e-7  #: [Pa]; 2e-6 dyn/cm^2 as in that paper. 0 is without noise
    critical: float = 1800.0  #: Reynolds number below which there is none [1]
    band: tuple[float, float] = (500.0, 8000.0)  #: pass-band of the noise [Hz]
    #: cut-off of the low-pass filter of the flow through the constriction [Hz]
    smoothing: float = 500.0

    def noise(self, n: int, rate: float, seed: int) -> Floats:
        """Two independent noises of the variance of uniform noise in +-1/2, shape (2, n)."""
        if self.gain == 0.0 or n == 0:
            return np.zeros((2, n))
        begin = count("the seed", seed, least=0, error=AcousticsError)
        white = np.random.default_rng(begin).standard_normal((2, n))
        low, high = self.band
        sos = butter(2, (low, min(high, 0.45 * rate)), "bandpass", fs=rate, output="sos")
        share = 2.0 * (min(high, 0.45 * rate) - low) / rate
        return np.asarray(sosfilt(sos, white, axis=1)) / np.sqrt(12.0 * share)


NO_TURBULENCE: Final = Turbulence(gain=0.0)  #: no turbulence
