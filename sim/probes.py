"""Probes: quantities recorded at every output time."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from sim.checks import real_numbers
from sim.dense import dot
from sim.errors import SceneError
from sim.indices import count_of, index, indices, kept_until_known
from sim.scene import Index
from sim.state import Array, Control, Outputs, State, StepReport
from sim.system import System

AXES = ("x", "y", "z")

Report = StepReport | None  #: None for the initial state and inside a step
Values = tuple[Array | float, ...]  #: values of all variables of a probe at one time


@dataclass(frozen=True)
class Variable:
    """Name, dims after time, unit and coordinates of a recorded variable."""

    name: str
    units: str
    dims: tuple[str, ...] = ()
    coords: Mapping[str, Sequence[str]] | None = None


class Probe(Protocol):
    """Interface of probes."""

    def variables(self) -> tuple[Variable, ...]:
        """Describe the variables returned by `record`, in order."""
        ...

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Values at one time."""
        ...


@runtime_checkable
class ReadsErrors(Protocol):
    """Probe or step control that reads the estimated error of every step, which takes time."""

    reads_errors: ClassVar[bool]


@runtime_checkable
class RecordsTogether(Probe, Protocol):
    """Interface of probes that evaluate several outputs at once."""

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Values of every variable along the first axis, under activations (n, n_muscles)."""
        ...


def recorded(
    probe: Probe, system: System, outputs: Outputs, activation: Array
) -> tuple[Array, ...]:
    """Values of a probe over several outputs under activations (n, n_muscles)."""
    if isinstance(probe, RecordsTogether):
        return probe.record_all(system, outputs, activation)
    rows = [
        probe.record(system, outputs.state(k), Control(a, float(outputs.t[k])), report)
        for k, (a, report) in enumerate(zip(activation, outputs.reports, strict=True))
    ]
    return tuple(np.array(column, dtype=np.float64) for column in zip(*rows, strict=True))


def _over_markers(name: str, markers: tuple[str, ...]) -> tuple[Variable, ...]:
    """One variable of named nodes, (marker, axis) [m]."""
    return (Variable(name, "m", ("marker", "axis"), {"marker": markers, "axis": AXES}),)


@dataclass(frozen=True, eq=False)
class _Named:
    """Named nodes."""

    nodes: Index  #: (n_markers,) node indices, or a mask (n_nodes,)
    names: tuple[str, ...]  #: marker names

    def __post_init__(self) -> None:
        place = type(self).__name__
        object.__setattr__(self, "nodes", kept_until_known(place, "node", self.nodes))
        if count_of(self.nodes) != len(self.names):
            raise SceneError(
                f"{place}: {count_of(self.nodes)} nodes for {len(self.names)} names, expected one each"
            )

    def _indices(self, n: int) -> Index:
        return indices(type(self).__name__, "node", self.nodes, n)


@dataclass(frozen=True, eq=False)
class Markers(_Named):
    """Positions of named nodes, (marker, axis) [m]."""

    def variables(self) -> tuple[Variable, ...]:
        """One variable ``position``."""
        return _over_markers("position", self.names)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Copy the marker positions."""
        return (state.q[self._indices(len(state.q))],)

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Copy the marker positions."""
        return (outputs.q[:, self._indices(outputs.q.shape[1])],)


@dataclass(frozen=True)
@real_numbers
class Opening:
    """Distance of one node above another along a direction, such as the lip opening [m].

    e . (x_upper - x_lower) with the unit vector e, negative if the upper node is below the lower
    one. The direction is fixed in space, because a distance has no sign, the direction between the
    nodes is reversed if one slides in front of the other, and normals rotate as lips roll.
    """

    #: node indices
    upper: int
    lower: int
    #: from the lower to the upper node, of any length above zero
    direction: tuple[float, float, float]
    name: str = "lip_opening"  #: name of the variable

    def __post_init__(self) -> None:
        for name in ("upper", "lower"):
            index("Opening", f"{name} node", getattr(self, name), None)
        if len(self.direction) != 3 or not 0.0 < math.hypot(*self.direction) < math.inf:
            raise SceneError(
                f"Opening: direction = {self.direction!r}, expected three numbers that are not all zero"
            )

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        return (Variable(self.name, "m"),)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Signed distance along the direction."""
        n = len(state.q)
        upper, lower = (index("Opening", "node", k, n) for k in (self.upper, self.lower))
        apart = state.q[upper] - state.q[lower]
        return (float(np.array(self.direction) @ apart) / math.hypot(*self.direction),)


@dataclass(frozen=True)
class SmallestJ:
    """Smallest det F over all Gauss points [1]."""

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        return (Variable("smallest_J", "1"),)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Evaluate det F in the state."""
        return (system.smallest_J(state.q)[0],)


@dataclass(frozen=True, eq=False)
class StepErrors(_Named):
    """Estimated errors of each step at named nodes, (marker, axis) [m], and iteration tolerance [m].

    The error of the step is NaN if the integrator has no estimate; the tolerance is 0 if it does not
    iterate. The errors of the input are those by the part of the activation that the line of a step
    misses, lasting and passing, and those of contact by rows of the start, lasting and passing, which
    are NaN if surfaces press and the integrator has no estimate of them (`sim.state.StepReport`).
    """

    reads_errors: ClassVar[bool] = True

    def variables(self) -> tuple[Variable, ...]:
        """Errors of the steps, their input, contact, and iteration."""
        return (
            *_over_markers("step_error", self.names),
            *_over_markers("input_error", self.names),
            *_over_markers("passing_error", self.names),
            *_over_markers("contact_error", self.names),
            *_over_markers("contact_passing_error", self.names),
            Variable("iteration_error", "m"),
        )

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Return the estimate at the nodes; zero at the start."""
        nodes = self._indices(len(state.q))
        none = np.zeros((len(nodes), 3))
        if report is None:
            return none, none, none, none, none, 0.0
        contact = (none, none) if report.contact_error is None else report.contact_error[:, nodes]
        if report.contact_error is None and report.touching:
            contact = (none + np.nan, none + np.nan)
        left = float(np.nan_to_num(report.increment))
        if report.local_error is None:
            return none + np.nan, none, none, *contact, left
        missed = report.input_error
        lasting, passing = (none, none) if missed is None else missed[:, nodes]
        return report.local_error[nodes], lasting, passing, *contact, left


@dataclass(frozen=True)
class Energies:
    """Kinetic and potential energy [J] of all terms at the current control, relaxed if viscoelastic."""

    def variables(self) -> tuple[Variable, ...]:
        """Two variables."""
        return Variable("kinetic_energy", "J"), Variable("potential_energy", "J")

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Return v' M v / 2 and the sum of the terms' energies."""
        kinetic = 0.5 * dot(system.node_mass, (state.v**2).sum(axis=1))
        kinetic += system.kinematics.kinetic_energy(state)
        return kinetic, system.force(state.q, control).energy


@dataclass(frozen=True)
class Iterations:
    """Solver statistics of every interval: iterations, factorisations, steps, rejections, residual."""

    def variables(self) -> tuple[Variable, ...]:
        """Six counts and the residual."""
        counts = ("iterations", "factorisations", "steps", "rejected", "shifts", "indefinite")
        return (*(Variable(name, "1") for name in counts), Variable("residual", "N"))

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Copy the report; zeros for the initial state."""
        return (0.0,) * 7 if report is None else self._counts(report)

    def record_all(self, system: System, outputs: Outputs, activation: Array) -> tuple[Array, ...]:
        """Copy the reports."""
        return tuple(np.array([self._counts(r) for r in outputs.reports], dtype=np.float64).T)

    def _counts(self, report: StepReport) -> tuple[float, ...]:
        return (
            report.iterations,
            report.factorisations,
            report.steps,
            report.rejected,
            report.shifts,
            report.indefinite,
            report.residual,
        )


@dataclass(frozen=True)
class Positions:
    """Positions of all nodes, (node, axis) [m]: large, for pictures and comparisons."""

    def variables(self) -> tuple[Variable, ...]:
        """One variable."""
        return (Variable("node_position", "m", ("node", "axis"), {"axis": AXES}),)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Copy all positions."""
        return (state.q.copy(),)


@dataclass(frozen=True)
class Contacts:
    """Contacts of every pairing: number, smallest gap [m], normal force [N].

    The gap is negative if a vertex is deeper than its allowed initial depth, and NaN if no surfaces
    are close. The force is the sum of the absolute normal forces.

    Raises
    ------
    SceneError
        On recording: the scene has no contact.
    """

    #: names of the pairings of the scene in their order, as coordinates
    pairings: tuple[str, ...] | None = None

    def variables(self) -> tuple[Variable, ...]:
        """Three variables over the pairings."""
        coords = None if self.pairings is None else {"pairing": self.pairings}
        names = (("contacts", "1"), ("contact_gap", "m"), ("contact_force", "N"))
        return tuple(Variable(name, units, ("pairing",), coords) for name, units in names)

    def record(self, system: System, state: State, control: Control, report: Report) -> Values:
        """Measure the contacts of the state."""
        if system.contact is None:
            raise SceneError(
                "the probe Contacts found no contact in the scene: declare one or remove the probe"
            )
        return system.contact.measure(state)
