"""Equilibrium of a face under gravity, and its motion under an activation."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr

import sim
from emgface.errors import ConfigurationError, FaceError
from emgface.face.accuracy import SET_BY_ACCURACY
from emgface.face.contact import touching
from emgface.face.control import control_of, seconds
from emgface.face.event_error import (
    CONTACT_FORCE,
    ERRORS,
    TOUCHING,
    ContactForce,
    event_error,
    in_other_steps,
)
from emgface.face.identity import belongs, require_face
from emgface.face.integration import integrator_of, steps_of
from emgface.face.lip_shape import UP_DIRECTION, has_mouth
from emgface.face.mouth import Mouth
from emgface.face.muscle_force import MuscleForces
from emgface.face.numerical_error import largest_motion, numerical_error
from emgface.face.recipe import compose_scene, displacement_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.stability import rounding_sensitivity
from emgface.face.waypoints import Branch, WayPoints
from emgface.run.digest import canonical_json
from sim.probes import Probe
from sim.threads import one_blas_thread

Progress = Callable[[int, int], None]

SETTLE_STEP, SETTLE_CHUNK, SETTLE_LIMIT, SETTLED_SPEED = 0.05, 0.5, 20.0, 1e-5
"""Step [s], time between checks [s], longest time [s], and speed [m/s] regarded as rest."""

NOT_OF_REST: Final[dict[str, Any]] = dict.fromkeys(
    (
        *SET_BY_ACCURACY,
        "accuracy",
        "output",
        "timing",
        "sigma_max_policy",
        "reduced",
        "check_contact",
    ),
    True,
) | {"contact": {"renewals"}}
"""Parameters that do not affect the equilibrium of a face, as those that `model_dump` excludes."""
NOT_OF_STILLNESS: Final[dict[str, Any]] = dict.fromkeys(
    ("linear_solver", "alpha", "beta", "damping_tangent", "stiffening", "line_force"), True
)
"""Further ones that act on moving or active tissue only; they distinguish stored equilibria."""
REST_ATTRIBUTE: Final = "rest_parameters"  #: attribute of an equilibrium with its parameters (JSON)


def load_kernels(face: xr.Dataset, parameters: SimulationParameters) -> None:
    """Compile the kernels of the terms of a face, or load them, beginning with the last term.

    A process that simulates begins with the first one, so that two processes compile different ones.
    """
    system = sim.compile_scene(replace(compose_scene(face, parameters), damping=None))
    q, control = system.rest_state().q, system.control(np.zeros(len(system.muscles)))
    for term in reversed(system.terms):
        replace(system, terms=(term,)).tangent(q, control)


@one_blas_thread
def settle_face(face: xr.Dataset, parameters: SimulationParameters) -> xr.Dataset:
    """Positions of all nodes at rest under gravity and prestress, without activation.

    sigma_max affects them, because the passive stress of a fibre scales with it. The result
    contains ``node_position(node, axis)`` [m], with the attributes ``settling_time`` [s] and
    ``largest_speed`` [m/s], 0 if the equilibrium was found as the minimum of the energy, and
    ``largest_displacement`` [m]. Raises NotConverged if the face still moves after the longest time
    allowed, and InvertedElement, with the ``element`` id of the face model, if the weight inverts
    an element.
    """
    still = parameters.model_copy(
        update={"contact": parameters.contact.model_copy(update={"renewals": 0})}
    )
    system = sim.compile_scene(compose_scene(face, still))
    state = system.rest_state()
    if parameters.gravity or parameters.prestress.method != "none":
        work = sim.Workspace(system, parameters.linear_solver)
        with named_elements(face):
            state = _settled(face, parameters, system, work)
    speed = float(np.linalg.norm(state.v, axis=1).max())
    moved = np.linalg.norm(state.q - face["position"].values, axis=1).max()
    at_rest = xr.Dataset(
        {"node_position": (("node", "axis"), state.q, {"units": "m"})},
        coords={"axis": face["axis"].values},
        attrs={
            "settling_time": state.t,
            "largest_speed": speed,
            "largest_displacement": float(moved),
            "origin": "simulated",
            REST_ATTRIBUTE: canonical_json(_of_rest(parameters)),
        },
    )
    return belongs(at_rest, face)


def of_rest(parameters: SimulationParameters) -> dict[str, Any]:
    """Parameters by which stored equilibria are found again."""
    return parameters.model_dump(mode="json", exclude=NOT_OF_REST)


def _of_rest(parameters: SimulationParameters) -> dict[str, Any]:
    """Parameters that affect the equilibrium; the mesh itself is that without any load."""
    values = parameters.model_dump(mode="json", exclude=NOT_OF_REST | NOT_OF_STILLNESS)
    if parameters.gravity or parameters.prestress.method != "none":
        return values
    return {name: values[name] for name in ("gravity", "prestress")}


def require_rest(settled: xr.Dataset, face: xr.Dataset, parameters: SimulationParameters) -> None:
    """FaceError if an equilibrium is that of another face, or was computed with other parameters.

    One that does not state its parameters, as of earlier versions, is compared by its face alone.
    """
    if not isinstance(settled, xr.Dataset) or "node_position" not in settled:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise FaceError(
            f"a {type(settled).__name__} is passed as an equilibrium, expected node_position in a "
            "Dataset: pass the result of `settle_face`, or omit it"
        )
    require_face(settled.attrs, face, "equilibrium")
    text = settled.attrs.get(REST_ATTRIBUTE)
    if text is None:
        return
    own, used = (_leaves(json.loads(t)) for t in (str(text), canonical_json(_of_rest(parameters))))
    # A parameter that another version lacks is not compared.
    differ = [name for name in own if name in used and own[name] != used[name]]
    if differ:
        name = differ[0]
        more = f" (and other values of {', '.join(differ[1:])})" if differ[1:] else ""
        raise FaceError(
            f"the equilibrium was computed with {name} = {own[name]}{more}, found {name} = {used[name]} "
            "in the simulation: pass the equilibrium of these parameters, or omit it"
        )


def _leaves(tables: Mapping[str, Any], table: str = "") -> dict[str, Any]:
    """Values by the name of a parameter with its tables, such as "contact.friction"."""
    values = dict[str, Any]()
    for name, value in tables.items():
        below = isinstance(value, Mapping)
        values |= _leaves(value, f"{table}{name}.") if below else {f"{table}{name}": value}
    return values


def _settled(
    face: xr.Dataset, parameters: SimulationParameters, system: sim.System, work: sim.Workspace
) -> sim.State:
    """State at rest: the minimum of the energy, or, if it is not found, the limit of a motion."""
    state, silent = system.rest_state(), system.control(np.zeros(len(system.muscles)))
    if parameters.prestress.method == "displaced":
        first = sim.compile_scene(displacement_scene(face, parameters))
        state = sim.displace_held(first, state, face["position"].values)
    try:
        rest, _ = sim.Static(tolerance=1e-9).step(system, state, silent, 1.0, work)
        return replace(rest, t=0.0)
    except (sim.InvertedElement, sim.NotConverged, sim.SingularSystem):
        pass
    speed = np.inf
    while speed > SETTLED_SPEED:
        if state.t > SETTLE_LIMIT - SETTLE_CHUNK / 2:
            why = f"the face still moves at {speed:.2g} m/s, expected {SETTLED_SPEED:g} m/s"
            raise sim.NotConverged((), state.t, why)
        _, state = sim.simulate(
            system,
            sim.resting(len(system.muscles)),
            duration=SETTLE_CHUNK,
            integrator=sim.ConvergedEuler(tolerance=1e-9, residual_tolerance=1e-7),
            steps=sim.HalvingStep(SETTLE_STEP),
            probes=(),
            initial=state,
            work=work,
        )
        speed = float(np.linalg.norm(state.v, axis=1).max())
    return state


@one_blas_thread
def simulate_face(
    face: xr.Dataset,
    activation: xr.DataArray,
    parameters: SimulationParameters,
    *,
    settled: xr.Dataset | None = None,
    further: tuple[Probe, ...] = (),
    progress: Progress | None = None,
    solver_threads: int = 1,
    waypoints: WayPoints | None = None,
    branch: Branch | None = None,
    forces: bool = False,
) -> xr.Dataset:
    """Simulate the motion of a face for an activation (muscle, time) [1] of all its muscles.

    The motion starts at `settled`, the result of `settle_face` (default: computed). `further` are
    probes besides markers, lips, smallest J, energies and iterations; ``progress(done,
    total)`` is called after every step. With ``parameters.check_contact``, a motion with contact is
    repeated with other time steps. `solver_threads` are those of `sim.simulate`, for the motion.
    `waypoints` are written; a motion with a `branch` begins at its way point instead, and its
    ``numerical_error`` counts from there. With `forces`, the result contains
    ``muscle_force(muscle, time)`` (`MuscleForces`) and, at full order with contact,
    ``contact_force(time)``, the sum of the normal forces of all contacts [N].

    The result contains ``position(marker, axis, time)`` [m] of the lip markers from time 0, with
    ``smallest_J``, ``iterations``, ``lip_opening`` [m] (negative if the lips have passed each
    other), ``mouth_area`` [m^2] and ``lip_protrusion`` [m] (`Mouth`) of a face with a mouth
    opening, energies [J] and ``numerical_error`` [m] of the markers
    (`emgface.face.numerical_error`). Its attributes are ``solver``, ``contact``, ``step`` and
    ``output`` [s], ``sigma_max`` [Pa], ``run_time_s``, ``origin`` "simulated"; ``unstable_from_s``,
    ``unstable_until_s`` [s] and ``rounding_sensitivity`` [m] if the equilibrium lost stability
    (`emgface.face.stability`); the times in the recording, ``recorded_start`` [s] and
    ``recorded_pace`` (recorded per simulated second); ``solver_threads``, with a ``note`` if they are
    several; ``motion`` [m], the largest displacement of a
    marker, and, if the integrator has an estimate, the largest ``numerical_error`` [m] and
    ``inaccurate``, 1 if it exceeds a tenth of the motion. If surfaces touched, ``event_error`` [m]
    is the part of contact in that error, and ``event_error_measured`` 2 if the steps estimated it, 1
    if the motion was repeated, and 0 if that part is assumed (`emgface.face.event_error`); where the
    repetition failed, ``repetition_failed`` is the reason. With a reduced face
    (``parameters.reduced.file``) it is that of `emgface.reduced.motion.trusted_motion`; ``reduced`` is
    then 1, or 0 if the motion was not trusted and is that of full order (``reduction_doubt``).

    Raises ActivationError if a muscle of the face has no activation, a name is unknown, or there
    are fewer than two samples; FaceError if `settled` belongs to another face or other parameters;
    ControlError if a value is not finite or outside 0-1; InvertedElement (``element`` is the id in the
    face model), NotConverged or SingularSystem if a step fails; ToleranceMissed if `error_tolerance`
    cannot be met.
    """
    doubt, points = None, waypoints or (branch and branch.points)
    if forces:
        further = (*further, MuscleForces.from_face(face, parameters))
    if parameters.reduced.file is not None:
        if points is not None:
            raise ConfigurationError("way points require full order: omit the reduced face")
        from emgface.reduced.motion import trusted_motion  # which requires this module

        control, duration, pace = control_of(activation, face["muscle"].values, parameters)
        trajectory, doubt = trusted_motion(face, control, duration, parameters, further)
        if trajectory is not None:
            return _described(trajectory, face, activation, parameters, pace)
        further = tuple(probe for probe in further if not isinstance(probe, Mouth))  # as below
    system = sim.compile_scene(compose_scene(face, parameters))
    control, duration, pace = control_of(activation, system.muscles, parameters)
    if branch is not None:
        branch.require_use(waypoints, duration)
    start = branch.state if branch else _start(face, parameters, system, settled)
    checkpoint = None if points is None else points.outputs(parameters.output)
    if waypoints is not None:
        waypoints.clear()

    def run(
        initial: sim.State,
        probes: tuple[Probe, ...],
        progress: Progress | None = None,
        stepped: SimulationParameters = parameters,
        keep: WayPoints | None = None,
    ) -> xr.Dataset:
        return sim.simulate(
            system,
            control,
            duration=duration - initial.t,
            integrator=integrator_of(stepped),
            steps=steps_of(face, stepped),
            every=parameters.output,
            probes=probes,
            initial=initial,
            work=sim.Workspace(system, parameters.linear_solver),
            progress=progress,
            solver_threads=solver_threads,
            checkpoint=checkpoint,
            at_checkpoint=keep and keep.keep,
        )[0]

    watched = _probes(face)
    touches = (ContactForce(),) if touching(face, parameters) else ()
    with named_elements(face):
        trajectory = run(start, (*watched, *touches, *further), progress, keep=waypoints)
    if branch is not None:
        trajectory.attrs |= {"branched_at": start.t, "branched_from": branch.digest}
    if "unstable_from_s" in trajectory.attrs:
        trajectory.attrs["rounding_sensitivity"] = rounding_sensitivity(
            system, start, trajectory, lambda moved: run(moved, watched[:1])
        )

    def again() -> xr.Dataset:
        return run(start, watched[:1], progress, in_other_steps(parameters))

    of_contact, error_attrs = event_error(
        trajectory, again if parameters.check_contact else None, parameters.beta
    )
    kinds = ("step_error", "iteration_error", "input_error", "passing_error")
    step, *others = (trajectory[kind] for kind in kinds)
    of_steps = numerical_error(step, parameters.beta, *others)
    error = (of_steps + of_contact).assign_attrs(units="m")
    if forces and CONTACT_FORCE in trajectory:
        trajectory = trajectory.assign(contact_force=trajectory[CONTACT_FORCE])
    recorded = [*kinds, *ERRORS, CONTACT_FORCE, TOUCHING]
    trajectory = trajectory.drop_vars(recorded, errors="ignore")
    trajectory = trajectory.assign(numerical_error=error)
    trajectory.attrs |= error_attrs
    trajectory.attrs["solver"] = parameters.solver
    if doubt is not None:
        trajectory.attrs |= {"reduced": 0, "reduction_doubt": doubt}
    _described(trajectory, face, activation, parameters, pace)
    if error.notnull().all():
        trajectory.attrs["numerical_error"] = float(error.max())
        inaccurate = trajectory.attrs["numerical_error"] > 0.1 * trajectory.attrs["motion"]
        trajectory.attrs["inaccurate"] = int(inaccurate)
    return trajectory


def _start(
    face: xr.Dataset,
    parameters: SimulationParameters,
    system: sim.System,
    settled: xr.Dataset | None,
) -> sim.State:
    """State of a face at rest."""
    if settled is None:
        settled = settle_face(face, parameters)
    require_rest(settled, face, parameters)
    rest = system.rest_state()
    return sim.State(
        0.0, np.ascontiguousarray(settled["node_position"].values), rest.v, rest.memory
    )


def _described(
    trajectory: xr.Dataset,
    face: xr.Dataset,
    activation: xr.DataArray,
    parameters: SimulationParameters,
    pace: float,
) -> xr.Dataset:
    """Add the attributes of any motion."""
    trajectory.attrs |= {
        "contact": parameters.contact.method,
        "step": parameters.step,
        "output": parameters.output,
        "sigma_max": parameters.sigma_max,
        "origin": "simulated",
        "recorded_start": float(seconds(activation["time"])[0]),
        "recorded_pace": pace,
    }
    trajectory.attrs["motion"] = largest_motion(trajectory)
    return belongs(trajectory, face)


def _probes(face: xr.Dataset) -> tuple[Probe, ...]:
    names = tuple(map(str, face["marker"].values))
    nodes = face["marker_node"].values.astype(np.int64)
    probes: list[Probe] = [sim.Markers(nodes, names)]
    if "lip_opening_node" in face:
        upper, lower = (int(node) for node in face["lip_opening_node"].values)
        probes.append(sim.Opening(upper, lower, UP_DIRECTION))
    if has_mouth(face):
        probes.append(Mouth.from_face(face))
    return (
        *probes,
        sim.StepErrors(nodes, names),
        sim.SmallestJ(),
        sim.Energies(),
        sim.Iterations(),
    )
