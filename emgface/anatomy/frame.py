"""Check of the directions of a model: x to the subject's right, y anterior, z superior."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.errors import DataError

Floats = NDArray[np.float64]

AXIS_OF_DIRECTION: Final = {"right": 0, "anterior": 1, "superior": 2}
LEAST_COSINE: Final = 0.5
"""Cosine of 60 degrees, by which no upright head is turned, and less than a quarter turn."""


#: length [m] below which a vector of the anatomy determines no direction
SHORTEST_VECTOR: Final = 2e-3


def to_the_right(names: Sequence[str], places: Floats) -> Floats | None:
    """Mean vector (3,) [m] from each place whose name ends in ``_L`` to its partner in ``_R``.

    None without such a pair; `places` is (k, 3).
    """
    of_name = dict(zip(names, places, strict=True))
    pairs = [(n, n[:-2] + "_R") for n in names if n.endswith("_L") and n[:-2] + "_R" in of_name]
    return np.mean([of_name[r] - of_name[left] for left, r in pairs], axis=0) if pairs else None


def check_frame(what: str, directions: Mapping[str, Floats | None], error: type[DataError]) -> None:
    """Refuse a model that is turned or mirrored.

    `directions` are vectors (3,) of the anatomy [m] by the names of `AXIS_OF_DIRECTION`; the part of
    each that lies along the earlier ones is left out. One that is None, or what is left of it shorter
    than `SHORTEST_VECTOR`, is not checked.
    Raises `error` where a vector and its axis form an angle of more than 60 degrees.
    """
    earlier: list[Floats] = []
    for name, vector in directions.items():
        if vector is None:
            continue
        own = np.asarray(vector, dtype=np.float64)
        for unit in earlier:
            own = own - (own @ unit) * unit
        length = float(np.linalg.norm(own))
        if not length > SHORTEST_VECTOR:
            continue
        earlier.append(own / length)
        if not earlier[-1][AXIS_OF_DIRECTION[name]] >= LEAST_COSINE:
            shown = ", ".join(f"{x:.2f}" for x in earlier[-1])
            raise error(
                f"the {name} direction of the {what}, from its names and places, is ({shown}), "
                f"expected about {'xyz'[AXIS_OF_DIRECTION[name]]}: in the frame of models x is to "
                "the subject's right, y anterior and z superior. Rotate it (from LPS coordinates, "
                "x and y change sign), or exchange the names of left and right if it is mirrored"
            )
