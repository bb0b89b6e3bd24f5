"""Options of an alignment, and the resulting shift and scale."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal, cast

import numpy as np

from analysis.arguments import number, yes_or_no
from analysis.errors import AlignmentError
from analysis.lag import LEAST_MOTION, Array, Match, Search

Scaling = Literal["length", "search", "none"]
Sign = Literal["direction", "correlation"]

CLEAR_COSINE: Final = 0.75
"""Absolute cosine of two components above which their direction determines the sign.

The 95 % quantile of |cos| between two random directions in six dimensions, where its density is (1
- c^2)^(3/2). The thirty coordinates of ten markers on one mouth are not independent: the components
of different instructions of simulated volunteers (except D and F, which share a smile) have cosines
up to 0.68 (simulated; three volunteers on the coarse face).
"""


@dataclass(frozen=True)
class Options:
    """Options of `analysis.align.align`, which describes them.

    Raises AlignmentError if an option lies outside its range.
    """

    scaling: Scaling
    scale_range: tuple[float, float]
    scale_step: float
    max_shift: float | None
    least_overlap: float
    least_gain: float
    cutoff: float | None
    sign: Sign
    clear_cosine: float
    centred: bool
    subsample: bool

    def __post_init__(self) -> None:
        """Raise for an option of another type or outside its range."""
        for name in ("centred", "subsample"):
            yes_or_no(name, getattr(self, name), error=AlignmentError)
        numbers = (
            "scale_step",
            "max_shift",
            "least_overlap",
            "least_gain",
            "cutoff",
            "clear_cosine",
        )
        for name in numbers:
            if getattr(self, name) is not None or name not in ("max_shift", "cutoff"):
                number(name, getattr(self, name), error=AlignmentError)
        if not isinstance(cast("object", self.scale_range), Sequence) or len(self.scale_range) != 2:
            raise AlignmentError(
                f"scale_range is {self.scale_range!r}, expected the least and greatest scale"
            )
        for bound in self.scale_range:
            number("scale_range", bound, error=AlignmentError)
        if self.scaling not in ("length", "search", "none"):
            raise AlignmentError(
                f"scaling is {self.scaling!r}, expected 'length', 'search' or 'none'"
            )
        if self.sign not in ("direction", "correlation"):
            raise AlignmentError(f"sign is {self.sign!r}, expected 'direction' or 'correlation'")
        if not 0 < self.scale_range[0] <= 1 <= self.scale_range[1]:
            raise AlignmentError(
                f"scale_range is {self.scale_range}, expected 0 < least <= 1 <= greatest"
            )
        if not 0 < self.scale_step < 0.5:
            raise AlignmentError(
                f"scale_step is {self.scale_step}, expected a value between 0 and 0.5"
            )
        if self.max_shift is not None and not self.max_shift >= 0:
            raise AlignmentError(f"max_shift is {self.max_shift} s, expected 0 or more")
        if not 0 < self.least_overlap <= 1:
            raise AlignmentError(
                f"least_overlap is {self.least_overlap}, expected above 0 and at most 1"
            )
        if self.cutoff is not None and not self.cutoff > 0:
            raise AlignmentError(f"cutoff is {self.cutoff} Hz, expected above 0 or None")
        if not 0 <= self.least_gain < 1:
            raise AlignmentError(f"least_gain is {self.least_gain}, expected from 0 to below 1")
        if not 0 <= self.clear_cosine <= 1:
            raise AlignmentError(f"clear_cosine is {self.clear_cosine}, expected from 0 to 1")

    def recorded(self) -> dict[str, Any]:
        """Return the options as attributes of a result."""
        values = asdict(self)
        values["scale_range"] = list(self.scale_range)
        values["sign_by"] = values.pop("sign")
        values["centred"], values["subsample"] = int(self.centred), int(self.subsample)
        if self.max_shift is None:
            values["max_shift"] = "bounded by least_overlap"
        if self.cutoff is None:
            values["cutoff"] = "none"
        return values


@dataclass(frozen=True)
class ComponentPair:
    """Two coefficient vectors with their instants [s].

    A shift is counted from `start`, the first instant of the measured trial, which precedes the
    first sample with all markers visible. `nominal` is the scale given by the two durations.
    """

    measured: tuple[Array, Array]
    simulated: tuple[Array, Array]
    start: float
    nominal: float


def _search(pair: ComponentPair, options: Options, sign: int | None) -> Search:
    """Agreement of the vectors for one sign of the measured one, or for the better of both."""
    return Search(
        pair.measured,
        pair.simulated,
        nominal=pair.nominal,
        sign=sign,
        cutoff=options.cutoff,
        max_shift=options.max_shift,
        least_overlap=options.least_overlap,
        least_gain=options.least_gain,
        offset=float(pair.measured[0][0]) - pair.start,
    )


def best_match(pair: ComponentPair, options: Options, *, sign: int | None) -> Match:
    """Find shift and scale, for one sign of the measured vector or for the better of both.

    Raises AlignmentError if no shift leaves enough overlap.
    """
    search, nominal = _search(pair, options, sign), pair.nominal
    best = search.at_scale(nominal, subsample=options.subsample)
    if options.scaling == "search":
        least, most = (nominal * factor for factor in options.scale_range)
        top = search.over_scales(
            nominal, least, most, options.scale_step, subsample=options.subsample
        )
        if best is None or (
            top is not None and top.unexplained < (1.0 - options.least_gain) * best.unexplained
        ):
            best = top
    if best is None:
        raise AlignmentError(
            f"no shift leaves an overlap of {options.least_overlap:.0%} of the time and "
            f"{LEAST_MOTION:.0%} of the motion (measured {np.ptp(pair.measured[0]):.3g} s, "
            f"simulated {np.ptp(pair.simulated[0]):.3g} s): widen max_shift, lower least_overlap, or "
            "use scaling='length'"
        )
    return best


def signed_match(
    pair: ComponentPair, cosine: float, options: Options
) -> tuple[int, Match, bool, bool]:
    """Determine the sign of the measured vector and its match.

    `cosine` is that between the two components, of arbitrary sign [1]. Returns the sign, 1 or -1;
    shift and scale for it; if the direction of the components is clear; and if it indicates another
    sign than the correlation at the scale of the match. Raises AlignmentError if no shift leaves
    enough overlap.
    """
    by_direction = 1 if cosine >= 0 else -1
    clear = abs(cosine) >= options.clear_cosine
    if options.sign == "direction" and clear:
        best = best_match(pair, options, sign=by_direction)
        either = _search(pair, options, None).at_scale(best.scale, subsample=False)
        disagrees = either is not None and either.r * by_direction < 0
        return by_direction, best, clear, disagrees
    best = best_match(pair, options, sign=None)
    sign = 1 if best.r >= 0 else -1
    return sign, best, clear, sign != by_direction


def scale_at_bound(scale: float, nominal: float, options: Options) -> bool:
    """Test if a scale is outside `scale_range`, or a searched one at its end."""
    least, most = options.scale_range
    if not least * (1 - 1e-9) <= scale <= most * (1 + 1e-9):
        return True
    if options.scaling != "search":
        return False
    factor = scale / nominal
    end = 0.5 * options.scale_step
    return bool(abs(np.log(factor / least)) < end or abs(np.log(factor / most)) < end)
