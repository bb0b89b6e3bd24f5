"""Sound of a tube in time: a staggered scheme for tubes of changing area and length.

Linearised flow in a tube of rigid or yielding walls, after van den Doel and Ascher 2008 (IEEE TASL
16:1163): rho du/dt = -dp/dx - loss, S/(rho c^2) dp/dt = -d(S u)/dx - C z, M dz/dt + B z + K y = p.
Pressure and velocity, which remain finite where an area vanishes, are defined at alternate points of
space and time. Losses are implicit; losses that increase with sqrt(s) are sums of first-order terms.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import nnls
from scipy.signal import resample_poly

from emgface.acoustics._kernels import tube
from emgface.acoustics.errors import AcousticsError, CourantError
from emgface.acoustics.medium import CLOSURE_AREA, Floats, LineBranch, Medium, Shapes, shapes
from emgface.acoustics.sources import NO_TURBULENCE, Source, Turbulence

kernels: Any = tube

#: steps between the instants at which the shape of a changing tube is evaluated
STEPS_PER_SHAPE: Final = 64
LANES: Final = 16
"""Multiple of the nodes to which arrays are filled, so that compiled loops have no remainder."""
#: steps that are computed in one call, between reports of progress
CHUNK: Final = 96 * STEPS_PER_SHAPE
MOST_TUBE_NODES: Final = kernels.STRIDE - LANES - 1  #: largest number of nodes
HISS: Final = 40_000.0  #: lowest rate of samples of turbulence, between which it is linear [Hz]
FRICTION_BAND: Final = (60.0, 9000.0)
"""Band in which the terms of the losses represent sqrt(s) [Hz]."""


@dataclass(frozen=True, eq=False)
class TubeSound:
    """Signals of a tube at the rate of the steps."""

    rate: float  #: steps per second [Hz]
    #: (n,) flow out of the openings and into the tract [m^3/s]
    mouth: Floats
    nose: Floats
    glottis: Floats
    pressure: Floats  #: (n,) above the glottis [Pa]
    glottal_area: Floats  #: (n,) smallest area of the glottis [m^2]; 0 without folds
    #: (nodes,), (cells,) pressure [Pa] along the tube at the end, and velocity [m/s] half a step later
    node_pressure: Floats
    cell_velocity: Floats
    rho: float  #: density of the air [kg/m^3]

    def radiated(self, rate: float, distance: float = 0.3) -> Floats:
        """Sound pressure before the mouth, low-pass filtered and resampled.

        p = rho/(2 pi distance) d(U_mouth + U_nose)/dt: a small source in a wall, without the delay.

        Parameters
        ----------
        rate : float
            Of the result [Hz]; the rate of the steps must be a multiple of it.
        distance : float
            From the lips [m].

        Returns
        -------
        ndarray, shape (samples,)
            [Pa]
        """
        factor = round(self.rate / rate)
        if not np.isclose(factor * rate, self.rate) or distance <= 0.0:
            raise AcousticsError(
                f"sound of {self.rate:g} Hz is requested at {rate:g} Hz and {distance:g} m, expected a "
                "divisor of the rate of the steps and a distance above 0"
            )
        flow = self.mouth + self.nose
        p = self.rho / (2.0 * np.pi * distance) * np.diff(flow, prepend=0.0) * self.rate
        return np.asarray(resample_poly(p, 1, factor)) if factor > 1 else p


@cache
def friction_terms(count: int = 4) -> tuple[Floats, Floats]:
    """Weights w [s^-1/2] and rates b [1/s] of sqrt(s) = sum of w s/(s + b), s = j omega.

    Weights are positive, so that the losses are passive at any step. The relative error is at most
    4 % in magnitude within `FRICTION_BAND` with four terms, 1 % with six.
    """
    b = 2.0 * np.pi * np.geomspace(0.6 * FRICTION_BAND[0], 2.5 * FRICTION_BAND[1], count)
    s = 2j * np.pi * np.geomspace(*FRICTION_BAND, 200)
    terms = s[:, None] / (s[:, None] + b) / np.sqrt(s)[:, None]
    system = np.concatenate([terms.real, terms.imag])
    target = np.concatenate([np.ones(200), np.zeros(200)])
    return np.asarray(nnls(system, target)[0], np.float64), b


def _onto(count: int, cells: int) -> Floats:
    """Fractions of each of some sections within each of some cells, shape (cells, sections)."""
    edges, own = np.linspace(0, 1, cells + 1), np.linspace(0, 1, count + 1)
    low = np.maximum(edges[:-1, None], own[None, :-1])
    high = np.minimum(edges[1:, None], own[None, 1:])
    return np.maximum(high - low, 0.0) * cells


def _middle(x: Floats) -> Floats:
    """Means of successive rows."""
    return 0.5 * (x[:-1] + x[1:])


def _at_nodes(half: Floats) -> Floats:
    """Sums at the nodes of the values of the adjacent half cells."""
    sums = half.copy()
    sums[:, 1:] += half[:, :-1]
    return sums


def _instants(steps: Any, dt: float) -> Floats:
    return np.asarray(dt * steps, np.float64)


@dataclass(frozen=True, eq=False)
class _Layout:
    """Nodes of mouth and nose in one row, see `sim._kernels.tube`.

    Flux areas and volume areas of cells at the frames, between which they change linearly.
    """

    tube: Shapes
    medium: Medium
    sections: int
    branch: LineBranch | None
    ends: tuple[int, int]
    node: int

    @cached_property
    def frames(self) -> tuple[Floats, Floats]:
        """Areas of cells with the inertia and with the volume of their part of the tube, at frames.

        Rows are filled with cells of area 0, one at least.
        """
        N, nodes = self.sections, max(self.ends) + 1
        own = self.tube.areas
        W = _onto(own.shape[1], N)
        flux, mean = np.zeros((2, len(own), LANES * (nodes // LANES + 1)))
        flux[:, :N], mean[:, :N] = 1.0 / ((1.0 / own) @ W.T), own @ W.T
        if self.branch is not None:
            side = shapes(self.branch.areas, self.branch.length).areas[0]
            X = _onto(len(side), nodes - N - 2)
            flux[:, N + 1 : nodes - 1], mean[:, N + 1 : nodes - 1] = (
                1.0 / (X @ (1.0 / side)),
                X @ side,
            )
        return flux, mean

    def at(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Flux area, volume area and length of cells at instants."""
        t, N = self.tube.times, self.sections
        k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(len(t) - 2, 0))
        ahead = np.minimum(k + 1, len(t) - 1)
        share = np.clip((times - t[k]) / np.maximum(t[ahead] - t[k], 1e-300), 0.0, 1.0)[:, None]
        flux, mean = (x[k] + share * (x[ahead] - x[k]) for x in self.frames)
        h = np.ones_like(flux)
        h[:, :N] = np.interp(times, t, self.tube.length)[:, None] / N
        if self.branch is not None:
            h[:, N + 1 : self.ends[1]] = self.branch.length / (self.ends[1] - N - 1)
        return flux, mean, h

    def grid(self, times: Floats) -> tuple[Floats, ...]:
        """Coefficients of the kernel at the boundaries and in the middle of blocks of steps."""
        m, N = self.medium, self.sections
        flux, mean, h = self.at(times)
        V, surface = _at_nodes(0.5 * mean * h), _at_nodes(0.5 * m.circumference(mean) * h)
        V[:, max(self.ends) + 1 :] = 1.0
        S, inverse = _middle(flux), 1.0 / _middle(h)
        inverse[:, flux[0] == 0.0] = 0.0
        narrow = np.argmin(S[:, :N], axis=1)
        blocks = np.arange(len(S))
        ahead = np.where(np.arange(N) >= narrow[:, None], S[:, :N], 0.0).max(axis=1)
        loss = np.where(narrow == N - 1, 1.0, (1.0 - S[blocks, narrow] / ahead) ** 2)
        some, per = np.maximum(S, CLOSURE_AREA), _middle(surface) / _middle(V)
        jet = np.stack([narrow.astype(np.float64), loss], axis=1)
        return flux, V, inverse, m.friction_rate(some), m.steady_rate(some), per, jet


def _layout(
    tube: Shapes, medium: Medium, sections: int, branch: LineBranch | None, dt: float
) -> _Layout:
    shortest = float(tube.length.min()) / sections
    if branch is None:
        return _Layout(tube, medium, sections, None, (sections, -1), -1)
    cells = max(1, int(branch.length / max(shortest, 1.05 * medium.c * dt)))
    node = round(branch.position / float(tube.length[0]) * sections)
    if not 0 < node < sections:
        raise AcousticsError(
            f"the branch begins at {branch.position:.3g} m, expected a point within the tube of "
            f"{float(tube.length[0]):.3g} m"
        )
    return _Layout(tube, medium, sections, branch, (sections, sections + 1 + cells), node)


def check_sampling(sections: int, duration: float, rate: float) -> None:
    """Raise AcousticsError for too few sections or samples, or a duration or rate out of range."""
    if sections < 2 or not (
        2.0 <= duration * rate and duration <= 3600.0 and 1000.0 <= rate <= 1e6
    ):
        raise AcousticsError(
            f"{sections} sections, {duration:g} s at {rate:g} Hz: expected at least 2 sections and 2 "
            "samples, up to 3600 s and 1000 Hz to 1 MHz"
        )


def simulate_tube(
    areas: ArrayLike,
    length: ArrayLike,
    source: Source,
    *,
    times: ArrayLike = 0.0,
    duration: float,
    rate: float = 44_100.0,
    sections: int = 60,
    substeps: int | None = None,
    medium: Medium | None = None,
    branch: LineBranch | None = None,
    turbulence: Turbulence = NO_TURBULENCE,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> TubeSound:
    """Simulate the sound of a tube.

    Parameters
    ----------
    areas : array_like, shape (sections,) or (frames, sections)
        Areas from the glottis to the lips [m^2]; those below 1e-8 m^2 are closed.
    length : array_like, scalar or shape (frames,)
        Length of the tube [m].
    source : Source
        `Folds`, `Flow`, or another source at the glottis.
    times : array_like, shape (frames,)
        Instants of the frames [s], between which areas and length change linearly.
    duration : float
        [s]
    rate : float
        Samples per second of the sound [Hz].
    sections : int
        Cells of the grid.
    substeps : int, optional
        Steps per sample; by default the smallest number that satisfies the Courant limit by 2 %.
    medium : Medium, optional
        Air, walls and openings; with all losses by default.
    branch : LineBranch, optional
        Nasal tract.
    turbulence : Turbulence
        Noise; none by default.
    seed : int
        Of the noise.
    progress : callable, optional
        Called as ``progress(done, total)`` with numbers of steps.

    Returns
    -------
    TubeSound
        Signals at rate times substeps.

    Raises
    ------
    CourantError
        The Courant number c dt/dx exceeds 1.
    AcousticsError
        As `shapes`; the source, the branch or the sampling is not valid.

    Notes
    -----
    The area of a velocity cell represents the inertia of its part of the tube (mean of 1/S), and the
    volume of a pressure node is half that of both adjacent cells. With this choice the limit is
    c dt/dx <= 1 for any areas. Without losses the energy
    sum of V p^2/(2 rho c^2) + sum of rho A h u- u+/2 is constant. The flow dS/dt displaced by moving
    walls is omitted, because it is far below the audible range.
    """
    medium = medium or Medium()
    tube = shapes(areas, length, times)
    check_sampling(sections, duration, rate)
    cell = float(tube.length.min()) / sections
    steps = substeps or int(np.ceil(medium.c / (0.98 * cell * rate)))
    dt = 1.0 / (rate * steps)
    if medium.c * dt > cell * (1.0 + 1e-9):
        raise CourantError(medium.c * dt / cell, dt, cell)
    layout = _layout(tube, medium, sections, branch, dt)
    n, nodes = round(duration * rate) * steps, max(layout.ends) + 1
    if nodes > MOST_TUBE_NODES:
        raise AcousticsError(
            f"{nodes} nodes of the tube and its branch, expected at most {MOST_TUBE_NODES}"
        )
    weight, decay = friction_terms(kernels.TERMS)
    weight = weight * float(medium.friction > 0.0)
    beta = 0.5 * dt * decay
    losses = (
        float(np.sum(weight / (1.0 + beta))),
        (1.0 - beta) / (1.0 + beta),
        2.0 * beta * weight / (1.0 + beta) ** 2,
    )
    walls = medium.mass, medium.damping, medium.stiffness, medium.yielding, medium.heat_rate
    rough = turbulence.gain, turbulence.critical, 2.0 * np.pi * turbulence.smoothing
    hold = max(
        k for k in range(1, steps + 1) if k == 1 or (steps % k == 0 and rate * steps / k >= HISS)
    )
    noise = turbulence.noise(n // hold + 2, rate * steps / hold, seed)
    state, folds = np.zeros(kernels.ROWS * kernels.STRIDE), source.folds()
    ports, flows, motion, out = np.zeros((2, 3)), np.zeros(2), np.zeros(4), np.zeros((5, n))
    load = medium.load(1.0) if medium.radiates else (0.0, 1.0)
    still = len(tube.times) == 1
    g = layout.grid(np.zeros(2))
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        t = _instants(np.arange(first, last) + 0.5, dt)
        if not still:
            count = -(-(last - first) // STEPS_PER_SHAPE)
            g = layout.grid(_instants(first + STEPS_PER_SHAPE * np.arange(count + 1), dt))
        kernels.advance(
            dt, first, CHUNK if still else STEPS_PER_SHAPE, (medium.rho, medium.c, medium.mu), walls,
            losses, state, ports, flows, motion, g, load, layout.ends, layout.node, folds, rough,
            np.stack([source.flow(t), source.pressure(t), source.rest(t)]), noise, hold,
            out,
        )  # fmt: skip
        if progress is not None:
            progress(last, n)
    rows = state.reshape(kernels.ROWS, -1)
    mouth, nose, glottis, pressure, opening = out
    return TubeSound(
        rate * steps, mouth, nose, glottis, pressure, opening, rows[0, :nodes], rows[1, : nodes - 1],
        medium.rho,
    )  # fmt: skip


def kelly_lochbaum(
    areas: ArrayLike, length: float, inflow: ArrayLike, *, c: float = 350.0, lips: float = -1.0
) -> tuple[Floats, float]:
    """Flow out of the lips of a lossless tube by scattering of waves (Kelly and Lochbaum 1962).

    Parameters
    ----------
    areas : array_like, shape (sections,)
        Areas of sections of equal length, from the glottis to the lips [m^2].
    length : float
        Of the tube [m].
    inflow : array_like, shape (n,)
        Flow into the tube [m^3/s].
    c : float
        Speed of sound [m/s].
    lips : float
        Reflection of waves of flow at the lips; -1: pressure 0.

    Returns
    -------
    flow : ndarray, shape (n,)
        Out of the lips [m^3/s].
    rate : float
        Samples per second c sections/length, which the method prescribes [Hz].

    Raises
    ------
    AcousticsError
        As `shapes`.
    """
    S = shapes(areas, length).areas[0]
    given = np.ascontiguousarray(inflow, np.float64)
    out = np.zeros_like(given)
    kernels.scatter((S[:-1] - S[1:]) / (S[:-1] + S[1:]), 1.0, lips, given, out)
    return out, c * len(S) / length
