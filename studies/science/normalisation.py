"""Effect of normalisation per trial and per session on rho and on inactive muscles."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, HATCHES, blank, save, styled
from benchmarks.report import markdown
from emgface.errors import FeatureWarning, SignalError
from emgface.run.store import Store
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import study_face
from emgface.study.intake import take_in
from emgface.study.run import feature_extents
from emgface.study.stages import Laboratory
from studies.science.setup import finished_study, opened, plan, results_store
from studies.science.subset import (
    mean_interval,
    mean_text,
    median_per_volunteer,
    of_subset,
    smallest_change,
    subset,
    subset_study,
)

LEAST_PEAK = 0.06
"""Peak of the true activation above which a muscle takes part in a trial [1]."""

REACHES: Final = ("trial", "session")  #: data from which Eq. 8 takes the minimum and maximum
WORDS: Final = {"trial": "per trial", "session": "per session"}
KEYS: Final = ["world", "normalisation", "strategy"]


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Compare normalisation per trial and per session: rho, and activation of silent muscles."""
    scores, peaks = [], []
    for world, folder in studies.items():
        for reach in REACHES:
            study = subset_study(
                folder.parent / "recordings",
                f"simulated volunteers, {world} world, normalised {WORDS[reach]}",
                session=reach == "session",
            )
            results = folder
            if reach == "session":
                results = finished_study(study, plan.store / f"normalisation-{world}")
            cube = of_subset(opened(results))
            scores.append(median_per_volunteer(cube, world=world, normalisation=reach))
            peaks.append(_silent_peaks(study).assign(world=world, normalisation=reach))
    scored = pd.concat(scores, ignore_index=True)
    silent = pd.concat(peaks, ignore_index=True)
    scored.to_csv(out / "normalisation.csv", index=False)
    silent.to_csv(out / "silent_muscles.csv", index=False)
    save(_draw(scored, silent), out / "normalisation.png", dpi=130)
    rho = scored.pivot_table(index=KEYS, columns="volunteer", values="median rho", sort=False)
    peak = silent.groupby(KEYS)["peak"].median()
    return "\n".join(
        [
            "## Normalisation per trial and per session",
            "",
            "Eq. 8 as printed uses the minimum and maximum of each trial; the computed activation of "
            "an inactive muscle therefore reaches 1, like that of every other muscle. The alternative "
            "uses the minimum and maximum over all trials of a volunteer, which include all "
            "instructions and repetitions (`signals.normalisation.reach`). The table is based on "
            f"{scored['volunteer'].nunique()} volunteers, only the instructions {', '.join(subset())} "
            "and only the first repetition. A muscle is called silent in a trial if the excitation "
            f"that generated its EMG remains below {LEAST_PEAK:g}. For these muscles, the table lists "
            "the median, over trials and muscles, of the peak activation computed from the EMG (0 for "
            "muscles that the strategy omits).",
            "",
            markdown(_table(rho, peak), ".2f"),
            "",
            "*rho: mean over volunteers of the median over instructions and markers, with its 95 % "
            "interval over volunteers (Student's t); gain: paired difference (simulated; values: "
            "[rho](normalisation.csv), [silent muscles](silent_muscles.csv)).*",
            "",
            "![rho and peak activation of silent muscles, per trial and per session "
            "(simulated)](normalisation.png)",
            "",
            _reading(rho, peak),
        ]
    )


def _table(rho: pd.DataFrame, peak: pd.Series) -> pd.DataFrame:
    """One row per world and strategy; `rho` has one column per volunteer."""
    rows: list[dict[str, object]] = []
    for world in dict.fromkeys(rho.index.get_level_values("world")):
        for strategy in dict.fromkeys(rho.index.get_level_values("strategy")):
            each = {reach: (world, reach, strategy) for reach in REACHES}
            row: dict[str, object] = {"simulated": f"{world} world, {strategy}"}
            row |= {f"rho, {WORDS[reach]}": mean_text(rho.loc[key]) for reach, key in each.items()}
            row["gain"] = mean_text(_gain(rho, world, strategy), "+.2f")
            row |= {f"peak of silent muscles, {WORDS[r]}": peak[key] for r, key in each.items()}
            rows.append(row)
    return pd.DataFrame(rows)


def _gain(rho: pd.DataFrame, world: str, strategy: str) -> pd.Series:
    """Rho per session minus rho per trial of every volunteer."""
    return rho.loc[(world, "session", strategy)] - rho.loc[(world, "trial", strategy)]


def _silent_peaks(study: StudyConfiguration) -> pd.DataFrame:
    """Peak activation of every silent muscle of a trial, with every strategy, from stored results."""
    laboratory = Laboratory(Store(results_store()), study_face(study.face), study, print)
    intake = take_in(study.recordings)
    rows: list[dict[str, object]] = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FeatureWarning)
        extents = feature_extents(laboratory, intake)
        for recording in intake.recordings:
            volunteer, instruction, _ = recording.place
            highest = recording.dataset["true_excitation"].max("time_true")
            silent = highest["muscle"].values[highest.values < LEAST_PEAK]
            for strategy in study.strategies:
                try:
                    activation = laboratory.activation(recording, strategy, extents.get(volunteer))
                except SignalError:
                    continue  # no score either
                peak = activation.dataset["activation"].sel(muscle=silent).max("time")
                rows += [
                    {
                        "strategy": strategy,
                        "volunteer": volunteer,
                        "instruction": instruction,
                        "muscle": str(muscle),
                        "peak": float(value),
                    }
                    for muscle, value in zip(silent, peak.values, strict=True)
                ]
    return pd.DataFrame(rows)


@styled
def _draw(scored: pd.DataFrame, silent: pd.DataFrame):
    """Scores above, silent muscles below, one column per world."""
    worlds = list(dict.fromkeys(scored["world"]))
    strategies = list(dict.fromkeys(scored["strategy"]))
    figure = blank(8.5, 6.0)
    panels = figure.subplots(2, len(worlds), sharey="row", squeeze=False)
    for column, world in enumerate(worlds):
        for row, (table, value) in enumerate(((scored, "median rho"), (silent, "peak"))):
            panel = panels[row, column]
            for k, reach in enumerate(REACHES):
                for i, strategy in enumerate(strategies):
                    own = table[
                        (table["world"] == world)
                        & (table["normalisation"] == reach)
                        & (table["strategy"] == strategy)
                    ][value].to_numpy()
                    place, colour = i + 0.38 * (k - 0.5), COLOURS[(5, 0)[k]]
                    if row == 0:
                        panel.bar(place, own.mean(), 0.34, color=colour, hatch=HATCHES[k],
                                  edgecolor="black", linewidth=0.6,
                                  label=WORDS[reach] if i == column == 0 else None)  # fmt: skip
                        spread = np.linspace(-0.1, 0.1, own.size)
                        panel.scatter(place + spread, own, s=7, color="0.4", zorder=3)
                        mean, low, high = mean_interval(own)
                        panel.errorbar(place, mean, [[mean - low], [high - mean]],
                                       color="black", capsize=3, linewidth=1.0)  # fmt: skip
                    else:
                        low, middle, high = np.percentile(own, [25, 50, 75])
                        panel.bar(place, middle, 0.34, color=colour, hatch=HATCHES[k],
                                  edgecolor="black", linewidth=0.6)  # fmt: skip
                        panel.errorbar(place, middle, [[middle - low], [high - middle]],
                                       color="black", capsize=2, linewidth=0.8)  # fmt: skip
            panel.set_xticks(range(len(strategies)), strategies)
        panels[0, column].set_title(f"{world} world")
    panels[0, 0].set_ylabel("median rho of a volunteer")
    panels[1, 0].set_ylabel("peak activation\nof silent muscles")
    panels[1, 0].legend(*panels[0, 0].get_legend_handles_labels(), loc="upper right")
    figure.suptitle("Normalisation per trial and per session (SIMULATED recordings)")
    figure.supxlabel(
        "minimum and maximum over the trial or the session; "
        "above: means over volunteers with 95 % intervals, dots volunteers;\n"
        "below: medians and quartiles over trials "
        "and silent muscles", fontsize=7.5,
    )  # fmt: skip
    return figure


def _reading(rho: pd.DataFrame, peak: pd.Series) -> str:
    """Describe the figure in sentences with its numbers."""
    worlds = list(dict.fromkeys(rho.index.get_level_values("world")))
    strategies = list(dict.fromkeys(rho.index.get_level_values("strategy")))
    sentences: list[str] = []
    for world in worlds:
        gain = {name: _gain(rho, world, name) for name in strategies}
        most = max(gain, key=lambda name: float(gain[name].mean()))
        silent = {reach: peak[world, reach, "act_all"] for reach in REACHES}
        sentences.append(
            f"* In the {world} world, normalisation per session instead of per trial changes rho as "
            "follows: "
            + ", ".join(f"{name} by {mean_text(values, '+.2f')}" for name, values in gain.items())
            + f"; {most} gains most. With act_all, the median peak activation of silent muscles is "
            f"{silent['trial']:.2f} with normalisation per trial and {silent['session']:.2f} with "
            "normalisation per session."
        )
    least = [smallest_change(_gain(rho, world, name)) for world in worlds for name in strategies]
    sentences.append(
        "* **Power:** the smallest change of rho that is detected with a power of 0.8, given the spread "
        f"between these volunteers, is {min(least):.2f} to {max(least):.2f}, depending on strategy and "
        "world."
    )
    sentences.append(
        "* act_3 and act_rel omit most silent muscles and depend less on the choice: the lower scores "
        "of act_all are largely due to the normalisation."
        if all(
            mean_interval(_gain(rho, world, "act_all") - _gain(rho, world, name))[1] > 0.0
            for world in worlds
            for name in ("act_3", "act_rel")
        )
        else "* In at least one world, the results do not show that act_all gains more than both other "
        "strategies; silent muscles alone therefore do not explain the difference between the "
        "strategies."
    )
    return "\n".join(sentences) + "\n"
