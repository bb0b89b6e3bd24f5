"""Verdicts on the checks of the published jaw: in how many variants a required value is reached.

The requirements are the texts of `benchmarks.jaw_published.WANTED`.
"""

import re
from collections.abc import Mapping

NOTHING = ("", "reported only", "not published")
PULL = {"planar, hyoid fixed": 2.0, "curved, hyoid free": 1.0}
"""Largest errors of check 3 [mm], by variant."""
OF_CHECK = {
    "1": "code",
    "2": "code",
    "3": "free",
    "4": "free",
    "5": "free",
    "6": "free",
    "7": "free",
}
"""Basis of the checks with the stated parameters, as defined on docs/evidence.md."""


def basis_of(check: str, required: str) -> str:
    """Basis of a row: "code" for properties of the computation, "computed" without a requirement."""
    if required in NOTHING:
        return "computed"
    return "code" if "mirrored" in check else OF_CHECK[check.partition(" ")[0]]


def met_of(required: str, values: Mapping[str, str]) -> str:
    """In how many of the variants with a value the requirement is met, as "2 of 5"; "-" without one.

    A single number is a bound if it is written as a power of ten, and otherwise a value that is reached
    if the computed one rounds to it.
    """
    if required in NOTHING:
        return "-"
    given = {name: text for name, text in values.items() if text}
    if required.startswith("2 planar"):
        given = {name: text for name, text in given.items() if name in PULL}
        verdicts = [abs(float(text)) <= PULL[name] for name, text in given.items()]
    else:
        verdicts = [_reached(required, text) for text in given.values()]
    return f"{sum(verdicts)} of {len(verdicts)}"


def _reached(required: str, text: str) -> bool:
    if required in ("yes", "closed"):
        return text == "yes" if required == "yes" else float(text) == 0.0
    try:
        values = [float(one) for one in text.split(",")]
    except ValueError:  # "none", or the name of the error of a task that did not finish
        return False
    if match := re.search(r"([\d.]+) to ([\d.]+)$", required):
        low, high = map(float, match.groups())
        return any(low <= value <= high for value in values)
    if match := re.fullmatch(r"([\d.]+) \+- ([\d.]+)( %)?", required):
        middle, reach = float(match[1]), float(match[2])
        reach *= 0.01 * middle if match[3] else 1.0
        return all(abs(value - middle) <= reach for value in values)
    if re.fullmatch(r"1e-\d+", required):
        return all(abs(value) <= float(required) for value in values)
    return all(round(value) == int(required) for value in values)
