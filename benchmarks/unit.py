"""Unit of run time U: one numerical factorisation plus one solution of a scene's matrix."""

import statistics
import time
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from sim import System
from sim.linear import linear_solver

REPEATS: Final = 5  #: number of measurements, of which the median is taken
STEP: Final = 0.01  #: time step of the measured step [s]


def step_matrix(system: System) -> NDArray[np.float64]:
    """Values of M + h D + h^2 K at rest, h = `STEP`, on the pattern of the system."""
    control, q = system.control(np.zeros(len(system.muscles))), system.scene.mesh.X
    K = system.tangent(q, control)[1]
    A = STEP * system.damping(q, control, K) + STEP * STEP * K
    A[system.pattern.diagonal] += system.mass
    return A


def unit_seconds(system: System, clock: Callable[[], float] = time.perf_counter) -> float:
    """Median time [s] of one factorisation and one solution with `step_matrix`.

    Times in units U can be compared between machines, because these two are most of a step.
    """
    A = step_matrix(system)
    linear = linear_solver()
    linear.analyse(system.pattern)
    rhs = np.ones(system.pattern.n)
    times: list[float] = []
    for _ in range(REPEATS + 1):
        start = clock()
        linear.factorise(A)
        linear.solve(rhs)
        times.append(clock() - start)
    return statistics.median(times[1:])
