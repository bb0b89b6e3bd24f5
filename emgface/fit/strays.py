"""Landmarks that contradict the others or a face: expected places, strays, exchanges, proportions.

The difference of two shapes is a random function whose expectation is affine and whose increments
over a distance h have the variance 2 `GROWTH` h per coordinate. With K_ij = -GROWTH |p_i - p_j| +
noise^2 delta_ij, the drift P = (1, p) and an orthonormal basis Q of the complement of P,
B = Q (Q' K Q)^-1 Q' gives the errors of the best linear predictions without a set I of points:
e_I = B_II^-1 (B y)_I, with the covariance B_II^-1 (Dubrule 1983). This is the thin-plate spline of
`emgface.fit.similarity` without these points; its error is judged by its own variance, which is small
among neighbours and large for a tip that the others surround from one side.

The affine part itself is known with the covariance of its generalised least squares. The stretch of one
axis against the other two, a logarithm, then has the standard deviation of proportions between persons:
5.6 % with the 20 named landmarks of a face. Face indices (nasion to gnathion over zygion to zygion,
Farkas 1994, as commonly quoted) vary by 5.3 to 5.8 %, generated adults along the three axes by 3.6, 4.2
and 6.4 %.
"""

from collections.abc import Sequence
from itertools import combinations
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist
from scipy.stats import chi2

from emgface.errors import FitError, listed
from emgface.fit.similarity import GROWTH, Floats, misfit, similarity

#: smallest number of landmarks of which one can be judged by the others
LEAST_JUDGED_LANDMARKS: Final = 7
CLICK: Final = 1.5e-3  #: smallest standard deviation of a landmark in these tests [m]
STRAY: Final = 5.0
"""Number of standard deviations, per coordinate, by which a landmark may miss its expected place.

Correct landmarks of the two published faces and of 25 generated ones are within 3.7.
"""
#: the same of the place that a similarity of fewer landmarks predicts [m]
STRAY_OF_FEW: Final = 2e-3
SUSPECT: Final = 2.0  #: number of standard deviations of landmarks that may be exchanged
UNDONE: Final = 0.2  #: share of the squared error that remains if two exchanged names are corrected
PROPORTION: Final = 2.5
"""Stretch of an axis against the others that is doubted, in standard deviations [1].

Members of the generated groups are drawn within as many deviations of each measure.
"""
#: share of the misfit that remains if exchanged sides are corrected [1]
EXCHANGED_MISFIT_SHARE: Final = 0.5
OTHER_SIDE: Final = {"left": "right", "right": "left", "l": "r", "r": "l"}
AXIS_WORDS: Final = ("width", "depth", "height")  #: of a face or jaw along its axes
LANDMARKS_COINCIDE: Final = 2e-4  #: distance at which two landmarks are at one place [m]


class Predictions:
    """Errors of the predictions of points (n, 2 or 3) [m] from the others, with their covariance."""

    def __init__(self, source: Floats, target: Floats, noise: float) -> None:
        n, centred = len(source), source - source.mean(axis=0)
        K = noise**2 * np.eye(n) - GROWTH * cdist(source, source)
        P = np.column_stack([np.ones(n), centred / np.abs(centred).max()])
        Q = np.linalg.qr(P, mode="complete")[0][:, P.shape[1] :]
        self.B: Floats = np.asarray(Q @ np.linalg.solve(Q.T @ K @ Q, Q.T), dtype=np.float64)
        self.target, self.By = target, self.B @ target

    @classmethod
    def of_similarity(cls, mapped: Floats, target: Floats) -> "Predictions":
        """Predictions of a similarity of few landmarks, with errors independent of each other."""
        few = object.__new__(cls)
        few.B, few.target = np.eye(len(target)) / STRAY_OF_FEW**2, target
        few.By = few.B @ (target - mapped)
        return few

    def errors(self) -> tuple[Floats, Floats]:
        """Errors (n, d) and their standard deviations (n,) [m]; infinite if others decide nothing."""
        diagonal = np.diag(self.B)
        some = diagonal > 1e-9 * diagonal.max(initial=0.0)
        variance = 1.0 / np.where(some, diagonal, 1.0)
        sd = np.where(some, np.sqrt(variance), np.inf)
        return np.where(some[:, None], variance[:, None] * self.By, 0.0), sd

    def exchanged(self, i: int, j: int) -> tuple[float, float]:
        """Squared errors of two points, in units of their covariance, as named and exchanged."""
        own = [i, j]
        block = self.B[np.ix_(own, own)]
        try:
            e = np.linalg.solve(block, self.By[own])
        except np.linalg.LinAlgError:
            return 0.0, 0.0
        swapped = e + self.target[own[::-1]] - self.target[own]
        return float((e * (block @ e)).sum()), float((swapped * (block @ swapped)).sum())


def check_strays(
    names: Sequence[str], source: Floats, target: Floats, given: str, noise: float
) -> None:
    """Refuse landmarks at one place, two that are exchanged, and one that the others contradict.

    Persons may differ by more than expected: the limit grows with the median deviation of the other
    landmarks without the one in question.
    """
    apart, before = cdist(target, target), cdist(source, source)
    for i, j in np.argwhere(
        np.triu((apart < LANDMARKS_COINCIDE) & (before > 5.0 * LANDMARKS_COINCIDE), 1)
    ):
        raise FitError(
            f"{given}: {names[i]} and {names[j]} are at one place, on the face "
            f"{1e3 * before[i, j]:.3g} mm apart: correct one of them"
        )
    if len(names) < LEAST_JUDGED_LANDMARKS:
        mapped = similarity(source, target)(source)
        _check_exchanges(names, Predictions.of_similarity(mapped, target), given)
        return
    predictions = Predictions(source, target, max(noise, CLICK))
    _check_exchanges(names, predictions, given)
    errors, sd = predictions.errors()
    z = deviations(errors, sd)
    k = int(np.argmax(z))
    rest = np.delete(np.arange(len(names)), k)
    others = deviations(*Predictions(source[rest], target[rest], max(noise, CLICK)).errors())
    dims = source.shape[1]
    expected = np.sqrt(chi2.ppf(0.5, dims) / dims)
    limit = STRAY * max(1.0, float(np.median(others)) / expected)
    if z[k] > limit:
        miss = 1e3 * float(np.linalg.norm(errors[k]))
        raise FitError(
            f"{given}: landmark {names[k]} lies {miss:.3g} mm from the place expected from the others, "
            f"expected at most {miss * limit / z[k]:.3g} mm: check its side and position, or omit it"
        )


def stretches(source: Floats, target: Floats, noise: float) -> tuple[Floats, Floats]:
    """Logarithms (3,) of the stretch along each axis against the other two, and their deviations [1].

    With the affine part A of the spline and the logarithmic strain E = log(A'A) / 2, the stretch of axis
    k is E_kk less the mean of the other two. It is about the axes of the model, because the shear of
    two profiles differs more than their proportions do.
    """
    n, centred = len(source), source - source.mean(axis=0)
    P = np.column_stack([np.ones(n), centred])
    K = noise**2 * np.eye(n) - GROWTH * cdist(source, source)
    M = np.linalg.inv(np.block([[K, P], [P.T, np.zeros((4, 4))]]))
    A = (M[n + 1 :, :n] @ target).T
    values, vectors = np.linalg.eigh(A.T @ A)
    own = np.diag((vectors * (0.5 * np.log(values))) @ vectors.T)
    scale = np.exp(own.mean())
    variance = np.maximum(-np.diag(M[n + 1 :, n + 1 :]), 0.0) / scale**2
    return 1.5 * (own - own.mean()), np.sqrt(variance + (variance.sum() - variance) / 4.0)


def unusual_proportions(
    source: Floats, target: Floats, rotation: Floats, given: str, noise: float
) -> str | None:
    """Doubt about landmarks of which one axis is longer or shorter than those of persons.

    `rotation` turns the axes of the model to those of the landmarks.
    """
    stretch, sd = stretches(source, target, max(noise, CLICK))
    k = int(np.argmax(np.abs(stretch) / sd))
    if not abs(stretch[k]) > (limit := PROPORTION * float(sd[k])):
        return None
    along = rotation[:, k]
    axis = int(np.argmax(np.abs(along)))
    size, most = (100.0 * float(np.expm1(x)) for x in (abs(stretch[k]), limit))
    way = "larger" if stretch[k] > 0.0 else "smaller"
    of_model = f"the {AXIS_WORDS[k]} of the model"
    direction = f"{'xyz'[axis]} of the files ({listed(np.round(along, 2))}; {of_model})"
    return (
        f"{given}: along the axis {direction} the landmarks are {size:.0f} % {way} against the other "
        f"two axes, among persons at most {most:.0f} %: check the spacing of the slices, in the header "
        "of the image or of its labels, and whether the scan is scaled along this axis, unless the "
        "person has this shape"
    )


def deviations(errors: Floats, sd: Floats) -> Floats:
    """Errors (n, d) in standard deviations, root mean square over the coordinates (n,) [1]."""
    return np.linalg.norm(errors, axis=1) / (np.sqrt(errors.shape[1]) * sd)


def _check_exchanges(names: Sequence[str], predictions: Predictions, given: str) -> None:
    """Refuse two landmarks that the others explain much better if their names are exchanged."""
    worst: tuple[float, int, int] | None = None
    errors, sd = predictions.errors()
    suspects = np.flatnonzero(deviations(errors, sd) > SUSPECT)
    for i, j in combinations(suspects.tolist(), 2):
        now, then = predictions.exchanged(i, j)
        undone = now > 2.0 * errors.shape[1] * SUSPECT**2 and then < UNDONE * now
        if undone and (worst is None or now - then > worst[0]):
            worst = now - then, i, j
    if worst is not None:
        _, i, j = worst
        raise FitError(
            f"{given}: the landmarks {names[i]} and {names[j]} seem to be exchanged: each lies nearer "
            "to the place of the other; exchange their names"
        )


def check_sides(names: Sequence[str], source: Floats, target: Floats, given: str) -> None:
    """Refuse landmarks of which two or three pairs, but not all, have the names of the other side.

    Together they change the similarity, so that no pair alone seems to be exchanged.
    """
    pairs = [
        (k, names.index(other))
        for k, name in enumerate(names)
        if name < (other := _other_side(name)) and other in names
    ]
    before = best = misfit(similarity(source, target), source, target)
    wrong: tuple[tuple[int, int], ...] = ()
    for some in (c for size in (2, 3) if 2 * size <= len(pairs) for c in combinations(pairs, size)):
        order = np.arange(len(names))
        for i, j in some:
            order[[i, j]] = j, i
        after = misfit(similarity(source, target[order]), source, target[order])
        if after < best:
            best, wrong = after, some
    if wrong and best < EXCHANGED_MISFIT_SHARE * before:
        exchanged = listed(f"{names[i]} and {names[j]}" for i, j in wrong)
        raise FitError(
            f"{given}: the sides of {exchanged} seem to be exchanged: with their names corrected, the "
            f"landmarks fit to {1e3 * best:.3g} mm rms instead of {1e3 * before:.3g} mm; exchange their "
            "names"
        )


def _other_side(name: str) -> str:
    """Name of the same landmark on the other side; the name itself if it has no side."""
    words = name.split("_")
    return "_".join(OTHER_SIDE.get(word, word) for word in words)


def spread_of_spline(at: Floats, places: Floats, noise: float) -> Floats:
    """Standard deviation (k,) per coordinate of the spline through points (n, 3) at `places` (k, 3) [m].

    With k the covariances of a place with the points and the drift, and M the bordered matrix of the
    spline, the variance is -k' M^-1 k (universal kriging).
    """
    centre = at.mean(axis=0)
    size = np.abs(at - centre).max()
    P, p = (np.column_stack([np.ones(len(x)), (x - centre) / size]) for x in (at, places))
    K = noise**2 * np.eye(len(at)) - GROWTH * cdist(at, at)
    M = np.block([[K, P], [P.T, np.zeros((P.shape[1], P.shape[1]))]])
    k = np.vstack([-GROWTH * cdist(at, places), p.T])
    return np.sqrt(np.maximum(-(k * np.linalg.solve(M, k)).sum(axis=0), 0.0))


def left_out(source: Floats, target: Floats, noise: float) -> Floats:
    """Distance (n,) of every landmark from the place that the others predict [m]; NaN if they cannot."""
    if len(source) < LEAST_JUDGED_LANDMARKS - 1:
        return np.full(len(source), np.nan)
    errors, sd = Predictions(source, target, noise).errors()
    return np.where(np.isfinite(sd), np.linalg.norm(errors, axis=1), np.nan)
