"""Prescribed motion of nodes and bodies, and its velocities and accelerations by differences."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.bodies import Body, Motion
from sim.errors import SceneError
from sim.kinematics import rotations
from sim.kinematics.members import NodeMotion
from sim.pattern import Index
from sim.state import Array

PATH_DIFFERENCE = 1e-4
"""Time step of finite differences [s]; their relative error for a motion of 10 Hz is 1e-12."""


@dataclass(frozen=True)
class Path:
    """Prescribed motion of one body; None keeps it fixed."""

    motion: Motion | None


class Paths:
    """All prescribed motions: of bodies `moved` (n_bodies,), of which `led` (k,) are not at rest."""

    def __init__(
        self,
        nodes: Sequence[tuple[Index, NodeMotion]],
        motions: Sequence[Path | None],
        bodies: Sequence[Body],
    ) -> None:
        self._nodes, self._n = nodes, len(bodies)
        self._motions = [
            (b, path.motion, bodies[b].name)
            for b, path in enumerate(motions)
            if path is not None and path.motion is not None
        ]
        self.led: Index = np.array([b for b, _, _ in self._motions], dtype=np.int64)
        self.moved = np.array([path is not None for path in motions], dtype=bool)

    def __bool__(self) -> bool:
        """Return True if anything moves."""
        return bool(self._nodes) or bool(self._motions)

    def set_positions(self, q: Array, t: float) -> None:
        """Set prescribed nodes to their positions at a time."""
        for nodes, path in self._nodes:
            q[nodes] = _finite(np.asarray(path(t), dtype=np.float64), "PrescribedNodes", t)

    def set_frames(self, frames: Array, t: float) -> None:
        """Set prescribed bodies to their frames at a time."""
        for b, motion, name in self._motions:
            centre, quaternion = motion(t)
            frames[b, :3], frames[b, 3:] = centre, quaternion
            _finite(frames[b], f"PrescribedBody({name!r})", t)
            frames[b, 3:] /= np.linalg.norm(frames[b, 3:])

    def set_velocities(self, v: Array, t: float) -> None:
        """Set the velocities of prescribed nodes."""
        for nodes, path in self._nodes:
            v[nodes] = _slope([np.asarray(path(t + k * PATH_DIFFERENCE)) for k in (-2, -1, 1, 2)])

    def twists(self, t: float) -> Array:
        """Twists (n_bodies, 6); zero for bodies that are not prescribed."""
        out = np.zeros((self._n, 6))
        if self._motions:
            here, *around = self._around(t, (0, -2, -1, 1, 2))
            if all(np.array_equal(f, here) for f in around):
                return out
            out[:, :3] = _slope([f[:, :3] for f in around])
            out[:, 3:] = _slope([rotations.difference(here[:, 3:], f[:, 3:]) for f in around])
        return out

    def accelerations(self, a: Array, t: float) -> Array:
        """Write accelerations of prescribed nodes into a; return rates (n_bodies, 6) of the twists."""
        for nodes, path in self._nodes:
            x = [np.asarray(path(t + k * PATH_DIFFERENCE)) for k in (-1, 0, 1)]
            a[nodes] = (x[0] - 2.0 * x[1] + x[2]) / PATH_DIFFERENCE**2
        later, sooner = self.twists(t + PATH_DIFFERENCE), self.twists(t - PATH_DIFFERENCE)
        return (later - sooner) / (2.0 * PATH_DIFFERENCE)

    def _around(self, t: float, steps: tuple[int, ...]) -> list[Array]:
        points: list[Array] = []
        for k in steps:
            frames = np.zeros((self._n, 7))
            frames[:, 3] = 1.0
            self.set_frames(frames, t + k * PATH_DIFFERENCE)
            points.append(frames)
        return points


def _slope(x: Sequence[Array]) -> Array:
    """Derivative by central differences of fourth order, from values at -2, -1, 1 and 2."""
    return (x[0] - 8.0 * x[1] + 8.0 * x[2] - x[3]) / (12.0 * PATH_DIFFERENCE)


def _finite(values: Array, name: str, t: float) -> Array:
    if not np.isfinite(values).all():
        raise SceneError(f"{name} is not finite at {t:g} s, expected numbers")
    return values
