"""Measures of a generated face by least squares, as the first step of a fit to a person.

Surfaces do not state where along the skin a node lies; the measures of the template do, by what faces
have in common. The energy is that of springs to surfaces, contours and landmarks, in units of their
variances, and of the deviations of the measures from those of the face, scaled like the landmarks, in
units of their spread among adults; a rigid motion is found with them. Each round takes one step of
Gauss and Newton. The face that is generated with these measures has its own muscles and attachments.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import xarray as xr
from scipy.spatial.transform import Rotation

from emgface.errors import FaceError, listed
from emgface.fit.family import MEASURE_SPREADS, Family
from emgface.fit.inputs import Paired
from emgface.fit.similarity import Floats, Similarity, similarity
from emgface.fit.springs import Rows
from emgface.fit.targets import UNCOVERED_RATIO, Pull, Target, pulling

CORRELATED: Final = 1e-4  #: area over which the misfit of a surface is one independent value [m2]
SURFACE_SPREADS: Final = (4e-3, 2e-3, 1e-3, 0.6e-3, 0.4e-3, 0.3e-3, 0.3e-3, 0.3e-3)
"""Standard deviations of the distance from a surface in the rounds of nearest points [m]."""
SPRING_HUBER: Final = 2.0  #: misfit in standard deviations beyond which a spring becomes weaker [1]
LARGEST_ROUND_CHANGE: Final = 2.0  #: largest change of a measure in a round, in its spreads [1]
#: differences that give the derivatives, in spreads of the measures [1]
DIFFERENCE_IN_SPREADS: Final = 1e-4


@np.errstate(invalid="ignore", divide="ignore")  # measures of the search may have no surface
def nearer_face(
    face: xr.Dataset, paired: Paired, targets: Sequence[Target], noise: float
) -> xr.Dataset:
    """Generated face with the measures of a person; the face itself if it is not a generated one.

    `noise` is the standard deviation of a landmark [m].
    """
    family = Family.from_face(face)
    if family is None:
        return face
    landmarks = paired.points
    motion = similarity(landmarks.source, landmarks.target)
    spread = np.array(list(MEASURE_SPREADS.values()))
    n = len(spread)
    lengths = np.array([name != "width_asymmetry" for name in MEASURE_SPREADS])
    expected = np.where(lengths, motion.scale, 1.0) * family.start
    values, rigid = expected, replace(motion, scale=1.0)
    prior = np.concatenate([np.ones(n), np.zeros(6)])

    def springs(q: Floats, width: float, number: int, beyond: float = UNCOVERED_RATIO) -> Rows:
        rows = _robust(landmarks.rows(noise**-2), q, noise)
        if not targets:
            return rows
        pull = Pull(1.0 / (CORRELATED * width**2), 0.0, 0.0, seed=number, beyond=beyond)
        return rows.joined(_robust(pulling(q, targets, pull), q, width))

    try:
        for number, width in enumerate(SURFACE_SPREADS):
            own = family.nodes(values)
            moved = [
                (family.nodes(values + DIFFERENCE_IN_SPREADS * s) - own) / DIFFERENCE_IN_SPREADS
                for s in np.diag(spread)
            ]
            q = rigid(own)
            centre = q.mean(axis=0)
            turns = [np.cross(axis, q - centre) for axis in np.eye(3)]
            shifts = [np.broadcast_to(axis, q.shape) for axis in np.eye(3)]
            turned = [m @ rigid.rotation.T for m in moved]
            slope = np.array([*turned, *turns, *shifts], dtype=np.float64)
            H, g = _normal_equations(springs(q, width, number), slope, q)
            g[:n] += (values - expected) / spread
            step = -np.linalg.solve(H + np.diag(prior), g)
            values = (
                values + np.clip(step[:n], -LARGEST_ROUND_CHANGE, LARGEST_ROUND_CHANGE) * spread
            )
            turn = Rotation.from_rotvec(step[n:-3]).as_matrix()
            shift = centre + step[-3:] - turn @ centre
            rigid = Similarity(1.0, turn @ rigid.rotation, turn @ rigid.shift + shift)
        before, after = (
            _mean_square(springs(q, SURFACE_SPREADS[0], 0, beyond=0.0), q)
            for q in (motion(face["position"].values), rigid(family.nodes(values)))
        )
    except (FaceError, ValueError, np.linalg.LinAlgError):  # no surface has these measures
        return face
    return family.member(values) if after < before else face


def _mean_square(rows: Rows, q: Floats) -> float:
    r = _misfit(rows, q)
    return float(np.einsum("ri,rij,rj->", r, rows.stiffness, r)) / len(r)


def changed_measures(before: xr.Dataset, after: xr.Dataset) -> list[str]:
    """Sentence with the measures that differ by more than half of their spread."""
    changes = []
    for name, spread in MEASURE_SPREADS.items():
        a, b = (float(face.attrs[f"measure_{name}"]) for face in (before, after))
        if abs(b - a) > 0.5 * spread:
            unit = 1.0 if name == "width_asymmetry" else 1e-3
            changes.append(f"{name} {a / unit:.3g} to {b / unit:.3g}")
    if not changes:
        return []
    return [f"the measures of the generated face were fitted first [mm]: {listed(changes, 32)}"]


def _robust(rows: Rows, q: Floats, width: float) -> Rows:
    """Springs whose stiffness is multiplied by the weight of Huber of their misfit."""
    r = _misfit(rows, q)
    stiffness = np.maximum(np.trace(rows.stiffness, axis1=1, axis2=2), 1e-30)
    size = np.sqrt(np.einsum("ri,rij,rj->r", r, rows.stiffness, r) / stiffness)
    weight = np.minimum(1.0, SPRING_HUBER * width / np.maximum(size, 1e-12))
    return replace(rows, stiffness=weight[:, None, None] * rows.stiffness)


def _misfit(rows: Rows, q: Floats) -> Floats:
    return np.einsum("rk,rki->ri", rows.weights, q[rows.nodes]) - rows.target


def _normal_equations(rows: Rows, slope: Floats, q: Floats) -> tuple[Floats, Floats]:
    """Matrix (n, n) and right side (n,) for the derivatives (n, n_nodes, 3) of the nodes."""
    J = np.einsum("rk,prki->rip", rows.weights, slope[:, rows.nodes])
    WJ = rows.stiffness @ J
    return np.einsum("rip,riq->pq", J, WJ), np.einsum("ri,rip->p", _misfit(rows, q), WJ)
