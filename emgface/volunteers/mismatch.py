"""Mismatch between a person and the assumptions of a study, drawn for a world."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS, INSTRUCTIONS, MODELLED, MUSCLES
from emgface.volunteers.instructions import strongest_muscle
from emgface.volunteers.recruitment import Recruitment, draw_recruitment
from emgface.volunteers.world import World

_STREAMS: Final = {"strength": 20, "delay": 21, "snr": 22, "recruitment": 30}
"""Separate random streams, so that one kind of mismatch does not affect the others."""
_TRUNCATION: Final = 2.0


@dataclass(frozen=True)
class Mismatch:
    """Mismatch of one person."""

    strength: Mapping[str, float]  #: factor on the force of each muscle, by name with side [1]
    delay: float  #: electromechanical delay [s]
    snr: Mapping[str, float] | None  #: signal-to-noise ratio of each channel [dB]
    #: recruitment in each instruction that deviates from the table
    recruitment: Mapping[str, Recruitment]

    def as_parameters(self) -> dict[str, Any]:
        """All drawn values as plain data, for the file of a recording."""
        return asdict(self)

    def driven(self, activation: xr.DataArray) -> xr.DataArray:
        """Activation multiplied by the relative strengths [1], which drives the face."""
        if self.strongest == 1.0:
            return activation
        factor = [self.strength[str(muscle)] for muscle in activation["muscle"].values]
        return activation * (np.array(factor)[:, None] / self.strongest)

    @property
    def strongest(self) -> float:
        """Largest strength, which is a factor on sigma_max [1]."""
        return max(self.strength.values())


def draw_mismatch(seed: int, index: int, world: World) -> Mismatch:
    """Draw the mismatch of one person of a set; `index` is 1 for the first volunteer.

    Equal seed, index and world result in equal mismatch.
    """

    def stream(kind: str, more: int = 0) -> np.random.Generator:
        return np.random.default_rng([seed, index, _STREAMS[kind] + more])

    normal = np.clip(stream("strength").standard_normal(len(MODELLED)), -_TRUNCATION, _TRUNCATION)
    strong: dict[str, float] = dict(
        zip(MODELLED, np.exp(world.strength * normal).tolist(), strict=True)
    )
    snr = None
    if world.snr is not None:
        drawn = stream("snr").uniform(*world.snr, size=len(CHANNELS))
        snr = dict(zip(CHANNELS, map(float, drawn), strict=True))
    recruited = {
        instruction: draw_recruitment(
            instruction, strongest_muscle(instruction), world, stream("recruitment", k)
        )
        for k, instruction in enumerate(INSTRUCTIONS)
    }
    return Mismatch(
        strength={muscle: strong[muscle[:-2]] for muscle in MUSCLES},
        delay=float(stream("delay").uniform(*world.delay)),
        snr=snr,
        recruitment={name: one for name, one in recruited.items() if one is not None},
    )


def world_parameters(
    parameters: SimulationParameters, world: World, mismatch: Mismatch
) -> SimulationParameters:
    """Replace the laws and the muscle stress of a study by those of a person in a world."""
    values: dict[str, Any] = parameters.model_dump()
    values["sigma_max"] = parameters.sigma_max * mismatch.strongest
    values["line_force"] = parameters.line_force * mismatch.strongest
    values["kappa"] = parameters.kappa * world.kappa_factor
    if world.volume == "element" and parameters.incompressibility == "pointwise":
        values |= {"incompressibility": "element", "bulk_potential": "quadratic"}
    if world.fibre_law == "other":
        values["fibre_law"] = "blemker" if parameters.fibre_law == "generic" else "generic"
    return SimulationParameters.model_validate(values)
