"""Dense linear algebra on one thread, so that its sums have one order whatever a machine is set to."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits  # pyright: ignore[reportMissingTypeStubs]

P = ParamSpec("P")
R = TypeVar("R")


def one_blas_thread(function: Callable[P, R]) -> Callable[P, R]:
    """Let BLAS and LAPACK of NumPy, SciPy and MKL use one thread while a function runs.

    How they divide a product or a factor depends on their number of threads, and so do its last digits.
    The dense matrices here are small; the elements are summed on all threads (`sim.chunks`).
    """

    @wraps(function)
    def on_one_thread(*args: P.args, **kwargs: P.kwargs) -> R:
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return on_one_thread
