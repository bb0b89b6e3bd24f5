"""Published statements about the seven experiments, each tested against a table with its errors."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from emgface.anatomy.head.sweep import MESH_ERROR, STEP_ERROR
from studies.coupled.experiments import OPENERS

CLOSED: Final = 0.5  #: opening in the midline below which the lips are closed [mm]
VERDICTS: Final = {True: "reproduced", False: "not reproduced", None: "undecided within the error"}


@dataclass(frozen=True)
class Value:
    """Outcome of a run with the sum of its errors."""

    size: float
    error: float

    def __str__(self) -> str:
        return f"{self.size:.2f} ± {self.error:.2f}"

    def above(self, other: "Value") -> bool | None:
        """Compare two values; None if they differ by less than their errors."""
        difference = self.size - other.size
        decided = abs(difference) > self.error + other.error  # False if one is not a number
        return difference > 0.0 if decided else None

    def __sub__(self, other: "Value") -> "Value":
        return Value(self.size - other.size, self.error + other.error)

    def __abs__(self) -> "Value":
        return Value(abs(self.size), self.error)


@dataclass(frozen=True)
class Finding:
    """Published statement, the computed values, and whether it holds."""

    statement: str
    computed: str
    holds: bool | None


class Results:
    """Table of a sweep, read by the name of a run and an outcome."""

    def __init__(self, table: pd.DataFrame) -> None:
        self.rows: dict[str, dict[Any, Any]] = {
            str(row["name"]): row for row in table.to_dict("records")
        }

    def __call__(self, name: str, outcome: str) -> Value:
        """Value and error of an outcome.

        Those of runs that failed or are absent are not a number and never decide.
        """
        row = self.rows.get(name, {})
        error = sum(
            float(row[outcome + ending])
            for ending in (STEP_ERROR, MESH_ERROR)
            if not pd.isna(row.get(outcome + ending))
        )
        return Value(float(row.get(outcome, np.nan)), error)


def every(*holds: bool | None) -> bool | None:
    """True if all hold, False if one does not, otherwise undecided."""
    if any(one is False for one in holds):
        return False
    return None if any(one is None for one in holds) else True


def _stiffening(at: Results) -> Iterator[Finding]:
    plain, stiff = (at(f"factor {f}, OOP 1", "protrusion_mm") for f in (1, 10))
    yield Finding(
        "Stiffening enables protrusion",
        f"protrusion {plain} mm without, {stiff} mm with a factor of 10, at full activation",
        stiff.above(plain),
    )
    plain, stiff = (at(f"factor {f}, OOP 1", "area_mm2") for f in (1, 10))
    yield Finding(
        "With stiffening the lips are rounded around an opening, without it they are not",
        f"area {plain} mm² without, {stiff} mm² with a factor of 10",
        stiff.above(plain),
    )
    steps = [
        abs(at(f"factor {f}, OOP 1", "protrusion_mm") - at(f"factor {f}, OOP 0.5", "protrusion_mm"))
        for f in (1, 10)
    ]
    yield Finding(
        "The gesture saturates with activation if the lips are stiff enough",
        f"change of protrusion from half to full activation {steps[0]} mm without, {steps[1]} mm with",
        steps[0].above(steps[1]),
    )
    low, high = (
        abs(at(f"factor {b}, OOP 1", "protrusion_mm") - at(f"factor {a}, OOP 1", "protrusion_mm"))
        for a, b in ((1, 3), (10, 20))
    )
    yield Finding(
        "It saturates with stiffness if the activation is high enough",
        f"change of protrusion {low} mm with 3 times the factor 1, {high} mm with 2 times the factor 10",
        low.above(high),
    )


def _shape(at: Results) -> Iterator[Finding]:
    layers = ("deep", "middle", "superficial")
    pairs = {
        k: [at(f"{r} {k}", "protrusion_mm") for r in ("marginal", "peripheral")] for k in layers
    }
    yield Finding(
        "A more peripheral ring protrudes the lips more, at any depth",
        "; ".join(f"{k} {a} to {b} mm" for k, (a, b) in pairs.items()),
        every(*(b.above(a) for a, b in pairs.values())),
    )
    deep = {
        name: [at(f"{r} deep", name) for r in ("marginal", "peripheral")]
        for name in ("width_mm", "opening_mm", "area_mm2")
    }
    yield Finding(
        "Deep: width, height and area are larger with a peripheral ring",
        "; ".join(f"{name.split('_')[0]} {a} to {b}" for name, (a, b) in deep.items()),
        every(*(b.above(a) for a, b in deep.values())),
    )
    a, b = (at(f"{r} superficial", "area_mm2") for r in ("marginal", "peripheral"))
    c, d = (at(f"{r} superficial", "width_mm") for r in ("marginal", "peripheral"))
    yield Finding(
        "Superficial: the area grows with the width of the mouth",
        f"area {a} to {b} mm², width {c} to {d} mm",
        every(b.above(a), d.above(c)),
    )
    near, far = (at(f"peripheral {k}", "protrusion_mm") for k in ("superficial", "deep"))
    yield Finding(
        "A superficial ring protrudes poorly",
        f"peripheral ring: superficial {near} mm, deep {far} mm",
        far.above(near),
    )
    near, far = (at(f"peripheral {k}", "opening_mm") for k in ("superficial", "deep"))
    yield Finding(
        "A superficial ring closes the lips",
        f"opening with the peripheral ring: superficial {near} mm, deep {far} mm",
        far.above(near),
    )


def _teeth(at: Results) -> Iterator[Finding]:
    for outcome, words in (
        ("protrusion_mm", "Without teeth the lips protrude less"),
        ("opening_mm", "Without teeth the rounding is disturbed (smaller opening)"),
    ):
        pairs = {
            f"factor {f}": [at(f"factor {f}, OOP 1, {t}", outcome) for t in ("no teeth", "teeth")]
            for f in (1, 10)
        }
        yield Finding(
            words,
            "; ".join(f"{name}: {a} mm without, {b} mm with" for name, (a, b) in pairs.items()),
            every(*(b.above(a) for a, b in pairs.values())),
        )


def _closes_until(at: Results, name: str) -> Value:
    """Lowering of the incisor at which the lips open by `CLOSED`, by linear interpolation [mm]."""
    down = [-at(f"{name}, openers {level:g}", "lower_incisor_up_mm").size for level in OPENERS]
    gaps = [at(f"{name}, openers {level:g}", "opening_mm") for level in OPENERS]
    wide = np.array([gap.size for gap in gaps])
    if wide[0] > CLOSED:
        return Value(0.0, 0.0)
    k = max(1, int(np.argmax(wide > CLOSED)))
    slope = (down[k] - down[k - 1]) / (wide[k] - wide[k - 1])
    return Value(down[k - 1] + (CLOSED - wide[k - 1]) * slope, gaps[k].error * slope)


def _closing(at: Results) -> Iterator[Finding]:
    lowest = {name: _closes_until(at, name) for name in ("superficial", "deep", "marginal")}
    yield Finding(
        "The superficial layer is the best at closing the lips with a low jaw",
        "closed until the incisor is lowered by: "
        + ", ".join(f"{name} {down} mm" for name, down in lowest.items()),
        every(*(lowest["superficial"].above(lowest[name]) for name in ("deep", "marginal"))),
    )
    last = OPENERS[-1]
    alone, both = (
        at(f"{name}, openers {last:g}", "opening_mm")
        for name in ("superficial", "superficial and marginal")
    )
    yield Finding(
        "With the marginal ring in addition they close at a very low jaw",
        f"opening at the lowest jaw {alone} mm alone, {both} mm with it",
        alone.above(both),
    )
    changes = {
        part: at(f"superficial, openers {last:g}", f"{part}_up_mm")
        - at(f"none, openers {last:g}", f"{part}_up_mm")
        for part in ("upper", "lower", "lower_incisor")
    }
    zero = Value(0.0, 0.0)
    yield Finding(
        "The upper lip moves down and the lower lip up",
        f"by the superficial layer at the lowest jaw: upper {changes['upper']} mm, lower "
        f"{changes['lower']} mm",
        every(zero.above(changes["upper"]), changes["lower"].above(zero)),
    )
    yield Finding(
        "Orbicularis oris raises the jaw slightly",
        f"incisor {changes['lower_incisor']} mm up",
        changes["lower_incisor"].above(zero),
    )


def _expressions(at: Results) -> Iterator[Finding]:
    names = dict.fromkeys(str(name).rpartition(",")[0] for name in at.rows)
    pairs = {n: [at(f"{n}, skin x 1", f"{k}_mm") for k in ("corners", "other")] for n in names}
    yield Finding(
        "The corner of the mouth moves most",
        "; ".join(f"{n}: corner {a} mm, others up to {b} mm" for n, (a, b) in pairs.items()),
        every(*(a.above(b) for a, b in pairs.values())),
    )
    skins = {n: [at(f"{n}, skin x {k}", "all_mm") for k in (1, 4)] for n in names}
    yield Finding(
        "A stiffer skin moves less",
        "; ".join(f"{n}: {a} to {b} mm" for n, (a, b) in skins.items()),
        every(*(a.above(b) for a, b in skins.values())),
    )


def _coupling(at: Results) -> Iterator[Finding]:
    zero = Value(0.0, 0.0)
    jaw = {
        name: abs(at(name, "lower_incisor_forward_mm") - at("rest", "lower_incisor_forward_mm"))
        for name in ("GGP 0.5", "HG 0.5", "STY 0.5", "GH and MH 0.5")
    }
    yield Finding(
        "Muscles of the tongue move the jaw",
        "incisor relative to rest, forward or backward: "
        + "; ".join(f"{name} {value} mm" for name, value in jaw.items()),
        every(*(value.above(zero) for value in jaw.values())),
    )
    back = at("openers 0.2", "back_forward_mm") - at("rest", "back_forward_mm")
    yield Finding(
        "Muscles of the jaw move the tongue",
        f"openers move the back of the tongue forward by {back} mm relative to rest",
        abs(back).above(zero),
    )


def labial_findings(at: Results, own: str, levels: str) -> Iterator[Finding]:
    """Statements about the three labials, whose runs begin with `own`."""
    rest, closure = at("rest", "area_mm2"), at(f"{own}closure", "area_mm2")
    yield Finding(f"Closure: area 0 ({levels})", f"{closure} mm²", Value(1.0, 0.0).above(closure))
    lip, open_ = (at(f"{own}fricative", name) for name in ("lower_to_teeth_mm", "area_mm2"))
    yield Finding(
        f"Fricative: a slit, lower lip within 1 mm of the upper incisors ({levels})",
        f"{lip} mm, {open_} of {rest} mm²",
        every(Value(1.0, 0.0).above(lip), open_.above(Value(1.0, 0.0)), rest.above(open_)),
    )
    small = at(f"{own}approximant", "area_mm2")
    ratio = small.size / rest.size
    yield Finding(
        f"Approximant: a small opening, 0.40 of that at rest (15.9 of 40.1 mm²; {levels})",
        f"{small} of {rest} mm², {ratio:.2f}",
        every(rest.above(small), 0.28 < ratio < 0.52),
    )


def _labials(at: Results) -> Iterator[Finding]:
    yield from labial_findings(at, "", "published levels")
    yield from labial_findings(at, "own ", "own levels")


FINDINGS: Final[Mapping[str, Callable[[Results], Iterator[Finding]]]] = {
    "stiffening": _stiffening,
    "shape": _shape,
    "teeth": _teeth,
    "closing": _closing,
    "expressions": _expressions,
    "coupling": _coupling,
    "labials": _labials,
}


def findings(name: str, table: pd.DataFrame) -> list[Finding]:
    """Test the published statements of an experiment with the table of its sweep."""
    return list(FINDINGS[name](Results(table)))
