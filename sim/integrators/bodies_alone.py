"""Fused steps of scenes of rigid bodies without tissue."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sim._kernels.body_tables import Led, Scratch
from sim._kernels.free_bodies import run_free_bodies
from sim._kernels.multibody import advance_bodies, force_bodies
from sim.joints.compiled import DRIFT, PROJECTIONS
from sim.joints.contract import REACTIONS
from sim.multibody import Multibody
from sim.state import Array, Control, ControlAt, Pose, State
from sim.system import System
from sim.terms.crushable import GONE


@dataclass(frozen=True, eq=False)
class BodiesAlone:
    """Memory of the steps of one scene of bodies."""

    system: System
    tables: Multibody
    scratch: Scratch

    @classmethod
    def of(cls, system: System) -> "BodiesAlone | None":
        """Memory for a system; None unless it is a scene of rigid bodies without tissue."""
        tables = system.multibody
        return None if tables is None else cls(system, tables, tables.scratch())

    def advance(
        self, state: State, control: ControlAt, ends: Sequence[float], theta: float
    ) -> tuple[State, int]:
        """Advance by linearly implicit steps up to the first that requires more than a Cholesky factor.

        Returns the state and the number of steps.

        Parameters
        ----------
        state : State
        control : ControlAt
        ends : times at which steps end [s].
        theta : float
            Implicit part of a step; 1 is Euler's method, 1/2 the trapezoidal rule.
        """
        time = [state.t]
        for end in ends:
            time.append(time[-1] + (end - time[-1]))
        frames, twists = state.frames.copy(), state.twists.copy()
        q, v = np.empty_like(state.q), np.empty_like(state.v)
        reaction = np.zeros(len(self.tables.rows.kind))
        eaten = self.tables.eaten
        whole = np.array([name in state.memory and state.memory[name][0] > 0.0 for name in eaten])
        whole = whole.astype(np.bool_)  # an empty array has no type of its own
        done: int = advance_bodies(
            self.tables.table,
            self.tables.lines,
            self.tables.rows,
            self.tables.kinds,
            self._led(time[1:]),
            self.scratch,
            np.diff(time),
            control.at_ends(time),
            whole,
            GONE,
            theta,
            PROJECTIONS,
            DRIFT,
            frames,
            twists,
            q,
            v,
            reaction,
        )
        memory = {REACTIONS: reaction} if done and len(reaction) else {}
        memory |= {name: np.array([float(w)]) for name, w in zip(eaten, whole, strict=True)}
        return State(time[done], q, v, memory, frames, twists), done

    def force(self, state: State, control: Control) -> Array:
        """Generalised forces (n,) of all terms outside a step, as of `System.force`."""
        tables, scratch = self.tables, self.scratch
        force_bodies(tables.table, tables.lines, scratch, state.frames, control.activation)
        return scratch.r.copy()

    @property
    def are_free(self) -> bool:
        """True if nothing but constant forces on points and damping acts on the bodies."""
        tables = self.tables
        return not (len(tables.led) or len(tables.rows.kind) or len(tables.lines.rest))

    def run_free(self, state: State, ends: Sequence[float]) -> State:
        """State after steps of the classical Runge-Kutta method that end at the given times [s]."""
        frames, twists, maps = state.frames.copy(), state.twists.copy(), self.system.kinematics
        run_free_bodies(self.tables.table, np.diff([state.t, *ends]), frames, twists)
        t, still = float(ends[-1]), np.zeros(self.tables.n)
        q = maps.advance(Pose(state.q, frames, t), still, t).q
        return maps.state(Pose(q, frames, t), maps.velocities(replace(state, twists=twists)), {})

    def _led(self, times: Sequence[float]) -> Led:
        """Motion of prescribed bodies at some times."""
        led, maps = self.tables.led, self.system.kinematics
        n, k = len(times), len(led)
        frames: Array = np.zeros((n if k else 0, k, 7))
        twists: Array = np.zeros((n if k else 0, k, 6))
        for i in range(n if k else 0):
            whole = maps.rest_frames.copy()
            maps.prescribe(whole, times[i])
            frames[i], twists[i] = whole[led], maps.prescribed_twists(times[i])[led]
        return Led(led, frames, twists)
