"""Mapping of seven measured to ten modelled muscles per side.

Source: Eskes et al. 2017, Eqs 2-6. The other muscles (ZYG, RIS, LLSAN, DAO, MEN) are used as
measured.
"""

from collections.abc import Sequence
from typing import Final, Literal

import numpy as np
import xarray as xr

from emgface.errors import SchemaError
from emgface.muscles import CHANNELS, MODELLED, MUSCLES, SIDES

MAPPING_WEIGHTS: Final[dict[str, dict[str, float]]] = {
    "ZYG": {"ZYG": 1.0},
    "RIS": {"RIS": 1.0},
    "LLSAN": {"LLSAN": 1.0},
    "LAO": {"LLSAN": 0.75},
    "BUC": {"RIS": 0.50, "ZYG": 0.50},
    "OOP": {"OOS": 0.50, "OOI": 0.50},
    "OOM": {"OOS": 0.10, "OOI": 0.10},
    "DLI": {"DAO": 0.75},
    "DAO": {"DAO": 1.0},
    "MEN": {"MEN": 1.0},
}
"""Weight of each measured muscle in each modelled one, with OOM as in the text."""

OOM_AS_PRINTED: Final = {"OOS": 0.05, "OOI": 0.15}
"""Eq. 3 as printed: 0.10 (OOP + OOI), with OOP = 0.50 (OOS + OOI) inserted."""


def mapping_matrix(oom: Literal["text", "as_printed"] = "text") -> xr.DataArray:
    """Weight of each channel in each muscle (Eqs 2-6), dims (muscle, channel), shape (20, 14) [1].

    `oom` is ``"text"`` (OOM is a fifth of OOP) or ``"as_printed"`` (Eq. 3 without correction).
    Weights between the sides are zero.
    """
    matrix = xr.DataArray(
        np.zeros((len(MUSCLES), len(CHANNELS))),
        dims=("muscle", "channel"),
        coords={"muscle": list(MUSCLES), "channel": list(CHANNELS)},
        attrs={"units": "1", "oom": oom},
    )
    for side in SIDES:
        for muscle in MODELLED:
            printed = muscle == "OOM" and oom == "as_printed"
            for measured, weight in (
                OOM_AS_PRINTED if printed else MAPPING_WEIGHTS[muscle]
            ).items():
                matrix.loc[f"{muscle}_{side}", f"{measured}_{side}"] = weight
    return matrix


def sources_of(muscle: str) -> tuple[str, ...]:
    """Return the channels, of the same side, from which a muscle of the model is computed.

    Examples
    --------
    >>> sources_of("BUC_L")
    ('RIS_L', 'ZYG_L')
    """
    name, _, side = muscle.rpartition("_")
    return tuple(f"{measured}_{side}" for measured in MAPPING_WEIGHTS[name])


def map_channels(
    quantity: xr.DataArray,
    oom: Literal["text", "as_printed"] = "text",
    muscles: Sequence[str] = MUSCLES,
) -> xr.DataArray:
    """Combine channels into muscles (Eqs 2-6).

    `quantity` (channel, time) contains signals, features or activations; channels from which no
    muscle is computed are ignored, and a missing channel counts as zero if another one of the same
    muscle exists. The result (muscle, time) keeps the attributes and adds ``oom``, the reading of
    Eq. 3 (`mapping_matrix`). Raises SchemaError if no channel of a muscle exists.
    """
    recorded = [str(name) for name in quantity["channel"].values]
    lacking = [name for name in muscles if not set(sources_of(name)) & set(recorded)]
    if lacking:
        raise SchemaError(
            f"no channel of the muscle{'s' if len(lacking) > 1 else ''} {', '.join(lacking)} (found "
            f"{', '.join(recorded) or 'none'}), expected {', '.join(sources_of(lacking[0]))} for "
            f"{lacking[0]}: rename the channels or record them"
        )
    channels = [name for name in CHANNELS if name in recorded]
    matrix = mapping_matrix(oom).sel(muscle=list(muscles), channel=channels)
    mapped = xr.dot(matrix, quantity.sel(channel=channels), dim="channel")
    (time,) = (dim for dim in mapped.dims if dim != "muscle")
    mapped = mapped.transpose("muscle", time).rename(quantity.name)
    mapped.attrs = {**quantity.attrs, "oom": oom}
    mapped[time].attrs = dict(quantity[time].attrs)
    return mapped
