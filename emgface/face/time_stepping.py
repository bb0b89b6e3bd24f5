"""Parameters of the time integration and of the outputs."""

from typing import Any, Literal

from pydantic import model_validator

from emgface.choices import ESKES, THIS_PACKAGE, Parameters, choice, parameter, positive
from emgface.face.accuracy import ACCURACY_PRESETS, accuracy_settings


class TimeStepping(Parameters):
    """Parameters of solver, step and accuracy."""

    accuracy: str | None = choice(
        None,
        "'draft', 'study', 'reference', 'published', 'realtime' (a reduced face, never repeated at "
        "full order), or the desired error, such as '0.1 mm'; determines solver, step, "
        "iteration_tolerance and error_tolerance, unless "
        "these are specified.",
        source=f"{THIS_PACKAGE}: points measured by `python -m benchmarks work_precision`",
        note="the default is 'study'",
    )
    solver: Literal[
        "converged",
        "trapezoidal",
        "sdirk2",
        "linearly_implicit",
        "linearly_implicit_trapezoidal",
    ] = choice(
        "sdirk2",
        "Integrator: implicit Euler iterated to its tolerance ('converged'), the "
        "trapezoidal rule, the L-stable second-order SDIRK2, or the Euler method or the "
        "trapezoidal rule with one linear solution per step.",
        note="'linearly_implicit' is the method of the published simulator",
    )
    step: float = parameter(
        0.01, "Time step; with error control, the largest time step.", unit="s", gt=0, le=0.1
    )
    output: float = parameter(
        0.01,
        "Time between outputs; a multiple of the step, or the step is a multiple of it.",
        unit="s",
        note="within a step, the motion is interpolated by the cubic with the positions and "
        "velocities at its ends; with contact, or where the interpolation would compress an "
        "element too far, steps end at outputs",
        gt=0,
        le=0.1,
    )
    iteration_tolerance: float = positive(
        5e-6,
        "Largest error of a nodal position at which the iteration of a step ends.",
        unit="m",
        note="solvers with one linear solution per step do not iterate",
    )
    error_tolerance: float | None = positive(
        1e-4,
        "Error of the lip markers that determines the steps, which divide `step`. If it is "
        "absent, also where only a `solver` is specified, steps have one size and are "
        "halved where they fail.",
        unit="m",
        note="the estimated error refers to the largest error of a motion: of 40 motions whose "
        "activation switches within steps, the largest estimate reached the largest error in 39, but "
        "the estimate of each output reached the error of that output in 15 only; use the largest "
        "estimate for every output",
    )
    timing: Literal["recorded", "normalised"] = choice(
        "recorded",
        "Simulated time: that of the recording, or one output per sample of the activation.",
        source=f"{ESKES}, Discussion (each instruction was normalised to 160 time steps)",
        note="'normalised' changes the speed of the movement if the duration of the trial is not "
        "samples x output",
    )
    linear_solver: Literal[
        "auto", "pardiso", "pardiso_single", "superlu", "gmres_pardiso", "gmres_superlu"
    ] = choice(
        "auto",
        "Linear solver: PARDISO, in double or single precision, or SuperLU of SciPy; or "
        "iterative ('gmres'), with factors of one of them that are reused in many steps.",
        note="'auto' uses PARDISO if it is installed, and reuses factors for large faces",
    )

    @model_validator(mode="before")
    @classmethod
    def _as_accurate(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        if data.get("accuracy") is not None:
            wanted = str(data["accuracy"])
            settings = accuracy_settings(wanted)
            if wanted in ACCURACY_PRESETS and str(data.get("solver")).startswith(
                "linearly_implicit"
            ):
                settings["error_tolerance"] = None  # a specified solver, without error control
            return settings | data
        return {"error_tolerance": None} | data if "solver" in data else data

    @model_validator(mode="after")
    def _runnable(self) -> "TimeStepping":
        if self.error_tolerance is not None and self.solver.startswith("linearly_implicit"):
            raise ValueError(
                f"solver = '{self.solver}' has no error control: choose 'sdirk2', 'trapezoidal' or "
                "'converged', or omit error_tolerance"
            )
        ratio = max(self.step / self.output, self.output / self.step)
        if abs(ratio - round(ratio)) > 1e-9 * ratio:
            raise ValueError(
                f"step = {self.step:g} s and output = {self.output:g} s: expected one to be a whole "
                "multiple of the other"
            )
        return self
