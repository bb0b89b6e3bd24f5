"""Numba code of the signal chain, with a separate cache."""

from pathlib import Path

from sim._kernels.cache import kernel_cache

with kernel_cache(Path(__file__).parent):
    from emgface.signals._kernels.running import running_sum, running_willison

__all__ = ["running_sum", "running_willison"]
