"""Tables and sentences that compare the scores of a study with baselines and ceilings."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.baselines import has_baselines, unexplained
from analysis.statistics.finding import persons
from analysis.statistics.scope import too_few_volunteers
from analysis.statistics.skill import LEVELS, against_baselines
from analysis.tables import Column, Table, origin_of, recordings
from analysis.typed import selected, texts

HEADS: Final = (
    "rho", "template", "repeat", "ceiling", "shuffled EMG", "wrong instruction", "best wrong",
)  # fmt: skip
"""Heads of `LEVELS`."""
NOTE: Final = (
    "Means over markers and trials. template: mean motion of the other volunteers, without EMG; "
    "repeat: another repetition of the person; ceiling: the best motion that is the same in every "
    "repetition; shuffled EMG: motion driven by the EMG of another repetition; wrong instruction: by "
    "that of the person's other instructions, their mean and the best of them. All are aligned and "
    "scored alike. "
)


NOTHING: Final = (
    "No other volunteer, instruction or repetition was scored: nothing says what rho is worth here."
)


def baseline_table(found: xr.Dataset) -> Table:
    """List rho of every strategy beside its baselines, with gains and skill.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `analysis.statistics.skill.against_baselines`.

    Returns
    -------
    Table
        One row per strategy: means of `LEVELS`; gain over the template, gain by the trial's own EMG
        and skill, each with the bounds of its interval; volunteers and trials.
    """
    shown = {
        "gain_template": "gain over template",
        "gain_shuffled": "gain by own EMG",
        "skill": "skill",
    }
    columns = [Column("strategy"), *(Column(head) for head in HEADS)]
    for name in shown.values():
        columns += [Column(name), Column(f"{name}, lower"), Column(f"{name}, upper")]
    columns += [Column("volunteers"), Column("trials")]
    rows: list[tuple[Any, ...]] = []
    for strategy in found["strategy"].values:
        one = selected(found, {"strategy": strategy})
        row: list[Any] = [str(strategy), *(float(one[name]) for name in LEVELS)]
        for name in shown:
            row += [float(one[name]), *map(float, one[f"{name}_interval"].values)]
        rows.append((*row, int(one["volunteers"]), int(one["trials"])))
    origin = str(found.attrs["origin"])
    note = NOTE + "skill: share of the way from template to ceiling, of the means; negative: worse "
    note += f"than the template. Intervals: {100 * found.attrs['level']:.3g} %, over volunteers."
    title = f"rho beside its baselines, {recordings(origin)}"
    return Table(title, tuple(columns), tuple(rows), origin, note)


def baseline_instruction_table(cube: xr.Dataset) -> Table:
    """List rho beside its baselines per instruction and strategy.

    Parameters
    ----------
    cube : xarray.Dataset
        With baselines, without further axes.

    Returns
    -------
    Table
        One row per instruction and strategy: means of `LEVELS`, median skill of the trials, trials
        with a skill, and trials whose ceiling leaves no room above the template.
    """
    columns = (
        Column("instruction"), Column("strategy"), *(Column(head) for head in HEADS),
        Column("median skill"), Column("trials with skill"), Column("no room"),
    )  # fmt: skip
    rows: list[tuple[Any, ...]] = []
    for instruction in cube["instruction"].values:
        for strategy in cube["strategy"].values:
            one = selected(cube, {"instruction": instruction, "strategy": strategy})
            ok = texts(one["status"]) == "ok"
            levels = [_mean(one[name].where(ok)) for name in LEVELS]
            skill = one["skill"].values[np.isfinite(one["skill"].values)]
            no_room = int((texts(one["skill_reason"]) == "no room above the template").sum())
            middle = float(np.median(skill)) if len(skill) else np.nan
            rows.append((str(instruction), str(strategy), *levels, middle, len(skill), no_room))
    origin = origin_of(cube)
    title = f"rho beside its baselines per instruction, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, NOTE)


def individual_table(cube: xr.Dataset) -> Table:
    """List what a template cannot win: size, timing, asymmetry and variation within instructions.

    Parameters
    ----------
    cube : xarray.Dataset
        With baselines, without further axes.

    Returns
    -------
    Table
        One row per strategy and one for the template: mean |ln(amplitude ratio)| [1], mean absolute
        errors of onset and peak [s] and of the asymmetry [1], correlation of the asymmetry with the
        measured one over trials, and the correlation of deviations within an instruction.
    """
    measured = cube["asymmetry_measured"]
    rows: list[tuple[Any, ...]] = []
    for strategy in cube["strategy"].values:
        one = selected(cube, {"strategy": strategy})
        ok = texts(one["status"]) == "ok"
        rows.append(
            (
                str(strategy),
                _mean(_log_size(one["amplitude_ratio"].where(ok))),
                _mean(abs(one["onset_error"])),
                _mean(abs(one["peak_error"])),
                _mean(abs(one["asymmetry_simulated"] - measured)),
                _correlation(one["asymmetry_simulated"], measured),
                _mean(one["within_rho"]),
            )
        )
    template = cube["template_asymmetry"].broadcast_like(measured)
    rows.append(
        (
            "template",
            _mean(_log_size(cube["template_amplitude_ratio"])),
            _mean(abs(cube["template_onset_error"])),
            _mean(abs(cube["template_peak_error"])),
            _mean(abs(template - measured)),
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
        "Means over trials. Timing is on the clock of the recording, before alignment; the template's "
        "is the mean of the other volunteers, from the start of a trial. Asymmetry: (left - right) / "
        "(left + right). within instruction: correlation of the deviations of repetitions from the "
        "person's mean, simulated with measured; a motion that is the same every time has none, and "
        "its mean over all orders of the repetitions is 0. The peak of a posture that is held says "
        "little."
    )
    title = f"what a template cannot predict, {recordings(origin)}"
    return Table(title, columns, tuple(rows), origin, note)


def what_rho_means(found: xr.Dataset, rho: float = 0.9) -> list[str]:
    """Say plainly what a correlation means in a study.

    Parameters
    ----------
    found : xarray.Dataset
        Result of `analysis.statistics.skill.against_baselines`.
    rho : float
        The correlation to explain.

    Returns
    -------
    list of str
        Sentences: what rho leaves open, what scores without the trial's EMG, what follows, and one
        per strategy.
    """
    told = [
        f"A rho of {rho:.2f} leaves {100 * unexplained(rho):.0f} % of the size of a movement "
        f"unexplained after the best scaling, one of 0.99 leaves {100 * unexplained(0.99):.0f} %."
    ]
    levels = {name: _first(found[name].values) for name in LEVELS}
    template, ceiling = levels["template_rho"], levels["ceiling"]
    others = int(found["template_volunteers"])
    if np.isfinite(template):
        who = f"the mean motion of {others} other volunteers"
        who = "the motion of another volunteer" if others == 1 else who
        text = f"In this study {who} at the same instruction, without any EMG, scores "
        text += f"{template:.2f} (template)"
        if np.isfinite(ceiling):
            text += (
                f", another repetition of the same person {levels['repeat_rho']:.2f}, and the best "
            )
            text += f"motion that is the same in every repetition {ceiling:.2f} (ceiling)"
        told.append(text + ".")
        if template >= rho:
            told.append(
                f"A rho of {rho:.2f} thus says that the lips made the movement that was asked for; it "
                "does not say that the EMG was needed to know it, since the template knows more."
            )
        else:
            told.append(
                f"A rho of {rho:.2f} is more than the template reaches: {rho - template:.2f} of it "
                "is about this person or trial."
            )
        if others < 3:
            told.append(
                "A template of one or two volunteers is poor; the mean of more would score higher, so "
                "that gain and skill are flattered."
            )
    else:
        told.append("There is no other volunteer, so there is no template to compare with.")
    wrong = levels["wrong_rho"], levels["wrong_rho_max"]
    if np.isfinite(wrong[0]):
        told.append(
            f"The simulated motion of a wrong instruction scores {wrong[0]:.2f} on average, and "
            f"{wrong[1]:.2f} where the best of them is taken."
        )
    if not np.isfinite(ceiling):
        told.append("No instruction was repeated, so that ceiling and skill are unknown.")
    return told + [_of_strategy(found, str(label)) for label in found["strategy"].values]


def comparison(cube: xr.Dataset, *, seed: int = 0) -> tuple[list[str], dict[str, Table]]:
    """Return the sentences and tables on baselines; none of an older cube, which lacks them.

    Parameters
    ----------
    cube : xarray.Dataset
        Without further axes.
    seed : int
        Of the bootstrap.

    Returns
    -------
    list of str
        `what_rho_means`.
    dict of str to Table
        ``baselines``, ``baselines_instruction`` and ``individual``.
    """
    if not has_baselines(cube):
        return [NOTHING] if "template_rho" in cube else [], {}
    found = against_baselines(cube, seed=seed)
    tables = {
        "baselines": baseline_table(found),
        "baselines_instruction": baseline_instruction_table(cube),
        "individual": individual_table(cube),
    }
    return what_rho_means(found), tables


def _of_strategy(found: xr.Dataset, strategy: str) -> str:
    one = selected(found, {"strategy": strategy})
    rho, gain, skill = (float(one[name]) for name in ("rho", "gain_template", "skill"))
    if not np.isfinite(rho):
        return f"{strategy}: no trial is scored."
    text = f"{strategy}: mean rho {rho:.2f}"
    if np.isfinite(gain):
        text += f", less the template {gain:+.3f}{_interval(one, 'gain_template', 3)}"
    if np.isfinite(skill):
        text += f", skill {skill:.2f}{_interval(one, 'skill', 2)}"
    own = float(one["gain_shuffled"])
    if np.isfinite(own):
        text += f"; the EMG of the trial itself adds {own:+.3f} to that of another repetition"
        text += _interval(one, "gain_shuffled", 3)
    n = int(one["volunteers"])
    few = too_few_volunteers(n) if np.isfinite(gain) else ""
    return f"{text} ({persons(n)}{', ' + few if few else ''})." if n else f"{text}."


def _interval(one: xr.Dataset, name: str, digits: int) -> str:
    low, high = map(float, one[f"{name}_interval"].values)
    if not np.isfinite([low, high]).all():
        return ""
    level = 100 * float(one.attrs["level"])
    return f" ({level:.3g} % interval {low:.{digits}f} to {high:.{digits}f})"


def _mean(data: xr.DataArray) -> float:
    """Mean of what is defined."""
    values = data.values[np.isfinite(data.values)]
    return float(values.mean()) if len(values) else np.nan


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


def _first(values: Sequence[float] | np.ndarray) -> float:
    """Mean over strategies of what is the same for all but for the trials they lack."""
    values = np.asarray(values, dtype=np.float64)
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan
