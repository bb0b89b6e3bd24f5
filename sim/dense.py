"""Products of long vectors without BLAS, and solutions with small dense matrices.

NumPy passes products of vectors to a threaded BLAS, whose waiting threads slow down the element loop and
the sparse solver (a step took three times as long) and whose sums depend on the number of threads.
Failures of LAPACK are `SingularSystem`.
"""

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager

import numpy as np
from scipy.sparse import csr_array

from sim.errors import SingularSystem
from sim.pattern import Array


def dot(a: Array, b: Array) -> float:
    """Sum of the products of all entries of two arrays of one shape."""
    return float(np.einsum("i,i->", a.reshape(-1), b.reshape(-1)))


def norm(a: Array) -> float:
    """Euclidean norm of all entries."""
    return math.sqrt(dot(a, a))


def curvature(s: Array, y: Array) -> float:
    """Product of a step and the change of the gradient, or 0 if it is not positive beyond rounding."""
    sy = dot(s, y)
    return sy if sy > 1e-10 * norm(s) * norm(y) else 0.0


@contextmanager
def reported(what: str) -> Generator[None]:
    """Raise SingularSystem, which step controls catch, where LAPACK fails on a matrix `what`."""
    try:
        yield
    except np.linalg.LinAlgError as error:
        raise SingularSystem(
            f"{what} cannot be solved ({error}), expected independent equations: try a smaller step, "
            "or leave out rows that repeat each other"
        ) from error


def solved(A: Array, b: Array, what: str) -> Array:
    """Solution of A x = b."""
    with reported(what):
        return np.asarray(np.linalg.solve(A, b), dtype=np.float64)


def inverse(A: Array, what: str) -> Array:
    """Inverse of A."""
    with reported(what):
        return np.asarray(np.linalg.inv(A), dtype=np.float64)


def least(A: Array, b: Array, what: str, cutoff: float | None = None) -> Array:
    """Smallest x of least |A x - b|; `cutoff` is the relative size of singular values that are zero."""
    with reported(what):
        return np.asarray(np.linalg.lstsq(A, b, rcond=cutoff)[0], dtype=np.float64)


Push = Callable[[Array], Array]
"""Motion A^-1 G'f, (n,) or (k, n), by forces f of the rows, (m,) or (k, m)."""


def solve_under_rows(
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
