"""The unit of run time U: one numerical factorisation plus one solution of a scene's matrix."""

import statistics
import time
from collections.abc import Callable

import numpy as np

from sim import System
from sim.linear import linear_solver


def unit_seconds(
    system: System, repeats: int = 5, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Median time [s] of one factorisation and one solution of M + h D + h^2 K at rest, h = 10 ms.

    Figures in units U compare between machines, since most of a step is this.
    """
    control, q, h = system.control(np.zeros(len(system.muscles))), system.scene.mesh.X, 0.01
    K = system.tangent(q, control)[1]
    A = h * system.damping(q, control, K) + h * h * K
    A[system.pattern.diagonal] += system.mass
    linear = linear_solver()
    linear.analyse(system.pattern)
    rhs = np.ones(system.pattern.n)
    times: list[float] = []
    for _ in range(repeats + 1):
        start = clock()
        linear.factorise(A)
        linear.solve(rhs)
        times.append(clock() - start)
    return statistics.median(times[1:])
