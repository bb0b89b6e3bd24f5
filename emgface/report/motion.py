"""The moving faces of a report: one trial per instruction, under every strategy."""

import base64
import zlib
from collections.abc import Callable
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.muscles import INSTRUCTIONS, MUSCLE_NAMES
from emgface.report.results import FAILURES, Results, Trial, representative
from emgface.report.skin import Skin, skin_motion, skin_of

QUANTUM: Final = 20e-6
"""Positions are rounded to this [m], far below what is seen."""
ABSENT: Final = -32768
"""Stands for a marker that was not measured."""
LARGEST: Final = 9_000_000
"""Characters of all encoded motions; above it every second frame is left out."""

Say = Callable[[str, int, int], None]


def moving_faces(
    results: Results, say: Say | None = None
) -> tuple[xr.Dataset, dict[str, Any]] | None:
    """Simulate the skin in the trials that stand for their instructions.

    Parameters
    ----------
    results : Results
        The finished study; what cannot be simulated is noted there.
    say : callable, optional
        Told label, number done and number to do.

    Returns
    -------
    Dataset
        For `analysis.figures.rendered_faces`: the faces farthest from rest.
    dict
        For the page: mesh and motions, see `_encoded`; None in place of both where there is no
        trial to show.
    """
    if results.laboratory is None:
        return None
    skin = skin_of(results.laboratory.face)
    chosen = representative(results.base)
    strategies = [str(s) for s in results.base["strategy"].values]
    wanted = [(place, strategy) for place in chosen.values() for strategy in strategies]
    shown: list[tuple[Trial, xr.Dataset]] = []
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
            moved = skin_motion(results.laboratory, activation, trial.motion, skin, label).dataset
        except FAILURES as error:
            results.notes.append(f"The moving face of {label} is left out: {error}")
            continue
        change = float(abs(trial.scores["rho"] - cell["rho"]).max())
        if change > 1e-6:
            results.notes.append(
                f"{label} was computed again by this version of the package, its rho differs from "
                f"the cube's by up to {change:.2g}: run the study again before using the report."
            )
        shown.append((trial, moved))
    if not shown:
        return None
    return _farthest(shown, skin, list(chosen), strategies), _encoded(shown, skin, results)


def _farthest(
    shown: list[tuple[Trial, xr.Dataset]],
    skin: Skin,
    instructions: list[str],
    strategies: list[str],
) -> xr.Dataset:
    """Faces at the frame in which the markers are farthest from where they began."""
    size = (len(instructions), len(strategies))
    position = np.full((*size, len(skin.node), 3), np.nan)
    n_markers = shown[0][1].sizes["marker"]
    marks = {name: np.full((*size, n_markers, 3), np.nan) for name in ("simulated", "measured")}
    for trial, moved in shown:
        at = instructions.index(trial.place[1]), strategies.index(trial.strategy)
        own = moved["position"].transpose("time", "marker", "axis").values
        frame = int(np.argmax(((own - own[0]) ** 2).sum(axis=(1, 2))))
        position[at] = moved["skin_position"].values[frame]
        marks["simulated"][at] = own[frame]
        marks["measured"][at] = _measured(trial, moved)[frame]
    dims = ("instruction", "strategy")
    metres = {"units": "m"}
    return xr.Dataset(
        {
            "position": ((*dims, "node", "axis"), position, metres),
            "triangle": (("triangle", "corner"), skin.triangle),
            **{name: ((*dims, "marker", "axis"), each, metres) for name, each in marks.items()},
        },
        coords={"instruction": instructions, "strategy": strategies, "axis": ["x", "y", "z"]},
        attrs={
            key: str(value)
            for key, value in shown[0][0].recording.dataset.attrs.items()
            if key in ("origin", "world")
        },
    )


def _measured(trial: Trial, moved: xr.Dataset) -> NDArray[np.float64]:
    """Aligned measured markers at the frames, NaN where there are none, (frame, marker, axis)."""
    aligned = trial.aligned["position"].transpose("time", "marker", "axis")
    order = [str(name) for name in moved["marker"].values]
    wanted = np.searchsorted(aligned["time"].values, moved["time"].values - 1e-9)
    return aligned.sel(marker=order).values[np.minimum(wanted, aligned.sizes["time"] - 1)]


def _encoded(shown: list[tuple[Trial, xr.Dataset]], skin: Skin, results: Results) -> dict[str, Any]:
    """Mesh and motions as JSON-expressible text.

    Positions are whole numbers of `QUANTUM` about `centre`; each frame is the difference from the
    one before, low bytes before high ones, deflated, in base 64.
    """
    every = 1
    while True:
        data = _with_frames(shown, skin, results, every)
        if sum(len(trial["skin"]) for trial in data["trials"]) <= LARGEST or every >= 8:
            return data
        every *= 2


def _with_frames(
    shown: list[tuple[Trial, xr.Dataset]], skin: Skin, results: Results, every: int
) -> dict[str, Any]:
    assert results.laboratory is not None
    rest = results.laboratory.face["position"].values[skin.node]
    centre = (rest.min(axis=0) + rest.max(axis=0)) / 2
    trials: list[dict[str, Any]] = []
    for trial, moved in shown:
        frames = moved.isel(time=slice(None, None, every))
        time = frames["time"].values
        activation = trial.activation["activation"].transpose("time", "muscle")
        recorded = trial.motion.attrs["recorded_start"] + trial.motion.attrs["recorded_pace"] * time
        at = np.clip(
            np.searchsorted(activation["time"].values, recorded - 1e-9), 0, len(activation) - 1
        )
        levels = np.round(255 * activation.values[at]).astype(np.uint8)
        simulated = frames["position"].transpose("time", "marker", "axis").values
        rho = trial.scores["rho"].values
        trials.append(
            {
                "instruction": trial.place[1],
                "strategy": trial.strategy,
                "label": " ".join(map(str, trial.place)),
                "rho": round(float(np.nanmedian(rho)), 4) if np.isfinite(rho).any() else None,
                "sigma_max": round(float(trial.motion.attrs["sigma_max"])),
                "time": [round(float(t), 4) for t in time],
                "skin": deltas(whole(frames["skin_position"].values, centre)),
                "simulated": deltas(whole(simulated, centre)),
                "measured": deltas(whole(_measured(trial, moved)[::every], centre)),
                "activation": packed(levels),
            }
        )
    return {
        "quantum": QUANTUM,
        "absent": ABSENT,
        "nodes": len(skin.node),
        "triangle": packed(skin.triangle.astype("<u4")),
        "origin": str(results.cube.attrs["origin"]),
        "face": str(results.laboratory.face.attrs["name"]),
        "lips": [round(1e3 * float(x), 3) for x in _lips(results.laboratory.face) - centre],
        "instructions": {
            key: INSTRUCTIONS[key] for key in dict.fromkeys(t["instruction"] for t in trials)
        },
        "strategies": list(dict.fromkeys(t["strategy"] for t in trials)),
        "markers": [str(name) for name in shown[0][1]["marker"].values],
        "muscles": [
            {"id": str(m), "name": MUSCLE_NAMES[str(m).rpartition("_")[0]]}
            for m in shown[0][0].activation["muscle"].values
        ],
        "trials": trials,
    }


def _lips(face: xr.Dataset) -> NDArray[np.float64]:
    """Middle of the lip markers at rest, which the page looks at [m]."""
    return face["position"].values[face["marker_node"].values].mean(axis=0)


def whole(position: NDArray[Any], centre: NDArray[np.float64]) -> NDArray[np.int16]:
    """Round positions [m] to whole numbers of `QUANTUM` about a centre; NaN becomes `ABSENT`."""
    steps = np.round((np.asarray(position, dtype=np.float64) - centre) / QUANTUM)
    steps = np.where(np.isfinite(steps), np.clip(steps, -32767, 32767), ABSENT)
    return steps.astype(np.int16)


def deltas(values: NDArray[np.int16]) -> str:
    """Encode frames of whole numbers, the first dim being time, as differences."""
    flat = values.reshape(len(values), -1)
    with np.errstate(over="ignore"):
        change = np.diff(flat, axis=0, prepend=np.zeros((1, flat.shape[1]), dtype=np.int16))
    raw = change.astype("<i2").tobytes()
    planes = np.frombuffer(raw, dtype=np.uint8).reshape(-1, 2)
    return packed(np.concatenate([planes[:, 0], planes[:, 1]]))


def packed(values: NDArray[Any]) -> str:
    """Deflate the bytes of an array and write them in base 64."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode("ascii")
