"""Motions of the reduced face for edited curves, frame by frame, from the first frame that changes."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from emgface.pictures.body import Skin
from emgface.reduced.model import ReducedFace
from emgface.view.curves import Curves
from sim import Activation, State, Workspace
from sim.activation import Driven
from sim.reduced import FusedEuler, ReductionError
from sim.reduced.fused import OMITTED
from sim.state import Outputs, StepReport
from sim.threads import one_blas_thread

Floats = NDArray[np.float64]

AT_ONCE: Final = 5  #: number of frames between two looks at whether a motion is still wanted


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of a motion.

    Attributes
    ----------
    time : array (n,) [s]
    skin, markers : arrays (n, points, 3) [m]
    coordinates, levels : arrays (k, modes) [sqrt(kg) m], (k, muscles) [1]
        Coordinates and activations at the frames that were computed.
    bound : float
        Largest bound of the error of the reduction [m].
    since : float
        Time from which the motion was computed anew [s].
    """

    time: Floats
    skin: Floats
    markers: Floats
    coordinates: Floats
    levels: Floats
    bound: float
    since: float


class Motions:
    """Motions of edited curves, one after the other, with steps of one length.

    The state at every frame of the last motion is kept. What precedes the first frame with another
    activation is not computed again; the motion is the same bit for bit as from the start. Previews
    have steps that are longer than the time between frames; positions between them are those of the
    straight line.

    Parameters
    ----------
    reduced : ReducedFace
    skin : Skin
    output : float
        Time between frames [s].
    step : float
        Length of the steps [s], a fraction of `output` or twice as long.
    """

    def __init__(self, reduced: ReducedFace, skin: Skin, output: float, step: float) -> None:
        face, r = reduced.face, reduced.moving
        nodes = face["marker_node"].values.astype(np.int64)
        own = reduced.modes[nodes, :, r:]
        self._reduced, self._output, self._step = reduced, output, step
        self._steps = max(round(output / step), 1)  # of a frame
        self._skin = np.ascontiguousarray(reduced.modes[skin.node][..., :r].reshape(-1, r))
        self._rest, self._markers = reduced.rest[skin.node], len(nodes)
        self._error = ReductionError(np.ascontiguousarray(own).reshape(-1, own.shape[2]))
        self._seen = np.zeros((0, (self._steps + 1) * len(reduced.model.system.muscles)))
        self._states: list[State] = [reduced.equilibrium]
        self._work = Workspace(reduced.model.system)

    @one_blas_thread
    def __call__(self, curves: Curves, watch: Callable[[], None] | None = None) -> Frames:
        """Motion of curves; errors as `emgface.reduced.motion.simulate_reduced`.

        `watch`, which is called every `AT_ONCE` frames, may end it by an error.
        """
        system, length = self._reduced.model.system, self._steps * self._step
        frames = max(round(curves.duration / self._output), 1)
        count = int(np.ceil(frames * self._output / length - 1e-9))
        ends: Floats = self._step * np.arange(1.0, count * self._steps + 1)
        activation = Activation(*curves.activation(system.muscles))
        driven, times = (
            Driven(system, activation),
            np.append(0.0, ends[self._steps - 1 :: self._steps]),
        )
        levels = activation.at_all(times)
        # What the steps of each frame see, and what the correction of the markers sees at its end.
        steps = driven.at_ends([0.0, *ends.tolist()]).reshape(count, -1)
        seen = np.concatenate([steps, levels[1:]], axis=1)
        n = min(count, len(self._seen))
        same = np.append((seen[:n] == self._seen[:n]).all(axis=1), False)
        first = int(np.argmin(same))
        states = self._states[: first + 1]
        groups: list[list[float]] = ends.reshape(count, -1)[first:].tolist()
        at_once = AT_ONCE if watch else max(len(groups), 1)
        for k in range(0, len(groups), at_once):
            if k and watch:
                watch()
            states += self._after(states[-1], driven, groups[k : k + at_once])
        self._states, self._seen = states, seen
        return self._frames(states, levels, first * length, frames + 1)

    def _after(self, state: State, driven: Driven, groups: list[list[float]]) -> list[State]:
        """States at the end of each group of steps that end at given times [s]."""
        system, contact, states = self._reduced.model.system, self._reduced.contact, list[State]()
        integrator, work = FusedEuler(contact), self._work
        if contact is None:
            for outputs in integrator.run(system, state, driven, groups, work):
                states += [outputs.state(k) for k in range(len(outputs.t))]
            return states
        for group in groups:
            for end in group:
                state, _ = integrator.step(system, state, driven, end - state.t, work)
            states.append(state)
        return states

    def _frames(self, states: list[State], levels: Floats, since: float, frames: int) -> Frames:
        reduced, n = self._reduced, len(states)
        y = np.array([s.q.reshape(-1)[: reduced.moving] for s in states])
        outputs = Outputs(
            t=np.array([s.t for s in states]),
            q=np.array([s.q for s in states]),
            v=np.array([s.v for s in states]),
            memory={OMITTED: np.array([s.memory[OMITTED] for s in states])},
            frames=np.zeros((n, 0, 7)),
            twists=np.zeros((n, 0, 6)),
            reports=[StepReport(h=self._step, smallest_J=np.nan)] * n,
        )
        system = reduced.model.system
        markers = reduced.markers.record_all(system, outputs, levels)[0][:, : self._markers]
        estimate = self._error.record_all(system, outputs, levels)[0]
        skin = self._rest + (y @ self._skin.T).reshape(n, -1, 3)
        if self._step > self._output:
            skin, markers = (between(x)[:frames] for x in (skin, markers))
        attrs = reduced.dataset.attrs
        bound = attrs["error_factor"] * (float(estimate.max()) + attrs["error_floor"])
        time: Floats = self._output * np.arange(float(len(skin)))
        return Frames(time, skin, markers, y, levels, bound, since)


def between(values: Floats) -> Floats:
    """The same rows (n, ...) with the mean of neighbours between them (2 n - 1, ...)."""
    whole = np.empty((2 * len(values) - 1, *values.shape[1:]))
    whole[::2] = values
    whole[1::2] = 0.5 * (values[1:] + values[:-1])
    return whole
