"""Outcomes of a treatment that clinicians measure, from a face at rest and its motions."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from analysis.scores import amplitude_ratio, correlation_3d
from emgface.acoustics.matrix import formants
from emgface.face.lip_shape import lip_rim
from emgface.face.surface import face_areas
from emgface.muscles import LIP_MARKERS
from emgface.treatment.jobs import AT_LEAST, PRESSURE
from emgface.treatment.motions import ComparedMotions

Floats = NDArray[np.float64]


CLOSED_AREA: Final = 1e-6  #: area of an opening that counts as closed [m^2]
TRACT: Final = (0.16, 3e-4)  #: length [m] and area [m^2] of a uniform tract behind the lips
TRACT_LIP_LENGTH: Final = 0.01  #: length of the lips along the tract [m]


@dataclass(frozen=True)
class Outcome:
    """One number of a face: its name, unit, the movement it requires ("" is rest), and its value."""

    name: str
    unit: str
    movement: str
    value: Callable[[xr.Dataset, xr.Dataset | None], float]
    #: sentence of the plain page, with {} for the value and its unit
    plain: str = ""
    #: whether the value in a motion is a lower bound
    at_least: Callable[[xr.Dataset], bool] = lambda motion: False
    #: whether the value answers a question, 1 for yes and 0 for no
    answer: bool = False


def _marker(motion: xr.Dataset, name: str) -> Floats:
    return motion["position"].sel(marker=name).transpose("time", "axis").values


def _moved(motion: xr.Dataset, name: str) -> float:
    """Largest displacement of a marker [m]."""
    path = _marker(motion, name)
    return float(np.linalg.norm(path - path[0], axis=1).max())


def _mouth_width(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    node = face["marker_node"].values
    x = face["position"].values[node]
    left, right = (LIP_MARKERS.index(name) for name in ("corner_left", "corner_right"))
    return float(np.linalg.norm(x[left] - x[right]))


def _margin(lip: str) -> Callable[[xr.Dataset, xr.Dataset | None], float]:
    def length(face: xr.Dataset, motion: xr.Dataset | None) -> float:
        x = face["position"].values[getattr(lip_rim(face), lip)]
        return float(np.linalg.norm(np.diff(x, axis=0), axis=1).sum())

    return length


def _height(lip: str) -> Callable[[xr.Dataset, xr.Dataset | None], float]:
    """Mean height of the vermilion: its area over the length of its margin [m]."""
    length = _margin(lip)

    def height(face: xr.Dataset, motion: xr.Dataset | None) -> float:
        from emgface.face.parts import facets_of, surface_names

        name = f"{lip}_lip_vermilion"
        if name not in surface_names(face):
            return float("nan")
        area = face_areas(face["position"].values, facets_of(face, name)).sum()
        return float(area / length(face, motion))

    return height


def _skin_asymmetry(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Mean distance of the lip markers from the mirror images of their partners [m]."""
    nodes = face["marker_node"].values
    x = dict(zip(map(str, LIP_MARKERS), face["position"].values[nodes], strict=True))
    pairs = [(n, n.replace("left", "right")) for n in LIP_MARKERS if n.endswith("left")]
    mirror = np.array([-1.0, 1.0, 1.0])
    return float(np.mean([np.linalg.norm(x[a] * mirror - x[b]) for a, b in pairs]))


def _opened(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    assert motion is not None
    return float(motion["lip_opening"].max())


def _residual_area(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Smallest area of the opening between the lips [m^2]."""
    assert motion is not None
    return float(motion["mouth_area"].min()) if "mouth_area" in motion else float("nan")


def _protrusion(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Forward displacement of the lips when the mouth is narrowest, negative backwards [m]."""
    assert motion is not None
    if "lip_protrusion" not in motion:
        return float("nan")
    path = motion["lip_protrusion"].values
    return float(path[np.argmin(_width(motion))] - path[0])


def _width(motion: xr.Dataset) -> Floats:
    """Distance (time,) of the corner markers [m]."""
    apart = _marker(motion, "corner_left") - _marker(motion, "corner_right")
    return np.linalg.norm(apart, axis=1)


def _narrowing(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    assert motion is not None
    width = _width(motion)
    return float(width[0] - width.min())


def _pursed(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Mean over the lip markers of their largest displacement [m]."""
    assert motion is not None
    return float(np.mean([_moved(motion, str(name)) for name in LIP_MARKERS]))


def _smile(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    assert motion is not None
    return 0.5 * (_moved(motion, "corner_left") + _moved(motion, "corner_right"))


def smile_asymmetry(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Excursion of the right corner minus that of the left, over their sum [1]."""
    assert motion is not None
    left, right = _moved(motion, "corner_left"), _moved(motion, "corner_right")
    return (right - left) / max(right + left, 1e-9)


def _lips_close(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """1 if the opening between the lips vanishes, as /p b m/ require, otherwise 0."""
    area = _residual_area(face, motion)
    return float(area <= CLOSED_AREA) if np.isfinite(area) else float("nan")


def _pressure(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    """Pressure in the mouth that the closed lips hold [Pa] (`emgface.treatment.pressure`)."""
    assert motion is not None
    return float(motion.attrs.get(PRESSURE, np.nan))


def _pressure_at_least(motion: xr.Dataset) -> bool:
    return bool(motion.attrs.get(AT_LEAST, 0))


def formant_of_lips(area: float) -> float:
    """First formant [Hz] of a uniform tract that ends in lips with an opening of an area [m^2].

    The tract is a tube of `TRACT` (length, area) and the lips one of `TRACT_LIP_LENGTH` length, so
    that the number shows what the lips alone change; the closed tract of an area below
    `CLOSED_AREA` has none (NaN).
    """
    if not np.isfinite(area) or area <= CLOSED_AREA:
        return float("nan")
    length, wide = TRACT
    cells = np.append(np.full(round(length / TRACT_LIP_LENGTH), wide), area)
    return float(formants(cells, len(cells) * TRACT_LIP_LENGTH, highest=3000.0)[0][0])


def _formant(face: xr.Dataset, motion: xr.Dataset | None) -> float:
    return formant_of_lips(_residual_area(face, motion))


OUTCOMES: Final = (
    Outcome("mouth width", "mm", "", _mouth_width, "the width of the mouth is {}"),
    Outcome("length of the upper lip margin", "mm", "", _margin("upper")),
    Outcome("length of the lower lip margin", "mm", "", _margin("lower")),
    Outcome(
        "upper vermilion height", "mm", "", _height("upper"),
        "the height of the red of the upper lip is {}",
    ),
    Outcome(
        "lower vermilion height", "mm", "", _height("lower"),
        "the height of the red of the lower lip is {}",
    ),
    Outcome("asymmetry of the lips at rest", "mm", "", _skin_asymmetry),
    Outcome("lip opening", "mm", "opening", _opened, "the lips open by {}"),
    Outcome(
        "residual gap when closing", "mm2", "closing", _residual_area,
        "the gap that is left between lips pressed together, as for p, b and m, is {}",
    ),
    Outcome("pursing, amplitude", "mm", "A", _pursed),
    Outcome("pursing, protrusion", "mm", "A", _protrusion, "pursed lips come forward by {}"),
    Outcome(
        "pursing, narrowing", "mm", "A", _narrowing,
        "the corners of pursed lips come together by {}",
    ),
    Outcome("lips close for /p b m/", "1", "closing", _lips_close, answer=True),
    Outcome(
        "pressure held before the lips part", "Pa", "closing", _pressure,
        "the pressure in the mouth that closed lips hold is {}", _pressure_at_least,
    ),
    Outcome(
        "rounding, smallest opening", "mm2", "A", _residual_area,
        "the opening between pursed lips, as for “oo”, is {}",
    ),
    Outcome("rounding, first formant of a uniform tract", "Hz", "A", _formant),
    Outcome(
        "smile, excursion of the corners", "mm", "D", _smile,
        "the corners of the mouth move in a smile by {}",
    ),
    Outcome("smile, asymmetry", "1", "D", smile_asymmetry),
)  # fmt: skip
"""All outcomes; a new one is an entry."""

UNIT_FACTORS: Final = {"mm": 1e3, "mm2": 1e6, "1": 1.0, "Hz": 1.0, "Pa": 1.0}


def outcome_table(
    intact: xr.Dataset, treated: xr.Dataset, motions: ComparedMotions
) -> pd.DataFrame:
    """Table with ``outcome``, ``unit``, ``before``, ``after`` and ``change``; NaN where undefined.

    ``bound`` names the values that are lower bounds, "before", "after" or "both", and is otherwise
    empty. The change is then at most ("before") or at least ("after") that of the table, or unknown
    ("both").
    """
    rows: list[tuple[str, str, float, float]] = []
    bounds: list[str] = []
    for outcome in OUTCOMES:
        pair = [
            outcome.value(face, done.get(outcome.movement)) * UNIT_FACTORS[outcome.unit]
            if not outcome.movement or outcome.movement in done
            else float("nan")
            for face, done in ((intact, motions.intact), (treated, motions.treated))
        ]
        rows.append((outcome.name, outcome.unit, pair[0], pair[1]))
        least = [
            outcome.movement in done and outcome.at_least(done[outcome.movement])
            for done in (motions.intact, motions.treated)
        ]
        bounds.append(bound_of(*least))
    table = pd.DataFrame(rows, columns=["outcome", "unit", "before", "after"])
    table["bound"] = bounds
    table["change"] = (table["after"] - table["before"]).mask(table["bound"] == "both")
    table = table[["outcome", "unit", "before", "after", "change", "bound"]]
    numbers = ["before", "after", "change"]
    table[numbers] = table[numbers].mask(table[numbers].abs() < 5e-4, 0.0)  # without -0.00
    return table


def bound_of(before: bool, after: bool) -> str:
    """Name of the values that are lower bounds: "before", "after", "both", or none."""
    return "both" if before and after else "before" if before else "after" if after else ""


ANSWERS: Final = {1.0: "yes", 0.0: "no"}  #: words of the values of an answer
AT_LEAST_WORDS: Final = {
    "before": {"before": "at least ", "change": "at most "},
    "after": {"after": "at least ", "change": "at least "},
    "both": {"before": "at least ", "after": "at least "},
}
"""Words before a value, by the bounds of its row and the column."""


def with_words(outcomes: pd.DataFrame, digits: int = 2) -> pd.DataFrame:
    """Outcomes for readers: bounds and answers as words, without the column ``bound``."""
    shown = outcomes.drop(columns="bound").astype(object)
    answers = {outcome.name for outcome in OUTCOMES if outcome.answer}
    for row in [k for k, outcome in enumerate(outcomes["outcome"]) if outcome in answers]:
        for name in ("before", "after"):
            value = float(outcomes[name].iloc[row])
            shown.loc[shown.index[row], name] = ANSWERS.get(value, "")
        shown.loc[shown.index[row], ["unit", "change"]] = "", np.nan
    for row, bound in enumerate(outcomes["bound"]):
        for name, words in AT_LEAST_WORDS.get(bound, {}).items():
            value = float(outcomes[name].iloc[row])
            shown.loc[shown.index[row], name] = f"{words}{value:.{digits}f}"
    return shown


def movement_table(motions: ComparedMotions) -> pd.DataFrame:
    """Agreement of each movement after with before the treatment: amplitude ratio and rho.

    Both are medians over the lip markers; the displacements from the start of each face are compared.
    """
    rows: list[tuple[str, str, float, float]] = []
    for name, before in motions.intact.items():
        after = motions.treated[name]
        n = min(before.sizes["time"], after.sizes["time"])
        moved = [
            (m["position"] - m["position"].isel(time=0)).isel(time=slice(n)).drop_vars("time")
            for m in (before, after)
        ]
        ratio = float(np.nanmedian(amplitude_ratio(moved[0], moved[1]).values))
        rho = correlation_3d(moved[0], moved[1], smallest_motion=1e-6).values
        median = float(np.nanmedian(rho)) if np.isfinite(rho).any() else float("nan")
        rows.append((name, motions.words[name], ratio, median))
    return pd.DataFrame(rows, columns=["movement", "words", "amplitude ratio", "rho"])
