"""Moving faces of a report: one trial per instruction, with every strategy."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.muscles import INSTRUCTIONS
from emgface.pictures.body import Body, Skin, body_of, skin_of
from emgface.pictures.encoding import (
    body_data,
    deltas,
    levels,
    measured_frames,
    middle_of,
    muscle_names,
    scaling,
    whole,
)
from emgface.pictures.lips import lips_of_motion
from emgface.report.results import FAILURES, ReportedTrial, Results, representative

MOST_MOTION_CHARACTERS: Final = 9_000_000
"""Limit of the characters of all motions, above which every second frame is omitted."""

Say = Callable[[str, int, int], None]


def moving_faces(
    results: Results, say: Say | None = None
) -> tuple[xr.Dataset, Body, dict[str, Any]] | None:
    """Simulate the skin in the representative trial of each instruction.

    Returns the faces at their largest displacement (for `emgface.report.faces.study_faces`), their
    drawn surface, and surface and motions for the page; None if there is no trial to show. Failures
    are noted in `results`; `say` receives label, completed number and total.
    """
    if results.laboratory is None:
        return None
    skin = skin_of(results.laboratory.face)
    chosen = representative(results.base)
    strategies = [str(s) for s in results.base["strategy"].values]
    wanted = [(place, strategy) for place in chosen.values() for strategy in strategies]
    shown: list[tuple[ReportedTrial, xr.Dataset]] = []
    for done, (place, strategy) in enumerate(wanted):
        label = " ".join(map(str, (*place, strategy)))
        if say:
            say(label, done, len(wanted))
        where = {"volunteer": place[0], "instruction": place[1], "repetition": place[2]}
        cell = results.base.sel(where | {"strategy": strategy})
        if str(cell["status"].values) != "ok":
            continue
        try:
            trial = results.trial(place, strategy)
            assert results.laboratory is not None
            activation = trial.activation["activation"]
            sigma_max = float(trial.motion.attrs["sigma_max"])
            own = results.laboratory.for_volunteer(place[0])
            moved = own.skin_motion(activation, sigma_max, label).dataset
        except FAILURES as error:
            results.notes.append(f"The moving face of {label} is omitted: {error}")
            continue
        change = float(abs(trial.scores["rho"] - cell["rho"]).max())
        if change > 1e-6:
            results.notes.append(
                f"{label} was computed again by this version of the package; the new rho differs "
                f"from that in the cube by up to {change:.2g}: run the study again before "
                "using the report."
            )
        shown.append((trial, moved))
    if not shown:
        return None
    body = body_of(results.laboratory.face, skin)
    farthest = _farthest(shown, skin, list(chosen), strategies)
    return farthest, body, _encoded(shown, skin, body, results)


def _farthest(
    shown: list[tuple[ReportedTrial, xr.Dataset]],
    skin: Skin,
    instructions: list[str],
    strategies: list[str],
) -> xr.Dataset:
    """Faces at the frame of the largest marker displacement."""
    size = (len(instructions), len(strategies))
    position = np.full((*size, len(skin.node), 3), np.nan)
    n_markers = shown[0][1].sizes["marker"]
    marks = {name: np.full((*size, n_markers, 3), np.nan) for name in ("simulated", "measured")}
    for trial, moved in shown:
        at = instructions.index(trial.place[1]), strategies.index(trial.strategy)
        own = moved["position"].transpose("time", "marker", "axis").values
        frame = int(np.argmax(((own - own[0]) ** 2).sum(axis=(1, 2))))
        position[at] = moved["surface_position"].values[frame]
        marks["simulated"][at] = own[frame]
        marks["measured"][at] = measured_frames(trial.aligned, moved)[frame]
    dims = ("instruction", "strategy")
    metres = {"units": "m"}
    return xr.Dataset(
        {
            "position": ((*dims, "node", "axis"), position, metres),
            **{name: ((*dims, "marker", "axis"), each, metres) for name, each in marks.items()},
        },
        coords={"instruction": instructions, "strategy": strategies, "axis": ["x", "y", "z"]},
        attrs={
            key: str(value)
            for key, value in shown[0][0].recording.dataset.attrs.items()
            if key in ("origin", "world")
        },
    )


def _encoded(
    shown: list[tuple[ReportedTrial, xr.Dataset]], skin: Skin, body: Body, results: Results
) -> dict[str, Any]:
    """Surface and motions as JSON, with fewer frames if they would be too large."""
    assert results.laboratory is not None
    face, first = results.laboratory.face, shown[0]
    rest = face["position"].values[skin.node]
    every, trials = 1, _with_frames(shown, middle_of(rest), 1)
    while sum(len(trial["skin"]) for trial in trials) > MOST_MOTION_CHARACTERS and every < 8:
        every *= 2
        trials = _with_frames(shown, middle_of(rest), every)
    return body_data(body, rest) | {
        "instructions": {
            key: INSTRUCTIONS[key] for key in dict.fromkeys(t["instruction"] for t in trials)
        },
        "strategies": list(dict.fromkeys(t["strategy"] for t in trials)),
        "markers": [str(name) for name in first[1]["marker"].values],
        "muscles": muscle_names(first[0].activation["muscle"].values),
        "scaling": scaling(first[0].activation),
        "trials": trials,
    }


def _with_frames(
    shown: list[tuple[ReportedTrial, xr.Dataset]], centre: NDArray[np.float64], every: int
) -> list[dict[str, Any]]:
    trials: list[dict[str, Any]] = []
    for trial, moved in shown:
        frames = moved.isel(time=slice(None, None, every))
        time = frames["time"].values
        recorded = trial.motion.attrs["recorded_start"] + trial.motion.attrs["recorded_pace"] * time
        simulated = frames["position"].transpose("time", "marker", "axis").values
        trials.append(
            {
                "instruction": trial.place[1],
                "strategy": trial.strategy,
                "label": " ".join(map(str, trial.place)),
                "about": _about(trial),
                "time": [round(float(t), 4) for t in time],
                "skin": deltas(whole(frames["surface_position"].values, centre)),
                "simulated": deltas(whole(simulated, centre)),
                "measured": deltas(whole(measured_frames(trial.aligned, moved)[::every], centre)),
                "activation": levels(trial.activation["activation"], recorded),
            }
        )
    return trials


def _about(trial: ReportedTrial) -> str:
    """Describe the motion in a sentence."""
    rho = trial.scores["rho"].values
    median = f"{np.nanmedian(rho):.2f}" if np.isfinite(rho).any() else "undefined"
    label = " ".join(map(str, trial.place))
    face = f", {name}" if (name := trial.motion.attrs.get("face")) else ""
    origin = str(trial.recording.dataset.attrs.get("origin", "measured"))
    return (
        f"{origin.capitalize()} recording {label} ({INSTRUCTIONS[trial.place[1]]}) under "
        f"{trial.strategy}: median rho {median}; simulated motion{face}, sigma_max "
        f"{float(trial.motion.attrs['sigma_max']) / 1e3:.4g} kPa. {lips_of_motion(trial.motion)}"
    ).strip()
