"""Units of input data: known spellings, and their conversion to SI.

All arrays of the package are in SI; only readers of foreign files convert.
"""

import difflib
import re

import xarray as xr

from emgface.errors import UnitsError

# Divisors instead of factors: 1000 is exact in binary, 0.001 is not, so that a value in millimetres
# divided by 1000 is the double closest to the value in metres.
DIVISORS: dict[str, dict[str, float]] = {
    "V": {"V": 1.0, "mV": 1e3, "uV": 1e6, "nV": 1e9},
    "m": {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6},
    "s": {"s": 1.0, "ms": 1e3, "us": 1e6},
}
"""Convertible units of each SI unit, with the divisor."""

QUANTITIES = {"voltage": "V", "length": "m", "time": "s"}
"""Quantities of input data, and their SI units."""

_WORDS = {
    "metre": "m", "metres": "m", "meter": "m", "meters": "m",
    "millimetre": "mm", "millimetres": "mm", "millimeter": "mm", "millimeters": "mm",
    "centimetre": "cm", "centimetres": "cm", "centimeter": "cm", "centimeters": "cm",
    "second": "s", "seconds": "s", "sec": "s", "millisecond": "ms", "milliseconds": "ms",
}  # fmt: skip
_VOLTS = re.compile(
    r"(n|u|m|(?i:nano|micro|milli))?[ -]?(?i:volts?)|((?i:micro))[ -]?(?i:v(?:ol?)?)"
)
"""Words for volts, the last one as abbreviated in the 8 characters of a field of EDF."""
# The micro sign, the Greek letter mu, and micro signs whose bytes were read as another code page.
_MICRO = ("\u00b5", "\u03bc", "\u00c2\u00b5", "\u00ce\u00bc", "\u00e6")


def spelling(unit: str) -> str:
    """Return the package's spelling of a unit; an unknown one is only stripped.

    Examples
    --------
    >>> spelling(" Millimeters ")
    'mm'
    >>> spelling("µV")
    'uV'
    """
    unit = unit.strip()
    for sign in sorted(_MICRO, key=len, reverse=True):
        if unit.startswith(sign):
            unit = "u" + unit[len(sign) :]
    plain = unit.lower()
    if plain in _WORDS:
        return _WORDS[plain]
    if volts := _VOLTS.fullmatch(unit):
        prefix = (volts[1] or volts[2] or "").lower()
        return f"{'u' if prefix == 'micro' else prefix[:1]}V"
    # Case distinguishes prefixes (mV, MV); only unambiguous spellings ignore it.
    return {"MM": "mm", "CM": "cm", "uv": "uV", "UV": "uV", "mv": "mV", "v": "V"}.get(unit, unit)


def quantity_of(unit: str) -> str | None:
    """Return ``voltage``, ``length`` or ``time`` for a unit in any spelling, None for others."""
    known = spelling(unit)
    for quantity, si in QUANTITIES.items():
        if known in DIVISORS[si]:
            return quantity
    return None


def to_si(array: xr.DataArray, quantity: str) -> xr.DataArray:
    """Convert an array from the unit in its attributes to SI (V, m or s), as float64.

    Coordinates and other attributes are kept. Raises UnitsError if the unit is absent, unknown, or
    of another quantity.

    Examples
    --------
    >>> to_si(xr.DataArray([25.0], dims="sample", attrs={"units": "mm"}), "length").item()
    0.025
    """
    if quantity not in QUANTITIES:
        near = difflib.get_close_matches(quantity, QUANTITIES, n=1, cutoff=0.0)[0]
        raise UnitsError(
            f"Unknown quantity {quantity!r}; expected one of {', '.join(QUANTITIES)}, "
            f"nearest is {near!r}."
        )
    si = QUANTITIES[quantity]
    accepted = DIVISORS[si]
    label = array.name or quantity
    unit = array.attrs.get("units")
    if not isinstance(unit, str) or not unit.strip():
        raise UnitsError(
            f"{label} has no unit; expected {' or '.join(accepted)}: specify the unit in the "
            "source or in its sidecar."
        )
    divisor = accepted.get(spelling(unit))
    if divisor is None:
        raise UnitsError(
            f"{label} is in {unit!r}, which is not a unit of {quantity}; expected "
            f"{' or '.join(accepted)}: specify the unit that the values are in."
        )
    values = array.astype("float64")
    converted = values if divisor == 1.0 else values / divisor
    return converted.assign_attrs({**array.attrs, "units": si})
