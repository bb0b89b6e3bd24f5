"""Probes of rigid bodies: their frames, and the forces of their joints."""

from dataclasses import dataclass

import numpy as np

from sim.errors import SceneError
from sim.integrators.constrained_acceleration import forces_of_rows
from sim.joints.compiled import CompiledJoints
from sim.joints.contract import REACTIONS
from sim.probes import AXES, Report, Values, Variable
from sim.state import Array, Control, Outputs, State
from sim.system import System


@dataclass(frozen=True)
class Frames:
    """Centres [m] and quaternions of all bodies."""

    names: tuple[str, ...]  #: bodies in the order of the scene

    def variables(self) -> tuple[Variable, ...]:
        """Variables ``body_position`` and ``body_quaternion``."""
        body = {"body": self.names}
        centre = Variable("body_position", "m", ("body", "axis"), body | {"axis": AXES})
        parts = body | {"part": ("w", "x", "y", "z")}
        return centre, Variable("body_quaternion", "1", ("body", "part"), parts)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Copy the frames."""
        return state.frames[:, :3].copy(), state.frames[:, 3:].copy()

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Copy the frames."""
        return outputs.frames[..., :3].copy(), outputs.frames[..., 3:].copy()


@dataclass(frozen=True)
class Reactions:
    """Force [N] and moment [N m] that every joint exerts on its body b, or on its point.

    They are means over the step that ends at the output; with explicit integrators, and at the start,
    they are those of the motion at the output (NaN with limits and compliant joints). The moment is
    about the place of the joint on b; the opposite force and moment act on body a.

    Raises
    ------
    SceneError
        On recording: the scene has no or other joints.
    """

    names: tuple[str, ...]  #: joints in the order of the scene

    def variables(self) -> tuple[Variable, ...]:
        """Variables ``joint_force`` and ``joint_moment``."""
        coords = {"joint": self.names, "axis": AXES}
        names = (("joint_force", "N"), ("joint_moment", "N m"))
        return tuple(Variable(name, units, ("joint", "axis"), coords) for name, units in names)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Sum the forces of the rows of each joint."""
        rows, forces = self._rows(system), forces_of_rows(system, state, control)[None]
        force, moment = rows.reactions(state.frames[None], state.q[None], forces)
        return force[0], moment[0]

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Sum the forces of the rows of each joint."""
        rows, forces = self._rows(system), outputs.memory.get(REACTIONS)
        if forces is None:
            states = [outputs.state(k) for k in range(len(activation))]
            control = [Control(a, x.t) for a, x in zip(activation, states, strict=True)]
            both = zip(states, control, strict=True)
            forces = np.array([forces_of_rows(system, x, c) for x, c in both])
        return rows.reactions(outputs.frames, outputs.q, forces)

    def _rows(self, system: System) -> CompiledJoints:
        joints = () if system.rows is None else system.rows.joints
        if system.rows is None or joints != self.names:
            raise SceneError(
                f"the probe Reactions refers to {self.names}, expected the joints {joints}"
            )
        return system.rows
