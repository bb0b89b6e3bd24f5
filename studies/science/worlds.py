"""Scores of simulated volunteers whose persons, recordings or both violate the assumptions."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, MARKS, blank, save, styled
from benchmarks.report import markdown
from emgface.volunteers.world import MISMATCHES, World, mismatched_in
from studies.science.setup import finished_study, opened, people, plan
from studies.science.subset import (
    mean_interval,
    mean_text,
    median_per_volunteer,
    of_subset,
    smallest_change,
    subset,
    subset_study,
)

RECORDING: Final = ("pick-up", "noise")  #: kinds of mismatch of the EMG alone
PERSON: Final = ("mesh", "laws", "courses", "strengths", "delay", "recruitment", "repetition")
"""Kinds of mismatch of the person: the face and what its muscles do."""
WORLDS: Final[dict[str, tuple[str, ...]]] = {
    "matched": (),
    "recording mismatched": RECORDING,
    "person mismatched": PERSON,
    "mismatched": (*PERSON, *RECORDING),
}
EFFECTS: Final = {
    "recording, matched person": ("matched", "recording mismatched"),
    "recording, mismatched person": ("person mismatched", "mismatched"),
    "person, matched recording": ("matched", "person mismatched"),
    "person, mismatched recording": ("recording mismatched", "mismatched"),
}
"""Pairs of worlds that differ in the recording or in the person only."""
TRUE: Final = "true activation"


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Draw the median rho of every strategy in the four worlds."""
    scored = pd.concat([_scores(name, studies) for name in WORLDS], ignore_index=True)
    scored.to_csv(out / "worlds.csv", index=False)
    save(_draw(scored), out / "worlds.png", dpi=130)
    levels = per_volunteer(scored, "median rho")
    shift = per_volunteer(scored, "median shift [s]")["act_3"].median(axis="columns")
    lost, trials = int(scored["without score"].sum()), int(scored["trials"].sum())
    return "\n".join(
        [
            "## Worlds: decrease of the scores as assumptions are violated",
            "",
            "The kinds of mismatch (`emgface volunteers --world ...`, with the sizes of "
            "`emgface.volunteers.world.World`) are divided into those of the recording "
            f"({', '.join(RECORDING)}), which change only the EMG, and those of the person "
            f"({', '.join(PERSON)}). This section uses {scored['volunteer'].nunique()} volunteers, "
            f"only the instructions {', '.join(subset())} and only the first repetition. The results of "
            "the worlds in which person and recording are both matched or both mismatched are parts of "
            "the studies with all instructions and repetitions, which the following sections describe. "
            "All worlds use the same persons, instructions and random numbers. Of "
            f"{trials} trials, {lost} have no score.",
            "",
            markdown(_table(levels, shift).reset_index(), ".0f"),
            "",
            "*Mean over volunteers of the median of rho over instructions and markers, with its 95 % "
            "interval over volunteers (Student's t; simulated; [values of each "
            "volunteer](worlds.csv)).*",
            "",
            "![Median rho per strategy with person and recording matched and mismatched "
            "(simulated)](worlds.png)",
            "",
            "*Large marks: means of the table with their intervals; small marks: volunteers.*",
            "",
            "The next table lists how much a mismatch of the recording or of the person changes these "
            "means; the volunteers are paired:",
            "",
            markdown(effects(levels).reset_index()),
            "",
            reading(levels, shift),
        ]
    )


def per_volunteer(scored: pd.DataFrame, value: str) -> dict[str, pd.DataFrame]:
    """Values of every strategy, one row per world and one column per volunteer."""
    return {
        str(strategy): own.pivot_table(
            index="world", columns="volunteer", values=value, sort=False
        ).loc[list(WORLDS)]
        for strategy, own in scored.groupby("strategy", sort=False)
    }


def _table(levels: Mapping[str, pd.DataFrame], shift: pd.Series) -> pd.DataFrame:
    """Means with intervals of every world, and the median shift of act_3."""
    table = pd.DataFrame(
        {name: [mean_text(own.loc[world]) for world in WORLDS] for name, own in levels.items()},
        index=list(WORLDS),
    ).rename_axis("world (simulated)")
    table["shift of act_3 [ms]"] = (1e3 * shift).round().astype(int).to_numpy()
    return table


def effects(levels: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Changes between pairs of worlds with intervals of the paired differences."""
    return pd.DataFrame(
        {
            name: [mean_text(own.loc[b] - own.loc[a], "+.2f") for a, b in EFFECTS.values()]
            for name, own in levels.items()
        },
        index=list(EFFECTS),
    ).rename_axis("mismatch (simulated)")


def _scores(name: str, studies: Mapping[str, Path]) -> pd.DataFrame:
    """Scores of one world, with those of the true activation."""
    world, folder = world_named(name), plan.store / name.replace(" ", "-")
    title = f"simulated volunteers, {world.label}"
    if name in studies:
        cube = opened(studies[name])
    else:
        if not (plan.finished and (folder / "study" / "cube.nc").is_file()):
            people(world, folder, subset())
        study = subset_study(folder / "recordings", title)
        cube = opened(finished_study(study, folder / "study"))
    true = subset_study(
        folder / "recordings", f"{title}, true activation", activation_source="true"
    )
    truth = opened(finished_study(true, folder / "true"))
    parts = [median_per_volunteer(of_subset(c), world=name) for c in (cube, truth)]
    return pd.concat(parts, ignore_index=True).replace({"strategy": {"true": TRUE}})


def world_named(name: str) -> World:
    """World of the comparison."""
    return mismatched_in(WORLDS[name])


@styled
def _draw(scored: pd.DataFrame):
    """Draw median rho in the worlds: means with intervals, and every volunteer."""
    figure = blank(8.5, 4.6)
    panel = figure.subplots()
    levels = per_volunteer(scored, "median rho")
    for i, (strategy, own) in enumerate(levels.items()):
        colour = COLOURS[(4, 1, 2, 5)[i % 4]]
        place = np.arange(len(own)) + (i - 0.5 * (len(levels) - 1)) * 0.18
        mean, low, high = np.array([mean_interval(row) for row in own.to_numpy()]).T
        panel.errorbar(place, mean, [mean - low, high - mean], marker=MARKS[i], color=colour,
                       linestyle="", markersize=7, capsize=3.0, label=strategy)  # fmt: skip
        for values in own.to_numpy().T:
            panel.scatter(place + 0.05, values, s=9, marker=MARKS[i], color=colour, alpha=0.5,
                          linewidths=0)  # fmt: skip
    panel.set_xticks(range(len(WORLDS)), list(WORLDS))
    panel.set_xlabel("world")
    panel.set_ylabel("median rho of a volunteer")
    panel.axhline(1.0, color="0.8", linewidth=0.7, zorder=0)
    panel.set_ylim(float(scored["median rho"].min()) - 0.05, 1.02)
    figure.legend(*panel.get_legend_handles_labels(), loc="outside lower center", ncols=4,
                  title="large: means over volunteers, 95 % intervals; small: volunteers")  # fmt: skip
    figure.suptitle(
        f"rho with matched and mismatched persons and recordings, instructions "
        f"{', '.join(subset())} (SIMULATED)"
    )
    return figure


def reading(levels: Mapping[str, pd.DataFrame], shift: pd.Series) -> str:
    """Describe the figure in sentences with its numbers."""
    changes = effects(levels)
    true = levels[TRUE]
    sentences = [
        f"* **The true activation scores {true.loc['matched'].mean():.2f} in the matched and "
        f"{true.loc['mismatched'].mean():.2f} in the mismatched world.** It drives the face of the "
        "study, whose anatomy, mesh, laws, muscle courses and strengths differ from those of the "
        "person: a mismatched person changes the score of the true activation by "
        f"{changes[TRUE]['person, matched recording']}. "
        "The EMG does not affect this score: a mismatched recording changes it by "
        f"{changes[TRUE]['recording, matched person']}.",
        "* **Delay and activation dynamics** are compensated by the alignment, which shifts the "
        "measured motion: the median shift of act_3 changes from "
        f"{1e3 * shift['matched']:.0f} to {1e3 * shift['person mismatched']:.0f} ms. A delay common "
        "to all muscles does not affect rho.",
    ]
    for name, own in levels.items():
        if name == TRUE:
            continue
        sentences.append(
            f"* The score of {name} changes from {own.loc['matched'].mean():.2f} in the matched to "
            f"{own.loc['mismatched'].mean():.2f} in the mismatched world, by "
            f"{mean_text(own.loc['mismatched'] - own.loc['matched'], '+.2f')}. A mismatched recording "
            f"alone changes this score by {changes[name]['recording, matched person']}, a mismatched "
            f"person alone by {changes[name]['person, matched recording']}."
        )
    if "act_rel" in levels and "act_all" in levels:
        lead = levels["act_rel"] - levels["act_all"]
        sentences.append(
            f"* The difference act_rel - act_all is {mean_text(lead.loc['matched'], '+.2f')} in the "
            "matched world, where the bursts are drawn from the table of muscles that act_rel uses, "
            f"and {mean_text(lead.loc['mismatched'], '+.2f')} in the mismatched world, where each "
            "person departs from this table. Because the movements of both worlds are derived from this "
            "table, these values do not estimate the difference in people."
        )
    sentences.append(power(levels))
    sentences.append(
        "* The sizes of the mismatches of delay, activation dynamics, tissue filter and "
        "signal-to-noise ratio follow publications; the sizes of the other mismatches are "
        "assumptions. The effects depend on these sizes and on the instructions."
    )
    assert set(MISMATCHES) == {*PERSON, *RECORDING}
    return "\n".join(sentences) + "\n"


def power(levels: Mapping[str, pd.DataFrame]) -> str:
    """Smallest changes by a mismatch that this number of volunteers detects."""
    said: list[str] = []
    for kind in ("recording", "person"):
        pairs = [pair for name, pair in EFFECTS.items() if name.startswith(kind)]
        least = [
            smallest_change((own.loc[b] - own.loc[a]).to_numpy())
            for name, own in levels.items()
            if name != TRUE
            for a, b in pairs
        ]
        said.append(f"{min(least):.2f} to {max(least):.2f} by a mismatch of the {kind}")
    return (
        "* **Power:** with the spread between these volunteers, the smallest change of rho that is "
        f"detected with a power of 0.8 is {' and '.join(said)}, depending on strategy and world; "
        "smaller ones can remain undetected."
    )
