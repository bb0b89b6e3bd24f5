"""Fit of one calibration trial: its markers as a linear function of the activations, and its sEMG."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from emgface.face.recipe import named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.assumptions import emg_precision
from emgface.inverse.kept import Kept
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.problem import Problem, pose_problem
from emgface.inverse.run import fitted
from emgface.inverse.variants import RECORDED_MUSCLES
from emgface.signals.parameters import SignalChain
from sim.inverse import LinearTargets, Quadratic
from sim.state import Array
from sim.threads import one_blas_thread

GAIN = 0.5, 0.5
"""Mean and standard deviation of the gain before the trials are known [1]."""
DELAY = 0.04, 0.02
"""Mean and standard deviation of the delay of a person before the trials are known [s]."""
ERROR, PRIOR_SAMPLES = 0.25, 4.0
"""Error of the sEMG before the trials are known [1], and the samples for which it counts."""

Scales = tuple[Array, Array, Array]
"""Gain, delay and error of all muscles."""

_DIMS = {
    "emg": ("time_emg", "muscle"),
    "emg_time": ("time_emg",),
    "step_time": ("time",),
    "basis": ("time", "spline"),
    "displacement": ("time", "coordinate"),
    "coefficients": ("spline", "muscle"),
    "residual": ("time", "coordinate"),
    "J": ("time", "coordinate", "coefficient"),
}

_NUMBERS = ("h", "size", "noise", "marker_weight")


@dataclass(frozen=True)
class CalibrationTrial:
    """sEMG of a trial, and its markers as a linear function of the activations near their best fit.

    Attributes
    ----------
    muscles : of the columns of all arrays.
    emg, emg_time : activation from sEMG (n_samples, n_muscles) and its times [s].
    step_time : (n_steps,) time of the recording at the ends of the steps [s].
    basis : (n_steps, n_splines) splines at these times.
    displacement : (n_steps, m) of the markers that is wanted [m].
    coefficients, residual, J : those of `sim.inverse.LinearTargets`.
    h, size, noise, marker_weight : step [s], unit of the residuals [m], noise of a coordinate [m], and
        weight of `emgface.inverse.assumptions.marker_precision`.
    """

    muscles: tuple[str, ...]
    emg: Array
    emg_time: Array
    step_time: Array
    basis: Array
    displacement: Array
    coefficients: Array
    residual: Array
    J: Array
    h: float
    size: float
    noise: float
    marker_weight: float

    def __post_init__(self) -> None:  # noqa: D105
        for name in _DIMS:  # as read from a file, so that sums have the same order
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))

    @property
    def linearised(self) -> LinearTargets:
        """Targets as a linear function of the coefficients."""
        return LinearTargets(self.coefficients, self.residual, self.J)

    def delayed(self, muscle: int, delay: float) -> Array:
        """Activation from sEMG of one muscle at the ends of the steps, 0 where not recorded."""
        return np.interp(
            self.step_time - delay, self.emg_time, self.emg[:, muscle], left=0.0, right=0.0
        )

    def scaled(self, gain: Array, delay: Array) -> Array:
        """Activation from sEMG (n_steps, n_muscles) with gains and delays [s]."""
        each = enumerate(zip(gain, delay, strict=True))
        return np.array([g * self.delayed(m, d) for m, (g, d) in each]).T.clip(0.0, 1.0)

    def prior(self, p: InverseParameters, scales: Scales, mixing: Array, use: Array) -> Quadratic:
        """Density of the coefficients before the motion is known, with the sEMG of muscles in `use`."""
        gain, delay, error = scales
        weight = emg_precision(p.assumed, error, np.where(use, 1.0, 0.0), self.h)
        return p.assumed.density(self.scaled(gain, delay), weight, self.h, mixing).quadratic

    def to_dataset(self) -> xr.Dataset:
        """Dataset with all values, from which `of_dataset` returns the same bits."""
        arrays = {name: (dims, getattr(self, name)) for name, dims in _DIMS.items()}
        numbers = {name: getattr(self, name) for name in _NUMBERS}
        return xr.Dataset(arrays, attrs=numbers | {"muscles": " ".join(self.muscles)})

    @classmethod
    def of_dataset(cls, stored: xr.Dataset) -> "CalibrationTrial":
        """Trial from its dataset."""
        values: dict[str, Any] = {str(name): value.values for name, value in stored.items()}
        values.update({name: float(stored.attrs[name]) for name in _NUMBERS})
        values["muscles"] = tuple(stored.attrs["muscles"].split())
        return cls(**values)


@one_blas_thread
def fit_trial(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters,
    chain: SignalChain,
    parameters: InverseParameters,
    *,
    settled: xr.Dataset,
    session: xr.Dataset,
    kept: Kept | None = None,
) -> CalibrationTrial:
    """Fit a trial with the gain, delay and error that are assumed before; errors as of `invert`.

    `session` is the range of the features over all trials of the person. The state of the fit is
    stored in `kept`, from which an interrupted one continues.
    """
    p = parameters
    problem = pose_problem(recording, face, simulation, chain, p, settled=settled, session=session)
    muscles = problem.system.muscles
    emg = np.array([GAIN[0] * problem.delayed(m, DELAY[0]) for m in muscles]).T.clip(0.0, 1.0)
    recorded = np.array([m.rpartition("_")[0] in RECORDED_MUSCLES for m in muscles])
    error = np.full(len(muscles), ERROR)
    weight = emg_precision(p.assumed, error, np.where(recorded, 1.0, 0.0), problem.h)
    density = p.assumed.density(emg[1:], weight, problem.h)
    with named_elements(face):
        refined = fitted(problem, p, density, kept=kept, draws=0)
    one = refined.linearised
    activation = problem.emg["activation"].sel(muscle=list(muscles)).transpose("time", "muscle")
    return CalibrationTrial(
        muscles=tuple(muscles),
        emg=activation.values,
        emg_time=activation["time"].values,
        step_time=problem.start + problem.target.time[1:],
        basis=refined.splines.basis(refined.time),
        displacement=_displacement(problem),
        coefficients=one.coefficients,
        residual=one.residual,
        J=one.J,
        h=float(problem.h),
        size=float(problem.target.size),
        noise=float(problem.noise),
        marker_weight=float(refined.marker_weight),
    )


def _displacement(problem: Problem) -> Array:
    """Displacements (n_steps, m) of the markers from rest that are wanted [m]."""
    moved = problem.target.position - problem.state.q[problem.target.nodes]
    return moved.reshape(len(moved), -1)[1:]
