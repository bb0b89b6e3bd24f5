"""Solutions with small dense matrices, whose failures are `SingularSystem`."""

from collections.abc import Generator
from contextlib import contextmanager

import numpy as np

from sim.errors import SingularSystem
from sim.pattern import Array


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
