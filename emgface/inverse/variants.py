"""Variants of the inverse problem: the trust in the activation estimated from sEMG."""

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np

from emgface.errors import ConfigurationError
from sim.state import Array

Variant = Literal["driven", "hybrid", "assisted", "motion"]
INVERSE_VARIANTS: tuple[Variant, ...] = get_args(Variant)

RECORDED_MUSCLES = frozenset({"ZYG", "RIS", "LLSAN", "DAO", "MEN", "OOP"})
"""Muscles without side whose activation follows electrodes over them; Eqs 2-6 infer the others."""


def trust_of(
    variant: str, muscles: Sequence[str], weight: float, missing: Sequence[str] = ()
) -> Array:
    """Trust (n_muscles,) in the activation from sEMG, as of `sim.inverse.MeasuredActivation`.

    ``"driven"`` prescribes all muscles and ``"hybrid"`` those with electrodes; ``"assisted"``
    pulls these with a weight, and ``"motion"`` uses no sEMG. Muscles without electrodes, and those
    in `missing`, are free except where all are prescribed. Names of the variants: Pizzolato et al.
    2015. Raises ConfigurationError if the variant is unknown or the weight is negative.
    """
    if variant not in INVERSE_VARIANTS:
        raise ConfigurationError(
            f"variant {variant!r} is unknown, expected one of {', '.join(INVERSE_VARIANTS)}"
        )
    if not 0.0 <= weight < np.inf:
        raise ConfigurationError(f"weight of the sEMG is {weight!r}, expected a number >= 0")
    recorded = np.array(
        [m.rpartition("_")[0] in RECORDED_MUSCLES and m not in missing for m in muscles]
    )
    if variant == "driven":
        return np.full(len(muscles), np.inf)
    if variant == "hybrid":
        return np.where(recorded, np.inf, 0.0)
    return np.where(recorded, weight if variant == "assisted" else 0.0, 0.0)
