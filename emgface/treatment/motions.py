"""Motions of two faces under the same activations, for comparison."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError
from emgface.face.identity import treatments_between
from emgface.face.sigma_max import lowered
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.gestures import GESTURES, gesture_activation
from emgface.muscles import INSTRUCTIONS
from emgface.run.runner import Workers
from emgface.run.store import Store
from emgface.treatment.jobs import (
    AT_LEAST,
    BOUNDED,
    NO_PRESSURE,
    PRESSED,
    Faces,
    FailedJob,
    Job,
    results,
)
from emgface.treatment.reduced_pair import notes_of_reduction

GESTURE_RISE, HOLD = 0.25, 0.25  #: time of the rise of a gesture and time at its level [s]
MOVEMENTS: Final[Mapping[str, tuple[str, Mapping[str, float]]]] = {
    "opening": ("open the lips as far as possible", {"DLI": 1.0, "LLSAN": 1.0}),
    "closing": ("press the lips together", {"OOM": 0.5, "OOP": 0.5}),
}
"""Movements besides the instructions, which clinicians measure: words, and muscles of both sides."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class ComparedMotions:
    """Motions of an intact and a treated face, by the name of the movement.

    `words` describe every movement, `source` the activations, `failed` the movements that could not be
    simulated, with the reason, and `notes` are sentences on what was found in part only.
    """

    intact: dict[str, xr.Dataset]
    treated: dict[str, xr.Dataset]
    words: dict[str, str]
    source: str
    failed: dict[str, str]
    notes: tuple[str, ...] = ()


def gesture(levels: Mapping[str, float], muscles: NDArray[Any]) -> xr.DataArray:
    """Activation (muscle, time) that rises to levels [1] of muscles with side, and is held."""
    time = np.array([0.0, GESTURE_RISE, GESTURE_RISE + HOLD])
    values = np.zeros((len(muscles), 3))
    for k, name in enumerate(map(str, muscles)):
        values[k, 1:] = levels.get(name, 0.0)
    seconds = xr.DataArray(time, dims="time", attrs={"units": "s"})
    return xr.DataArray(
        values, {"muscle": list(map(str, muscles)), "time": seconds}, ("muscle", "time"),
        attrs={"units": "1", "origin": "simulated", "gesture": 1},
    )  # fmt: skip


def gestures(face: xr.Dataset, names: tuple[str, ...] = ()) -> dict[str, xr.DataArray]:
    """Activations of the six instructions and of `MOVEMENTS`, or of some of them."""
    muscles = face["muscle"].values
    activations = {name: gesture(gesture_activation(name), muscles) for name in GESTURES}
    for name, (_, levels) in MOVEMENTS.items():
        both = {f"{m}_{side}": a for m, a in levels.items() for side in "LR"}
        activations[name] = gesture(both, muscles)
    return {name: activations[name] for name in names or activations}


def recorded(
    folder: Path, mapping: Path | None = None
) -> tuple[dict[str, xr.DataArray], tuple[str, ...]]:
    """Activation of the first recording of every instruction in a folder, and notes on the others.

    Raises DataError if the folder has none, or if the recordings are those of several volunteers.
    """
    import emgface as ef

    if not folder.is_dir():
        what = "is a file" if folder.exists() else "does not exist"
        raise DataError(f"{folder} {what}, expected a folder with the recordings of one person")
    activations: dict[str, xr.DataArray] = {}
    persons: dict[str, str] = {}
    reasons: list[str] = []
    notes: list[str] = []
    for path in sorted(p for p in folder.glob("*") if p.is_file()):
        try:
            recording = ef.read(path, mapping=mapping)
            name = str(recording.attrs.get("instruction", ""))
            if name not in INSTRUCTIONS:
                reasons.append(f"{path.name}: its instruction is {name or 'not stated'}")
            elif name in activations:
                notes.append(f"{path.name} is another recording of {name} and was not used.")
            else:
                activations[name] = ef.activate(recording)["activation"]
                persons.setdefault(str(recording.attrs.get("volunteer", "")), path.name)
        except (DataError, OSError) as error:
            reasons.append(f"{path.name}: {error}")
    if not activations:
        raise DataError(
            f"{folder} contains no recording of an instruction A to F, expected at least one"
            + (f" ({reasons[0]})" if reasons else "")
        )
    if len(persons) > 1:
        people = " and ".join(f"{who or 'nobody'} ({file})" for who, file in persons.items())
        raise DataError(
            f"{folder} contains recordings of several volunteers, {people}, expected those of one "
            "person: make a folder for each"
        )
    if absent := [name for name in INSTRUCTIONS if name not in activations]:
        notes.append(f"No recording of {', '.join(absent)} was found: their outcomes are absent.")
    notes += [f"Not used: {reason.rstrip('.')}." for reason in reasons]
    return {name: activations[name] for name in sorted(activations)}, tuple(notes)


def words_of(name: str, activation: xr.DataArray) -> str:
    """Describe a movement: an instruction, the gesture in its place, or one of `MOVEMENTS`."""
    if name in MOVEMENTS:
        return MOVEMENTS[name][0]
    return GESTURES[name][0] if activation.attrs.get("gesture") else INSTRUCTIONS[name]


def compared_motions(
    intact: xr.Dataset,
    treated: xr.Dataset,
    activations: Mapping[str, xr.DataArray],
    parameters: SimulationParameters,
    *,
    source: str,
    progress: Progress | None = None,
    store: Store | None = None,
    workers: int | Workers = 1,
    stopping: Callable[[], bool] = lambda: False,
    reduced: tuple[Path, Path] | None = None,
) -> ComparedMotions:
    """Simulate both faces for every activation, with the same sigma_max in a movement.

    With a `store`, complete motions are kept there, a repeated call computes only the others, and
    several `workers` share them. A movement that fails at every admissible sigma_max is listed in
    `failed`; the others are not affected. With the files of the `reduced` faces of both
    (`emgface.treatment.reduced_pair`), `notes` state the bound of their error. Raises DataError if
    `treated` is neither `intact` nor a treatment of it, and KeyboardInterrupt if `stopping` returns
    True, after what has begun.
    """
    treatments_between(intact, treated)
    faces = Faces((intact, treated), activations, store, reduced)
    own = "closing" in activations and parameters.contact.method != "none"
    total, ended = 2 * (len(activations) + own), 0

    def both(pending: Mapping[str, SimulationParameters]) -> dict[str, _Pair]:
        """Results of both faces, by name; one of a failed pair may be absent."""
        nonlocal ended
        jobs = [Job(k, name, p) for name, p in pending.items() for k in (1, 0)]
        pairs: dict[str, _Pair] = {name: {} for name in pending}
        for job, result in results(faces, jobs, workers, stopping):
            pairs[job.name][job.which] = result
            ended = min(ended + 1, total)
            if progress is not None:
                progress(ended, total)
        return pairs

    if progress is not None:
        progress(0, total)
    motions, failed = _at_common_stress(both, dict.fromkeys(activations, parameters))
    notes: list[str] = []
    if own and "closing" in motions:
        stress = float(motions["closing"][0].attrs["sigma_max"])
        p = parameters.model_copy(update={"sigma_max": stress})
        for which, outcome in both({PRESSED: p})[PRESSED].items():
            when = ("before", "after")[which]
            if isinstance(outcome, FailedJob):
                outcome = xr.Dataset(attrs={NO_PRESSURE: outcome.text})
            motions["closing"][which].attrs |= outcome.attrs
            if NO_PRESSURE in outcome.attrs:
                notes.append(
                    f"The pressure held {when} was not found: {outcome.attrs[NO_PRESSURE]}."
                )
            elif outcome.attrs[AT_LEAST]:
                notes.append(
                    f"The pressure held {when} is a lower bound: {outcome.attrs[BOUNDED]}."
                )
    words = {name: words_of(name, given) for name, given in activations.items()}
    before, after = ({n: motions[n][k] for n in activations if n in motions} for k in (0, 1))
    of_reduction = () if reduced is None else notes_of_reduction(before, after)
    return ComparedMotions(before, after, words, source, failed, (*of_reduction, *sorted(notes)))


_Pair = dict[int, "xr.Dataset | FailedJob"]


def _at_common_stress(
    both: Callable[[Mapping[str, SimulationParameters]], dict[str, _Pair]],
    pending: dict[str, SimulationParameters],
) -> tuple[dict[str, dict[int, xr.Dataset]], dict[str, str]]:
    """Motions of both faces by name, with a smaller sigma_max where one fails; and the failures."""
    motions: dict[str, dict[int, xr.Dataset]] = {}
    failed: dict[str, str] = {}
    while pending:
        pairs, again = both(pending), dict[str, SimulationParameters]()
        for name, pair in pairs.items():
            failures = [one for one in pair.values() if isinstance(one, FailedJob)]
            lower = lowered(pending[name])
            if not failures:
                motions[name] = {k: one for k, one in pair.items() if isinstance(one, xr.Dataset)}
            elif all(one.weaker for one in failures) and lower is not None:
                again[name] = lower
            else:
                failed[name] = failures[0].text
        pending = again
    return motions, failed
