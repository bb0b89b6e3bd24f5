"""Numba code of the mechanics, with a separate cache.

A kernel takes contiguous arrays and scalars, writes into buffers of the caller, uses no classes and
returns failures as values; the Python code that calls it raises.

The decorators of `sim._kernels.options` specify how they are compiled, so that the code
compiled in a process is the code that others load from the cache, and yields the same bits.
"""

from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

from sim._kernels.cache import kernel_cache

with kernel_cache(Path(__file__).parent):
    for _module in iter_modules(__path__):
        import_module(f"{__name__}.{_module.name}")
