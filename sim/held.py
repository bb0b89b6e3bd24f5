"""Solutions of A x = r + G'f that keep rows closed, G x + C f = b, by their Schur complement."""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from sim.dense import least, solved
from sim.pattern import Array

Push = Callable[[Array], Array]
"""Motion A^-1 G'f, (n,) or (k, n), by forces f of the rows, (m,) or (k, m)."""


def held(
    x: Array,
    G: Array | csr_array,
    S: Array,
    push: Push,
    what: str,
    *,
    wanted: Array | float = 0.0,
    soft: Array | float = 0.0,
    cutoff: float | None = None,
    repeats: int = 1,
    most: float = 0.0,
) -> tuple[Array, Array]:
    """Solutions of A x = r without rows, changed so that the rows hold, and the forces of the rows.

    With S = G A^-1 G' of the matrix itself one correction is exact. S may belong to a similar matrix,
    and the correction is then repeated until the rows are open by `most` at most.

    Parameters
    ----------
    x : (n,) or (k, n) solutions without the forces.
    G : (m, n) rows.
    S : (m, m) their matrix G A^-1 G', or a similar one.
    push : motion by forces.
    what : name of S, for the message of a failure.
    wanted : (m,) or (k, m) value b of G x + C f.
    soft : (m,) compliance C of the rows.
    cutoff : relative size of singular values of S that are zero, because rows repeat each other; None
        if the rows are independent.
    repeats : largest number of corrections.

    Raises SingularSystem if S is singular and has no `cutoff`.
    """
    f = np.zeros((*x.shape[:-1], G.shape[0]))
    W = S + np.diag(np.broadcast_to(soft, len(S)))
    for _ in range(repeats if f.size else 0):
        left = wanted - np.asarray(G @ x.T).T - soft * f
        if float(np.abs(left).max()) <= most:
            break
        more = solved(W, left.T, what).T if cutoff is None else least(W, left.T, what, cutoff).T
        x, f = x + push(more), f + more
    return x, f
