"""Tables and sentences that compare the scores of a study with baselines and ceilings."""

from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.baselines import NO_ROOM, complete, has_baselines, unexplained
from analysis.descriptives import mean_defined
from analysis.statistics.finding import persons
from analysis.statistics.scope import too_few_volunteers
from analysis.statistics.skill import CORRELATIONS, against_baselines
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import scored_values, selected, texts

HEADS: Final = (
    "rho", "template", "all persons", "repeat", "ceiling", "EMG of others", "shuffled EMG",
    "wrong instruction", "best wrong",
)  # fmt: skip
"""Column heads of `CORRELATIONS`."""
NOTE: Final = (
    "Means over markers and trials. template: mean motion of the other volunteers, without "
    "EMG; all persons: the template, extrapolated to infinitely many volunteers; repeat: another "
    "repetition of the person; ceiling: the best motion that is the "
    "same in every repetition; EMG of others: mean motion driven by the EMG of the other volunteers, "
    "which contains no EMG of the person; shuffled EMG: motion driven by the EMG of another "
    "repetition; wrong instruction: motion driven by the EMG of the person's other "
    "instructions, mean and maximum. All are aligned and scored in the same way. "
)


NO_BASELINES: Final = (
    "No other volunteer, instruction or repetition was scored, so that rho cannot be "
    "compared with baselines."
)


def baseline_table(compared: xr.Dataset) -> Table:
    """Tabulate rho, baselines, gains and skill of every strategy, from `against_baselines`."""
    shown = {
        "gain_template": "gain over all persons", "gain_others": "gain over EMG of others",
        "gain_shuffled": "gain by own EMG", "gain_room": "largest gain by own EMG",
        "skill": "skill", "skill_others": "skill without own EMG",
    }  # fmt: skip
    columns = [Column("strategy"), *(Column(head) for head in HEADS)]
    for name in shown.values():
        columns += [Column(name), Column(f"{name}, lower"), Column(f"{name}, upper")]
    columns += [Column("volunteers"), Column("trials")]
    rows: list[tuple[Any, ...]] = []
    for strategy in compared["strategy"].values:
        one = selected(compared, {"strategy": strategy})
        row: list[Any] = [str(strategy), *(float(one[name]) for name in CORRELATIONS)]
        for name in shown:
            row += [float(one[name]), *map(float, one[f"{name}_interval"].values)]
        rows.append((*row, int(one["volunteers"]), int(one["trials"])))
    origin = str(compared.attrs["origin"])
    note = (
        NOTE
        + "skill: (rho - template) / (ceiling - template), ratio of the means; negative: worse "
    )
    note += f"than the template. Intervals: {100 * compared.attrs['level']:.3g} %, over volunteers."
    title = f"rho and its baselines, {recordings(origin)}"
    return Table(title, tuple(columns), tuple(rows), origin, note)


def baseline_instruction_table(cube: xr.Dataset) -> Table:
    """Tabulate rho, its baselines and the skill per instruction and strategy."""
    columns = (
        Column("instruction"), Column("strategy"), *(Column(head) for head in HEADS),
        Column("median skill"), Column("trials with skill"), Column("no room"),
    )  # fmt: skip
    cube = scored_values(complete(cube))
    rows: list[tuple[Any, ...]] = []
    for instruction in cube["instruction"].values:
        for strategy in cube["strategy"].values:
            one = selected(cube, {"instruction": instruction, "strategy": strategy})
            levels = [mean_defined(one[name]) for name in CORRELATIONS]
            skill = one["skill"].values[np.isfinite(one["skill"].values)]
            no_room = int((texts(one["skill_reason"]) == NO_ROOM).sum())
            middle = float(np.median(skill)) if len(skill) else np.nan
            rows.append((str(instruction), str(strategy), *levels, middle, len(skill), no_room))
    origin = origin_of(cube)
    title = f"rho and its baselines per instruction, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, NOTE)


def individual_table(cube: xr.Dataset) -> Table:
    """Tabulate amplitude, timing, asymmetry and variation, which a template cannot predict.

    One row per strategy and one for the template: mean |ln(amplitude ratio)| [1], mean absolute
    errors of onset and peak [s] and of the asymmetry [1], correlation of the asymmetry with the
    measured one over trials, and the correlation of deviations within an instruction.
    """
    cube = scored_values(cube)
    measured = cube["asymmetry_measured"]
    rows: list[tuple[Any, ...]] = []
    for strategy in cube["strategy"].values:
        one = selected(cube, {"strategy": strategy})
        rows.append(
            (
                str(strategy),
                mean_defined(_log_size(one["amplitude_ratio"])),
                mean_defined(abs(one["onset_error"])),
                mean_defined(abs(one["peak_error"])),
                mean_defined(abs(one["asymmetry_simulated"] - measured)),
                _correlation(one["asymmetry_simulated"], measured),
                mean_defined(one["within_rho"]),
            )
        )
    template = cube["template_asymmetry"].broadcast_like(measured)
    rows.append(
        (
            "template",
            mean_defined(_log_size(cube["template_amplitude_ratio"])),
            mean_defined(abs(cube["template_onset_error"])),
            mean_defined(abs(cube["template_peak_error"])),
            mean_defined(abs(template - measured)),
            _correlation(template, measured),
            np.nan,
        )
    )
    columns = (
        Column("strategy"), Column("|ln amplitude ratio|"), Column("|onset error|", "s", "ms", 1e3, 0),
        Column("|peak error|", "s", "ms", 1e3, 0), Column("|asymmetry error|", digits=3),
        Column("asymmetry, r"), Column("within instruction, r"),
    )  # fmt: skip
    origin = origin_of(cube)
    note = (
        "Means over trials. Times are those of the recording, before alignment; times of the "
        "template are means over the other volunteers, from the start of a trial. "
        "Asymmetry: (left - right) / (left + right). within instruction: correlation of the "
        "deviations of repetitions from the person's mean, simulated with measured; it is "
        "undefined for a motion that is the same in every repetition, and its mean over all "
        "orders of the repetitions is 0. The time of the peak of a held posture is of "
        "little significance."
    )
    title = f"measures that a template cannot predict, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, note)


def what_rho_means(compared: xr.Dataset, rho: float = 0.9) -> list[str]:
    """Explain a correlation by the result of `against_baselines`, in sentences."""
    sentences = [
        f"With a rho of {rho:.2f}, {100 * unexplained(rho):.0f} % of the amplitude of a "
        "movement remains unexplained after the best scaling; with 0.99, "
        f"{100 * unexplained(0.99):.0f} % remains unexplained."
    ]
    # The mean over strategies, whose values differ only by missing trials.
    levels = {name: mean_defined(compared[name]) for name in CORRELATIONS}
    template, ceiling = levels["template_rho"], levels["ceiling"]
    others = int(compared["template_volunteers"])
    if np.isfinite(template):
        who = f"the mean motion of {others} other volunteers"
        who = "the motion of another volunteer" if others == 1 else who
        text = f"In this study, {who} for the same instruction, without EMG, scores "
        text += f"{template:.2f} (template)"
        if np.isfinite(ceiling):
            text += (
                f"; another repetition of the same person scores {levels['repeat_rho']:.2f}, and the "
                "best motion that is the same in every repetition scores "
                f"{ceiling:.2f} (ceiling)"
            )
        sentences.append(text + ".")
        if template >= rho:
            sentences.append(
                f"A rho of {rho:.2f} therefore shows that the lips made the instructed "
                "movement, but not that the EMG contributed to the prediction, because the "
                "score of the template is at least as high."
            )
        else:
            limit = levels["template_limit"]
            more = (
                f"The mean of infinitely many volunteers would score about {limit:.2f}, because the "
                "template contains the individual parts of its few members; a prediction without EMG "
                f"can therefore exceed the template by {limit - template:.2f}. "
            )
            if limit >= rho:
                more += f"A rho of {rho:.2f} thus does not show that the EMG contributed."
            else:
                more += (
                    f"Of a rho of {rho:.2f}, {rho - limit:.2f} cannot be reached by any motion that is "
                    "common to all persons."
                )
            sentences.append(more)
        if others < 3:
            sentences.append(
                "A template of one or two volunteers is unreliable, and so are its extrapolation to "
                "all persons, gain and skill."
            )
    else:
        sentences.append("There is no other volunteer and therefore no template for comparison.")
    wrong = levels["wrong_rho"], levels["wrong_rho_max"]
    if np.isfinite(wrong[0]):
        sentences.append(
            f"The simulated motion of a wrong instruction scores {wrong[0]:.2f} on average, and "
            f"{wrong[1]:.2f} if the best of the wrong instructions is chosen in each trial."
        )
    if not np.isfinite(ceiling):
        sentences.append("No instruction was repeated; ceiling and skill are undefined.")
    return sentences + [_of_strategy(compared, str(label)) for label in compared["strategy"].values]


def comparison(
    cube: xr.Dataset, *, draws: int = 2000, seed: int = 0
) -> tuple[list[str], dict[str, Table]]:
    """Return `what_rho_means` and the tables on baselines; empty for a cube without baselines.

    `draws` and `seed` are those of the bootstrap.
    """
    if not has_baselines(cube):
        return [NO_BASELINES] if "template_rho" in cube else [], {}
    compared = against_baselines(cube, draws=draws, seed=seed)
    tables = {
        "baselines": baseline_table(compared),
        "baselines_instruction": baseline_instruction_table(cube),
        "individual": individual_table(cube),
    }
    return what_rho_means(compared), tables


def _of_strategy(compared: xr.Dataset, strategy: str) -> str:
    one = selected(compared, {"strategy": strategy})
    rho, gain, skill = (float(one[name]) for name in ("rho", "gain_template", "skill"))
    if not np.isfinite(rho):
        return f"{strategy}: no trial is scored."
    text = f"{strategy}: mean rho {rho:.2f}"
    if np.isfinite(gain):
        text += f", difference from the template of all persons {gain:+.3f}"
        text += _interval(one, "gain_template", 3)
    if np.isfinite(skill):
        text += f", skill {skill:.2f}{_interval(one, 'skill', 2)}"
        free = float(one["skill_others"])
        if np.isfinite(free):
            text += f"; with the EMG of the other volunteers instead, rho {float(one['others_rho']):.2f}"
            text += f" and skill {free:.2f}{_interval(one, 'skill_others', 2)}"
    own = float(one["gain_shuffled"])
    if np.isfinite(own):
        text += "; relative to the EMG of another repetition, the EMG of the trial changes rho by "
        text += f"{own:+.3f}"
        text += _interval(one, "gain_shuffled", 3)
        text += f" (at most {float(one['gain_room']):.3f}, 1 minus the score of another repetition)"
    n = int(one["volunteers"])
    few = too_few_volunteers(n) if np.isfinite(gain) else ""
    return f"{text} ({persons(n)}{', ' + few if few else ''})." if n else f"{text}."


def _interval(one: xr.Dataset, name: str, digits: int) -> str:
    low, high = map(float, one[f"{name}_interval"].values)
    if not np.isfinite([low, high]).all():
        return ""
    level = 100 * float(one.attrs["level"])
    return f" ({level:.3g} % interval {low:.{digits}f} to {high:.{digits}f})"


def _log_size(ratio: xr.DataArray) -> xr.DataArray:
    positive = ratio.where(ratio > 0)
    return positive.copy(data=np.abs(np.log(positive.values)))


def _correlation(x: xr.DataArray, y: xr.DataArray) -> float:
    """Pearson correlation over trials in which both are defined."""
    a, b = (
        each.transpose("volunteer", "instruction", "repetition").values.ravel() for each in (x, y)
    )
    both = np.isfinite(a) & np.isfinite(b)
    if both.sum() < 3 or np.ptp(a[both]) == 0 or np.ptp(b[both]) == 0:
        return np.nan
    return float(np.corrcoef(a[both], b[both])[0, 1])
