"""Solution of one implicit stage by Newton's method to a tolerance."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial, reduce
from typing import Final

import numpy as np

from sim.contact.step import ContactStep
from sim.errors import SceneError
from sim.integrators.constrained import minimise_constrained
from sim.integrators.contact_converged import ContactSolution, minimise_in_contact, moved_upright
from sim.integrators.contact_stage import StageInContact, StageWithRows
from sim.integrators.estimate import of_input, relaxed
from sim.integrators.newton import (
    IncrementalPotential,
    Iteration,
    Point,
    Potential,
    Stage,
    Tolerances,
    VaryingInertia,
    minimise,
)
from sim.integrators.workspace import Workspace
from sim.joints.contract import REACTIONS
from sim.linear.contract import Matrix
from sim.state import Array, ControlAt, Evaluation, Line, Pose, State, StepReport
from sim.system import System, damping_matrix

AHEAD_OF_STAGE = 2.5
"""Factor on the displacements of a stage in the search for rows: the base of the next stage is ahead."""


@dataclass(frozen=True)
class Iterative(Tolerances):
    """Newton's method to a tolerance, on a potential.

    The line search requires det F > 0 at every Gauss point and a decrease of the potential. A
    factor is reused, with quasi-Newton updates, over many steps as long as the iteration converges;
    a matrix that is not positive definite is shifted.
    """

    def _minimiser(
        self, system: System, work: Workspace, s: float, until: float
    ) -> Callable[[Potential, Point], tuple[Point, Iteration]]:
        """Return the iteration for a system, with its constraints if it has any.

        Factors belong to this integrator and s, its implicit part of a step [s].
        """
        key = type(self).__name__, s
        if system.constraints is not None and (system.rows or system.kinematics.matrix_varies):
            raise SceneError(
                f"{key[0]} does not solve hard volumes together with bodies, joints or attachments: use "
                "LinearlyImplicitEuler, or a soft volume"
            )

        def settle(potential: Potential, point: Point) -> tuple[Point, Iteration]:
            if system.constraints is None:
                return minimise(potential, point, work, key, self, until)
            return minimise_constrained(potential, point, work, self, until)

        return settle


@dataclass(frozen=True)
class StageSolution:
    """Pose and independent velocities w (n,) at the end of a stage, its iteration, and its rows."""

    pose: Pose
    w: Array
    here: Evaluation
    went: Iteration
    contact: ContactSolution | StageInContact | None = None

    @property
    def reaction(self) -> Array | None:
        """Forces of the rows of joints."""
        return self.contact.reaction if isinstance(self.contact, StageInContact) else None

    @property
    def memory(self) -> Mapping[str, Array]:
        """Contact memory for the next step."""
        return {} if self.contact is None else self.contact.memory


Parts = Sequence[tuple[float, StageSolution]]
"""Stages of a step with their weights in the method."""


@dataclass(frozen=True)
class Converged(Iterative):
    """Implicit stages solved to a tolerance: Newton on the incremental potential.

    Attributes: as `Tolerances`.
    """

    def _solve(
        self,
        system: System,
        stage: Stage,
        state: State,
        work: Workspace,
        here: Evaluation | None = None,
    ) -> StageSolution:
        """Solve a stage; `here` is the evaluation at the state's positions under its control."""
        varies = system.kinematics.matrix_varies
        phi = (VaryingInertia if varies else IncrementalPotential)(system, stage, work)
        settle = self._minimiser(system, work, stage.s, stage.t)
        start = phi.start(state.pose, None if varies else here)

        key, contact = (type(self).__name__, stage.s), None
        if system.contact is not None:
            contact = ContactStep(system.contact, state, stage.t)
        if system.rows is not None or (varies and contact is not None):
            way = np.linalg.norm(phi.pose(phi.inertial_guess()).q - state.q, axis=1)
            rows = StageWithRows(phi, contact, work, key, self, stage.t)
            done = rows.solve(start, AHEAD_OF_STAGE * way)
            here = done.point.here
            if contact is not None:
                here = moved_upright(phi, done.point, done.pose.q, stage.t)
            return StageSolution(done.pose, phi.velocities(done.point.d), here, done.went, done)
        if contact is None:
            end, went = settle(phi, start)
            return StageSolution(end.pose, phi.velocities(end.d), end.here, went)
        v = system.kinematics.displacements(stage.u, stage.base)
        way = np.linalg.norm(stage.base.q + stage.s * v - state.q, axis=1)
        # Hard landings take up to 150 iterations in all, ordinary steps about ten.
        most = 3 * self.max_iterations
        solution = minimise_in_contact(phi, start, contact, way, key, work, settle, stage.t, most)
        end = solution.point
        pose = replace(end.pose, q=solution.q)
        return StageSolution(pose, phi.velocities(end.d), solution.here, solution.went, solution)

    def _freed(
        self,
        system: System,
        error: Array,
        momentum: Array,
        D: Matrix,
        s: float,
        end: StageSolution,
        work: Workspace,
    ) -> Array:
        """Return an error estimate at the end of a stage without the contribution of a jump of the load.

        Other arguments and result as of `relaxed`. Vertices that touch at the end stay on their faces,
        also those that were stopped within the step: their position is that of the face, whenever they
        met it.
        """
        solve = partial(_solved_at, end, system, work)
        return relaxed(system, error, momentum, D, s, solve, end.pose)

    def _of_contact(
        self, system: System, h: float, s: float, parts: Parts, work: Workspace
    ) -> Array | None:
        """Errors (2, n_points, 3) of the positions [m] by rows of contact of the start of a stage.

        With the normals and closest points of its end, the nodal forces of a stage would differ by
        F = (G1 - G0)' lambda, and the gaps at the end of the step are g1 instead of 0. With the matrix A
        of the last stage, the errors are minus the motion by the impulses h F, which lasts, and minus
        the motion that closes the gaps, as the next step does:

            A x = s h sum of b F over the stages + s^2 G' f,    G x = 0      lasting
            A y = s^2 G' f,                                     G y = -g1    passing

        `parts` are the stages with their weights b in the method. None if nothing presses, or if
        nothing reads the errors.
        """
        end = parts[-1][1]
        if not work.estimates or end.contact is None:
            return None
        changes = [(b, part.contact.renewed()) for b, part in parts if part.contact is not None]
        known = [b * change[0] for b, change in changes if change is not None]
        if not known:
            return None
        push = s * h * system.kinematics.generalised_force(np.sum(known, axis=0), end.pose)
        last, none = changes[-1][1], np.zeros_like(push)
        passing = none if last is None else end.contact.solve_under_rows(none, -last[1])
        moves = (end.contact.solve_under_rows(push), passing)
        return -np.array([system.kinematics.displacements(x, end.pose) for x in moves])

    def _of_input(
        self,
        system: System,
        control: ControlAt,
        line: Line,
        s: float,
        end: StageSolution,
        work: Workspace,
    ) -> Array | None:
        """Error of the positions by the activation that the line misses, as of `of_input`."""
        solve = partial(_solved_at, end, system, work)
        return of_input(system, control, line, s, solve, end.pose)


def _solved_at(end: StageSolution, system: System, work: Workspace, rhs: Array) -> Array:
    """Solution with the matrix of a stage, under the rows that act at its end."""
    if end.contact is not None:
        return end.contact.solve_under_rows(rhs)
    if system.constraints is None:
        return work.newton.solve(rhs)
    return work.constraints.saddle.roughly(rhs)


def final_state(
    system: System, end: StageSolution, w: Array, memory: Mapping[str, Array], h: float
) -> State:
    """State of a step that ends with a stage, with velocities w, brought back to the rows of joints."""
    pose, rows = end.pose, system.rows
    if rows is None or end.reaction is None:
        return system.kinematics.state(pose, w, memory)
    pose, w, impulse = rows.projected(pose, w, momentum=True)
    return system.kinematics.state(pose, w, {**memory, REACTIONS: end.reaction + impulse / h})


APPROACH: Final = 1e-9
"""Travel towards the limit of a joint within a step above which the limit is hit [m, rad]."""


def hits_limit(system: System, state: State, end: StageSolution, h: float) -> bool:
    """Return True if a limit of a joint stops a motion towards it in a step of length h.

    The velocity then changes at once. A stage of a method of second order would extrapolate this change
    to the end of the step, so that bodies rebound.
    """
    rows = system.rows
    if rows is None or end.reaction is None:
        return False
    stopped = rows.unilateral & (end.reaction > 0.0)
    if not stopped.any():
        return False
    now = rows.evaluate(state.pose)
    speed = now.G @ system.kinematics.velocities(state)[rows.columns] + now.drift
    return bool((h * speed[stopped] < -APPROACH).any())


def by_joints(system: System, pose: Pose, reaction: Array | None) -> Array:
    """Generalised force (n,) of the rows of joints at a pose; zero without."""
    out, rows = np.zeros_like(system.mass), system.rows
    if rows is not None and reaction is not None:
        out[rows.columns] = rows.evaluate(pose).G.T @ reaction
    return out


def middle_damping(system: System, state: State, control: Line, h: float) -> Matrix:
    """Damping at the predicted middle of a step, where the predictor does not invert.

    It is constant over the step. The order of a method remains 2, because the change of the damping is
    odd about the middle.
    """
    kinematics, middle = system.kinematics, control.at(0.5)
    pose = kinematics.advance(state.pose, 0.5 * h * kinematics.velocities(state), state.t + 0.5 * h)
    upright = system.smallest_J(pose.q)[0] > 0.0
    return damping_matrix(system, pose if upright else state.pose, state.v, middle)


def report_of(
    h: float,
    stages: list[StageSolution],
    local_error: Array | None = None,
    input_error: Array | None = None,
    contact_error: Array | None = None,
) -> StepReport:
    """One report for the stages of a step and the estimated errors of its positions (n_nodes, 3)."""
    went = reduce(Iteration.joined, (stage.went for stage in stages))
    return StepReport(
        h=h,
        smallest_J=stages[-1].here.smallest_J,
        local_error=local_error,
        input_error=input_error,
        contact_error=contact_error,
        **asdict(went),
    )
