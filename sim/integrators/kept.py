"""Named arrays in which solvers keep their memory for a restart."""

from collections.abc import Mapping

import numpy as np

from sim.state import Array


def named(part: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    """Arrays of a part with its name before theirs."""
    return {f"{part}.{name}": array for name, array in arrays.items()}


def part_of(arrays: Mapping[str, Array], part: str) -> dict[str, Array]:
    """Arrays of a part, by their names within it; the inverse of `named`."""
    start = f"{part}."
    return {k.removeprefix(start): a for k, a in arrays.items() if k.startswith(start)}


def codes(name: str) -> Array:
    """Text as an array."""
    return np.frombuffer(name.encode(), dtype=np.uint8).astype(np.float64)


def text(codes: Array) -> str:
    """Inverse of `codes`."""
    return codes.astype(np.uint8).tobytes().decode()
