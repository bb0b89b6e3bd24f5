"""Individual properties of simulated volunteers, drawn from stated distributions."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import CHANNELS, INSTRUCTIONS, MUSCLES
from emgface.schema.validation import declaration

POWERS: Final = {None: 0, "1": 0, "m": 1, "N": 2}
"""Power of the scale of a face with which a quantity of the same tissue grows, by its unit."""


@dataclass(frozen=True)
class SimulatedVolunteer:
    """Properties of a simulated person, drawn from `seed` and `index`."""

    name: str  #: "S01", "S02", ...
    seed: int
    index: int
    geometry_scale: float  #: factor on all positions of the face model
    sigma_max: float  #: largest active muscle stress [Pa]
    stiffness: float  #: factor on C10, C20 and kappa of the tissue
    levels: Mapping[str, float]  #: factor on the activation of each muscle
    co_contraction: float  #: peak activation of muscles that do not belong to an instruction
    gain: Mapping[str, float]  #: root-mean-square sEMG of each channel at full activation [V]
    cross_talk: float  #: fraction of a neighbour's amplitude
    baseline_noise: float  #: noise of the electrodes [V]
    mains_hum: float  #: amplitude of the hum [V]
    marker_noise: float  #: standard deviation per coordinate [m]
    head_rotation: float  #: amplitudes of the head's motion [rad]
    head_shift: float  #: amplitudes of the head's motion [m]
    #: 1 for a person who moves only the muscles of the instruction, 0 for the least skilled
    skill: float = 0.5
    speed: float = 1.0  #: factor on the speed of all movements
    asymmetry: float = 0.0  #: logarithm of the ratio of left to right effort

    @property
    def variability(self) -> float:
        """Factor on the deviations of a repetition: 1.3 for the least skilled, 0.7 for the best."""
        return 1.3 - 0.6 * self.skill

    @property
    def efforts(self) -> dict[str, float]:
        """Factor on the activation of each muscle, including the asymmetry of the sides."""
        half = {"L": np.exp(0.5 * self.asymmetry), "R": np.exp(-0.5 * self.asymmetry)}
        return {muscle: float(level * half[muscle[-1]]) for muscle, level in self.levels.items()}

    def rng(self, instruction: str, repetition: int) -> np.random.Generator:
        """Return the generator of one trial, independent of other trials and of their order."""
        position = list(INSTRUCTIONS).index(instruction)
        return np.random.default_rng([self.seed, self.index, 1 + position, repetition])

    def as_parameters(self) -> dict[str, Any]:
        """All drawn values as plain data, for the digest of stored results."""
        return asdict(self)


def draw_volunteer(index: int, seed: int) -> SimulatedVolunteer:
    """Draw a volunteer; equal seed and index (1 for the first) result in the same person.

    geometry scale U(0.92, 1.08); sigma_max U(80, 150) kPa; tissue stiffness log-normal, sigma 0.15;
    level of each muscle log-normal, sigma 0.10; co-contraction U(0.01, 0.05); gain of each channel
    log-uniform in 100-400 uV; cross-talk U(0.03, 0.10); baseline noise U(0.8, 1.5) uV; hum U(0.2,
    1) uV; marker noise 0.1 mm (without simulated cameras); head rotation U(1, 3) degrees; head
    shift U(1, 4) mm; skill decreases from 1 to 0 with the co-contraction; speed U(0.93, 1.07);
    asymmetry N(0, 0.1) within 0.25. The ranges are chosen.
    """
    rng = np.random.default_rng([seed, index, 0])
    person = SimulatedVolunteer(
        name=f"S{index:02d}",
        seed=seed,
        index=index,
        geometry_scale=float(rng.uniform(0.92, 1.08)),
        sigma_max=float(rng.uniform(80e3, 150e3)),
        stiffness=float(np.exp(rng.normal(0.0, 0.15))),
        levels={muscle: float(np.exp(rng.normal(0.0, 0.10))) for muscle in MUSCLES},
        co_contraction=float(rng.uniform(0.01, 0.05)),
        gain={
            channel: float(np.exp(rng.uniform(np.log(100e-6), np.log(400e-6))))
            for channel in CHANNELS
        },
        cross_talk=float(rng.uniform(0.03, 0.10)),
        baseline_noise=float(rng.uniform(0.8e-6, 1.5e-6)),
        mains_hum=float(rng.uniform(0.2e-6, 1.0e-6)),
        marker_noise=0.1e-3,
        head_rotation=float(np.deg2rad(rng.uniform(1.0, 3.0))),
        head_shift=float(rng.uniform(1e-3, 4e-3)),
    )
    return replace(
        person,
        skill=1.0 - (person.co_contraction - 0.01) / 0.04,
        speed=float(rng.uniform(0.93, 1.07)),
        asymmetry=float(np.clip(rng.normal(0.0, 0.1), -0.25, 0.25)),
    )


def person_face(face: xr.Dataset, scale: float) -> xr.Dataset:
    """Scale all lengths of a face model by a factor, and its forces by that of their areas."""
    scaled = face.copy()
    for name, declared in declaration("face_model").arrays().items():
        if name in face and (power := POWERS[declared.units]):
            scaled[name] = face[name] * scale**power
            scaled[name].attrs = dict(face[name].attrs)
    return scaled


def person_parameters(
    person: SimulatedVolunteer, parameters: SimulationParameters
) -> SimulationParameters:
    """Replace the tissue and muscle parameters that differ from person to person."""
    return parameters.model_copy(
        update={
            "sigma_max": person.sigma_max,
            "C10": parameters.C10 * person.stiffness,
            "C20": parameters.C20 * person.stiffness,
            "kappa": parameters.kappa * person.stiffness,
            "tissues": tuple(t.stiffened(person.stiffness) for t in parameters.tissues),
        }
    )
