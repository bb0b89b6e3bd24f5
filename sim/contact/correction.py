"""Post-step correction of penetrations.

The velocities are not changed, so that the correction of an overlap does not accelerate bodies.
"""

from collections.abc import Callable

import numpy as np

from sim.contact.rows import Flags, Rows
from sim.contact.step import penalties
from sim.pattern import SymmetricPattern
from sim.scene import Index
from sim.state import Array

NOTICED = 3e-6
"""Penetration depth above which positions are corrected [m]."""

CONSIDERABLE = 1e-4
"""Depth of an active row above which the step is solved again [m]."""

AT_ALL = 2e-5
"""Depth of an inactive row above which the step is solved again [m]."""

CORRECTIONS = 4
FARTHEST = 2.0
"""Largest factor on a correction."""

Opened = Callable[[Rows, Array], Array]
"""Displacements (n_nodes, 3) that open rows by distances (k,) [m]."""


def considerable(rows: Rows, u: Array, pushing: Index) -> Flags:
    """Test if rows (k,) are too deep at displacements u (n_nodes, 3) for a correction.

    `pushing` contains the slots of active rows.
    """
    return -rows.gaps(u) > np.where(np.isin(rows.slot, pushing), CONSIDERABLE, AT_ALL)


def moved_out(q: Array, q0: Array, near: Rows, opened: Opened) -> Array:
    """Positions with penetrations removed along the compliance of the tissue.

    Parameters
    ----------
    q, q0 : (n_nodes, 3) positions at the end and the start of the step [m].
    near : Rows
        Those at q.
    opened : callable
    """
    none = np.zeros_like(q)
    for _ in range(CORRECTIONS):
        gap = near.gaps(q - q0)
        deep = np.flatnonzero(gap < -NOTICED)
        if not len(deep):
            break
        rows, wanted = near.take(deep), -gap[deep]
        move = opened(rows, wanted)
        moved = rows.gaps(move) - rows.gaps(none)
        share = float(moved @ wanted) / max(float(moved @ moved), np.finfo(float).tiny)
        q = q + min(max(share, 0.0), FARTHEST) * move
    return q


def pressed(
    rows: Rows,
    wanted: Array,
    pushing: Index,
    pattern: SymmetricPattern,
    diagonal: Array,
    penalty: float,
) -> Array:
    """Nodal forces (n_nodes, 3) that open rows approximately by distances (k,) [m].

    Parameters
    ----------
    pushing : slots of active rows.
    pattern : SymmetricPattern
    diagonal : (n_free,) of the stiffness [N/m].
    penalty : float
        Factor on the stiffness of active rows in the matrix.
    """
    factor = np.where(np.isin(rows.slot, pushing), penalty, 1.0)
    rho = factor * penalties(pattern, diagonal, rows, 1.0)
    return rows.spread((rho * wanted)[:, None] * rows.normal, pattern.n_nodes)
