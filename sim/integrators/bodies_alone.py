"""Fused steps of scenes of rigid bodies without tissue."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sim._kernels.body_tables import Flags, PrescribedBodies, Scratch
from sim._kernels.multibody import advance_bodies, change_of_bodies, place_bodies
from sim.joints.compiled import DRIFT, PROJECTIONS
from sim.joints.contract import REACTIONS
from sim.multibody import Multibody
from sim.pattern import Index
from sim.state import Array, ControlAt, Outputs, State, StepReport
from sim.system import System
from sim.terms.crushable import GONE

STEPS_AT_ONCE = 1000
"""Largest number of steps that are computed without a check for interruption."""


@dataclass(frozen=True, eq=False)
class BodiesAlone:
    """Memory of the steps of one scene of bodies."""

    system: System
    tables: Multibody
    scratch: Scratch

    @classmethod
    def for_system(cls, system: System) -> "BodiesAlone | None":
        """Memory for a system; None unless it is a scene of rigid bodies without tissue."""
        tables = system.multibody
        return None if tables is None else cls(system, tables, tables.scratch())

    def advance(
        self, state: State, control: ControlAt, ends: Sequence[float], theta: float
    ) -> "Passed":
        """Advance by linearly implicit steps up to the first that requires the general path.

        `ends` are the times at which steps end [s], of which at most `STEPS_AT_ONCE` are used, and
        `theta` is the implicit part of a step, 1 for Euler's method and 1/2 for the trapezoidal rule.
        """
        time = [state.t]
        for end in ends[:STEPS_AT_ONCE]:
            time.append(time[-1] + (end - time[-1]))
        n, names = len(time), self.tables.eaten
        frames, twists = np.empty((n, *state.frames.shape)), np.empty((n, *state.twists.shape))
        frames[0], twists[0] = state.frames, state.twists
        whole = np.zeros((n, len(names)), dtype=np.bool_)
        whole[0] = [name in state.memory and state.memory[name][0] > 0.0 for name in names]
        reaction = np.zeros((n - 1, len(self.tables.rows.kind)))
        negative, h = np.zeros(n - 1, dtype=np.int64), np.diff(time)
        tables = self.tables.table, self.tables.lines, self.tables.rows, self.tables.kinds
        about = h, control.at_ends(time), whole, GONE, theta, PROJECTIONS, DRIFT
        results = frames, twists, reaction, negative
        done: int = advance_bodies(*tables, self._led(time[1:]), self.scratch, *about, *results)
        jump = self._jumps(h[:done], twists[: done + 1])
        times = np.array(time)
        return Passed(self, times, h, frames, twists, whole, reaction, negative > 0, done, jump)

    def _jumps(self, h: Array, twists: Array) -> Array:
        """Step times the largest change (n,) of the velocity of a point of a free body in it."""
        change = np.diff(twists, axis=0)
        speed = np.linalg.norm(change[..., :3], axis=2)
        speed += self._reach * np.linalg.norm(change[..., 3:], axis=2)
        return h * speed[:, self.tables.table.column >= 0].max(axis=1, initial=0.0)

    @cached_property
    def _reach(self) -> Array:
        """Largest distance (n_bodies,) of a point of a body from its centre [m]."""
        table = self.tables.table
        reach = np.zeros(len(table.column))
        on = table.body >= 0
        np.maximum.at(reach, table.body[on], np.linalg.norm(table.arm[on], axis=1))
        return reach

    def changes(self, frames: Array, activation: Array) -> tuple[Array, Array]:
        """Motions (n, k) between frames (n + 1, ...), and decreases (n, k) of forces outside a step.

        Those at both ends of a motion are under its activation, one of (n, n_muscles).
        """
        tables, (d, change) = self.tables, np.empty((2, len(activation), self.tables.n))
        change_of_bodies(tables.table, tables.lines, self.scratch, frames, activation, d, change)
        return d, change

    def _led(self, times: Sequence[float]) -> PrescribedBodies:
        """Motion of prescribed bodies at some times."""
        led, maps = self.tables.led, self.system.kinematics
        n, k = len(times), len(led)
        frames: Array = np.zeros((n if k else 0, k, 7))
        twists: Array = np.zeros((n if k else 0, k, 6))
        for i in range(n if k else 0):
            whole = maps.rest_frames.copy()
            maps.prescribe(whole, times[i])
            frames[i], twists[i] = whole[led], maps.prescribed_twists(times[i])[led]
        return PrescribedBodies(led, frames, twists)


@dataclass(frozen=True, eq=False)
class Passed:
    """States passed by fused steps.

    `time`, `frames`, `twists` and `whole` are of the start and of the end of every step; `h`,
    `reaction` and `indefinite` are the length, the forces of rows and the definiteness of the matrix of
    each. `done` steps were possible, with `jump` as of `sim.state.StepReport`.
    """

    bodies: BodiesAlone
    time: Array
    h: Array
    frames: Array
    twists: Array
    whole: Flags
    reaction: Array
    indefinite: Flags
    done: int
    jump: Array

    def state(self, k: int) -> State:
        """State after k > 0 steps."""
        return self._outputs(np.array([k]), ()).state(0)

    def outputs(self, after: Index) -> Outputs:
        """States after numbers > 0 of steps that ascend, with reports on the steps in between."""
        return self._outputs(after, self._reports(np.concatenate([[0], after])))

    def _outputs(self, after: Index, reports: Sequence[StepReport]) -> Outputs:
        tables, frames, twists = self.bodies.tables, self.frames[after], self.twists[after]
        table, arm = tables.table, self.bodies.scratch.points.arm
        q, v = np.empty((2, len(after), *arm.shape))
        place_bodies(table.body, table.arm, frames, twists, arm, q, v)
        memory = {REACTIONS: self.reaction[after - 1]} if len(tables.rows.kind) else {}
        for name, whole in zip(tables.eaten, self.whole[after].T, strict=True):
            memory[name] = whole.astype(np.float64)[:, None]
        return Outputs(self.time[after], q, v, memory, frames, twists, reports)

    def report(self, first: int, last: int) -> StepReport:
        """Report of the steps after the first up to the last."""
        return self._reports(np.array([first, last]))[0]

    def _reports(self, bounds: Index) -> list[StepReport]:
        """Reports of the steps between successive bounds."""
        first, last = bounds[:-1], int(bounds[-1])
        columns = (
            np.minimum.reduceat(self.h[:last], first),
            np.diff(bounds),
            np.add.reduceat(self.indefinite[:last], first, dtype=np.int64),
            np.maximum.reduceat(self.jump[:last], first),
        )
        return [
            StepReport(h, float("inf"), n, 0, n, n, indefinite=bent, jump=jump)
            for h, n, bent, jump in zip(*(x.tolist() for x in columns), strict=True)
        ]
