"""Amplitude of the motion, rho and lost stability over the largest muscle stress sigma_max.

    python -m studies.science --only strength

One study of the generated face with sigma_max as an axis. Excursions in instructed movements of this
face, and of the published one where the folder EMGFACE_SHARED has it, are compared with those of persons
(`studies.science.excursions`), which do not depend on how the volunteers were simulated.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

import emgface as ef
from analysis.figures.style import COLOURS, MARKS, blank, save, styled
from benchmarks.report import markdown
from emgface.face.file import load_face, save_face
from emgface.face.muscle_parameters import PUBLISHED_START, SIGMA_MAX
from studies.science import excursions
from studies.science.setup import RESOLUTION, finished_study, opened, plan
from studies.science.subset import (
    mean_interval,
    mean_text,
    mismatched_people,
    subset,
    subset_study,
)

LEVELS: Final = (50e3, 100e3, 150e3, 300e3)  #: [Pa]
OF_PUBLISHED: Final = (100e3, 300e3)
"""Levels [Pa] of the published face, which is compared with persons only: volunteers with generated
faces would say nothing about it, and a trial takes about 30 times as long."""
STRATEGY: Final = "act_rel"
DECISION: Final = (
    f"* **The default remains the published start of {PUBLISHED_START / 1e3:.0f} kPa.** The volunteers "
    f"favour about {SIGMA_MAX / 1e3:.0f} kPa because they are drawn there, which is no evidence about "
    "persons; in a smile, persons move farther than the face with either value. Studies on this page "
    f"set {SIGMA_MAX / 1e3:.0f} kPa, the stress of published simulations of lips and expressions "
    "(Stavness et al.), so that face and volunteers are about equally strong."
)
DRAWN_AT: Final = (80e3, 150e3)  #: range from which sigma_max of simulated volunteers is drawn [Pa]


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Sweep sigma_max on every face, write tables and figure, and describe them."""
    sweep = _sweep("generated")
    moved = pd.concat(
        [_excursions(name, path) for name, path in faces().items()], ignore_index=True
    )
    sweep.to_csv(out / "strength.csv", index=False)
    moved.to_csv(out / "excursions.csv", index=False)
    save(_draw(sweep), out / "strength.png", dpi=130)
    save(excursions.drawn(moved), out / "excursions.png", dpi=130)
    return "\n".join(
        [
            "## Amplitude and the largest muscle stress",
            "",
            f"Volunteers of the mismatched world ({sweep['volunteer'].nunique()}, instructions "
            f"{', '.join(subset())}, first repetition) are simulated with every sigma_max, strategy "
            f"{STRATEGY}. The amplitude ratio is the motion of the face over that of the volunteer, "
            "median over instructions and markers. **lowered**: share of the trials that could not be "
            "simulated with this value, so that sigma_max was lowered by 10 % until they could; "
            "**failed**: share without a score.",
            "",
            markdown(_table(sweep), ".2f"),
            "",
            "*Mean over volunteers with 95 % interval (Student's t); shares with 95 % intervals of "
            "Wilson (simulated; [values of each volunteer](strength.csv)).*",
            "",
            "![Amplitude ratio, rho and lowered trials over sigma_max (simulated)](strength.png)",
            "",
            _reading(sweep, moved),
            "",
            markdown(excursions.compared(moved)),
            "",
            "*Full activation of the relevant muscles of Table 1 without contact (simulated; [all "
            "instructions and levels](excursions.csv)), and published excursions of persons.*",
            "",
            "![Excursion of corners and lips over sigma_max (simulated)](excursions.png)",
            "",
        ]
    )


def faces() -> dict[str, Path | None]:
    """Faces of the sweep: the generated one (None), and the file of the published one."""
    paths: dict[str, Path | None] = {"generated": None}
    shared = Path(os.environ.get("EMGFACE_SHARED", "../shared")) / "artisynth_models"
    if shared.is_dir():
        from emgface.face.artisynth import import_artisynth

        path = plan.store / "published_face.nc"
        if not path.is_file():
            save_face(import_artisynth(shared), path)
        paths["published"] = path
    return paths


def _sweep(name: str) -> pd.DataFrame:
    """Scores of the generated face with every sigma_max, one row per volunteer."""
    study = subset_study(
        mismatched_people(plan.store / f"strength-{name}"),
        f"sigma_max, {name} face",
        strategies=[STRATEGY],
        axis=[{"parameters": ["simulation.sigma_max"], "levels": list(LEVELS)}],
        simulation={"sigma_max_policy": {"scope": "trial"}},
    )
    cube = opened(finished_study(study, plan.store / f"strength-{name}"))
    return per_volunteer(cube.sel(strategy=STRATEGY), name)


def per_volunteer(cube: xr.Dataset, face: str) -> pd.DataFrame:
    """Median amplitude ratio and rho, and trials lowered or failed, per volunteer and sigma_max."""
    rows: list[dict[str, Any]] = []
    for stress in cube["simulation_sigma_max"].values.tolist():
        for volunteer in cube["volunteer"].values.tolist():
            one = cube.sel(simulation_sigma_max=stress, volunteer=volunteer)
            scored = one["status"].values == "ok"
            used = one["sigma_max"].values
            rows.append(
                {
                    "face": face,
                    "sigma_max [Pa]": stress,
                    "volunteer": volunteer,
                    "amplitude ratio": _median(one["amplitude_ratio"].values),
                    "rho": _median(one["rho"].values),
                    "trials": scored.size,
                    "lowered": int((used[scored] < stress * (1 - 1e-9)).sum()),
                    "failed": int((~scored).sum()),
                }
            )
    return pd.DataFrame(rows)


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else np.nan


def wilson(count: int, total: int, z: float = 1.959964) -> tuple[float, float]:
    """Interval of a share, Wilson 1927: (p + z^2/2n +- z sqrt(p (1-p)/n + z^2/4n^2)) / (1 + z^2/n)."""
    p, ratio = count / total, z * z / total
    middle = (p + 0.5 * ratio) / (1.0 + ratio)
    reach = z * np.sqrt(p * (1.0 - p) / total + 0.25 * ratio / total) / (1.0 + ratio)
    return max(0.0, middle - reach), min(1.0, middle + reach)


def stress_of_equal_motion(sweep: pd.DataFrame) -> tuple[float, int]:
    """sigma_max [Pa] at which the geometric mean of the ratio is 1, and how many volunteers reach 1.

    Linear in the logarithms of sigma_max and ratio; NaN if the mean is not 1 within the levels.
    """
    wide = sweep.pivot_table(index="sigma_max [Pa]", columns="volunteer", values="amplitude ratio")
    log_ratio = np.log(wide.to_numpy())
    stress = np.log(wide.index.to_numpy(dtype=np.float64))
    mean = np.maximum.accumulate(log_ratio.mean(axis=1))
    reached = (log_ratio.min(axis=0) <= 0.0) & (log_ratio.max(axis=0) >= 0.0)
    return float(np.exp(np.interp(0.0, mean, stress, np.nan, np.nan))), int(reached.sum())


def _excursions(name: str, path: Path | None) -> pd.DataFrame:
    """Excursions of one face at the levels of its sweep."""
    face = ef.face(resolution=RESOLUTION) if path is None else load_face(path)
    levels = LEVELS if path is None else OF_PUBLISHED
    # a movement of the published face takes about a minute; only the smile is compared with persons
    movements = excursions.INSTRUCTIONS if path is None else ("D",)
    return excursions.excursions(face, name, movements, levels, plan.accuracy)


def _table(sweep: pd.DataFrame) -> pd.DataFrame:
    rows: list[dict[str, object]] = []
    for (face, stress), own in sweep.groupby(["face", "sigma_max [Pa]"], sort=False):
        row: dict[str, object] = {
            "face (simulated)": face,
            "sigma_max [kPa]": f"{float(str(stress)) / 1e3:.0f}",
        }
        for name in ("amplitude ratio", "rho"):
            mean, low, high = mean_interval(own[name].to_numpy())
            row[name] = f"{mean:.2f} ({low:.2f} to {high:.2f})"
        for name in ("lowered", "failed"):
            count, total = int(own[name].sum()), int(own["trials"].sum())
            low, high = wilson(count, total)
            row[name] = f"{count} of {total} ({low:.0%} to {high:.0%})"
        rows.append(row)
    return pd.DataFrame(rows)


@styled
def _draw(sweep: pd.DataFrame):
    """Draw ratio, rho and lowered trials over sigma_max with volunteers."""
    figure = blank(10.0, 4.2)
    panels = figure.subplots(1, 3)
    for k, (face, group) in enumerate(sweep.groupby("face", sort=False)):
        colour, shift = COLOURS[(4, 5)[k]], (1.0, 1.02)[k]
        levels = group["sigma_max [Pa]"].unique() / 1e3 * shift
        for name, panel in zip(("amplitude ratio", "rho"), panels[:2], strict=True):
            wide = group.pivot_table(index="sigma_max [Pa]", columns="volunteer", values=name)
            mean, low, high = np.array([mean_interval(row) for row in wide.to_numpy()]).T
            panel.errorbar(levels, mean, [mean - low, high - mean], color=colour, marker=MARKS[k],
                           capsize=3, label=f"{face} face: mean, 95 % interval")  # fmt: skip
            for one in wide.to_numpy().T:
                panel.plot(levels * 1.03, one, ".", color=colour, alpha=0.4, label="volunteers")
        shares = group.groupby("sigma_max [Pa]")[["lowered", "failed", "trials"]].sum()
        lost = (shares["lowered"] + shares["failed"]).to_numpy()
        share = lost / shares["trials"].to_numpy()
        bounds = np.array(
            [wilson(int(n), int(m)) for n, m in zip(lost, shares["trials"], strict=True)]
        )
        panels[2].errorbar(levels, share, [share - bounds[:, 0], bounds[:, 1] - share],
                           color=colour, marker=MARKS[k], capsize=3)  # fmt: skip
    labels = ("motion of face / motion of volunteer", "median rho of a volunteer",
              "share of trials lowered or failed")  # fmt: skip
    panels[0].set_yscale("log")
    panels[0].set_yticks([0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0], [0.3, 0.5, 0.7, 1, 1.5, 2, 3])
    panels[0].minorticks_off()
    panels[0].axhline(1.0, color="0.5", linewidth=0.8)
    panels[1].set_ylim(None, 1.0)
    panels[2].set_ylim(-0.02, 1.02)
    ticks = [level / 1e3 for level in LEVELS]
    for panel, label in zip(panels, labels, strict=True):
        panel.set_ylabel(label)
        panel.set_xscale("log")
        panel.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        panel.minorticks_off()
        panel.set_xlabel("sigma_max [kPa]")
        panel.axvspan(*(v / 1e3 for v in DRAWN_AT), color="0.92", zorder=0,
                      label="sigma_max of the volunteers")  # fmt: skip
        panel.axvline(SIGMA_MAX / 1e3, color=COLOURS[2], linewidth=1.0, linestyle=":",
                      label=f"{SIGMA_MAX / 1e3:.0f} kPa (this page)")  # fmt: skip
        panel.axvline(PUBLISHED_START / 1e3, color="0.3", linewidth=1.0, linestyle="--",
                      label=f"{PUBLISHED_START / 1e3:.0f} kPa (published start)")  # fmt: skip
    handles = dict(zip(*reversed(panels[0].get_legend_handles_labels()), strict=True))
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=3,
                  fontsize=8)  # fmt: skip
    figure.suptitle("Size and shape of the motion, and lost trials, over sigma_max (SIMULATED)")
    return figure


def _reading(sweep: pd.DataFrame, moved: pd.DataFrame) -> str:
    """Describe the table in sentences with its numbers."""
    sentences: list[str] = []
    for face, own in sweep.groupby("face", sort=False):
        equal, reached = stress_of_equal_motion(own)
        at = f"at {equal / 1e3:.0f} kPa" if np.isfinite(equal) else "at no value of the sweep"
        start, default = (
            own[own["sigma_max [Pa]"] == level] for level in (PUBLISHED_START, SIGMA_MAX)
        )
        sentences.append(
            f"* **{str(face).capitalize()} face:** on average (geometric mean) it moves as far as the "
            f"volunteers {at}; {reached} of {own['volunteer'].nunique()} volunteers have a ratio of 1 "
            f"within the sweep. Ratio and rho are {mean_text(default['amplitude ratio'])} and "
            f"{mean_text(default['rho'])} with {SIGMA_MAX / 1e3:.0f} kPa, and "
            f"{mean_text(start['amplitude ratio'])} and {mean_text(start['rho'])} with "
            f"{PUBLISHED_START / 1e3:.0f} kPa. From the latter to the former, rho changes by "
            f"{mean_text(default['rho'].to_numpy() - start['rho'].to_numpy(), '+.2f')}."
        )
    sentences.append(excursions.reading(moved))
    if "published" not in set(moved["face"]):
        sentences.append(
            "* The published face is not part of this run, because EMGFACE_SHARED does not contain it."
        )
    sentences.append(DECISION)
    sentences.append(
        "* **What no world can tell:** sigma_max of the volunteers is drawn from "
        f"{DRAWN_AT[0] / 1e3:.0f} to {DRAWN_AT[1] / 1e3:.0f} kPa, a choice of this package, so that the "
        "ratio of motions, and the stress with the highest rho, follow from an assumption. Only the "
        "comparison of excursions with those of persons, and markers of a person "
        "(`sigma_max_policy.calibration`), are evidence about people. rho does not depend on the "
        "amplitude, but on the shape of the motion, which changes with sigma_max. The activations of "
        "Eq. 8 reach 1 in every trial, those of the volunteers do not; sigma_max and the scale of the "
        "activation cannot be distinguished by the markers."
    )
    return "\n".join(sentences) + "\n"
