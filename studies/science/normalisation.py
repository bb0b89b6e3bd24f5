"""Effect of normalisation per trial and per session on rho and on inactive muscles."""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, HATCHES, blank, save, styled
from benchmarks.recovery.recover import LEAST_PEAK
from benchmarks.report import markdown
from emgface.errors import FeatureWarning, SignalError
from emgface.recordings.dataset import read_recording
from emgface.signals.activation import activation_of, feature_range
from studies.science.setup import finished_study, opened, plan
from studies.science.subset import median_per_volunteer, names_of, of_subset, subset_study

REACHES: Final = ("trial", "session")
"""Data from which Eq. 8 takes the minimum and maximum."""
WORDS: Final = {"trial": "per trial", "session": "per session"}


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Compare normalisation per trial and per session: rho, and activation of silent muscles."""
    scores, peaks = [], []
    for world, folder in studies.items():
        cube = of_subset(opened(folder))
        names = names_of(cube)
        recordings = folder.parent / "recordings"
        for reach in REACHES:
            normalisation = {"reach": reach, "silent": "zero"}
            study = subset_study(
                recordings,
                names,
                f"simulated volunteers, {world} world, normalised {WORDS[reach]}",
                signals={"normalisation": normalisation},
            )
            if reach == "session":
                results = finished_study(study, plan.store / f"normalisation-{world}-{reach}")
                cube = opened(results)
            scores.append(median_per_volunteer(cube, world=world, normalisation=reach))
            peaks.append(_silent_peaks(recordings, names, study).assign(world=world))
    found = pd.concat(scores, ignore_index=True)
    silent = pd.concat(peaks, ignore_index=True)
    found.to_csv(out / "normalisation.csv", index=False)
    silent.to_csv(out / "silent_muscles.csv", index=False)
    save(_draw(found, silent), out / "normalisation.png", dpi=130)
    keys = ["world", "normalisation", "strategy"]
    rho = found.groupby(keys)["median rho"].mean()
    peak = silent.groupby(keys)["peak"].median()
    both = pd.DataFrame({"rho": rho, "peak of silent muscles": peak}).reset_index()
    wide = both.pivot_table(index=["world", "strategy"], columns="normalisation", sort=False)
    shown = pd.DataFrame(
        {
            f"{what}, {WORDS[reach]}": wide[what, reach].to_numpy(float)
            for what in ("rho", "peak of silent muscles")
            for reach in REACHES
        },
        index=[f"{world} world, {strategy}" for world, strategy in wide.index],
    ).rename_axis("simulated")
    return "\n".join(
        [
            "## Normalisation per trial and per session",
            "",
            "Eq. 8 as printed uses the minimum and maximum of each trial, so that an inactive "
            "muscle reaches an activation of 1 like all others. The alternative uses the minimum "
            "and maximum over all trials of a volunteer (`signals.normalisation.reach`). The same "
            f"{found['volunteer'].nunique()} volunteers and one repetition as above. A muscle is "
            "called silent in a trial if the excitation that generated its EMG remains below "
            f"{LEAST_PEAK:g}. The table lists the median, over trials and silent muscles, of the "
            "peak activation computed by the chain (0 for muscles that the strategy omits).",
            "",
            markdown(shown.reset_index(), ".2f"),
            "",
            "*rho: mean over volunteers of the median over instructions and markers (simulated; values: "
            "[rho](normalisation.csv), [silent muscles](silent_muscles.csv)).*",
            "",
            "![rho and peak activation of silent muscles, per trial and per session "
            "(simulated)](normalisation.png)",
            "",
            _reading(rho, peak),
        ]
    )


def _silent_peaks(recordings: Path, names: list[str], study) -> pd.DataFrame:
    """Peak activation of every silent muscle of a trial, with every strategy."""
    chain = study.signals
    rows: list[dict[str, object]] = []
    for name in names:
        trials = [
            read_recording(recordings / f"{name}_{instruction}_1.nc")
            for instruction in study.recordings.instructions
        ]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FeatureWarning)
            over = None
            if chain.normalisation.reach == "session":
                over = feature_range(trials, chain)
            for trial in trials:
                highest = trial["true_excitation"].max("time_true")
                silent = highest["muscle"].values[highest.values < LEAST_PEAK]
                for strategy in study.strategies:
                    try:
                        found = activation_of(trial, chain, strategy=strategy, session=over)
                    except SignalError:
                        continue  # no score either
                    peak = found["activation"].sel(muscle=silent).max("time")
                    rows += [
                        {
                            "normalisation": chain.normalisation.reach,
                            "strategy": strategy,
                            "volunteer": name,
                            "instruction": trial.attrs["instruction"],
                            "muscle": str(muscle),
                            "peak": float(value),
                        }
                        for muscle, value in zip(silent, peak.values, strict=True)
                    ]
    return pd.DataFrame(rows)


@styled
def _draw(found: pd.DataFrame, silent: pd.DataFrame):
    """Scores above, silent muscles below, one column per world."""
    worlds = list(dict.fromkeys(found["world"]))
    strategies = list(dict.fromkeys(found["strategy"]))
    figure = blank(8.5, 6.0)
    panels = figure.subplots(2, len(worlds), sharey="row", squeeze=False)
    for column, world in enumerate(worlds):
        for row, (table, value) in enumerate(((found, "median rho"), (silent, "peak"))):
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
                        spread = np.linspace(-0.08, 0.08, own.size)
                        panel.scatter(place + spread, own, s=9, color="black", zorder=3)
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
        "above: bars means over volunteers, dots volunteers;\n"
        "below: medians and quartiles over trials "
        "and silent muscles", fontsize=7.5,
    )  # fmt: skip
    return figure


def _reading(rho: pd.Series, peak: pd.Series) -> str:
    """Describe the figure in sentences with its numbers."""
    told = []
    for world in dict.fromkeys(rho.index.get_level_values("world")):
        mean, tall = rho[world], peak[world]
        gain = {name: mean["session", name] - mean["trial", name] for name in mean["trial"].index}
        most = max(gain, key=lambda name: gain[name])
        told.append(
            f"* In the {world} world, normalisation per session instead of per trial changes rho of "
            + ", ".join(f"{name} by {value:+.2f}" for name, value in gain.items())
            + f"; {most} gains most. With act_all, the peak activation of silent muscles is "
            f"{tall['trial', 'act_all']:.2f} per trial and {tall['session', 'act_all']:.2f} per session."
        )
    told.append(
        "* act_3 and act_rel omit most silent muscles and therefore hardly depend on the choice: the "
        "lower scores of act_all are largely due to the normalisation."
        if all(
            abs(rho[w, "session", "act_rel"] - rho[w, "trial", "act_rel"])
            < rho[w, "session", "act_all"] - rho[w, "trial", "act_all"]
            for w in dict.fromkeys(rho.index.get_level_values("world"))
        )
        else "* In at least one world, act_rel gains no less than act_all; silent muscles alone "
        "therefore do not explain the difference between the strategies."
    )
    return "\n".join(told) + "\n"
