"""Numba code of the acoustics, with a separate cache."""

from pathlib import Path

from sim._kernels.cache import kernel_cache

with kernel_cache(Path(__file__).parent):
    from emgface.acoustics._kernels import tube

__all__ = ["tube"]
