"""Air, walls and openings of a tube: constants, losses and radiation.

Sources: Flanagan, Speech Analysis, Synthesis and Perception, 1972, section 3 (losses, piston in a
wall); Sondhi and Schroeter 1987, IEEE TASSP 35:955; wall constants of Birkholz.
"""

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from emgface.acoustics.errors import AcousticsError

Floats = NDArray[np.float64]
Complex = NDArray[np.complex128]
CLOSURE_AREA: Final = 1e-8
"""Area that represents a closure [m^2]; smaller areas are raised to it (Story 1996 prints zeros)."""
PI: Final = float(np.pi)


@dataclass(frozen=True)
class Medium:
    """Air in a tube, its yielding walls and its open end."""

    #: speed of sound [m/s] and density [kg/m^3]
    c: float = 350.0
    rho: float = 1.14
    mu: float = 1.86e-5  #: viscosity [Pa s]
    #: ratio of specific heats [1], thermal conductivity [W/(m K)], specific heat at constant pressure
    #: [J/(kg K)], of air at 37 degrees C
    gamma: float = 1.4
    conduction: float = 0.0268
    heat: float = 1005.0
    #: factor on the losses by viscosity and heat conduction [1]; 0 is without
    friction: float = 1.0
    yielding: float = 1.0  #: factor on the flow taken up by the walls [1]; 0 is rigid walls
    #: of the walls per area [kg/m^2], [Pa s/m], [Pa/m]
    mass: float = 21.0
    damping: float = 8000.0
    stiffness: float = 845_000.0
    #: circumference divided by that of a circle of the same area [1]; tracts have 1.3 to 1.6
    roundness: float = 1.0
    #: open ends radiate like a piston in a wall; otherwise the pressure there is 0
    radiates: bool = True

    def circumference(self, areas: Any) -> Any:
        """Circumference [m] of sections of these areas [m^2]."""
        return self.roundness * 2.0 * np.sqrt(PI * areas)

    def friction_rate(self, areas: Any) -> Any:
        """Momentum lost at the wall: C sqrt(mu/rho)/S [s^-1/2], a factor of sqrt(s) u.

        Boundary layer of a wide tube. Its reactance, which Flanagan omits, is kept: without it the
        loss would not be causal. It lowers formants by up to 0.5 %.
        """
        return self.friction * self.circumference(areas) / areas * np.sqrt(self.mu / self.rho)

    def steady_rate(self, areas: Any) -> Any:
        """Momentum lost in steady flow: 8 pi mu/(rho S) [1/s] (Poiseuille), a factor of u.

        Negligible in open tubes, it limits the flow through a closure, where the boundary layer fills
        the section; 3 pi of it belong to the loss of a wide tube in the next order.
        """
        return self.friction * 8.0 * PI * self.mu / (self.rho * areas)

    @property
    def heat_rate(self) -> float:
        """Heat lost at the wall: (gamma - 1)/(rho c^2) sqrt(k/(rho cp)), per area and sqrt(s) p."""
        return float(
            self.friction * (self.gamma - 1.0) / (self.rho * self.c**2)
            * np.sqrt(self.conduction / (self.rho * self.heat))
        )  # fmt: skip

    def line(self, s: Complex, areas: Any) -> tuple[Complex, Complex]:
        """Series impedance [Pa s/m^4] and shunt admittance [m^2/(Pa s)] per length at s = j omega."""
        lost = self.friction_rate(areas) * np.sqrt(s) + self.steady_rate(areas)
        Z = self.rho / areas * (s + lost)
        wall = self.yielding / (s * self.mass + self.damping + self.stiffness / s)
        surface = wall + self.heat_rate * np.sqrt(s)
        return Z, s * areas / (self.rho * self.c**2) + self.circumference(areas) * surface

    def load(self, area: Any) -> tuple[Any, Any]:
        """Mass [kg/m^4] and resistance [Pa s/m^3] of an open end, acting in parallel.

        L = 8 rho/(3 pi sqrt(pi S)), R = 128 rho c/(9 pi^2 S): a piston in an infinite wall, with the
        end correction 8 r/(3 pi).
        """
        mass = 8.0 * self.rho / (3.0 * PI * np.sqrt(PI * area))
        return mass, 128.0 * self.rho * self.c / (9.0 * PI**2 * area)


LOSSLESS: Final = Medium(friction=0.0, yielding=0.0, radiates=False)
"""Rigid smooth walls, and pressure 0 at the open end."""


@dataclass(frozen=True, eq=False)
class LineBranch:
    """Side branch with an open end, such as the nasal tract."""

    #: (m,) areas from the branching point to the open end [m^2]; the first is the opening of the velum
    areas: Floats
    length: float  #: of the branch [m]
    position: float  #: distance of the branching point from the glottis [m]


@dataclass(frozen=True, eq=False)
class Shapes:
    """Area functions at some instants, checked."""

    #: ndarray, shape (frames, sections) areas of sections of equal length, from the glottis to the lips
    #: [m^2]
    areas: Floats
    length: Floats  #: ndarray, shape (frames,) length of the tube [m]
    #: ndarray, shape (frames,) instants [s]
    times: Floats = field(default_factory=lambda: np.zeros(1))


def shapes(areas: ArrayLike, length: ArrayLike, times: ArrayLike = 0.0) -> Shapes:
    """Check area functions and raise areas below `CLOSURE_AREA`.

    Raises AcousticsError if a value is not finite or negative, a length is not between 1 cm and 1 m, an
    area exceeds 100 cm^2 (as areas in cm^2 would), or times do not ascend.

    `areas` (sections,) or (frames, sections) are those from the glottis to the lips [m^2], `length`
    that of the tube, also (frames,) [m], and `times` (frames,) the instants [s].
    """
    S, t = (
        np.atleast_2d(np.asarray(areas, np.float64)),
        np.atleast_1d(np.asarray(times, np.float64)),
    )
    lengths = np.atleast_1d(np.asarray(length, np.float64))
    if lengths.size not in (1, t.size):
        raise AcousticsError(f"{lengths.size} lengths for {t.size} frames, expected one or as many")
    lengths = np.broadcast_to(lengths, t.shape).copy()
    if S.shape != (len(t), S.shape[1]) or S.shape[1] == 0:
        raise AcousticsError(
            f"areas have the shape {S.shape}, expected ({len(t)} frames, sections)"
        )
    if not (np.isfinite(S).all() and (S >= 0.0).all() and (S <= 0.01).all()):
        raise AcousticsError(
            f"areas lie between {S.min():.3g} and {S.max():.3g} m^2, expected finite values from 0 to "
            "0.01 m^2: convert cm^2 to m^2 by 1e-4"
        )
    if not ((lengths >= 0.01) & (lengths <= 1.0)).all():
        raise AcousticsError(
            f"the length of the tube is {lengths.min():.3g} m, expected 0.01 to 1 m: check its unit"
        )
    if not (np.isfinite(t).all() and (np.diff(t) > 0.0).all()):
        raise AcousticsError("times do not ascend, expected ascending instants of the frames [s]")
    return Shapes(np.maximum(S, CLOSURE_AREA), lengths, t)
