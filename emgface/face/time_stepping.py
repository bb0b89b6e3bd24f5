"""How the motion of the face is solved, and when it is recorded."""

from typing import Any, Literal

from pydantic import model_validator

from emgface.choices import ESKES, OWN, Parameters, choice, parameter, positive
from emgface.face.accuracy import PRESETS, accuracy_settings


class TimeStepping(Parameters):
    """Solver, step and accuracy."""

    accuracy: str | None = choice(
        None,
        "'draft', 'study', 'reference', 'published', or the error wanted such as '0.1 mm'; sets solver, "
        "step, iteration_tolerance and error_tolerance where they are not given.",
        source=f"{OWN}: points measured by `python -m benchmarks work_precision`",
        note="the defaults are those of 'study'; with contact.method = 'constraint' the solver is "
        "implicit Euler under the same control of its error",
    )
    solver: Literal[
        "converged",
        "trapezoidal",
        "sdirk2",
        "linearly_implicit",
        "linearly_implicit_trapezoidal",
    ] = choice(
        "sdirk2",
        "Integrator: implicit Euler iterated to its tolerance ('converged'), the trapezoidal rule, the "
        "L-stable second-order SDIRK2, or Euler and trapezoidal rule with one linear solution a step.",
        note="'linearly_implicit' is what the published simulator does",
    )
    step: float = parameter(
        0.01, "Time step; the largest one of error control.", unit="s", source=OWN, gt=0, le=0.1
    )
    output: float = parameter(
        0.01,
        "Time between outputs, a whole multiple of step or a whole part of it.",
        unit="s",
        source=OWN,
        note="within a step the motion is a cubic with the positions and velocities of its ends; with "
        "contact, and where that cubic would crush an element, steps end at outputs",
        gt=0,
        le=0.1,
    )
    iteration_tolerance: float = positive(
        5e-6,
        "Error of the position of a node that the iteration of a step may leave.",
        unit="m",
        note="solvers of one linear solution a step do not iterate",
    )
    error_tolerance: float | None = positive(
        1e-4,
        "Error of the lip markers that the steps are chosen by, each dividing `step`; absent, as "
        "where a `solver` is given without it: steps of one size, halved where they fail.",
        unit="m",
    )
    timing: Literal["recorded", "normalised"] = choice(
        "recorded",
        "Simulated time: that of the recording, or one output per sample of the activation.",
        source=f"{ESKES}, Discussion (each instruction was normalised to 160 time steps)",
        note="'normalised' changes the speed of a movement of a trial that is not samples x output long",
    )
    linear_solver: Literal[
        "auto", "pardiso", "pardiso_single", "superlu", "gmres_pardiso", "gmres_superlu"
    ] = choice(
        "auto",
        "Direct by PARDISO, in double or single precision, or by SciPy's SuperLU; or iterative, "
        "'gmres', with factors of theirs that serve many steps.",
        note="'auto' takes PARDISO where it is installed, and reuses factors of large faces",
    )

    @model_validator(mode="before")
    @classmethod
    def _as_accurate(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        contact = data.get("contact") or {}
        method = contact.get("method") if isinstance(contact, dict) else contact.method
        if data.get("accuracy") is not None or (method == "constraint" and "solver" not in data):
            wanted = str(data.get("accuracy") or "study")
            settings = accuracy_settings(wanted, constrained=method == "constraint")
            if wanted in PRESETS and str(data.get("solver")).startswith("linearly_implicit"):
                settings["error_tolerance"] = None  # a solver of one's own choice, without control
            return settings | data
        return {"error_tolerance": None} | data if "solver" in data else data

    @model_validator(mode="after")
    def _runnable(self) -> "TimeStepping":
        if self.error_tolerance is not None and self.solver.startswith("linearly_implicit"):
            raise ValueError(
                f"solver = '{self.solver}' has no error control: choose 'sdirk2', 'trapezoidal' or "
                "'converged', or leave error_tolerance out"
            )
        ratio = max(self.step / self.output, self.output / self.step)
        if abs(ratio - round(ratio)) > 1e-9 * ratio:
            raise ValueError(
                f"step = {self.step:g} s and output = {self.output:g} s: expected one to be a whole "
                "multiple of the other"
            )
        return self
