"""Scores of simulated volunteers from the matched to the mismatched world."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, MARKS, blank, save, styled
from benchmarks.report import markdown
from emgface.volunteers.world import KINDS, World, mismatched_in
from studies.science.setup import finished_study, opened, people, plan
from studies.science.subset import median_per_volunteer, names_of, of_subset, subset_study

RUNGS: Final = (
    ("matched", ()),
    ("+ mesh and laws", ("mesh", "laws")),
    ("+ courses and strengths", ("courses", "strengths")),
    ("+ delay and dynamics", ("delay",)),
    ("+ recruitment", ("recruitment",)),
    ("+ pick-up and noise\n= mismatched", ("pick-up", "noise")),
)
"""Worlds of the series, each with the kinds of mismatch that it adds to the one before."""
TRUE: Final = "true activation"


def _rungs() -> list[int]:
    """Indices of the worlds to compute: all, or the first and the last."""
    return [0, len(RUNGS) - 1] if plan.ends else list(range(len(RUNGS)))


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Draw the median rho of every strategy in every world from matched to mismatched."""
    found = pd.concat([_rung(k, studies) for k in _rungs()], ignore_index=True)
    found.to_csv(out / "worlds.csv", index=False)
    save(_draw(found), out / "worlds.png", dpi=130)
    order = list(dict.fromkeys(found["strategy"]))
    mean = found.groupby(["rung", "strategy"])["median rho"].mean().unstack()[order]
    shift = found.groupby(["rung", "strategy"])["median shift [s]"].median().unstack()
    titles = [_title(k) for k in _rungs()]
    table = mean.set_axis(titles).rename_axis("world (simulated)")
    table["shift of act_3 [ms]"] = (1e3 * shift["act_3"]).round().astype(int).to_numpy()
    lost = int(found["without score"].sum())
    return "\n".join(
        [
            "## Worlds: decrease of the scores as assumptions are violated",
            "",
            f"The first {found['volunteer'].nunique()} volunteers, one repetition of each instruction. "
            "Each row adds kinds of mismatch to the row above (`emgface volunteers --world "
            "mesh+laws+...`"
            + ("; here all of them at once" if plan.ends else "")
            + "), with the sizes of `emgface.volunteers.world.World`. All rows use the same persons, "
            "instructions and random numbers. Of "
            f"{int(found['trials'].sum())} trials, {lost} have no score.",
            "",
            markdown(table.reset_index(), ".2f"),
            "",
            "*Mean over volunteers of the median of rho over instructions and markers (simulated; "
            "[values of each volunteer](worlds.csv)).*",
            "",
            "![Median rho per strategy from the matched to the mismatched world "
            "(simulated)](worlds.png)",
            "",
            _reading(mean, shift),
        ]
    )


def _rung(k: int, studies: Mapping[str, Path]) -> pd.DataFrame:
    """Scores of one world, with those of the true activation."""
    world = _world(k)
    end = {0: "matched", len(RUNGS) - 1: "mismatched"}.get(k)
    if end is not None:
        recordings = studies[end].parent / "recordings"
        cube = of_subset(opened(studies[end]))
    else:
        names = names_of(opened(studies["matched"]))
        folder = plan.store / f"rung{k}"
        results = folder / "study"
        recordings = folder / "recordings"
        if not (plan.finished and (results / "cube.nc").is_file()):
            people(world, folder, volunteers=len(names), repetitions=1)
        study = subset_study(recordings, names, f"simulated volunteers, {world.label}")
        cube = opened(finished_study(study, results))
    true = subset_study(
        recordings,
        names_of(cube),
        f"simulated volunteers, {world.label}, true activation",
        activation_source="true",
    )
    truth = opened(finished_study(true, plan.store / f"rung{k}" / "true"))
    parts = [median_per_volunteer(cube, rung=k), median_per_volunteer(truth, rung=k)]
    found = pd.concat(parts, ignore_index=True).replace({"strategy": {"true": TRUE}})
    return found.assign(world=world.label)


def _before_delay() -> int:
    return 0 if plan.ends else _with_delay() - 1


def _with_delay() -> int:
    if plan.ends:
        return len(RUNGS) - 1
    return next(k for k, (_, kinds) in enumerate(RUNGS) if "delay" in kinds)


def _world(k: int) -> World:
    return mismatched_in([kind for _, kinds in RUNGS[: k + 1] for kind in kinds])


def _title(k: int) -> str:
    return RUNGS[k][0].replace("\n", " ")


@styled
def _draw(found: pd.DataFrame):
    """Draw median rho over the worlds, one line per strategy, one mark per volunteer."""
    figure = blank(8.5, 4.6)
    panel = figure.subplots()
    strategies = list(dict.fromkeys(found["strategy"]))
    for i, strategy in enumerate(strategies):
        own = found[found["strategy"] == strategy]
        mean = own.groupby("rung")["median rho"].mean()
        colour = COLOURS[(4, 1, 2, 5)[i % 4]]
        panel.plot(mean.index, mean, marker=MARKS[i], color=colour, label=strategy)
        aside = (i - 0.5 * (len(strategies) - 1)) * 0.06
        panel.scatter(own["rung"] + aside, own["median rho"], s=10, marker=MARKS[i], color=colour,
                      alpha=0.45, linewidths=0)  # fmt: skip
    made = sorted(set(found["rung"]))
    panel.set_xticks(made, [RUNGS[k][0] for k in made], rotation=20, ha="right")
    panel.set_ylabel("median rho of a volunteer")
    panel.axhline(1.0, color="0.8", linewidth=0.7, zorder=0)
    panel.set_ylim(min(0.0, float(found["median rho"].min()) - 0.05), 1.02)
    panel.legend(loc="lower left", title="lines: mean over volunteers")
    figure.suptitle("rho from the matched to the mismatched world (SIMULATED recordings)")
    return figure


def _reading(mean: pd.DataFrame, shift: pd.DataFrame) -> str:
    """Describe the figure in sentences with its numbers."""
    last = len(RUNGS) - 1
    true = mean[TRUE]
    change = mean.diff()
    worst = {name: int(change[name].idxmin()) for name in mean.columns if name != TRUE}
    told = [
        f"* **The true activation scores {true[0]:.2f} in the matched and {true[last]:.2f} in the "
        "mismatched world.** It drives the face of the study, whose anatomy, mesh, laws, muscle "
        "courses and strengths differ from the person's. If this is the cause, the score must "
        "decrease in the first two steps, and delay, recruitment, pick-up and noise must not "
        "decrease it further, because the true activation is the one after the delay"
        + (
            "."
            if plan.ends
            else f": the decrease is {true[0] - true[2]:.2f} in the first two steps and "
            f"{true[2] - true[last]:.2f} in the other three."
        ),
        "* **Delay and dynamics** are compensated by the alignment, which shifts the measured motion: "
        f"the median shift of act_3 changes from {1e3 * shift['act_3'][_before_delay()]:.0f} to "
        f"{1e3 * shift['act_3'][_with_delay()]:.0f} ms. A delay common to all muscles does "
        "not affect rho.",
    ]
    for name, step in worst.items():
        told.append(
            f"* {name} changes from {mean[name][0]:.2f} to {mean[name][last]:.2f}"
            + (
                "."
                if plan.ends
                else "; the largest decrease is with "
                f"{_title(step).partition(' = ')[0].removeprefix('+ ')} "
                f"({change[name][step]:+.2f})."
            )
        )
    if "act_rel" in mean and "act_all" in mean:
        lead = mean["act_rel"] - mean["act_all"]
        told.append(
            f"* act_rel exceeds act_all by {lead[0]:.2f} in the matched world, where the bursts are "
            f"drawn from the table of muscles that act_rel uses, and by {lead[last]:.2f} in the "
            "mismatched world, where each person departs from this table. Because the movements of both "
            "worlds are derived from this table, the difference is not an estimate of the difference in "
            "people."
        )
    told.append(
        "* The sizes of the mismatches were chosen, those of delay, activation dynamics, tissue filter "
        "and signal-to-noise ratio after publications. The size of each step depends on these choices "
        "and on the order in which the assumptions are violated."
    )
    assert set(KINDS) == {kind for _, kinds in RUNGS for kind in kinds} and np.isfinite(true).all()
    return "\n".join(told) + "\n"
