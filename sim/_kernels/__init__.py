"""All numba code of the mechanics, compiled once into a cache of its own.

A kernel takes contiguous arrays and scalars, writes into buffers of the caller, knows no classes and
reports trouble by value; the Python around it raises.

No kernel has `fastmath`, not even `contract`: numba optimises a parallel kernel once when it is compiled
and once more for its cache, and whatever the compiler is allowed to reorder differs between the two, in
the last digit of a stiffness. By the plain rules of IEEE 754 both are the same.
"""

from pathlib import Path

from sim._kernels.cache import kernel_cache

with kernel_cache(Path(__file__).parent):
    from sim._kernels import (
        barrier,
        crossing,
        element,
        grid,
        lanes,
        laws,
        matrix,
        nearest_faces,
        scatter,
        signed,
        solid,
        symmetric,
        tensor_element,
        tensor_laws,
        tensor_point,
        tensor_solid,
        triangles,
        volume,
    )

__all__ = [
    "barrier",
    "crossing",
    "element",
    "grid",
    "kernel_cache",
    "lanes",
    "laws",
    "matrix",
    "nearest_faces",
    "scatter",
    "signed",
    "solid",
    "symmetric",
    "tensor_element",
    "tensor_laws",
    "tensor_point",
    "tensor_solid",
    "triangles",
    "volume",
]
