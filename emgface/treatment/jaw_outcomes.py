"""Outcomes of a treated jaw: rest, opening by muscles and by a load, bite force, and stability.

Two jaws that open by different amounts under the same drive cannot be compared at their largest gape,
because a sideways deviation grows with the gape. The deviation is therefore also stated at equal gape.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.jaw.model import Floats
from emgface.anatomy.jaw.outcomes import point_displacement, separation
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.tasks import JAW_TASKS, JawTask
from emgface.errors import JawError
from emgface.face.identity import treatments_between

OPENING_RISE: Final = 2.0  #: duration of a slow rise of the openers [s]
OPENERS: Final = ("bi_ad", "bi_my", "bi_ip")
LOADS: Final = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)  #: downward loads on the incisor [N]
GAPES: Final = (5.0, 10.0)  #: gapes at which deviations are compared [mm]
PUSH: Final = 1.0  #: sideways load on the incisor [N]

Path = tuple[Floats, Floats]
"""Gape (n,) and displacement of the lower incisor to the right (n,), both in mm."""


def opened_by_muscles(jaw: xr.Dataset, without: str = "") -> Path:
    """Path of a slow opening: the openers rise linearly to full activation within `OPENING_RISE`.

    `without` names an exciter that stays inactive, such as ``bi_ip``, the lateral pterygoids.
    """
    drive = {name: [(0.0, 0.0), (OPENING_RISE, 1.0)] for name in OPENERS if name != without}
    motion = run_task(jaw, JawTask("slow opening", OPENING_RISE, drive), check=False)
    return separation(motion), point_displacement(motion, "lower_incisor")[:, 0]


def opened_by_load(jaw: xr.Dataset) -> Path:
    """Path of an opening by downward loads on the incisor, with the closers active as at rest.

    Every load of `LOADS` is held until the jaw comes to rest; larger ones than those for the
    widest of `GAPES` are left out.
    """
    rest = JAW_TASKS["rest"]
    gape, right = list[float](), list[float]()
    for load in LOADS:
        motion = run_task(jaw, replace(rest, load=(0.0, 0.0, -load)), check=False)
        gape.append(float(separation(motion)[-1]))
        right.append(float(point_displacement(motion, "lower_incisor")[-1, 0]))
        if gape[-1] > max(GAPES):
            break
    return np.array(gape), np.array(right)


def deviation_at(path: Path, gape: float) -> float:
    """Displacement of the incisor to the right [mm] where a path first reaches a gape [mm], else NaN."""
    reached = path[0] >= gape
    if not reached.any():
        return float("nan")
    k = int(np.argmax(reached))
    if k == 0:
        return float(path[1][0])
    share = (gape - path[0][k - 1]) / (path[0][k] - path[0][k - 1])
    return float(path[1][k - 1] + share * (path[1][k] - path[1][k - 1]))


def resected_side(jaw: xr.Dataset) -> str:
    """Return "L" or "R", the side without molars of a jaw; JawError if it has both."""
    joints = [str(j) for j in jaw["joint"].values]
    lost = [s for s in "LR" if f"bite_{s}" not in joints]
    if len(lost) != 1:
        raise JawError(
            f"the jaw lacks the molars of {len(lost)} sides, expected one: apply a plan with a "
            "resection ('emgface treat')"
        )
    return lost[0]


def jaw_outcomes(jaw: xr.Dataset, sound: str) -> dict[tuple[str, str], float]:
    """Outcomes of a jaw by name and unit; `sound` is the side "L" or "R" that was not treated."""
    rest = run_task(jaw, JAW_TASKS["rest"], check=False)
    values = {
        ("rest, separation of the incisors", "mm"): float(separation(rest)[-1]),
        ("rest, incisor to the right", "mm"): _right(rest),
    }
    for words, path in (
        ("opening by muscles", opened_by_muscles(jaw)),
        ("opening by a load on the incisor", opened_by_load(jaw)),
    ):
        k = int(np.argmax(path[0]))
        values[f"{words}, largest gape", "mm"] = float(path[0][k])
        values[f"{words}, incisor to the right at it", "mm"] = float(path[1][k])
        for gape in GAPES:
            name = f"{words}, incisor to the right at a gape of {gape:g} mm"
            values[name, "mm"] = deviation_at(path, gape)
    clench = run_task(jaw, JAW_TASKS["clench"], check=False)
    force = clench["joint_force"].sel(joint=f"bite_{sound}").isel(time=-1).values
    values["clenching at 10 %, bite force on the sound side", "N"] = float(np.linalg.norm(force))
    pushed = run_task(jaw, replace(JAW_TASKS["rest"], load=(PUSH, 0.0, 0.0)), check=False)
    moved = pushed["position"].isel(time=-1) - rest["position"].isel(time=-1)
    way = moved.sel(marker="lower_incisor").values
    values["sideways push of 1 N at rest, way of the incisor", "mm"] = 1e3 * float(
        np.linalg.norm(way)
    )
    return values


def _right(motion: xr.Dataset) -> float:
    return float(point_displacement(motion, "lower_incisor")[-1, 0])


def jaw_outcome_table(
    before: xr.Dataset,
    after: xr.Dataset,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Table with ``outcome``, ``unit``, ``before``, ``after`` and ``change`` of a resected jaw.

    Raises DataError if `after` is not a treatment of `before`.
    """
    treatments_between(before, after)
    sound = "R" if resected_side(after) == "L" else "L"
    outcomes: list[dict[tuple[str, str], float]] = []
    for k, jaw in enumerate((before, after)):
        if progress is not None:
            progress(k, 2)
        outcomes.append(jaw_outcomes(jaw, sound))
    if progress is not None:
        progress(2, 2)
    rows = [(*key, outcomes[0][key], outcomes[1][key]) for key in outcomes[0]]
    table = pd.DataFrame(rows, columns=["outcome", "unit", "before", "after"])
    table["change"] = table["after"] - table["before"]
    return table


__all__ = [
    "GAPES",
    "deviation_at",
    "jaw_outcome_table",
    "jaw_outcomes",
    "opened_by_load",
    "opened_by_muscles",
]
