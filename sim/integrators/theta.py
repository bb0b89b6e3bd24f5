"""Linearly implicit Euler and trapezoidal steps: one linear solution per step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import ClassVar

import numpy as np

from sim.checks import real_numbers, require
from sim.integrators.linearly_implicit import (
    LinearStep,
    StepEstimates,
    momentum_at,
    predicted_pose,
    step_of,
)
from sim.integrators.workspace import Workspace
from sim.state import ControlAt, Line, Outputs, State, StepReport, require_upright, united
from sim.system import System, damping_matrix, implicit_matrix


class _Linearised:
    """(M + theta h D + (theta h)^2 K) v1 = M v0 + h f(q0) - (1 - theta) h (D + theta h K) v0.

    The positions are q1 = q0 + h ((1 - theta) v0 + theta v1).
    """

    theta: ClassVar[float]
    estimated: ClassVar[bool]
    tolerance: float

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance, above=0.0)

    def step(
        self, system: System, state: State, control: ControlAt, h: float, work: Workspace
    ) -> tuple[State, StepReport]:
        """Advance by h.

        Raises InvertedElement if det F <= 0 somewhere at the start or at the end of the step;
        SingularSystem if the matrix could not be factorised.
        """
        if work.bodies is not None:
            passed = work.bodies.advance(state, control, (state.t + h,), self.theta)
            if passed.done:
                return passed.state(1), passed.report(0, 1)
        line = control.chord(state.t, h)

        def equation(system: System) -> LinearStep:
            return self.equation(system, state, line, work, control)

        return step_of(equation, system, state, h, self.tolerance, work)

    def fuses(self, work: Workspace) -> bool:
        """Test if the scene is one of bodies alone."""
        return work.bodies is not None

    def run(
        self,
        system: System,
        state: State,
        control: ControlAt,
        groups: Sequence[Sequence[float]],
        work: Workspace,
    ) -> Iterator[Outputs]:
        """States after each group of steps that end at the given times [s]; errors as of `step`."""
        ends = list(chain.from_iterable(groups))
        last, done, bodies = np.cumsum([len(group) for group in groups]), 0, work.bodies
        reports = list[StepReport]()  # of steps since the last output
        while done < len(ends):
            passed = None
            if bodies is not None:
                passed = bodies.advance(state, control, ends[done:], self.theta)
            if passed is None or not passed.done:
                state, report = self.step(system, state, control, ends[done] - state.t, work)
                done += 1
                reports.append(report)
                if done in last:
                    yield Outputs.at_state(state, united(reports, 0))
                    reports.clear()
                continue
            after = last[(last > done) & (last <= done + passed.done)] - done
            if len(after):
                outputs = passed.outputs(after)
                first = united([*reports, outputs.reports[0]], 0)
                yield replace(outputs, reports=[first, *outputs.reports[1:]])
                reports.clear()
            seen = int(after[-1]) if len(after) else 0
            if seen < passed.done:
                reports.append(passed.report(seen, passed.done))
            state, done = passed.state(passed.done), done + passed.done

    def equation(
        self,
        system: System,
        state: State,
        line: Line,
        work: Workspace,
        control: ControlAt | None = None,
    ) -> LinearStep:
        """Matrix and right-hand side of a step from a state, with the activation of a line over it.

        Without the control, the error of the step is not estimated.
        Raises InvertedElement if det F <= 0 at the start.
        """
        at_end, h, theta = line.at(1.0), line.h, self.theta
        kinematics = system.kinematics
        with work.timed("tangent"):
            pose = kinematics.at(state.pose, at_end.t)
            here, K = system.tangent(pose.q, at_end)
            D = damping_matrix(system, pose, state.v, at_end, K)
            predicted = predicted_pose(system, state, h, theta)
            by_damping, by_stiffness = theta * h, (theta * h) * (theta * h)
            A = implicit_matrix(system, pose, here, K, D, by_damping, by_stiffness, predicted)
        require_upright(here.element, here.smallest_J, state.t)
        force = kinematics.generalised_force(here.f, pose)
        if D.offset is not None:
            force = force - D.offset
        rhs = momentum_at(system, state, predicted)
        if theta < 1.0:  # theta h (D + theta h K) is the matrix less the mass
            w0 = kinematics.velocities(state)
            left = (1.0 - theta) / theta
            rhs = rhs + left * kinematics.apply_mass(w0, predicted) - left * A.times(w0)
        missed = StepEstimates(line, D, here, self.estimated, control)
        return LinearStep(A, rhs + h * force, theta, missed)


@dataclass(frozen=True)
@real_numbers
class LinearlyImplicitEuler(_Linearised):
    """One Newton step of implicit Euler, (M + h D + h^2 K) v1 = M v0 + h f(q0), q1 = q0 + h v1.

    K, D and f are evaluated at q0 with the control at the end of the step, or with the mean of the
    activation if it is not linear within the step. The method is of first order. It is that of the
    published simulator, and may likewise invert elements under large forces.

    Notes
    -----
    Strongly active muscles may make the matrix indefinite. The equation is solved nevertheless, and
    the report counts such steps as ``indefinite``.

    Stiff tissue that turns loses its swing: a rotation by theta within a step stretches it by
    theta^2/2, and the stress of this stretch resists the motion of the next step like a string. The
    loss of velocity per step is about h^2 E theta^2/(2 density L^2). The estimate contains the stretch,
    but not the loss, of which `sim.simulate` warns (`LostSwingWarning`). A pinned bar of 0.1 m with E =
    1e9 Pa in steps of 5 ms turns by 0.15 instead of 0.68 rad within 0.1 s (1e7 Pa: 0.51; 1e6 Pa:
    0.66); `Sdirk2` has no such error.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "L-stable"
    theta: ClassVar[float] = 1.0
    estimated: ClassVar[bool] = True
    #: largest estimated error of a nodal position that an iterative linear solver leaves in a step [m];
    #: a direct one leaves none
    tolerance: float = 1e-6


@dataclass(frozen=True)
@real_numbers
class LinearlyImplicitTrapezoidal(_Linearised):
    """The trapezoidal rule linearised at the start of the step.

    (M + h/2 D + h^2/4 K) v1 = (M - h/2 D - h^2/4 K) v0 + h f(q0), q1 = q0 + h/2 (v0 + v1).

    K, D and f are evaluated as in `LinearlyImplicitEuler`.

    Notes
    -----
    The method is of second order if control and damping matrix are constant, else of first, since
    both are evaluated at one end of the step. Modes faster than the step oscillate, and elements
    can invert.
    """

    order: ClassVar[int] = 1
    stability: ClassVar[str] = "A-stable"
    theta: ClassVar[float] = 0.5
    estimated: ClassVar[bool] = False
    tolerance: float = 1e-6  #: as of `LinearlyImplicitEuler`
