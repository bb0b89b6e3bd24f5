"""One recording as a problem of inverse tracking on a face."""

from dataclasses import dataclass

import numpy as np
import xarray as xr

from emgface.errors import MarkerError
from emgface.face.motion import require_rest, settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.kept import digest_of
from emgface.inverse.markers import marker_nodes, wanted_positions
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.signals import estimated_activation
from emgface.muscles import LIP_MARKERS
from emgface.run.digest import dataset_digest
from emgface.signals.parameters import SignalChain
from sim import State, System, Workspace, compile_scene
from sim.inverse import PointTarget
from sim.state import Array


@dataclass(frozen=True)
class Problem:
    """One recording as a problem of inverse tracking on a face.

    ``target`` is of the lip markers that are tracked, ``start`` the time of the recording at the
    start of the simulation [s], ``h`` the step [s], ``emg`` the activation from sEMG, before gain
    and delay, ``scale`` the ratio of the mouths [1], ``noise`` the standard deviation of a
    coordinate of the markers on the face [m], ``inputs`` the digest of the face and of the
    parameters of its mechanics, and ``at_rest`` the root mean square displacement of a coordinate
    while the mouth should be at rest [m].
    """

    system: System
    state: State
    work: Workspace
    target: PointTarget
    start: float
    h: float
    emg: xr.Dataset
    scale: float
    noise: float
    inputs: str
    at_rest: float = 0.0

    @property
    def duration(self) -> float:
        """Length of the recording [s]."""
        return float(self.target.time[-1])

    @property
    def moved(self) -> float:
        """Root mean square displacement of the targets per coordinate [m]."""
        rest = self.state.q[self.target.nodes]
        return float(np.sqrt(np.nanmean((self.target.position - rest) ** 2)))

    def delayed(self, muscle: str, delay: float) -> Array:
        """Activation from sEMG of one muscle at the times of the targets, 0 where not recorded."""
        one = self.emg["activation"].sel(muscle=muscle)
        times = self.start + self.target.time - delay
        return np.interp(times, one["time"].values, one.values, left=0.0, right=0.0)


def pose_problem(
    recording: xr.Dataset,
    face: xr.Dataset,
    simulation: SimulationParameters,
    chain: SignalChain,
    parameters: InverseParameters,
    *,
    settled: xr.Dataset | None = None,
    session: xr.Dataset | None = None,
) -> Problem:
    """Scene, targets and sEMG of a recording; errors as of `invert`."""
    p = parameters
    unknown = [name for name in p.left_out if name not in LIP_MARKERS]
    if unknown:
        raise MarkerError(
            f"left_out contains {unknown[0]!r}, expected lip markers: {', '.join(LIP_MARKERS)}"
        )
    if set(p.left_out) == set(LIP_MARKERS):
        raise MarkerError("all lip markers are left out, expected at least one that is tracked")
    emg = estimated_activation(recording, chain, p.variant, session)
    start, stop = (float(emg["time"][k]) for k in (0, -1))
    h = simulation.output
    steps = int((stop - start) / h + 1e-6)
    time = np.linspace(0.0, h * steps, steps + 1, dtype=np.float64)

    system = compile_scene(compose_scene(face, simulation))
    settled = settle_face(face, simulation) if settled is None else settled
    require_rest(settled, face, simulation)
    rest = system.rest_state()
    state = State(0.0, np.ascontiguousarray(settled["node_position"].values), rest.v, rest.memory)
    nodes = marker_nodes(face)
    wanted = wanted_positions(
        recording, state.q[nodes], face, chain.head_frame, time, start, p.left_out
    )
    used = np.array([name not in p.left_out for name in LIP_MARKERS])
    position = np.ascontiguousarray(wanted.position.values[:, used])
    target = PointTarget(nodes[used], time, position, p.marker_error)
    work = Workspace(system, simulation.linear_solver)
    inputs = digest_of(dataset_digest(face), simulation.model_dump_json())
    return Problem(
        system,
        state,
        work,
        target,
        start,
        h,
        emg,
        wanted.scale,
        wanted.noise,
        inputs,
        wanted.at_rest,
    )
