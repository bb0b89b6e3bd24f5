"""Parameters of laws: their units and ranges, and the check that they are finite numbers in them."""

from dataclasses import field, fields
from typing import Any

import numpy as np

from sim.checks import real_numbers, require


def quantity(default: Any, unit: str, **within: float) -> Any:
    """Field of a law with its SI unit, "1" for a number, and its bounds as of `require`."""
    return field(default=default, metadata={"unit": unit, "within": within})


def units(law: Any) -> dict[str, str]:
    """Unit of every parameter of a law, a class or an object."""
    return {f.name: f.metadata["unit"] for f in fields(law)}


@real_numbers
class Parametric:
    """Base class of laws, dataclasses of `quantity` fields, which are checked on creation."""

    def __post_init__(self) -> None:
        law: Any = self
        for f in fields(law):
            for number in np.ravel(getattr(self, f.name)).tolist():
                require(self, f.name, number, **f.metadata["within"])

    def parameters(self) -> tuple[float, ...]:
        """Parameters in the order of the attributes, which is that of the kernel."""
        law: Any = self
        return tuple(getattr(self, f.name) for f in fields(law))
