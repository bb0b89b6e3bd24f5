"""Activations estimated from markers and sEMG, compared with estimates without data of the person.

    python -m studies.science --only inverse

Volunteers of the mismatched world are inverted on the template face. Estimates are compared with the
true activation, and with nulls that contain neither markers nor sEMG of the trial: the sEMG-driven
activation of the other volunteers, and random activations that no table of instructions made. The
deviations from the mean of the other volunteers (`studies.science.deviations`) remove what all persons
share in an instruction.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

import emgface as ef
from analysis.figures.style import COLOURS, blank, save, styled
from benchmarks.report import markdown
from emgface.inverse.many import invert_all
from emgface.inverse.parameters import InverseParameters
from emgface.recordings.dataset import read_recording
from emgface.recordings.head import in_head_frame
from emgface.schema.netcdf import read_netcdf
from emgface.signals.parameters import HeadFrameParameters
from studies.science.deviations import (
    Floats,
    Trials,
    agreement,
    deviation_agreement,
    explained,
    mean_of_others,
    of_other_volunteers,
    random_activations,
    spread_of_deviations,
)
from studies.science.setup import RESOLUTION, plan, study_of
from studies.science.subset import mean_interval, mean_text, mismatched_people
from studies.science.verdict import (
    DRAWS,
    SEMG,
    TARGET,
    controls,
    controls_of_difference,
    differences,
    power_sentences,
    smallest_difference,
    verdict,
)

INSTRUCTIONS: Final = ("A", "D")
REPETITION: Final = 1
SETTINGS: Final = ("step:motion", "step:assisted", "trajectory:motion", "trajectory:assisted")
ITERATIONS: Final = InverseParameters().iterations
"""Largest number of iterations of the trajectory form; with 4, no fit of these trials converges."""
BEFORE: Final = 0.5
AFTER: Final = 1.0
STEP: Final = 0.02
"""Time around the onset of the motion in which activations are compared, and its sampling [s]."""
ONSET: Final = 0.5  #: share of the largest displacement that defines the onset
INFERRED: Final = ("LAO", "BUC", "OOM", "DLI")
"""Muscles without electrodes, whose sEMG is that of others (Eqs 2-6)."""


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Invert the volunteers, write table and figure, and describe them."""
    estimates, truth, trials, muscles, fits = estimated()
    table = scores(estimates, truth, trials, muscles)
    fits.to_csv(out / "inverse_fits.csv", index=False)
    power = controls(truth, trials), controls_of_difference(truth, trials, table)
    gains = increments(estimates, truth, trials, muscles)
    table.to_csv(out / "inverse.csv", index=False)
    power[0].to_csv(out / "inverse_controls.csv", index=False)
    power[1].to_csv(out / "inverse_differences.csv", index=False)
    gains.to_csv(out / "inverse_gains.csv", index=False)
    save(_draw(table, power[1]), out / "inverse.png", dpi=130)
    return text(table, power, gains, fits)


def estimated() -> tuple[dict[str, Floats], Floats, Trials, list[str], pd.DataFrame]:
    """Estimates of every setting and the truth (trial, muscle, sample), trials, muscles and fits.

    A fit that did not converge is an estimate as well; the table of fits says so for every trial.
    """
    recordings = mismatched_people(plan.store / "inverse" / SETTINGS[-1].replace(":", "_"))
    files = sorted(
        path
        for path in recordings.glob(f"*_{REPETITION}.nc")
        if path.stem.split("_")[1] in INSTRUCTIONS
    )
    study = study_of(recordings, "inverse")
    face = ef.face(resolution=RESOLUTION)
    samples: dict[str, list[Floats]] = {}
    for setting in SETTINGS:
        form, variant = setting.split(":")
        folder = plan.store / "inverse" / setting.replace(":", "_")
        parameters = InverseParameters(
            form=form,  # pyright: ignore[reportArgumentType]
            variant=variant,  # pyright: ignore[reportArgumentType]
            iterations=ITERATIONS,
        )
        invert_all(
            files, face, study, folder, parameters, workers=plan.workers, observer=plan.observer
        )
        samples[setting] = []
    samples[SEMG], truth, labels = [], list[Floats](), list[tuple[str, str]]()
    fits: list[dict[str, Any]] = []
    names = [str(m) for m in face["muscle"].values]
    for path in files:
        results = {s: plan.store / "inverse" / s.replace(":", "_") / path.name for s in SETTINGS}
        recording = read_recording(path)
        label = str(recording.attrs["volunteer"]), str(recording.attrs["instruction"])
        for setting, file in results.items():
            fits.append({"setting": setting, "volunteer": label[0], "instruction": label[1]})
            fits[-1] |= _state_of(file)
        if not all(one.is_file() for one in results.values()):
            continue  # a trial that a setting could not invert is compared in none
        at = onset(recording) + np.arange(-BEFORE, AFTER + 0.5 * STEP, STEP)
        for setting, file in results.items():
            one = read_netcdf(file, "activation")
            samples[setting].append(sampled(one["activation"].sel(muscle=names), at))
        semg = read_netcdf(results[SETTINGS[-1]], "activation")["emg_activation"]
        samples[SEMG].append(sampled(semg.sel(muscle=names), at))
        true = recording["true_activation"].rename(time_true="time").sel(muscle=names)
        truth.append(sampled(true, at))
        labels.append(label)
    trials = Trials(tuple(v for v, _ in labels), tuple(i for _, i in labels))
    estimates = {k: np.array(v) for k, v in samples.items()}
    return estimates, np.array(truth), trials, names, pd.DataFrame(fits)


def _state_of(file: Path) -> dict[str, Any]:
    """State of an inversion: "converged", "not converged", "no iterations" or "failed", and misfit."""
    if not file.is_file():
        return {"state": "failed", "misfit ratio": np.nan}
    attrs = read_netcdf(file, "activation").attrs
    state = "no iterations"
    if "converged" in attrs:
        state = "converged" if int(attrs["converged"]) else "not converged"
    return {"state": state, "misfit ratio": float(attrs["misfit_ratio"])}


def onset(recording: xr.Dataset) -> float:
    """Time at which the lip markers have made half of their largest displacement [s]."""
    lips = in_head_frame(recording["position"], HeadFrameParameters())
    time = lips["time_marker"].values
    moved = lips - lips.isel(time_marker=time <= time[0] + 0.1).mean("time_marker")
    size = np.sqrt((moved**2).sum("axis")).mean("marker").values
    return float(time[int((size > ONSET * np.nanmax(size)).argmax())])


def sampled(activation: xr.DataArray, at: Floats) -> Floats:
    """Activation (muscle, sample) at times [s], 0 outside of the trial."""
    values = activation.transpose("muscle", "time")
    time = values["time"].values
    return np.array([np.interp(at, time, row, left=0.0, right=0.0) for row in values.values])


def scores(
    estimates: Mapping[str, Floats], truth: Floats, trials: Trials, muscles: Sequence[str]
) -> pd.DataFrame:
    """Correlations of estimates and nulls with the truth, one row per estimate and volunteer."""
    rng = np.random.default_rng(46)
    free = [k for k, m in enumerate(muscles) if m.rpartition("_")[0] in INFERRED]
    own = [k for k in range(len(muscles)) if k not in free]
    semg, n = estimates[SEMG], len(trials.persons)
    made: dict[str, list[Floats]] = {name: [one] for name, one in estimates.items()}
    made["null: sEMG of the others, mean"] = [mean_of_others(semg, trials)]
    made["null: sEMG of another volunteer"] = [
        of_other_volunteers(semg, trials, k) for k in range(n - 1)
    ]
    made["null: true mean of the others"] = [mean_of_others(truth, trials)]
    made["null: random activations"] = [
        random_activations(truth.shape, rng)  # pyright: ignore[reportArgumentType]
        for _ in range(DRAWS)
    ]
    rows: list[dict[str, Any]] = []
    for name, drawn in made.items():
        columns: dict[str, Callable[[Floats], Floats]] = {
            "correlation": lambda e: agreement(e, truth, trials),
            "of deviations": lambda e: deviation_agreement(e, truth, trials),
            "of deviations, with electrode": lambda e: deviation_agreement(e, truth, trials, own),
            "of deviations, without": lambda e: deviation_agreement(e, truth, trials, free),
        }
        # The mean of the others contains nothing of the person: its deviations are not defined.
        constant = name in ("null: sEMG of the others, mean", "null: true mean of the others")
        values = {
            column: np.full(n, np.nan)
            if constant and column != "correlation"
            else np.mean([score(e) for e in drawn], axis=0)
            for column, score in columns.items()
        }
        rows += [
            {"estimate": name, "volunteer": person, **{c: v[k] for c, v in values.items()}}
            for k, person in enumerate(trials.persons)
        ]
    return pd.DataFrame(rows)


def increments(
    estimates: Mapping[str, Floats], truth: Floats, trials: Trials, muscles: Sequence[str]
) -> pd.DataFrame:
    """Share of the true deviations predicted by sEMG, by motion and by both, per volunteer."""
    motion = estimates["trajectory:motion"]
    free = [k for k, m in enumerate(muscles) if m.rpartition("_")[0] in INFERRED]
    own = [k for k in range(len(muscles)) if k not in free]
    rows: list[dict[str, Any]] = []
    for label, at in (("all", None), ("with electrode", own), ("without electrode", free)):
        share = {
            "sEMG": explained({"s": estimates[SEMG]}, truth, trials, at),
            "motion": explained({"m": motion}, truth, trials, at),
            "both": explained({"s": estimates[SEMG], "m": motion}, truth, trials, at),
        }
        rows += [
            {"muscles": label, "volunteer": person, **{k: v[i] for k, v in share.items()}}
            for i, person in enumerate(trials.persons)
        ]
    return pd.DataFrame(rows)


def convergence(fits: pd.DataFrame) -> str:
    """Sentences on how many fits converged, and which recordings were not inverted."""
    said: list[str] = []
    for setting, own in fits.groupby("setting", sort=False):
        if "trajectory" in str(setting):
            open_fits = own[own["state"] == "not converged"]
            names = ", ".join(f"{v} {i}" for v, i in open_fits[["volunteer", "instruction"]].values)
            done = int((own["state"] == "converged").sum())
            said.append(
                f"{done} of {len(own)} fits of {setting} converged"
                + (f" (not converged: {names})" if names else "")
            )
    failed = fits[fits["state"] == "failed"]
    lost = failed[["volunteer", "instruction"]].drop_duplicates()
    misfit = fits.groupby("setting", sort=False)["misfit ratio"].median()
    return (
        f"* **Convergence:** with at most {ITERATIONS} iterations, {' and '.join(said)}; fits that did "
        "not converge are part of the tables. "
        + (f"{len(lost)} recordings were not inverted and are left out. " if len(lost) else "")
        + "The median misfit, as a share of the motion of the markers, is "
        + ", ".join(f"{value:.2f} ({name})" for name, value in misfit.items())
        + "."
    )


def text(
    table: pd.DataFrame,
    power: tuple[pd.DataFrame, pd.DataFrame],
    gains: pd.DataFrame,
    fits: pd.DataFrame,
) -> str:
    """Describe tables and figure in sentences with their numbers; `power` of both controls."""
    used = fits.groupby(["volunteer", "instruction"], sort=False)["state"].agg(
        lambda states: "failed" not in set(states)
    )
    shown: list[dict[str, object]] = []
    for name, own in table.groupby("estimate", sort=False):
        cells = {c: _cell(own[c].to_numpy(), wider_of(c, own)) for c in table.columns[2:]}
        shown.append({"estimate (simulated)": name, **cells})
    shares: list[dict[str, object]] = []
    for label, own in gains.groupby("muscles", sort=False):
        wider = spread_of_deviations(len(own))
        cells = {c: mean_text(own[c].to_numpy(), wider=wider) for c in ("sEMG", "motion", "both")}
        cells["motion adds"] = mean_text((own["both"] - own["sEMG"]).to_numpy(), "+.2f", wider)
        cells["sEMG adds"] = mean_text((own["both"] - own["motion"]).to_numpy(), "+.2f", wider)
        shares.append({"muscles": label, **cells})
    return "\n".join(
        [
            "## Activations from motion, and what a person's own share is",
            "",
            f"{table['volunteer'].nunique()} volunteers of the mismatched world, instructions "
            f"{', '.join(fits['instruction'].unique())}, repetition {REPETITION} "
            f"({int(used.sum())} trials), are inverted on the template face with the stress "
            "of the study of this page; sEMG alone is the strategy act_all. Correlations "
            f"are over instructions, muscles and time from {BEFORE:g} s before to {AFTER:g} s after the "
            "onset of the motion. The correlation of deviations is that of estimate and truth after "
            "the mean of the other volunteers in the same instruction was subtracted from both.",
            "",
            markdown(pd.DataFrame(shown)),
            "",
            "*Mean over volunteers with 95 % interval (Student's t; simulated; [values of each "
            "volunteer](inverse.csv)). Intervals of deviations are wider by (n - 1) / (n - 2), because "
            "the mean of the others, which is a part of every deviation, makes volunteers more alike. "
            "Nulls contain neither markers nor sEMG of the trial.*",
            "",
            "![Correlation with the true activation and of deviations, and power of the comparison "
            "(simulated)](inverse.png)",
            "",
            f"* {verdict(table)}",
            convergence(fits),
            _best(table),
            "",
            "Share of the true deviations that is predicted with coefficients from the other "
            "volunteers (1 is all, 0 none, negative is worse than none), motion by the trajectory form:",
            "",
            markdown(pd.DataFrame(shares)),
            "",
            "*[Values of each volunteer](inverse_gains.csv); simulated.*",
            "",
            power_sentences(*power),
            "* **What no world can tell:** the true activations of the volunteers are drawn about one "
            "table of instructions; how far persons deviate from each other is an assumption, and "
            "sEMG and markers of a person have no known truth.",
            "",
        ]
    )


def wider_of(column: str, own: pd.DataFrame) -> float:
    """Ratio by which the interval of a column is widened (`spread_of_deviations`)."""
    return spread_of_deviations(len(own)) if column.startswith("of deviations") else 1.0


def _cell(values: Floats, wider: float) -> str:
    return mean_text(values, wider=wider) if np.isfinite(values).any() else "not defined"


def _best(table: pd.DataFrame) -> str:
    mean = table.groupby("estimate", sort=False)["correlation"].mean()
    nulls = mean[mean.index.str.startswith("null")]
    own = mean.drop(nulls.index)
    return (
        f"* The correlation itself does not show what is known of a person: the best estimate reaches "
        f"{own.max():.2f} ({own.idxmax()}), {nulls.idxmax().removeprefix('null: ')} "
        f"{nulls.max():.2f}, the mean sEMG of the others "
        f"{nulls['null: sEMG of the others, mean']:.2f}, and random activations "
        f"{nulls['null: random activations']:.2f}."
    )


@styled
def _draw(table: pd.DataFrame, of_difference: pd.DataFrame):
    """Draw both correlations of every estimate, and the power of the comparison with sEMG alone."""
    figure = blank(11.5, 4.4)
    panels = figure.subplots(1, 3, width_ratios=(1.0, 1.0, 0.7))
    names = list(dict.fromkeys(table["estimate"]))
    for panel, column in zip(panels, ("correlation", "of deviations"), strict=False):
        for k, name in enumerate(names):
            values = table[table["estimate"] == name][column].to_numpy()
            if not np.isfinite(values).any():
                panel.text(0.02, k, "not defined", fontsize=7, va="center")
                continue
            wider = wider_of(column, table[table["estimate"] == name])
            mean, low, high = mean_interval(values, wider)
            colour = "0.4" if name.startswith("null") else COLOURS[4]
            panel.errorbar(mean, k, xerr=[[mean - low], [high - mean]], fmt="o", color=colour,
                           capsize=3)  # fmt: skip
            panel.plot(values, np.full(values.size, k + 0.2), ".", color=colour, alpha=0.5)
        panel.axvline(0.0, color="0.6", linewidth=0.8)
        panel.set_yticks(range(len(names)), names if panel is panels[0] else [""] * len(names))
        panel.set_ylim(len(names) - 0.5, -0.5)
        panel.set_xlabel("correlation" if column == "correlation" else f"correlation {column}")
    panels[0].set_title("estimated and true activation", fontsize=9)
    panels[1].set_title("deviations from the other volunteers", fontsize=9)
    smallest = smallest_difference(differences(table))
    panels[2].plot(of_difference["true"], of_difference["found"], marker="o", color=COLOURS[4])
    panels[2].axhline(TARGET, color="0.6", linewidth=0.8, linestyle=":")
    panels[2].axvline(smallest, color="0.6", linewidth=0.8, linestyle=":")
    panels[2].text(smallest, 0.02, f" detectable: {smallest:.2f}", fontsize=8)
    panels[2].set_ylim(0.0, 1.02)
    panels[2].set_xlabel("true difference of two estimates")
    panels[2].set_ylabel("share of draws in which it is found")
    panels[2].set_title("power of the comparison", fontsize=9)
    figure.suptitle(
        "Activations from motion and sEMG (SIMULATED); means with 95 % intervals, dots: volunteers"
    )
    return figure
