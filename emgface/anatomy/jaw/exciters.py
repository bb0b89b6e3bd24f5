"""Exciters: groups of muscles that one excitation drives, for each side and both."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.model import Floats
from emgface.errors import JawError
from emgface.schema.rules import hint

Groups = Mapping[str, Sequence[str]]
"""Muscles or other groups by the name of a group, without sides."""
#: largest excitation [1]: cubic series through values up to 1 exceed them slightly
LARGEST_EXCITATION = 1.1


def exciters_of(muscles: Iterable[str], groups: Groups) -> dict[str, dict[str, float]]:
    """Muscles and gains by exciter: every muscle, group of a side, and group of both sides (``bi_``).

    `muscles` are names with sides ``_L`` and ``_R``. Members of `groups` that are not muscles of
    the model are omitted, and a group that contains a muscle of its own name replaces the exciter
    of that muscle. Raises JawError if a group contains itself.
    """
    names = list(muscles)

    plain = list(dict.fromkeys(name[:-2] for name in names if name[-2:] in ("_L", "_R")))

    def members(name: str, within: tuple[str, ...] = ()) -> list[str]:
        if name in within:
            if name in plain:
                return [name]
            raise JawError(f"group {name!r} contains itself ({' -> '.join((*within, name))})")
        if name not in groups:
            return [name]
        return [m for part in groups[name] for m in members(part, (*within, name))]

    gains: dict[str, dict[str, float]] = {name: {name: 1.0} for name in names}
    for group in [*groups, *plain]:
        both = dict[str, float]()
        for side in ("_L", "_R"):
            driven = {m + side: 1.0 for m in members(group) if m + side in names}
            if driven:
                gains[group + side] = driven
            both |= driven
        if both:
            gains[f"bi_{group}"] = both
    return gains


def excited_activation(jaw: xr.Dataset, excitation: Mapping[str, Floats]) -> tuple[Floats, float]:
    """Activation (n, muscles) that excitations [1] of exciters over the same times add up to.

    a_m = min(1, sum_e gain_em max(0, u_e)); also returns the most negative excitation that was set
    to zero, or 0. Raises JawError if an exciter does not exist, or an excitation is not finite or
    exceeds `LARGEST_EXCITATION`.
    """
    known = jaw["exciter"].values.tolist()
    total: Floats | float = 0.0
    negative = 0.0
    for name, values in excitation.items():
        if name not in known:
            raise JawError(
                f"no exciter is called {name!r}{hint(name, known)}, expected one of {', '.join(known)}"
            )
        u = np.asarray(values, dtype=np.float64)
        if not np.isfinite(u).all():
            raise JawError(f"excitation of {name} is not finite: interpolate its gaps first")
        if u.max(initial=0.0) > LARGEST_EXCITATION:
            raise JawError(
                f"excitation of {name} rises to {u.max():.3g}, expected a fraction of the maximum, 0 to "
                "1: divide percentages by 100, or normalise the series"
            )
        negative = min(negative, float(u.min(initial=0.0)))
        gain = jaw["exciter_gain"].values[known.index(name)]
        total = total + np.maximum(u, 0.0)[:, None] * gain
    return np.minimum(np.asarray(total), 1.0), negative
