"""Controls of skill and of the gain by own EMG: predictions that know nothing, or a known amount.

    python -m studies.science --only controls

All motions are drawn at random (`studies.science.drawn`), so that the share of EMG in a prediction is
known. The intervals are those of a study.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from analysis.figures.style import COLOURS, MARKS, blank, save, styled
from benchmarks.report import markdown
from studies.science.drawn import VARIATION, exchanged, gain_interval, gains, skill_interval, world
from studies.science.setup import each
from studies.science.strength import wilson

VOLUNTEERS: Final = (5, 6, 12)
STUDIES: Final = 500  #: studies of a prediction without EMG
CONTROLS: Final = 200  #: studies of each other prediction
SPECIFIC: Final = 0.05  #: share of the individual part of a motion that the positive control knows
FOLLOWED: Final = (0.0, 0.05, 0.1, 0.2, 0.5)
"""Share of the deviation of a repetition that a prediction from the own EMG follows."""
NOISE: Final = VARIATION
"""Variance of the error of a prediction that differs between repetitions, as large as theirs [1]."""
NOTHING: Final = "without EMG"
FINITE: Final = "without EMG, finite template"
KNOWING: Final = f"with {SPECIFIC:g} of the individual part"
PERMUTED: Final = "permuted"


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Draw the studies, write tables and figure, and describe them."""
    skill, gain = skills(), own_gains()
    skill.to_csv(out / "controls_skill.csv", index=False)
    gain.to_csv(out / "controls_gain.csv", index=False)
    save(_draw(skill, gain), out / "controls.png", dpi=130)
    return text(skill, gain)


def skills() -> pd.DataFrame:
    """Skill of predictions without EMG and with a known share of the individual part, per study."""
    jobs = [
        (volunteers, name, number)
        for volunteers in VOLUNTEERS
        for name, count in ((NOTHING, STUDIES), (FINITE, CONTROLS), (KNOWING, CONTROLS))
        for number in range(count)
    ]
    return _shares(pd.DataFrame(each(_skill, jobs)), ["volunteers", "prediction"])


def _skill(job: tuple[int, str, int]) -> dict[str, Any]:
    volunteers, name, number = job
    rng = np.random.default_rng((46, volunteers, number))
    scores = world(rng, volunteers, SPECIFIC if name == KNOWING else 0.0)
    interval = skill_interval(*scores, finite=name == FINITE)
    return {"volunteers": volunteers, "prediction": name} | _interval(interval)


def own_gains() -> pd.DataFrame:
    """Gain by own EMG of predictions that follow a known share of a repetition, per study."""
    jobs = [
        (volunteers, followed, permuted, number)
        for volunteers in VOLUNTEERS[1:]
        for followed, permuted in (*((one, False) for one in FOLLOWED), (0.5, True))
        for number in range(CONTROLS)
    ]
    return _shares(pd.DataFrame(each(_gain, jobs)), ["volunteers", "followed", "EMG"])


def _gain(job: tuple[int, float, bool, int]) -> dict[str, Any]:
    volunteers, followed, permuted, number = job
    rng = np.random.default_rng((47, volunteers, number))
    gain, room = gains(rng, volunteers, followed, NOISE)
    if permuted:
        gain = exchanged(rng, gain)
    labels = {
        "volunteers": volunteers,
        "followed": followed,
        "EMG": PERMUTED if permuted else "own",
    }
    return labels | _interval(gain_interval(gain)) | {"largest": float(room.mean())}


def _interval(interval: tuple[float, float, float]) -> dict[str, float]:
    middle, low, high = interval
    return {
        "mean": middle,
        "contains 0": float(low <= 0.0 <= high),
        "above 0": float(low > 0.0),
        "studies": 1.0,
    }


def _shares(rows: pd.DataFrame, by: list[str]) -> pd.DataFrame:
    """Means over studies, and their number."""
    grouped = rows.groupby(by, sort=False)
    means = grouped.mean(numeric_only=True)
    means["studies"] = grouped.size()
    return means.reset_index()


def text(skill: pd.DataFrame, gain: pd.DataFrame) -> str:
    """Describe tables and figure in sentences with their numbers."""
    free, known = (skill[skill["prediction"] == name] for name in (NOTHING, KNOWING))
    finite = skill[skill["prediction"] == FINITE]
    own, permuted = (gain[gain["EMG"] == name] for name in ("own", PERMUTED))
    half, none = (own[own["followed"] == share] for share in (0.5, 0.0))
    least = own[own["followed"] == FOLLOWED[1]]
    return "\n".join(
        [
            "## Controls: predictions that know nothing, or a known amount",
            "",
            "In motions drawn at random, the part of a motion that is common to all persons, that of "
            "the person and that of the repetition are known. Every study has six instructions; its "
            "intervals are those of the sections below.",
            "",
            markdown(_skill_table(skill)),
            "",
            markdown(_gain_table(gain)),
            "",
            "*Shares of simulated studies with 95 % intervals of Wilson ([skill]"
            "(controls_skill.csv), [gain](controls_gain.csv)). followed: share of the deviation of a "
            "repetition from the person's mean that the prediction contains; permuted: own EMG and "
            "that of another repetition, exchanged at random in each volunteer.*",
            "",
            "![Share of studies in which skill and gain by own EMG are found "
            "(simulated)](controls.png)",
            "",
            "* **A prediction without EMG has no skill:** its interval contains 0 in "
            f"{_listed(free, 'contains 0')}. With the template of the other volunteers itself as the "
            f"reference, which is noisy, skill would be found in {_listed(finite, 'above 0')}. A "
            f"prediction that knows {SPECIFIC:g} of the individual part is found in "
            f"{_listed(known, 'above 0')}.",
            "* **The gain by own EMG is found where it exists:** a prediction that follows half of the "
            f"deviation of a repetition is found in {_listed(half, 'above 0')}; its gain of "
            f"{half['mean'].iloc[0]:.3f} compares with a largest possible one of "
            f"{half['largest'].iloc[0]:.3f}. One that follows {FOLLOWED[1]:g} of it is found in "
            f"{_listed(least, 'above 0')}. A gain is found in {_listed(none, 'above 0')} if nothing is "
            f"followed, and in {_listed(permuted, 'above 0')} with permuted EMG (2.5 % are expected).",
            "* **What these controls cannot tell:** whether persons vary as much between repetitions as "
            f"assumed here (a variance of {VARIATION:g} of that of the mean motion), and whether the "
            "error of a prediction differs between repetitions by as much.",
            "",
        ]
    )


def _listed(rows: pd.DataFrame, share: str) -> str:
    each_n = [f"{row[share]:.1%} with {row['volunteers']}" for _, row in rows.iterrows()]
    return ", ".join(each_n) + " volunteers"


def _share(row: pd.Series, name: str) -> str:
    low, high = wilson(round(row[name] * row["studies"]), int(row["studies"]))
    return f"{row[name]:.1%} ({low:.1%} to {high:.1%})"


def _skill_table(skill: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "prediction (simulated)": row["prediction"],
            "volunteers": row["volunteers"],
            "studies": row["studies"],
            "skill": f"{row['mean']:+.3f}",
            "interval contains 0": _share(row, "contains 0"),
            "interval above 0": _share(row, "above 0"),
        }
        for _, row in skill.iterrows()
    )


def _gain_table(gain: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "followed (simulated)": f"{row['followed']:g}",
            "EMG": row["EMG"],
            "volunteers": row["volunteers"],
            "studies": row["studies"],
            "gain by own EMG": f"{row['mean']:+.3f}",
            "largest possible": f"{row['largest']:.3f}",
            "interval above 0": _share(row, "above 0"),
        }
        for _, row in gain.iterrows()
    )


@styled
def _draw(skill: pd.DataFrame, gain: pd.DataFrame):
    """Draw the share of studies in which skill, and gain by own EMG, are found."""
    figure = blank(9.5, 4.0)
    left, right = figure.subplots(1, 2)

    def points(panel: Any, place: Any, rows: pd.DataFrame, column: str, k: int, label: str) -> None:
        share = rows[column].to_numpy()
        bounds = np.array(
            [
                wilson(round(s * n), int(n))
                for s, n in zip(share, rows["studies"].to_numpy(), strict=True)
            ]
        )
        reach = np.maximum(np.abs(bounds.T - share), 0.0)
        panel.errorbar(place, share, reach, marker=MARKS[k], linestyle="-" if len(rows) > 1 else "",
                       color=COLOURS[(4, 1, 2, 5)[k]], capsize=3, label=label)  # fmt: skip

    for k, name in enumerate((NOTHING, FINITE, KNOWING)):
        own = skill[skill["prediction"] == name]
        points(left, np.arange(len(own)) + 0.06 * (k - 1), own, "above 0", k, name)
    left.set_xticks(range(len(VOLUNTEERS)), [str(n) for n in VOLUNTEERS])
    left.set_xlabel("volunteers of a study")
    left.set_ylabel("share of studies, interval above 0")
    left.set_title("skill", fontsize=9)
    for k, n in enumerate(VOLUNTEERS[1:]):
        group = gain[gain["volunteers"] == n]
        own, permuted = group[group["EMG"] == "own"], group[group["EMG"] == PERMUTED]
        points(right, own["followed"], own, "above 0", k, f"own EMG, {n} volunteers")
        points(right, permuted["followed"] + 0.02 * (k - 0.5), permuted, "above 0", k + 2,
               f"permuted EMG, {n} volunteers")  # fmt: skip
    right.set_xlabel("followed share of the deviation of a repetition")
    right.set_title("gain by own EMG", fontsize=9)
    for panel in (left, right):
        panel.axhline(0.025, color="0.5", linewidth=0.8, linestyle=":")
        panel.set_ylim(-0.03, 1.03)
    handles = [one for panel in (left, right) for one in panel.get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8)
    figure.suptitle("Found skill and gain (SIMULATED); dotted: 2.5 %, expected without any")
    return figure
