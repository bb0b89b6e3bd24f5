"""Products of sparse matrices with vectors: symmetric ones by their upper triangle, and by rows."""

# pyright: basic, reportAttributeAccessIssue=false
# numba compiles these functions; those called from Python carry types

import numpy as np
from numpy.typing import NDArray

from sim._kernels.options import kernel

Reals = NDArray[np.float64]


@kernel
def symmetric_product(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], values: Reals, x: Reals, out: Reals
) -> None:
    """Compute out = A x for a symmetric A stored by rows of its upper triangle, diagonal first."""
    out[:] = 0.0
    for i in range(indptr.size - 1):
        first = indptr[i]
        s = values[first] * x[i]
        xi = x[i]
        for k in range(first + 1, indptr[i + 1]):
            j = indices[k]
            s += values[k] * x[j]
            out[j] += values[k] * xi
        out[i] += s


@kernel
def product(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], values: Reals, x: Reals, out: Reals
) -> None:
    """Compute out = R x for R (m, n) stored by rows."""
    for i in range(indptr.size - 1):
        s = 0.0
        for k in range(indptr[i], indptr[i + 1]):
            s += values[k] * x[indices[k]]
        out[i] = s


@kernel
def transposed_product(
    indptr: NDArray[np.int32], indices: NDArray[np.int32], values: Reals, x: Reals, out: Reals
) -> None:
    """Compute out = R'x for R (m, n) stored by rows."""
    out[:] = 0.0
    for i in range(indptr.size - 1):
        for k in range(indptr[i], indptr[i + 1]):
            out[indices[k]] += values[k] * x[i]
