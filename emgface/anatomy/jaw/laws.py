"""Muscle laws by name, from the parameters of a jaw model."""

from collections.abc import Callable, Mapping

import numpy as np

import sim
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


LAWS: dict[str, MuscleLaw] = {
    "peck": peck,
    "hill": hill,
    "pennate": pennate,
    "spring": spring,
    "constant": constant,
}
"""Muscle laws by name."""
