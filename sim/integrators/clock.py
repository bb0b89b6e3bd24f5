"""Run times of the phases of a step."""

import time
from collections.abc import Generator
from contextlib import contextmanager


class PhaseClock:
    """Wall time and calls of every phase.

    A workspace and its solver share it. If the solver referred to its workspace instead, this cycle
    would keep the hundreds of megabytes of a scene until the next garbage collection.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}

    @contextmanager
    def timed(self, phase: str) -> Generator[None]:
        """Add the wall time of a block to a phase."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[phase] = self.seconds.get(phase, 0.0) + time.perf_counter() - start
            self.calls[phase] = self.calls.get(phase, 0) + 1
