"""Products of long vectors without BLAS.

NumPy passes them to a threaded BLAS, whose waiting threads slow down the element loop and the
sparse solver (a step took three times as long) and whose sums depend on the number of threads.
"""

import math

import numpy as np

from sim.state import Array


def dot(a: Array, b: Array) -> float:
    """Sum of the products of all entries of two arrays of one shape."""
    return float(np.einsum("i,i->", a.reshape(-1), b.reshape(-1)))


def norm(a: Array) -> float:
    """Euclidean norm of all entries."""
    return math.sqrt(dot(a, a))
