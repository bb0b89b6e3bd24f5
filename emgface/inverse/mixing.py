"""Cross-talk of the sEMG: share of every muscle in the signal over every other."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from emgface.errors import DataError
from emgface.inverse.variants import RECORDED_MUSCLES
from emgface.muscles import MUSCLES
from emgface.texts import labelled, open_text
from sim.inverse import minimise_in_box
from sim.scene import Index
from sim.state import Array

SHARE_SD: Final = 0.1
"""Standard deviation of a share before the trials are known [1]."""


def read_mixing(path: Path) -> Array:
    """Mixing matrix (n, n), in the order of `emgface.muscles.MUSCLES`, from a CSV file.

    The first column contains the muscles over which electrodes are, the others are named by muscles: the
    share of the activation of a muscle in the signal over another, which is 1 for the muscle under
    the electrodes. Empty cells and absent columns are 0, rows that are absent have no cross-talk.

    Raises
    ------
    DataError
        The file cannot be read, a name is unknown, a share is not within 0-1, or that of a muscle in
        its own signal is another than 1.
    """
    try:
        table = pd.read_csv(labelled(open_text(path)), index_col=0).fillna(0.0).astype(float)
    except (OSError, ValueError, UnicodeError) as error:
        raise DataError(
            f"{path} cannot be read as a mixing matrix ({error}): expected a CSV file with a row for "
            "every muscle with electrodes and a column for every muscle"
        ) from error
    recorded = [m for m in MUSCLES if m.rpartition("_")[0] in RECORDED_MUSCLES]
    for kind, names, known in (
        ("row", table.index, recorded),
        ("column", table.columns, list(MUSCLES)),
    ):
        unknown = [str(name) for name in names if str(name) not in known]
        if unknown or names.duplicated().any():
            raise DataError(
                f"{path}: {kind} {unknown[0] if unknown else 'twice'!r}, expected each of these once: "
                f"{', '.join(known)}"
            )
    mixing = np.eye(len(MUSCLES))
    for signal, row in table.iterrows():
        i = MUSCLES.index(str(signal))
        for muscle, share in row.items():
            if not 0.0 <= share <= 1.0:
                raise DataError(
                    f"{path}: share {share:g} of {muscle} in the signal over {signal}, expected 0 to 1"
                )
            if muscle == signal and share not in (0.0, 1.0):
                raise DataError(
                    f"{path}: share {share:g} of {muscle} in its own signal, expected 1 or an empty "
                    "cell, because the other shares are relative to it: divide the row by it"
                )
            if muscle != signal:
                mixing[i, MUSCLES.index(str(muscle))] = share
    return mixing


def in_order_of(mixing: Array, muscles: Sequence[str]) -> Array:
    """Matrix in another order of the muscles than that of `emgface.muscles.MUSCLES`."""
    order = [MUSCLES.index(m) for m in muscles]
    return mixing[np.ix_(order, order)]


def estimated_row(
    signal: Array, activation: Array, variance: Array, own: int, other: Index, weight: float
) -> Array:
    """Shares (n_muscles,) of the muscles in one signal, by bounded regression.

    They minimise weight |signal - a_own - sum_j x_j a_j|^2 + sum_j (x_j / `SHARE_SD`)^2 within 0-1,
    in the mean over the posterior of the activations a.

    Parameters
    ----------
    signal : (n,) gain times the sEMG.
    activation, variance : (n, n_muscles) posterior means and variances of the activations.
    own : int
        Muscle under the electrodes.
    other : (k,) muscles whose share is estimated.
    weight : float
        Inverse variance of a sample.
    """
    a = activation[:, other]
    Q = (
        weight * (a.T @ a + np.diag(variance[:, other].sum(axis=0)))
        + np.eye(len(other)) / SHARE_SD**2
    )
    c = weight * a.T @ (signal - activation[:, own])
    row = np.zeros(activation.shape[1])
    row[own] = 1.0
    row[other] = minimise_in_box(Q, c, 0.0 * c, 0.0 * c + 1.0).x
    return row
