"""Score one muscle's sEMG against the landmarks of videos, a template and shuffled EMG.

    python -m studies.pairs FOLDER --mapping mapping.toml --muscle ZYG_L --out FOLDER

Every trial is a file of EMG, ``NAME_emg.csv`` (text export of EMGworks or Trigno Discover, or any
recording that the package reads), and a table of landmarks, ``NAME_landmarks.csv``.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

import emgface as ef
from analysis.figures.style import COLOURS, blank, save, styled
from benchmarks.report import markdown
from emgface.errors import DataError
from emgface.files import replace_file
from emgface.recordings.dataset import read_recording
from studies.pairs.landmarks import corner_excursion
from studies.pairs.scores import NAMES, STEP, Floats, Trial, differences, scored
from studies.science.subset import mean_text

EMG, LANDMARKS = "_emg", "_landmarks.csv"
MECHANICS = {"accuracy": "draft", "contact": {"method": "none"}, "step": STEP, "output": STEP}


def pairs(folder: Path) -> tuple[list[tuple[Path, Path]], list[str]]:
    """Files of EMG with their landmarks, and the names of trials that lack one of both."""
    emg = {p.stem.removesuffix(EMG): p for p in folder.iterdir() if p.stem.endswith(EMG)}
    seen = {p.name.removesuffix(LANDMARKS): p for p in folder.glob(f"*{LANDMARKS}")}
    both = sorted({*emg} & {*seen})
    return [(emg[name], seen[name]) for name in both], sorted({*emg} ^ {*seen})


def predicted(recording: xr.Dataset, muscle: str, face: xr.Dataset) -> tuple[Floats, Floats]:
    """Time [s] and excursion [mm] of the mouth corner, in the frontal plane, driven by one muscle."""
    activation = ef.activate(
        recording, strategy="act_all", missing_side="leave_out", missing_muscle="leave_out"
    )
    others = [m for m in activation["muscle"].values if str(m) != muscle]
    activation["activation"].loc[{"muscle": others}] = 0.0
    motion = ef.simulate(activation, face, progress=False, **MECHANICS)
    corner = "corner_left" if muscle.endswith("_L") else "corner_right"
    x = motion["position"].sel(marker=corner, axis=["x", "z"]).transpose("time", "axis").values
    start = float(activation["time"][0])
    return motion["time"].values + start, 1e3 * np.linalg.norm(x - x[0], axis=1)


def labelled_simulated(folder: Path) -> bool:
    """Whether the README of a folder says that its recordings are simulated."""
    note = folder / "README.md"
    return note.is_file() and "simulated" in note.read_text(encoding="utf-8").lower()


def trials_of(folder: Path, mapping: Path | None, muscle: str) -> tuple[list[Trial], bool]:
    """Trials of a folder, and whether they are simulated.

    Raises
    ------
    DataError
        The folder has no pair, a pair lacks the muscle or its time, or a file cannot be read.
    """
    paired, lone = pairs(folder)
    if not paired:
        raise DataError(
            f"{folder} contains no pair of NAME{EMG}.csv and NAME{LANDMARKS}"
            + (f", only {', '.join(lone)}" if lone else "")
        )
    for name in lone:
        print(f"{name}: one file of the pair is absent, and the trial is left out")
    face, trials = ef.face(resolution="coarse"), list[Trial]()
    for emg, landmarks in paired:
        recording = read_recording(emg, mapping=mapping)
        if muscle not in recording["channel"].values:
            raise DataError(
                f"{emg.name} has the channels {', '.join(map(str, recording['channel'].values))}, "
                f"expected {muscle}: map its label in the mapping"
            )
        seen = corner_excursion(landmarks, muscle[-1])
        time, moved = predicted(recording.sel(channel=[muscle]), muscle, face)
        begin, end = max(time[0], seen.time[0]), min(time[-1], seen.time[-1])
        if end - begin < 10 * STEP:
            raise DataError(
                f"{emg.name} and {landmarks.name} have no common time, expected both in seconds since "
                "the start of the same trial"
            )
        at, known = np.arange(begin, end, STEP), np.isfinite(seen.value)
        measured = np.interp(at, seen.time[known], seen.value[known])
        repetition = int(recording.attrs.get("repetition", 1))
        labels = (str(recording.attrs.get(key, "")) for key in ("volunteer", "instruction"))
        trials.append(Trial(*labels, repetition, measured, np.interp(at, time, moved)))
    return trials, labelled_simulated(folder)


def reading(table: pd.DataFrame, muscle: str, *, simulated: bool) -> str:
    """Table with a conclusion for each comparison."""
    kind = "SIMULATED recordings" if simulated else "measured recordings"
    lines = [
        f"# {muscle} and the corner of the mouth, {kind}", "", markdown(table, ".2f"), "",
        "Mean rho: " + ", ".join(f"{name} {table[name].mean():.2f}" for name in NAMES) + ".", "",
    ]  # fmt: skip
    for name, values in differences(table).items():
        if not np.isfinite(values).any():
            lines.append(f"* EMG minus {name}: not defined, because no trial has one.")
            continue
        lines.append(
            f"* EMG minus {name}: {mean_text(values, '+.2f')} over {len(values)} volunteers"
            + ("." if len(values) >= 5 else "; fewer than 5 volunteers give no interval.")
        )
    lines.append(
        "* The template knows the instruction and the onset, but no EMG. Only a difference from the "
        "shuffled EMG that is above 0 shows that the EMG of the trial is informative beyond the habit "
        "of the person."
    )
    return "\n".join(lines) + "\n"


@styled
def drawn(trials: list[Trial], table: pd.DataFrame, *, simulated: bool):
    """Draw measured and predicted excursions of up to four trials, and the correlations of all."""
    figure = blank(11.0, 3.2)
    shown = trials[:4]
    panels = figure.subplots(1, len(shown) + 1)
    for panel, one in zip(panels, shown, strict=False):
        at = STEP * np.arange(len(one.measured))
        panel.plot(at, one.measured / np.nanmax(one.measured), color="black", label="video")
        top = np.nanmax(one.predicted) or 1.0
        panel.plot(at, one.predicted / top, color=COLOURS[0], label="EMG, face")
        panel.set_title(f"{one.volunteer} {one.instruction} {one.repetition}", fontsize=9)
        panel.set_xlabel("time [s]")
    panels[0].set_ylabel("excursion over its largest")
    panels[0].legend(fontsize=7)
    for k, name in enumerate(NAMES):
        panels[-1].plot(np.full(len(table), k), table[name], ".", color=COLOURS[k])
        panels[-1].plot(k, table[name].mean(), "_", color=COLOURS[k], markersize=18)
    panels[-1].set_xticks(range(len(NAMES)), NAMES, rotation=20, fontsize=7)
    panels[-1].set_xlim(-0.6, len(NAMES) - 0.4)
    panels[-1].set_title("rho of all trials", fontsize=9)
    if simulated:
        figure.suptitle("SIMULATED recordings", fontsize=9)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Score a folder; write ``pairs.csv``, ``pairs.md`` and ``pairs.png``."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--mapping", type=Path)
    parser.add_argument("--muscle", default="ZYG_L")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    trials, simulated = trials_of(given.folder, given.mapping, given.muscle)
    table = scored(trials)
    given.out.mkdir(parents=True, exist_ok=True)
    text = reading(table, given.muscle, simulated=simulated)
    replace_file(given.out / "pairs.csv", lambda path: table.to_csv(path, index=False))
    replace_file(given.out / "pairs.md", lambda path: path.write_text(text, encoding="utf-8"))
    save(drawn(trials, table, simulated=simulated), given.out / "pairs.png", dpi=120)
    print(text)


if __name__ == "__main__":
    try:
        main()
    except DataError as error:
        raise SystemExit(str(error)) from error
