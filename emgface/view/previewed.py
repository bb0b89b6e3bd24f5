"""Motion of the reduced face while a knot is dragged: long steps, from the first that changes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emgface.pictures.body import Skin
from emgface.reduced.model import ReducedFace
from emgface.view.curves import Curves
from sim import Activation, State, Workspace
from sim.activation import Driven
from sim.reduced import FusedEuler, ReductionError
from sim.state import Control

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Preview:
    """Frames of a motion.

    Attributes
    ----------
    time : array (n,) [s]
    skin, markers : arrays (n, points, 3) [m]
    bound : float
        Largest bound of the error of the reduction [m].
    since : float
        Time from which the motion was computed anew [s].
    """

    time: Floats
    skin: Floats
    markers: Floats
    bound: float
    since: float


class Previews:
    """Motions of edited curves as arrays, with steps of twice the time between frames.

    Positions between steps are those of the straight line. What precedes the first step with another
    activation is that of the last motion. A reduced face with contact has no previews of this kind.

    Parameters
    ----------
    reduced : ReducedFace
        Without contact.
    skin : Skin
    output : float
        Time between frames [s].
    """

    def __init__(self, reduced: ReducedFace, skin: Skin, output: float) -> None:
        face, r = reduced.face, reduced.moving
        nodes = face["marker_node"].values.astype(np.int64)
        own = reduced.modes[nodes, :, r:]
        self._reduced, self._output, self._step = reduced, output, 2.0 * output
        self._skin = np.ascontiguousarray(reduced.modes[skin.node][..., :r].reshape(-1, r))
        self._rest, self._markers = reduced.rest[skin.node], len(nodes)
        self._error = ReductionError(np.ascontiguousarray(own).reshape(-1, own.shape[2]))
        self._levels = np.zeros((0, 2 * len(reduced.model.system.muscles)))
        self._states: list[State] = [reduced.equilibrium]
        # Skin, markers and estimate of the error at the start and at the ends of the steps.
        system, control = reduced.model.system, Control(np.zeros(len(reduced.model.system.muscles)))
        at_rest = reduced.equilibrium.q.reshape(1, -1)[:, :r]
        marked = reduced.markers.record(system, reduced.equilibrium, control, None)[0]
        self._kept = (
            self._positions(at_rest),
            np.asarray(marked)[None, : self._markers],
            np.zeros(1),
        )

    def _positions(self, coordinates: Floats) -> Floats:
        return self._rest + (coordinates @ self._skin.T).reshape(len(coordinates), -1, 3)

    def __call__(self, curves: Curves) -> Preview:
        """Motion of curves; errors as `emgface.reduced.motion.simulate_reduced`."""
        system, h = self._reduced.model.system, self._step
        frames = max(round(curves.duration / self._output), 1) + 1
        ends: Floats = h * np.arange(1, frames // 2 + 1, dtype=np.float64)
        activation = Activation(*curves.activation(system.muscles))
        driven = Driven(system, activation)
        # What the steps see, and what the correction of the markers sees at their ends.
        seen = driven.at_ends([0.0, *ends.tolist()]), activation.at_all(ends)
        levels = np.concatenate(seen, axis=1)
        n = min(len(levels), len(self._levels))
        same = np.append((levels[:n] == self._levels[:n]).all(axis=1), False)
        first = int(np.argmin(same))
        states, parts = self._compute(driven, ends, first)
        kept = tuple(
            np.concatenate([old[: first + 1], new])
            for old, new in zip(self._kept, parts, strict=True)
        )
        self._states, self._levels = self._states[: first + 1] + states, levels
        self._kept = kept
        skin, markers = (between(x)[:frames] for x in kept[:2])
        attrs = self._reduced.dataset.attrs
        bound = attrs["error_factor"] * (float(kept[2].max()) + attrs["error_floor"])
        time: Floats = self._output * np.arange(frames, dtype=np.float64)
        return Preview(time, skin, markers, bound, first * h)

    def _compute(
        self, driven: Driven, ends: Floats, first: int
    ) -> tuple[list[State], tuple[Floats, Floats, Floats]]:
        """States, skin, markers and estimates at the ends of the steps after the first ones."""
        reduced, r = self._reduced, self._reduced.moving
        system, groups = reduced.model.system, [[float(t)] for t in ends[first:]]
        states, found = list[State](), list[tuple[Floats, Floats, Floats]]()
        if groups:
            integrator, work = FusedEuler(reduced.contact), Workspace(system)
            for outputs in integrator.run(system, self._states[first], driven, groups, work):
                under = driven.activation.at_all(outputs.t)
                markers = reduced.markers.record_all(system, outputs, under)[0]
                estimate = self._error.record_all(system, outputs, under)[0]
                y = outputs.q.reshape(len(outputs.t), -1)[:, :r]
                found.append((self._positions(y), markers[:, : self._markers], estimate))
                states += [outputs.state(k) for k in range(len(outputs.t))]
        empty = tuple(x[:0] for x in self._kept)
        skin, markers, estimate = (
            np.concatenate([old, *new]) for old, *new in zip(empty, *found, strict=True)
        )
        return states, (skin, markers, estimate)


def between(values: Floats) -> Floats:
    """The same rows (n, ...) with the mean of neighbours between them (2 n - 1, ...)."""
    whole = np.empty((2 * len(values) - 1, *values.shape[1:]))
    whole[::2] = values
    whole[1::2] = 0.5 * (values[1:] + values[:-1])
    return whole
