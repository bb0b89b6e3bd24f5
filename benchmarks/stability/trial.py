"""One case of the battery and the evaluation of its result."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

import sim
from benchmarks.integrators import CONVERGED, IMPLICIT, STATIC
from sim.integrators import Integrator
from sim.steps import StepControl

MOST = 1.0  #: largest displacement of a node in a correct result [m]
LEAST_ENERGY = 1e-9  #: least energy to which a drift is related [J]


Judge = Callable[[sim.System, sim.State, sim.State, np.ndarray], str]
"""Returns the error found in the system, its first and last state and the energy over time, or ""."""


@dataclass(frozen=True)
class Outcome:
    """Result of a case."""

    row: int
    title: str
    case: str
    parameter: str  #: parameter that is varied
    value: float  #: its value; NaN for a single case
    integrator: str
    outcome: str  #: "ok", "refused: <error>" (a typed failure) or "WRONG: <error>"
    smallest_J: float = float("nan")
    iterations: float = float("nan")
    rejected: float = float("nan")
    #: largest relative growth of the energy in one interval, without activation
    energy_drift: float = float("nan")
    expected: bool = False  #: a refusal is the correct result


@dataclass(frozen=True, eq=False)
class Trial:
    """Case to run.

    `row`, `title` and `case` are labels in the table, `activation`, `duration` and `steps`
    excitation and stepping; `steps.h` is the output interval.
    """

    row: int
    title: str
    case: str
    #: compiled at the start of the run, so that its failure is part of the outcome
    system: Callable[[], sim.System]
    activation: Callable[[sim.System], sim.Activation]
    duration: float
    steps: StepControl
    integrators: dict[str, Integrator] = field(default_factory=lambda: dict(IMPLICIT))
    parameter: str = ""  #: parameter varied in the row, with its unit
    value: float = float("nan")
    #: initial state of the system, by default at rest
    start: Callable[[sim.System], sim.State] = sim.System.rest_state
    judge: Judge | None = None  #: further condition of a correct result
    refusal: str = ""  #: name of the expected error, or ""


def run(trial: Trial, name: str) -> Outcome:
    """Run a trial with one integrator and evaluate its result."""
    integrator = trial.integrators[name]
    head = (trial.row, trial.title, trial.case, trial.parameter, trial.value, name)
    # Linearly implicit schemes do not halve a step that fails; their failure is the result.
    single = name not in CONVERGED | STATIC and isinstance(trial.steps, sim.HalvingStep)
    steps = sim.FixedStep(trial.steps.h) if single else trial.steps
    try:
        system = trial.system()
        start = trial.start(system)
        drive = trial.activation(system)
        trajectory, end = sim.simulate(
            system,
            drive,
            duration=trial.duration,
            integrator=integrator,
            steps=steps,
            probes=(sim.SmallestJ(), sim.Iterations(), sim.Energies()),
            initial=start,
        )
    except sim.SimulationError as error:
        right = trial.refusal in ("", type(error).__name__)
        word = "refused" if right else "WRONG: refused"
        name = type(error).__name__
        return Outcome(*head, f"{word}: {name}", expected=right and bool(trial.refusal))
    energy = (trajectory["kinetic_energy"] + trajectory["potential_energy"]).values
    wrong = _wrong(system, start, end, energy, trial)
    scale = max(float(np.abs(energy).max()), LEAST_ENERGY)
    return Outcome(
        *head,
        f"WRONG: {wrong}" if wrong else "ok",
        float(trajectory["smallest_J"].min()),
        float(trajectory["iterations"].sum() / len(trajectory["time"][1:])),
        float(trajectory["rejected"].sum()),
        float(np.diff(energy).max() / scale) if not drive.values.any() else float("nan"),
    )


def _wrong(
    system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray, trial: Trial
) -> str:
    if trial.refusal:
        return f"accepted, expected {trial.refusal}"
    if not (np.isfinite(end.q).all() and np.isfinite(end.v).all()):
        return "NaN in the result"
    least, element = system.smallest_J(end.q)
    if not least > 0.0:
        return f"element {element} is inverted"
    if trial.judge is not None:
        return trial.judge(system, start, end, energy)
    if np.abs(end.q - start.q).max() > MOST:
        return "its positions diverged"
    return ""


def stays(system: sim.System, start: sim.State, end: sim.State, energy: np.ndarray) -> str:
    """Judge that no node has moved."""
    moved = float(np.abs(end.q - start.q).max())
    return "" if moved < 1e-8 else f"it has moved by {moved:.1e} m"
