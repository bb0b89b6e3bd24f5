"""Motion of a reduced face, with the bound of its error."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import xarray as xr

from emgface.face.simulation_parameters import SimulationParameters
from emgface.files import existing_file
from emgface.reduced.model import LOWER, UPPER, Floats, ReducedFace
from emgface.reduced.trained import SAME_STEP
from emgface.run.digest import dataset_digest
from sim import (
    Activation,
    FixedStep,
    InvertedElement,
    Iterations,
    SingularSystem,
    State,
    Workspace,
    simulate,
)
from sim.activation import Driven
from sim.probes import Probe, Variable, recorded
from sim.reduced import FusedEuler, ReductionError
from sim.state import Control, Outputs, StepReport
from sim.system import System


@lru_cache(maxsize=8)
def _loaded(path: Path, changed: int, face: str, parameters: str) -> dict[str, ReducedFace]:
    """Reduced faces in use, by file, date, face and parameters; filled by `reduced_face_of`."""
    return {}


def reduced_face_of(face: xr.Dataset, parameters: SimulationParameters) -> ReducedFace:
    """Reduced face of the file that the parameters name, read once; errors as `ReducedFace.for_face`."""
    path = parameters.reduced.file
    assert path is not None  # Callers check it.
    existing_file(path, "a reduced face (emgface reduce)")
    changed = path.stat().st_mtime_ns
    kept = _loaded(path.resolve(), changed, dataset_digest(face), parameters.model_dump_json())
    if "face" not in kept:
        kept["face"] = ReducedFace.for_face(path, face, parameters)
    return kept["face"]


def trusted_motion(
    face: xr.Dataset,
    activation: Activation,
    duration: float,
    parameters: SimulationParameters,
    further: tuple[Probe, ...] = (),
) -> tuple[xr.Dataset | None, str]:
    """Motion of the reduced face of the parameters, or None with the reason if it is not trusted.

    It is not trusted if the bound of the error exceeds ``parameters.reduced.largest_error``, an
    activation is outside the range of the training, or an element inverts. Without
    ``parameters.reduced.fall_back``, or with ``accuracy`` "realtime", it is returned nevertheless,
    with the reason in the attribute ``reduction_doubt``, and InvertedElement is raised. Errors as of
    `ReducedFace.for_face`.
    """
    reduced, chosen = reduced_face_of(face, parameters), parameters.reduced
    fall_back = chosen.fall_back and parameters.accuracy != "realtime"
    times = {"step": parameters.step, "output": parameters.output}
    try:
        trajectory = simulate_reduced(reduced, activation, duration, **times, further=further)
    except (InvertedElement, SingularSystem) as error:
        if not fall_back:
            raise
        return None, f"the reduced motion failed: {error}"
    doubt, bound = trajectory.attrs["reduction_doubt"], float(trajectory["reduction_error"].max())
    if not doubt and bound > chosen.largest_error:
        limit = chosen.largest_error
        doubt = f"the bound of the error is {1e3 * bound:.3g} mm, above {1e3 * limit:.3g} mm"
    if doubt and fall_back:
        return None, doubt
    trajectory.attrs |= {"reduced": 1, "reduction_error": bound, "reduction_doubt": doubt}
    trajectory.attrs["solver"] = "reduced linearly_implicit"
    return trajectory, doubt


@dataclass(frozen=True, eq=False)
class Lifted:
    """A probe of full order, given the positions of all nodes of a reduced face."""

    probe: Probe
    rest: Floats
    modes: Floats

    def variables(self) -> tuple[Variable, ...]:
        """Variables of the probe."""
        return self.probe.variables()

    def record(
        self, system: System, state: State, control: Control, report: StepReport | None
    ) -> tuple[Floats | float, ...]:
        """Record the probe at the positions and velocities of full order."""
        q, v = (self._moved(x[None])[0] for x in (state.q, state.v))
        whole = replace(state, q=self.rest + q, v=v, memory={})
        return self.probe.record(system, whole, control, report)

    def record_all(
        self, system: System, outputs: Outputs, activation: Floats
    ) -> tuple[Floats, ...]:
        """Record the probe at several outputs."""
        q, v = (self._moved(x) for x in (outputs.q, outputs.v))
        whole = replace(outputs, q=self.rest + q, v=v, memory={})
        return recorded(self.probe, system, whole, activation)

    def _moved(self, y: Floats) -> Floats:
        """Displacements (t, node, axis) for coordinates (t, points, 3)."""
        r = self.modes.shape[2]
        return (y.reshape(-1, r) @ self.modes.reshape(-1, r).T).reshape(-1, *self.rest.shape)


def simulate_reduced(
    reduced: ReducedFace,
    activation: Activation,
    duration: float,
    *,
    step: float = 0.01,
    output: float = 0.01,
    further: tuple[Probe, ...] = (),
) -> xr.Dataset:
    """Motion of the markers for an activation in the order of the muscles of the face.

    The result contains ``position``, ``lip_opening``, ``smallest_J`` of the chosen points,
    ``reduction_error`` (time) [m], the bound that the error of every marker stays below with the
    calibrated probability, and ``activation_distance`` (time) [1]; its attribute ``reduction_doubt``
    is empty unless an activation, or its change in a step, is outside the range of the training, or
    steps are longer (`emgface.reduced.trained`).

    Raises
    ------
    InvertedElement, SingularSystem
        A step failed.
    """
    face, r = reduced.face, reduced.moving
    omitted = reduced.modes[face["marker_node"].values.astype(np.int64), :, r:]
    probes: list[Probe] = [
        reduced.markers,
        ReductionError(np.ascontiguousarray(omitted).reshape(-1, omitted.shape[2])),
        Iterations(),
    ]
    probes += [Lifted(probe, reduced.rest, reduced.modes[..., :r]) for probe in further]
    system = reduced.model.system
    trajectory, _ = simulate(
        system,
        activation,
        duration=duration,
        integrator=FusedEuler(reduced.contact),
        steps=FixedStep(step),
        every=output,
        probes=probes,
        initial=reduced.equilibrium,
        work=Workspace(system),
    )
    return _with_error(reduced, trajectory, activation, step=step)


def _with_error(
    reduced: ReducedFace, trajectory: xr.Dataset, activation: Activation, *, step: float
) -> xr.Dataset:
    """Outputs of a reduced face from its equilibrium, with their bound and the range of the training.

    The result is that of `simulate_reduced`.
    """
    face, data = reduced.face, reduced.dataset
    times = trajectory["time"].values
    duration = float(times[-1])
    if "lip_opening_node" in face:
        height = trajectory["position"].sel(axis="z", drop=True)
        gap = height.sel(marker=UPPER, drop=True) - height.sel(marker=LOWER, drop=True)
        trajectory = trajectory.isel(marker=slice(None, -2)).assign(
            lip_opening=gap.assign_attrs(units="m")
        )
    # An error persists while its cause subsides: the largest estimate so far.
    estimate = np.maximum.accumulate(trajectory["reduction_estimate"].values)
    bound = data.attrs["error_factor"] * (estimate + data.attrs["error_floor"])
    distance = reduced.trained.distances(activation.at_all(times))
    trajectory = trajectory.drop_vars("reduction_estimate").assign(
        reduction_error=("time", bound, {"units": "m"}),
        activation_distance=("time", distance, {"units": "1"}),
    )
    ends = step_ends(duration, step)
    levels = Driven(reduced.model.system, activation).at_ends([0.0, *ends.tolist()])
    doubt = reduced.trained.doubt(ends, levels)
    return trajectory.assign_attrs(reduction_doubt=doubt)


def step_ends(duration: float, step: float) -> Floats:
    """Ends [s] of the steps, at which they see the activation, also between the outputs."""
    return np.append(step * np.arange(1, np.ceil((1.0 - SAME_STEP) * duration / step)), duration)
