"""Simulated lip displacement of each muscle, compared with its anatomical action.

Every muscle pair is simulated separately, without gravity, with contact of the lips, from rest to a
constant activation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.choices import STAVNESS
from emgface.errors import ActivationError
from emgface.face.lip_shape import lip_opening
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import MODELLED, MUSCLE_NAMES
from emgface.texts import module_toml

Floats = NDArray[np.float64]

GRAY: Final = "Standring (ed.), Gray's Anatomy, Face and scalp"


@dataclass(frozen=True)
class Action:
    """Anatomical action of one muscle pair, with its source.

    Each of `signs` is a marker of the left side, an axis and the sign of its displacement. `closes`
    is True if the opening between the lips decreases.
    """

    text: str
    source: str
    signs: tuple[tuple[str, str, int], ...]
    closes: bool = False


COMPARED_ACTIVATION: Final = 0.5  #: activation of the pairs whose actions are compared [1]
PASSED: Final = 1e-4  #: depth above which lips are regarded as penetrating each other [m]

LEAST_DISPLACEMENT: Final = 1e-4  #: displacement below which a marker is regarded as not moved [m]

ACTIONS: Final[Mapping[str, Action]] = {
    muscle: Action(
        entry["text"],
        {"GRAY": GRAY, "STAVNESS": STAVNESS}[entry["source"]],
        tuple((marker, axis, sign) for marker, axis, sign in entry["signs"]),
        entry.get("closes", False),
    )
    for muscle, entry in module_toml(__file__).items()
}
"""Textbook actions of the modelled muscles, of ``actions.toml``."""


def steady_positions(
    face: xr.Dataset,
    activations: Sequence[Mapping[str, float]],
    *,
    parameters: SimulationParameters | None = None,
    rise: float = 0.3,
    duration: float = 0.8,
    step: float = 0.05,
    integrator: sim.ConvergedEuler | None = None,
) -> tuple[Floats, Floats]:
    """Simulate a face under several constant activations, each from rest.

    `activations` maps, for every run, a muscle such as ``ZYG_L`` to its activation from 0 to 1; the
    others are passive. By default of `parameters`, sigma_max is 100 kPa and gravity off. `rise`,
    `duration` and `step` are the time over which the activation increases, the end of the run and
    the time step [s]; each run starts from the geometry of the face. Returns the node positions at
    the end, shape (runs, nodes, 3) [m], and the smallest det F over each run [1]. Damping uses the
    stiffness at rest (`sim.RestRayleigh`), which is positive for any activation; a steady state
    does not depend on it. Raises ActivationError if a muscle is unknown, and errors as
    `sim.simulate`.
    """
    if parameters is None:
        parameters = SimulationParameters(sigma_max=SIGMA_MAX, gravity=False)
    scene = compose_scene(face, parameters)
    damping = sim.RestRayleigh(alpha=parameters.alpha, beta=parameters.beta)
    system = sim.compile_scene(replace(scene, damping=damping))
    names = list(system.muscles)
    work = sim.Workspace(system)
    start = system.rest_state()
    positions, smallest = [], []
    for run in activations:
        unknown = [name for name in run if name not in names]
        if unknown:
            raise ActivationError(
                f"unknown muscle {unknown[0]!r}, expected some of {', '.join(names)}"
            )
        values = np.zeros((2, len(names)))
        values[1] = [run.get(name, 0.0) for name in names]
        trajectory, state = sim.simulate(
            system,
            sim.Activation(np.array([0.0, rise]), values),
            duration=duration,
            integrator=integrator or sim.ConvergedEuler(),
            steps=sim.HalvingStep(step),
            probes=(sim.SmallestJ(),),
            initial=start,
            work=work,
        )
        positions.append(state.q)
        smallest.append(float(trajectory["smallest_J"].min()))
    return np.stack(positions), np.array(smallest)


def moves_as_described(face: xr.Dataset, muscle: str, position: Floats) -> bool:
    """Test if node positions (nodes, 3) [m] show the anatomical action of a muscle.

    Every displacement of `ACTIONS` must have its sign and exceed `LEAST_DISPLACEMENT`. For a muscle
    that closes the lips, the margin of the upper lip must move down and that of the lower lip up in
    the midline by more than `LEAST_DISPLACEMENT`, and at least half of the opening must be closed.
    """
    rest, action = face["position"].values, ACTIONS[muscle]
    node = dict(zip(face["marker"].values.tolist(), face["marker_node"].values, strict=True))
    moves = [(node[name], "xyz".index(axis), sign) for name, axis, sign in action.signs]
    if action.closes:
        upper, lower = face["lip_opening_node"].values
        moves += [(upper, 2, -1), (lower, 2, 1)]
        if lip_opening(face, position) > 0.5 * lip_opening(face, rest):
            return False
    return all(
        sign * (position - rest)[place, axis] > LEAST_DISPLACEMENT for place, axis, sign in moves
    )


def muscle_actions(
    face: xr.Dataset,
    *,
    muscles: Sequence[str] = MODELLED,
    parameters: SimulationParameters | None = None,
) -> pd.DataFrame:
    """Displacement of the lips by every muscle pair, with its anatomical action.

    Both muscles of a pair are activated by `COMPARED_ACTIVATION`; by default sigma_max is 100 kPa,
    gravity is off, and lips and teeth are in contact. The table (index `muscle`) contains the
    displacement [mm] of the left corner and the left upper and lower paramedian marker along x
    (positive: medially), y (anterior) and z (up); the `opening` of the lips, negative if the upper
    margin is below the lower one in the midline, and the depth of the lips in each other [mm];
    smallest det F, the action, its source, and `agrees`, True if `moves_as_described` and the lips
    penetrate each other by at most `PASSED`. Errors as of `steady_positions`.
    """
    runs = [{f"{muscle}_{side}": COMPARED_ACTIVATION for side in "LR"} for muscle in muscles]
    position, smallest = steady_positions(face, runs, parameters=parameters)
    moved = 1e3 * (position - face["position"].values)
    marker = {
        str(name): int(k)
        for name, k in zip(face["marker"].values, face["marker_node"].values, strict=True)
    }
    penetration = Penetration(face)
    rows = {}
    for k, muscle in enumerate(muscles):
        row: dict[str, object] = {"name": MUSCLE_NAMES[muscle]}
        for name in ("corner_left", "upper_paramedian_left", "lower_paramedian_left"):
            for axis, value in zip("xyz", moved[k, marker[name]], strict=True):
                row[f"{name.removesuffix('_left')} {axis}"] = float(value)
        row["opening"] = 1e3 * lip_opening(face, position[k])
        depth = penetration.lips(position[k])
        row["lips in lips"] = 1e3 * depth
        row["smallest det F"] = float(smallest[k])
        action = ACTIONS[muscle]
        row["action"], row["source"] = action.text, action.source
        row["agrees"] = depth <= PASSED and moves_as_described(face, muscle, position[k])
        rows[muscle] = row
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("muscle")
