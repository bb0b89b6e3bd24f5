"""Settings of a solution: integrators x steps x tolerances x linear solvers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sim
from benchmarks.integrators import CONVERGED, LINEARLY_IMPLICIT
from benchmarks.work_precision.models import Model
from emgface.face.integration import iterated_to
from sim.integrators import Integrator
from sim.linear import LINEAR_SOLVERS, pardiso_is_available
from sim.steps import StepControl

HORIZON = 0.055  #: relaxation time of errors in tissue with the default damping, its beta [s]


@dataclass(frozen=True, eq=False)
class Setting:
    """Method for the solution of a model."""

    family: str  #: line of the figure
    label: str  #: name within this line
    integrator: Integrator
    steps: StepControl
    model: Model = Model()
    linear: str = "auto"  #: linear solver, or "auto"

    @property
    def name(self) -> str:
        """Family, label and model."""
        return f"{self.family}, {self.label} ({self.model.name})"


def settings_of(
    model: Model, nodes: NDArray[np.int64], *, base: bool, full: bool = False
) -> list[Setting]:
    """Return the settings of a model.

    `nodes` are those of the lip markers, whose error is controlled. All settings are returned for
    the base model, and with `full` for every model, then also smaller steps; otherwise only a few.
    """
    if not (base or full):
        return [
            *_sized(
                model, "linearly implicit Euler", sim.LinearlyImplicitEuler(), sim.FixedStep, (10,)
            ),
            *_sized(model, "Euler", sim.ConvergedEuler(), sim.HalvingStep, (10,)),
            *_sized(model, "SDIRK2", sim.Sdirk2(), sim.HalvingStep, (40, 20, 10)),
        ]
    settings: list[Setting] = []
    for name, integrator in LINEARLY_IMPLICIT.items():
        smallest = (2.5,) if full else ()
        settings += _sized(model, name, integrator, sim.FixedStep, (20, 10, 5, *smallest))
    for name, integrator in CONVERGED.items():
        smallest = (2.5,) if full or name == "SDIRK2" else ()
        settings += _sized(model, name, integrator, sim.HalvingStep, (40, 20, 10, 5, *smallest))
    return [*settings, *_iterated(model, full), *_controlled(model, nodes), *_linear(model)]


def _sized(
    model: Model,
    family: str,
    integrator: Integrator,
    steps: type[sim.FixedStep] | type[sim.HalvingStep],
    milliseconds: tuple[float, ...],
) -> list[Setting]:
    """Settings of one integrator with steps of several sizes."""
    return [
        Setting(family, f"{milli:g} ms", integrator, steps(milli * 1e-3), model)
        for milli in milliseconds
    ]


def _iterated(model: Model, full: bool) -> list[Setting]:
    """Settings with larger and smaller tolerances than the default of 0.001 mm."""
    settings: list[Setting] = []
    for tolerance in (1e-4, 1e-5, 1e-7) if full else (1e-4, 1e-5):
        label = f"{tolerance * 1e3:g} mm"
        for family, made, h in (
            ("Euler 10 ms, iterated to", iterated_to(sim.ConvergedEuler(), tolerance), 0.01),
            ("SDIRK2 20 ms, iterated to", iterated_to(sim.Sdirk2(), tolerance), 0.02),
        ):
            settings.append(Setting(family, label, made, sim.HalvingStep(h), model))
    return settings


def _controlled(model: Model, nodes: NDArray[np.int64]) -> list[Setting]:
    """Steps chosen by the estimated error."""
    return [
        Setting(
            "SDIRK2, error control",
            f"{tolerance * 1e3:g} mm",
            iterated_to(sim.Sdirk2(), min(1e-5, 0.02 * tolerance)),
            sim.ErrorControlledStep(tolerance, 0.02, nodes, HORIZON),
            model,
        )
        for tolerance in (3e-4, 1e-4, 3e-5, 1e-5)
    ]


def _linear(model: Model) -> list[Setting]:
    """Settings with every available linear solver; a hard volume has its own solver."""
    if model.volume == "hard":
        return []
    names = [n for n in LINEAR_SOLVERS if pardiso_is_available() or "pardiso" not in n]
    return [
        Setting(f"{family}, solver", name, integrator, steps, model, name)
        for family, integrator, steps in (
            ("linearly implicit Euler 10 ms", sim.LinearlyImplicitEuler(), sim.FixedStep(0.01)),
            ("SDIRK2 20 ms", sim.Sdirk2(), sim.HalvingStep(0.02)),
        )
        for name in names
    ]
