"""Mesh of a person: similarity, spline, equilibria with the surfaces, relaxation of the elements."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from emgface.fit.corners import Corners
from emgface.fit.loops import along
from emgface.fit.mechanics import FINE_TOLERANCE, FitTissue
from emgface.fit.similarity import GROWTH, Similarity, growth_of, similarity, thin_plate
from emgface.fit.springs import Rows, at_nodes
from emgface.fit.targets import LandmarkPoints, Pull, Target, pulling
from emgface.fit.triangulated import Floats

Progress = Callable[[str, int, int], None]

TO_SPLINE: Final = 10.0  #: stiffness of springs to the thin-plate spline [N/m]
EVERY: Final = 3  #: every third point of a contour determines the spline
PULLS: Final = (
    Pull(3e4, 0.2, 0.3), Pull(1e5, 0.1, 0.3), Pull(3e5, 0.05, 0.3),
    Pull(1e6, 0.02, 0.3), Pull(3e6, 0.01, 0.05), Pull(1e7, 0.01, 0.05),
)  # fmt: skip
"""Springs of the iterations of closest points: stiffer, and freer along the surface, each time."""
RELAXING: Final = Pull(1e7, 0.1, 0.3, back=0.5)
RELAXATION_ROUNDS: Final = 2  #: rounds of relaxation
RELAXED_JACOBIAN, STIFFENING = 0.3, 10.0
"""Scaled Jacobian below which an element is relaxed, and factor on its stiffness."""
LANDMARK_NOISE: Final = 0.8e-3  #: standard deviation of a landmark [m]
LANDMARK: Final = 50.0
"""Stiffness of a landmark with this noise [N/m], if shapes differ by `GROWTH`.

With 5 N/m, landmarks near the rim are left behind by 7 mm.
"""


@dataclass(frozen=True)
class Deformed:
    """Positions of the nodes after every stage [m], by name, and the similarity at the beginning."""

    stages: dict[str, Floats]
    similarity: Similarity
    landmarks: LandmarkPoints
    iterations: int = 0

    @property
    def position(self) -> Floats:
        """Positions (n_nodes, 3) of the last stage [m]."""
        return next(reversed(self.stages.values()))


def deform(
    source: Floats,
    corners: Corners,
    landmarks: LandmarkPoints,
    targets: Sequence[Target],
    *,
    noise: float = LANDMARK_NOISE,
    progress: Progress | None = None,
    fixed_rows: Callable[[Floats], Rows] | None = None,
) -> Deformed:
    """Move nodes (n, 3) [m] to landmarks and surfaces without inverting any corner.

    `fixed_rows` returns further springs at positions, such as those of the prior of thickness.
    """
    tell = progress or (lambda what, done, total: None)
    total = 2 + (len(PULLS) if targets else 0) + RELAXATION_ROUNDS
    tell("spline", 0, total)
    motion = similarity(landmarks.source, landmarks.target)
    start = motion(source)
    spline = _spline(source, start, landmarks, targets, noise)
    stages = {"similarity": start, "spline": spline}
    tell("spline by mechanics", 1, total)
    nodes = np.arange(len(source))
    guide = at_nodes(nodes, spline, np.tile(TO_SPLINE * np.eye(3), (len(nodes), 1, 1)))
    tissue = FitTissue.at_rest(corners, start)
    q = stages["mechanics"] = tissue.settle(guide)
    iterations = tissue.iterations
    shown = growth_of(landmarks.source, landmarks.target, noise) / GROWTH
    stiffness = LANDMARK * shown * (LANDMARK_NOISE / noise) ** 2
    has_skin = any(target.only is None and target.name == "skin" for target in targets)

    def pulled(q: Floats, pull: Pull) -> Rows:
        if not targets:
            return guide  # the spline follows the landmarks as closely as their noise allows
        marks = landmarks.rows(stiffness, q if has_skin else None)
        return pulling(q, targets, pull).joined(marks, *([fixed_rows(q)] if fixed_rows else []))

    if targets:
        tissue = FitTissue.at_rest(corners, q)
        q = stages["surfaces"] = pull_to(
            tissue, pulled, lambda k: tell("fit to the surfaces", 2 + k, total)
        )
        iterations += tissue.iterations
    for k in range(RELAXATION_ROUNDS):
        tell("relaxation of the elements", total - RELAXATION_ROUNDS + k, total)
        tissue = FitTissue.toward_rectangles(
            corners, q, below=RELAXED_JACOBIAN, stiffening=STIFFENING
        )
        q = tissue.settle(pulled(q, replace(RELAXING, seed=50 + k)), 0.5 * FINE_TOLERANCE)
        iterations += tissue.iterations
    stages["relaxed"] = q
    tell("relaxation of the elements", total, total)
    return Deformed(stages, motion, landmarks, iterations)


def pull_to(
    tissue: FitTissue, rows: Callable[[Floats, Pull], Rows], tell: Callable[[int], None]
) -> Floats:
    """Equilibria with the springs `rows` of positions (n, 3) and a stage of `PULLS`, one by one."""
    for k, pull in enumerate(PULLS):
        tell(k)
        last = (FINE_TOLERANCE,) if k >= len(PULLS) - 2 else ()
        tissue.settle(rows(tissue.q, replace(pull, seed=k)), *last)
    return tissue.q


def _spline(
    source: Floats,
    start: Floats,
    landmarks: LandmarkPoints,
    targets: Sequence[Target],
    noise: float,
) -> Floats:
    """Thin-plate spline of the landmarks, and of points of the contours paired by it."""
    source_points, to = landmarks.source, landmarks.target

    def spline(source_points: Floats, to: Floats) -> Floats:
        return thin_plate(source_points, to, noise, growth_of(source_points, to, noise))(source)

    q = spline(source_points, to) if len(source_points) >= 4 else start
    for _ in range(2):
        points, places = [source_points], [to]
        for target in targets:
            for pair in target.pairs(q):
                foot, _ = along(q[pair.mine], pair.target)
                points.append(source[pair.mine[::EVERY]])
                places.append(foot[::EVERY])
        if len(points) == 1:
            break
        q = spline(np.concatenate(points), np.concatenate(places))
    return q
