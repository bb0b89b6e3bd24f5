"""Motions of two faces under the same activations, for comparison."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError, FaceError
from emgface.face.identity import treatments_between
from emgface.face.motion import settle_face, simulate_face
from emgface.face.sigma_max import lower_sigma_max
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.gestures import GESTURES, gesture_activation
from emgface.muscles import INSTRUCTIONS
from emgface.pictures.body import skin_of
from emgface.pictures.surface import SurfaceProbe, with_surface
from emgface.run.digest import dataset_digest
from emgface.run.mechanics import MECHANICS
from emgface.run.store import Stage, Store
from emgface.treatment.pressure import pressure_held

MOTION: Final = Stage(
    "treatment_motion", (*MECHANICS, "emgface.treatment.motions", "emgface.treatment.pressure")
)
PRESSURE: Final = "pressure_held_Pa"  #: attribute of a motion of closing
PRESSURE_STEP: Final = "pressure_step_Pa"
NO_PRESSURE: Final = "pressure_not_found"
RISE, HOLD = 0.25, 0.25  #: time of the rise of a gesture and time at its level [s]
TASKS: Final[Mapping[str, tuple[str, Mapping[str, float]]]] = {
    "opening": ("open the lips as far as possible", {"DLI": 1.0, "LLSAN": 1.0}),
    "closing": ("press the lips together", {"OOM": 0.5, "OOP": 0.5}),
}
"""Movements besides the instructions, which clinicians measure: words, and muscles of both sides."""

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class ComparedMotions:
    """Motions of an intact and a treated face, by the name of the movement.

    `words` describe every movement, `source` the activations, and `failed` the movements that could
    not be simulated, with the reason.
    """

    intact: dict[str, xr.Dataset]
    treated: dict[str, xr.Dataset]
    words: dict[str, str]
    source: str
    failed: dict[str, str]


def gesture(levels: Mapping[str, float], muscles: NDArray[Any]) -> xr.DataArray:
    """Activation (muscle, time) that rises to levels [1] of muscles with side, and is held."""
    time = np.array([0.0, RISE, RISE + HOLD])
    values = np.zeros((len(muscles), 3))
    for k, name in enumerate(map(str, muscles)):
        values[k, 1:] = levels.get(name, 0.0)
    seconds = xr.DataArray(time, dims="time", attrs={"units": "s"})
    return xr.DataArray(
        values, {"muscle": list(map(str, muscles)), "time": seconds}, ("muscle", "time"),
        attrs={"units": "1", "origin": "simulated", "gesture": 1},
    )  # fmt: skip


def gestures(face: xr.Dataset, names: tuple[str, ...] = ()) -> dict[str, xr.DataArray]:
    """Activations of the six instructions and of `TASKS`, or of some of them."""
    muscles = face["muscle"].values
    found = {name: gesture(gesture_activation(name), muscles) for name in GESTURES}
    for name, (_, levels) in TASKS.items():
        both = {f"{m}_{side}": a for m, a in levels.items() for side in "LR"}
        found[name] = gesture(both, muscles)
    return {name: found[name] for name in names or found}


def recorded(folder: Path, mapping: Path | None = None) -> dict[str, xr.DataArray]:
    """Activation of the first recording of every instruction in a folder.

    Raises DataError if the folder has none; files that cannot be read are left out.
    """
    import emgface as ef

    found: dict[str, xr.DataArray] = {}
    reasons: list[str] = []
    for path in sorted(p for p in folder.glob("*") if p.is_file()):
        try:
            recording = ef.read(path, mapping=mapping)
            name = str(recording.attrs.get("instruction", ""))
            if name in INSTRUCTIONS and name not in found:
                found[name] = ef.activate(recording)["activation"]
        except (DataError, OSError) as error:
            reasons.append(f"{path.name}: {error}")
    if not found:
        raise DataError(
            f"{folder} contains no recording of an instruction A to F, expected at least one"
            + (f" ({reasons[0]})" if reasons else "")
        )
    return {name: found[name] for name in sorted(found)}


def words_of(name: str, activation: xr.DataArray) -> str:
    """Describe a movement: an instruction, the gesture in its place, or one of `TASKS`."""
    if name in TASKS:
        return TASKS[name][0]
    return GESTURES[name][0] if activation.attrs.get("gesture") else INSTRUCTIONS[name]


def with_pressure(
    motion: xr.Dataset, face: xr.Dataset, parameters: SimulationParameters, settled: xr.Dataset
) -> xr.Dataset:
    """Add the pressure that the closed lips hold to a motion, or the reason why it was not found.

    The attributes are `PRESSURE` [Pa], with `PRESSURE_STEP` [Pa], or `NO_PRESSURE`; without contact,
    there is none.
    """
    if parameters.contact.method == "none":
        return motion
    try:
        held = pressure_held(face, parameters, settled=settled)
    except FaceError as error:
        return motion.assign_attrs({NO_PRESSURE: str(error)})
    return motion.assign_attrs({PRESSURE: held.pressure, PRESSURE_STEP: held.step})


def compared_motions(
    intact: xr.Dataset,
    treated: xr.Dataset,
    activations: Mapping[str, xr.DataArray],
    parameters: SimulationParameters,
    *,
    source: str,
    progress: Progress | None = None,
    store: Store | None = None,
) -> ComparedMotions:
    """Simulate both faces for every activation, with the same sigma_max in a movement.

    With a `store`, complete motions are kept there, and a repeated call computes only the others. A
    movement that fails at every admissible sigma_max is listed in `failed`; the others are not
    affected. Raises DataError if `treated` is neither `intact` nor a treatment of it.
    """
    treatments_between(intact, treated)
    from sim import SimulationError

    settled: dict[tuple[int, float], xr.Dataset] = {}
    skins = [skin_of(intact), skin_of(treated)]

    digests = ["", ""] if store is None else [dataset_digest(f) for f in (intact, treated)]

    def run(which: int, name: str, p: SimulationParameters) -> xr.Dataset:
        if store is None:
            return computed(which, name, p)
        own = activations[name].to_dataset(name="activation")
        inputs = {"face": digests[which], "activation": dataset_digest(own)}
        return store.get_or_compute(
            MOTION, inputs, {"simulation": p.model_dump(mode="json")},
            lambda: computed(which, name, p), label=name,
        ).dataset  # fmt: skip

    def computed(which: int, name: str, p: SimulationParameters) -> xr.Dataset:
        face = (intact, treated)[which]
        key = (which, p.sigma_max)
        if key not in settled:
            settled[key] = settle_face(face, p)
        motion = simulate_face(
            face, activations[name], p, settled=settled[key],
            further=(SurfaceProbe(skins[which].node),),
        )  # fmt: skip
        if name == "closing":
            motion = with_pressure(motion, face, p, settled[key])
        return with_surface(motion, face, skins[which])

    found: tuple[dict[str, xr.Dataset], dict[str, xr.Dataset]] = ({}, {})
    failed: dict[str, str] = {}
    for done, name in enumerate(activations):
        if progress is not None:
            progress(done, len(activations))

        def both(p: SimulationParameters, name: str = name) -> xr.Dataset:
            pair = run(1, name, p), run(0, name, p)
            found[1][name], found[0][name] = pair
            return pair[0]

        try:
            lower_sigma_max(both, parameters)
        except SimulationError as error:
            failed[name] = str(error)
            for one in found:
                one.pop(name, None)
    for which, when in enumerate(("before", "after")):
        reason = found[which]["closing"].attrs.get(NO_PRESSURE) if "closing" in found[which] else ""
        if reason:
            failed[f"pressure held, {when}"] = str(reason)
    if progress is not None:
        progress(len(activations), len(activations))
    words = {name: words_of(name, given) for name, given in activations.items()}
    return ComparedMotions(found[0], found[1], words, source, failed)
