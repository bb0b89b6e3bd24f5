"""Muscle laws by name, from the parameters of a jaw model."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

import sim
from emgface.anatomy.jaw.model import Floats
from sim.laws import LineLaw

MuscleLaw = Callable[[Mapping[str, float]], LineLaw]
"""Law of a muscle from its parameters, named as of `emgface.anatomy.jaw.model.MUSCLE_VALUES`."""


def peck(values: Mapping[str, float]) -> LineLaw:
    """The published law, optimal at rest unless the model states another length."""
    return sim.Peck(
        values["force_max"],
        stretch_opt=values.get("stretch_opt", 1.0),
        stretch_max=values["stretch_max"],
        tendon_ratio=values["tendon_ratio"],
        passive_fraction=values["passive_fraction"],
    )


def constant(values: Mapping[str, float]) -> LineLaw:
    """Tension that depends on activation alone."""
    return sim.ConstantForce(values["force_max"])


def hill(values: Mapping[str, float], pennation: float = 0.0) -> LineLaw:
    """Fibres of Hill in series with an elastic tendon."""
    return sim.Hill(
        values["force_max"],
        stretch_opt=values.get("stretch_opt", 1.0),
        tendon_ratio=values["tendon_ratio"],
        passive_fraction=values["passive_fraction"],
        pennation=pennation,
    )


PENNATION = np.radians(15.0)
"""Pennation of all muscles under the law "pennate" [rad]; that of human masseters and pterygoids is 10
to 20 degrees, as commonly quoted."""


def pennate(values: Mapping[str, float]) -> LineLaw:
    """Law `hill` with pennate fibres."""
    return hill(values, PENNATION)


def spring(values: Mapping[str, float]) -> LineLaw:
    """Active force without dependence on length, and a linear passive one with the largest of Peck."""
    per_strain = values["passive_fraction"] / (values["stretch_max"] - 1.0)
    return sim.LinearSpring(values["force_max"], per_strain, values.get("stretch_opt", 1.0))


def fibre_velocity(values: Mapping[str, float]) -> sim.ForceVelocity:
    """Force-velocity relation of fibres that shorten by at most ten optimal lengths per second.

    The tendon is taken as rigid, so that the rate of the fibres is that of the muscle.
    """
    fibres = (1.0 - values["tendon_ratio"]) * values.get("stretch_opt", 1.0)
    return sim.ForceVelocity(v_max=10.0 * fibres)


RELATIONS: dict[str, Callable[[Mapping[str, float]], sim.ForceVelocity]] = {
    "hill": fibre_velocity,
    "pennate": fibre_velocity,
}
"""Relations of the laws with one; they replace the dampers of muscles."""


MUSCLE_LAWS: dict[str, MuscleLaw] = {
    "peck": peck,
    "hill": hill,
    "pennate": pennate,
    "spring": spring,
    "constant": constant,
}
"""Muscle laws by name."""


@dataclass(frozen=True, eq=False)
class MuscleLine:
    """A muscle of a scene: numbers of its ends, law, damping [N s/m] and length at rest [m]."""

    ends: tuple[int, int]
    law: LineLaw
    damping: float
    rest: float
    relation: sim.ForceVelocity | None = None

    def tension(self, length: Floats, rate: Floats, activation: Floats) -> Floats:
        """Tension (n,) at lengths [m], rates [m/s] and activations, with that of the damper [N]."""
        rest = np.full_like(length, self.rest)
        _, F, _ = self.law.evaluate(length, rest, activation)
        F = F + self.damping * rate
        if self.relation is not None:
            _, passive, _ = self.law.evaluate(length, rest, np.zeros_like(activation))
            F = F + (F - passive) * (self.relation.evaluate(rate / self.rest)[0] - 1.0)
        return F
