"""Numba code of the mechanics, with a separate cache.

A kernel takes contiguous arrays and scalars, writes into buffers of the caller, uses no classes and
returns failures as values; the Python code that calls it raises.

The decorators of `sim._kernels.options` specify how they are compiled, so that the code
compiled in a process is the code that others load from the cache, and yields the same bits.
"""

from pathlib import Path

from sim._kernels.cache import kernel_cache

with kernel_cache(Path(__file__).parent):
    from sim._kernels import (
        barrier,
        body_forces,
        body_rows,
        body_tables,
        coulomb,
        crossing,
        dense,
        element,
        frames,
        free_bodies,
        grid,
        joints,
        lanes,
        laws,
        lines,
        matrix,
        multibody,
        nearest_faces,
        options,
        reduced,
        scatter,
        signed,
        solid,
        symmetric,
        tensor_element,
        tensor_laws,
        tensor_point,
        tensor_solid,
        triangles,
        triple,
        tube,
        volume,
    )

__all__ = [
    "barrier",
    "body_forces",
    "body_rows",
    "body_tables",
    "coulomb",
    "crossing",
    "dense",
    "element",
    "frames",
    "free_bodies",
    "grid",
    "joints",
    "kernel_cache",
    "lanes",
    "laws",
    "lines",
    "matrix",
    "multibody",
    "nearest_faces",
    "options",
    "reduced",
    "scatter",
    "signed",
    "solid",
    "symmetric",
    "tensor_element",
    "tensor_laws",
    "tensor_point",
    "tensor_solid",
    "triangles",
    "triple",
    "tube",
    "volume",
]
