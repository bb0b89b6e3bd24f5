"""Outcome of the tasks of a jaw compared with the published one."""

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.run import JAW_STEP, run_task
from emgface.anatomy.jaw.skull import in_skull
from emgface.anatomy.jaw.tasks import JAW_TASKS, with_series

PUBLISHED_OUTCOMES = {
    "rest": "separation 3 to 5 mm",
    "close": "intercuspation",
    "open": "gape 38 mm (text), 35 mm (figure)",
    "open_head": "gape 50 mm (text), 51 mm (figure)",
    "gape": "larynx lowered by about 1 mm",
    "protrude": "self-limited, in the midline",
    "lateral": "-",
    "clench": "-",
    "effort": "-",
    "cycles": "-",
    "chew": "20.1 mm down, 5.8 back, 2.3 lateral there; 6.1 mm lateral in closing",
    "swallow": "larynx up and forward, and back",
    "pull": "stored result: 33.6 mm down, 16.3 back at 4.56 N",
}
"""Stavness et al. 2006, section 3.1; Hannam et al. 2008; stored result of the published program."""


@dataclass(frozen=True)
class Expected:
    """Range of one outcome of `outcome` [mm], in absolute value, from a publication."""

    column: str
    low: float
    high: float
    persons: bool = False  #: measured in persons, not computed by the published model
    #: whether parameters of the generated jaw were chosen for it (``docs/jaw.md``)
    tuned: bool = False


EXPECTED_OUTCOMES: Final[Mapping[str, tuple[Expected, ...]]] = {
    "rest": (Expected("end_down", 3.0, 5.0),),
    "open": (Expected("gape", 35.0, 38.0),),
    "open_head": (Expected("gape", 50.0, 51.0),),
    "gape": (Expected("interincisal", 40.0, 55.0, persons=True, tuned=True),),
    "protrude": (Expected("forward", 5.0, 10.0, persons=True, tuned=True),),
    "lateral": (Expected("lateral", 7.0, 12.0, persons=True),),
    "chew": (
        Expected("down", 18.1, 22.1),
        Expected("forward", 5.2, 6.4),
        Expected("lateral", 5.5, 6.7),
    ),
    "pull": (Expected("end_down", 32.6, 34.6), Expected("end_forward", 15.3, 17.3)),
}
"""Published ranges. Persons: Woelfel et al. 2014, Zawawi et al. 2003, Ferrario et al. 2005; the others
are `PUBLISHED_OUTCOMES`, those of chewing +- 10 % and of the pull +- 1 mm. The remaining tasks have no
number."""


def verdicts(task: str, values: Mapping[str, float], *, generated: bool) -> tuple[str, str]:
    """Verdict on the published numbers of a task, and the basis of the comparison, in words.

    The basis is "calibrated" if parameters of the jaw were chosen for this number, "validated" if the
    number was never used, and "free" if the number is that of another model, which persons need not
    share. Both are empty for a task without published numbers.
    """
    said: list[str] = []
    basis: list[str] = []
    for one in EXPECTED_OUTCOMES.get(task, ()):
        value = abs(values[one.column])
        wanted = f"{one.low:g} to {one.high:g}"
        if one.low <= value <= one.high:
            said.append(f"{one.column} {value:.1f}: within {wanted}")
        else:
            off = value - (one.low if value < one.low else one.high)
            digits = max(1, math.ceil(-math.log10(abs(off))))  # enough to tell it from the bound
            said.append(f"{one.column} {value:.{digits}f}: outside {wanted} by {off:+.{digits}f}")
        if not one.persons:
            basis.append("free: computed by the published model")
        elif generated and one.tuned:
            basis.append("calibrated: measured in persons and used for parameters")
        else:
            basis.append("validated: measured in persons, never used")
    return "; ".join(said), "; ".join(dict.fromkeys(basis))


def point_displacement(motion: xr.Dataset, marker: str) -> Floats:
    """Displacement (time, axis) of a point since the start, in the frame of the skull [mm].

    A prescribed rotation of the head is removed.
    """
    x = motion["position"].sel(marker=marker).transpose("time", "axis").values
    if "skull" in motion["body"].values:
        x = in_skull(motion, x)
    return np.asarray(1e3 * (x - x[0]), dtype=np.float64)


def separation(motion: xr.Dataset, *, beyond_start: bool = True) -> Floats:
    """Distance (time,) of the incisors beyond that at the start, where the teeth are in contact [mm]."""
    apart = motion["position"].sel(marker="upper_incisor") - motion["position"].sel(
        marker="lower_incisor"
    )
    gape = np.linalg.norm(apart.transpose("time", "axis").values, axis=1)
    return np.asarray(1e3 * (gape - beyond_start * gape[0]), dtype=np.float64)


def interincisal(motion: xr.Dataset) -> Floats:
    """Distance (time,) of the edges of the incisors [mm], as mouth opening is measured."""
    return separation(motion, beyond_start=False)


def outcome(motion: xr.Dataset) -> dict[str, float]:
    """Gape and place of the lower incisor at the widest opening and at the end [mm].

    ``right``, ``forward`` and ``down`` are those of the lower incisor at the largest gape, ``end_*`` at
    the end; ``gape`` is the separation, ``interincisal`` the distance of the incisal edges there,
    ``widest_s`` the time of the largest gape, ``lateral`` the largest sideways displacement.
    """
    d, gape = point_displacement(motion, "lower_incisor"), separation(motion)
    k = int(np.argmax(gape))
    return {
        "gape": gape[k],
        "interincisal": interincisal(motion)[k],
        "widest_s": float(motion["time"][k]),
        "right": d[k, 0],
        "forward": d[k, 1],
        "down": -d[k, 2],
        "lateral": d[np.argmax(np.abs(d[:, 0])), 0],
        "end_right": d[-1, 0],
        "end_forward": d[-1, 1],
        "end_down": -d[-1, 2],
        "hyoid_forward": point_displacement(motion, "hyoid")[:, 1].max(),
        "hyoid_up": point_displacement(motion, "hyoid")[:, 2].max(),
    }


def task_outcome_table(
    jaw: xr.Dataset,
    series: str | os.PathLike[str] | None = None,
    *,
    step: float = JAW_STEP,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Outcome of every task [mm, s], the published one, and the exciters that the model lacks.

    ``verdict`` and ``basis`` are those of `verdicts`.
    ``error`` is the estimated error of the time steps [mm]. Published series of a folder replace
    the excitations of chewing; `progress` is called after every task as ``progress(done, total)``.
    """
    generated = "generated" in str(jaw.attrs.get("origin", ""))
    names, rows = list(JAW_TASKS), list[dict[str, object]]()
    for k, name in enumerate(names):
        task, options = with_series(name, series)
        motion = run_task(jaw, task, step=step, **options)
        values = {key: round(value, 3) for key, value in outcome(motion).items()}
        values["error"] = round(1e3 * motion.attrs["numerical_error"], 3)
        without = motion.attrs["absent_exciters"]
        verdict, basis = verdicts(name, values, generated=generated)
        said = {"published": PUBLISHED_OUTCOMES[name], "verdict": verdict, "basis": basis}
        rows.append({"task": name, **values, "without": without, **said})
        if progress is not None:
            progress(k + 1, len(names))
    return pd.DataFrame(rows)
