"""Excursions of the lips in instructed movements over sigma_max, and published ones of persons.

The relevant muscles of an instruction are fully activated, as Eq. 8 makes the strongest sample of every
trial. The comparison contains no simulated volunteer: nothing in it depends on how they were drawn.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

import emgface as ef
from analysis.figures.style import COLOURS, MARKS, blank, styled
from emgface.face.muscle_parameters import PUBLISHED_START, SIGMA_MAX
from emgface.muscles import INSTRUCTIONS as NAMES
from emgface.muscles import RELEVANT
from studies.science.setup import STEP, each, simulation

INSTRUCTIONS: Final = ("A", "B", "C", "D")
"""Instructions with one target; E and F are sequences of several movements."""
POINTS: Final = {
    "corners": ("corner_left", "corner_right"),
    "upper lip": ("upper_paramedian_left", "upper_paramedian_right"),
    "lower lip": ("lower_paramedian_left", "lower_paramedian_right"),
}
DURATION: Final = 0.8  #: [s]; the activation rises for its first half


@dataclass(frozen=True)
class Published:
    """Excursion of a point of the lips in persons [mm]."""

    instruction: str
    point: str
    low: float
    high: float
    mean: float | None
    source: str


PUBLISHED: Final = (
    Published(
        "D", "corners", 7.0, 22.0, 14.0,
        "full smile of adults; Paletz, Manktelow and Chaban 1994, Plast Reconstr Surg 93:784 "
        "(quoted, not checked against the original)",
    ),
    Published(
        "D", "upper lip", 2.0, 12.0, None,
        "mobility of the upper lip in a smile; dentalcare.com, course 649, section Lip Mobility",
    ),
)  # fmt: skip
"""Excursions with the same movement and point. For instructed puckering and depression of the corners,
no published amplitude of these points was found."""


def excursions(
    face: xr.Dataset,
    name: str,
    instructions: tuple[str, ...],
    levels: tuple[float, ...],
    accuracy: str = "draft",
) -> pd.DataFrame:
    """Largest distance from rest of corners and lips [mm], per instruction and sigma_max [Pa].

    ``used [Pa]`` is lower than sigma_max where the face could not be simulated with it.
    """
    jobs = [
        (face, name, instruction, stress, accuracy)
        for instruction in instructions
        for stress in levels
    ]
    return pd.DataFrame(each(_of_one_movement, jobs))


def _of_one_movement(job: tuple[xr.Dataset, str, str, float, str]) -> dict[str, Any]:
    """Row of `excursions` of one instruction and sigma_max [Pa]."""
    face, name, instruction, stress, accuracy = job
    muscles = face["muscle"].values.tolist()
    time = np.linspace(0.0, DURATION, round(DURATION / STEP) + 1)
    level = np.isin([m.rpartition("_")[0] for m in muscles], list(RELEVANT[instruction]))
    activation = xr.DataArray(
        np.outer(level, np.clip(time / (0.5 * DURATION), 0.0, 1.0)),
        coords={"muscle": muscles, "time": time},
        dims=("muscle", "time"),
    )
    values = simulation(sigma_max=stress, step=STEP, output=STEP, accuracy=accuracy)
    motion = ef.simulate(activation, face, progress=False, **values.model_dump(exclude_unset=True))
    moved = motion["position"] - motion["position"].isel(time=0)
    farthest = 1e3 * np.sqrt((moved**2).sum("axis")).max("time")
    return {
        "face": name,
        "instruction": instruction,
        "sigma_max [Pa]": stress,
        "used [Pa]": float(motion.attrs["sigma_max"]),
        **{
            f"{point} [mm]": float(farthest.sel(marker=list(markers)).mean())
            for point, markers in POINTS.items()
        },
    }


def compared(computed: pd.DataFrame) -> pd.DataFrame:
    """Published excursions with the computed ones at 100 and 300 kPa, and which of both is nearer.

    ``nearer`` is the stress with the smaller distance from the published mean; where only a range is
    published, it is the stress within it, "both" or "neither".
    """
    rows: list[dict[str, Any]] = []
    for face, own in computed.groupby("face", sort=False):
        for one in PUBLISHED:
            at = own[own["instruction"] == one.instruction].set_index("sigma_max [Pa]")
            low, high = (
                float(at.loc[s, f"{one.point} [mm]"]) for s in (SIGMA_MAX, PUBLISHED_START)
            )
            rows.append(
                {
                    "face (simulated)": face,
                    "movement": f"{one.instruction}: {NAMES[one.instruction]}",
                    "point": one.point,
                    f"{SIGMA_MAX / 1e3:.0f} kPa [mm]": f"{low:.1f}",
                    f"{PUBLISHED_START / 1e3:.0f} kPa [mm]": f"{high:.1f}",
                    "persons [mm]": f"{one.low:g} to {one.high:g}"
                    + ("" if one.mean is None else f", mean {one.mean:g}"),
                    "nearer": _nearer(one, low, high),
                    "source": one.source,
                }
            )
    return pd.DataFrame(rows)


def _nearer(one: Published, low: float, high: float) -> str:
    names = (f"{SIGMA_MAX / 1e3:.0f} kPa", f"{PUBLISHED_START / 1e3:.0f} kPa")
    if one.mean is not None:
        return names[int(abs(high - one.mean) < abs(low - one.mean))]
    within = [one.low <= value <= one.high for value in (low, high)]
    return {(True, True): "both", (False, False): "neither"}.get(
        (within[0], within[1]), names[within.index(True)] if any(within) else "neither"
    )


def reading(computed: pd.DataFrame) -> str:
    """Sentence on the stress that the comparison with persons favours, and on lowered stresses."""
    table = compared(computed)
    counts = table["nearer"].value_counts()
    strong = f"{PUBLISHED_START / 1e3:.0f} kPa"
    weak = f"{SIGMA_MAX / 1e3:.0f} kPa"
    decided = int(counts.get(strong, 0)), int(counts.get(weak, 0))
    lowered = computed[computed["used [Pa]"] < computed["sigma_max [Pa]"] * (1 - 1e-9)]
    names = [
        f"{face} {instruction} at {float(str(stress)) / 1e3:.0f} kPa"
        for face, instruction, stress in lowered[
            ["face", "instruction", "sigma_max [Pa]"]
        ].itertuples(index=False)
    ]
    lowering = (
        f"lowered in {', '.join(names)}" if names else "not lowered in any of these movements"
    )
    undecided = len(table) - sum(decided)
    return (
        "* **Compared with persons, independently of the simulated volunteers:** of "
        f"{len(table)} comparisons, {decided[0]} {'favours' if decided[0] == 1 else 'favour'} {strong}, "
        f"{decided[1]} {'favours' if decided[1] == 1 else 'favour'} {weak}, and {undecided} "
        f"{'does' if undecided == 1 else 'do'} not distinguish them. sigma_max was {lowering}. "
        "Eskes et al. 2017 state that their models in general moved less than the volunteers, with a "
        f"stress of {strong} that was lowered where elements inverted; a lower start would increase "
        "this difference. Of puckering, "
        "in which the lips of this face move farthest, and of depressed corners no published "
        "excursion of these points was found."
    )


@styled
def drawn(computed: pd.DataFrame):
    """Draw excursions over sigma_max, one panel per instruction, with published ranges."""
    figure = blank(10.0, 4.4)
    panels = figure.subplots(1, len(INSTRUCTIONS), sharey=True)
    lines, fills = ("-", "--"), ("full", "none")
    handles: dict[str, Any] = {}
    for panel, instruction in zip(panels, INSTRUCTIONS, strict=True):
        for k, (face, own) in enumerate(computed.groupby("face", sort=False)):
            at = own[own["instruction"] == instruction]
            for j, point in enumerate(POINTS):
                panel.plot(at["sigma_max [Pa]"] / 1e3, at[f"{point} [mm]"], lines[k],
                           color=COLOURS[(4, 1, 2)[j]], marker=MARKS[j], fillstyle=fills[k],
                           label=f"{point}, {face} face")  # fmt: skip
        for one in PUBLISHED:
            if one.instruction == instruction and one.mean is not None:
                panel.axhspan(
                    one.low, one.high, color="0.92", zorder=0, label=f"{one.point}, persons: range"
                )
                panel.axhline(
                    one.mean, color="0.5", linewidth=0.8, label=f"{one.point}, persons: mean"
                )
        panel.set_title(f"{instruction}: {NAMES[instruction]}", fontsize=9)
        panel.set_xlabel("sigma_max [kPa]")
        handles |= dict(zip(*reversed(panel.get_legend_handles_labels()), strict=True))
    panels[0].set_ylabel("largest distance from rest [mm]")
    panels[0].set_ylim(0.0)
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3,
                  fontsize=8)  # fmt: skip
    figure.suptitle("Excursion with fully activated relevant muscles (SIMULATED)")
    return figure
