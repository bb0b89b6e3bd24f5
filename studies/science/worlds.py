"""How the scores fall from volunteers that match the study's assumptions to those that do not."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, MARKS, blank, save, styled
from emgface.volunteers.world import KINDS, World, mismatched_in
from studies.science.setup import finished_study, opened, people, plan
from studies.science.subset import markdown, median_per_volunteer, names_of, of_subset, subset_study

RUNGS: Final = (
    ("matched", ()),
    ("+ mesh and laws", ("mesh", "laws")),
    ("+ courses and strengths", ("courses", "strengths")),
    ("+ delay and dynamics", ("delay",)),
    ("+ recruitment", ("recruitment",)),
    ("+ pick-up and noise\n= mismatched", ("pick-up", "noise")),
)
"""Steps of the ladder, each with the kinds of mismatch that it adds to those before."""
TRUE: Final = "true activation"


def _rungs() -> list[int]:
    """Rungs that are made: all, or the two ends."""
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
            "## Worlds: how scores fall as assumptions are taken back",
            "",
            f"The first {found['volunteer'].nunique()} volunteers, one repetition of each instruction. "
            "Each row adds kinds of mismatch to the row above (`emgface volunteers --world "
            "mesh+laws+...`)"
            + (", all of them at once here" if plan.ends else "")
            + ", with the sizes of `emgface.volunteers.world.World`. The same persons, "
            "instructions and random numbers are behind all rows. Of "
            f"{int(found['trials'].sum())} trials {lost} have no score.",
            "",
            markdown(table),
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
    """Median rho over the rungs, a line per strategy, a mark per volunteer."""
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
    """Say what the figure shows, with its numbers."""
    last = len(RUNGS) - 1
    true = mean[TRUE]
    change = mean.diff()
    worst = {name: int(change[name].idxmin()) for name in mean.columns if name != TRUE}
    told = [
        f"* **The true activation scores {true[0]:.2f} where all is matched and {true[last]:.2f} in the "
        "mismatched world.** It moves the face of the study, whose anatomy, mesh, laws, courses and "
        "strengths are not the person's. If that is the reason, the fall must come with the first two "
        "steps, and delay, recruitment, pick-up and noise may cost nothing more, since the true "
        "activation is that after the delay"
        + (
            "."
            if plan.ends
            else f": the first two steps take {true[0] - true[2]:.2f}, the other three "
            f"{true[2] - true[last]:.2f}."
        ),
        "* **Delay and dynamics** are taken up by the alignment, which shifts the measured motion: the "
        f"median shift of act_3 goes from {1e3 * shift['act_3'][_before_delay()]:.0f} to "
        f"{1e3 * shift['act_3'][_with_delay()]:.0f} ms. rho does not see a delay that all muscles "
        "share.",
    ]
    for name, step in worst.items():
        told.append(
            f"* {name} goes from {mean[name][0]:.2f} to {mean[name][last]:.2f}"
            + (
                "."
                if plan.ends
                else f"; the largest fall is with {_title(step).partition(' = ')[0].removeprefix('+ ')} "
                f"({change[name][step]:+.2f})."
            )
        )
    if "act_rel" in mean and "act_all" in mean:
        lead = mean["act_rel"] - mean["act_all"]
        told.append(
            f"* act_rel leads act_all by {lead[0]:.2f} in the matched world, where the bursts come from "
            f"the table that act_rel is told, and by {lead[last]:.2f} in the mismatched one, where each "
            "person departs from it. Even there movements begin from that table, so that the lead is no "
            "estimate of one with people."
        )
    told.append(
        "* The sizes of the mismatches were chosen (delay, activation dynamics, tissue filter and "
        "signal-to-noise ratio after publications). The ladder tells which assumptions matter and in "
        "which order they were taken back; other sizes and another order give other steps."
    )
    assert set(KINDS) == {kind for _, kinds in RUNGS for kind in kinds} and np.isfinite(true).all()
    return "\n".join(told) + "\n"
