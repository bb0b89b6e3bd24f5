"""From a face model and its parameters to a scene, and from an activation to lip motion."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import ActivationError
from emgface.face.simulation_parameters import SimulationParameters
from sim import (
    Activation,
    Blemker,
    ConvergedEuler,
    ElementVolume,
    Energies,
    Fixed,
    Generic,
    HalvingStep,
    InvertedElement,
    Iterations,
    LinearlyImplicitEuler,
    LogarithmicBulk,
    Markers,
    Material,
    MooneyRivlin,
    Muscles,
    NodalVolume,
    NotConverged,
    Opening,
    PassiveRayleigh,
    QuadraticBulk,
    Rayleigh,
    RestRayleigh,
    Scene,
    SmallestJ,
    Solid,
    State,
    System,
    Workspace,
    compile_scene,
    mesh_from_arrays,
    resting,
    simulate,
)
from sim.probes import Probe
from sim.scene import Term
from sim.steps import FixedStep
from sim.terms import Gravity

Progress = Callable[[int, int], None]

GRAVITY = (0.0, 0.0, -9.8)
"""Acceleration [m/s^2] (Eskes et al. 2017)."""

DAMPING = {"current": Rayleigh, "passive": PassiveRayleigh, "rest": RestRayleigh}
"""Damping law by the stiffness it takes."""

SETTLE_STEP, SETTLE_CHUNK, SETTLE_LIMIT, SETTLED_SPEED = 0.05, 0.5, 20.0, 1e-5
"""Step [s], time between checks [s], longest time [s] and speed [m/s] that counts as rest."""


@dataclass(frozen=True)
class ElementOrder:
    """How the elements of a face are numbered in the scene: hexahedra first, then wedges.

    Attributes
    ----------
    face_index : array of int, shape (n_elements,)
        Element of the face at each place of the scene.
    scene_index : array of int, shape (n_elements,)
        Place in the scene of each element of the face.
    """

    face_index: NDArray[np.int64]
    scene_index: NDArray[np.int64]


def element_order(face: xr.Dataset) -> ElementOrder:
    """Order the elements of a face by type.

    Parameters
    ----------
    face : Dataset
        Face model.

    Returns
    -------
    ElementOrder
    """
    wedge = face["connectivity"].values[:, -1] < 0
    face_index = np.concatenate([np.flatnonzero(~wedge), np.flatnonzero(wedge)])
    scene_index = np.empty_like(face_index)
    scene_index[face_index] = np.arange(len(face_index))
    return ElementOrder(face_index, scene_index)


def compose_scene(face: xr.Dataset, parameters: SimulationParameters) -> Scene:
    """Declare the scene of a face: tissue with muscles, gravity, damping, fixed nodes.

    Parameters
    ----------
    face : Dataset
        Face model.
    parameters : SimulationParameters
        Laws and loads.

    Returns
    -------
    Scene
    """
    connectivity = face["connectivity"].values
    wedge = connectivity[:, -1] < 0
    blocks = {"hex8": connectivity[~wedge], "wedge6": connectivity[wedge, :6]}
    mesh = mesh_from_arrays(
        face["position"].values, **{kind: nodes for kind, nodes in blocks.items() if len(nodes)}
    )
    p = parameters
    if p.fibre_law == "blemker":
        law = Blemker(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    else:
        law = Generic(sigma_max=p.sigma_max, stretch_star=p.lambda_star, P1=p.P1, P2=p.P2)
    pointwise = p.kappa if p.incompressibility == "pointwise" else 0.0
    logarithmic = p.bulk_potential == "logarithmic"
    bulk = LogarithmicBulk(pointwise) if logarithmic else QuadraticBulk(pointwise)
    order = element_order(face)
    muscles = Muscles(
        names=tuple(map(str, face["muscle"].values)),
        element=order.scene_index[face["bundle_index"].values],
        muscle=face["bundle_muscle"].values.astype(np.int64),
        direction=face["bundle_direction"].values,
        law=law,
    )
    tissue = Material(MooneyRivlin(p.C10, p.C20), bulk, density=p.density)
    solid = Solid(materials=(tissue,), muscles=muscles)
    terms: list[Term] = [solid]
    if p.incompressibility == "element":
        terms.append(ElementVolume(p.kappa))
    elif p.incompressibility == "nodal":
        terms.append(NodalVolume(p.kappa))
    if p.gravity:
        terms.append(Gravity(GRAVITY))
    damping = DAMPING[p.damping_tangent](p.alpha, p.beta) if p.alpha or p.beta else None
    fixed = np.flatnonzero(face["fixed"].values)
    return Scene(mesh=mesh, terms=tuple(terms), reductions=(Fixed(fixed),), damping=damping)


def settle_face(face: xr.Dataset, parameters: SimulationParameters) -> xr.Dataset:
    """Positions of all nodes at rest under gravity, all muscles silent.

    Parameters
    ----------
    face : Dataset
        Face model.
    parameters : SimulationParameters
        Laws and loads; sigma_max matters because the passive stress of a fibre scales with it.

    Returns
    -------
    Dataset
        ``node_position(node, axis)`` [m]; attrs ``settling_time`` [s], ``largest_speed`` [m/s] and
        ``largest_displacement`` [m].

    Raises
    ------
    NotConverged
        If the face still moves after the longest time allowed.
    InvertedElement
        If the weight inverts an element; its ``element`` is the id in the face model.
    """
    system = compile_scene(compose_scene(face, parameters))
    state = system.rest_state()
    speed = np.inf
    if not parameters.gravity:
        speed = 0.0
    work = Workspace(system, parameters.linear_solver)
    with _face_elements(face):
        while speed > SETTLED_SPEED:
            if state.t > SETTLE_LIMIT - SETTLE_CHUNK / 2:
                why = f"the face still moves at {speed:.2g} m/s, expected {SETTLED_SPEED:g} m/s"
                raise NotConverged((), state.t, why)
            _, state = simulate(
                system,
                resting(len(system.muscles)),
                duration=SETTLE_CHUNK,
                integrator=ConvergedEuler(tolerance=1e-9, residual_tolerance=1e-7),
                steps=HalvingStep(SETTLE_STEP),
                probes=(),
                initial=state,
                work=work,
            )
            speed = float(np.linalg.norm(state.v, axis=1).max())
    moved = np.linalg.norm(state.q - face["position"].values, axis=1).max()
    return xr.Dataset(
        {"node_position": (("node", "axis"), state.q, {"units": "m"})},
        coords={"axis": face["axis"].values},
        attrs={
            "settling_time": state.t,
            "largest_speed": speed,
            "largest_displacement": float(moved),
            "origin": "simulated",
        },
    )


def simulate_face(
    face: xr.Dataset,
    activation: xr.DataArray,
    parameters: SimulationParameters,
    *,
    settled: xr.Dataset | None = None,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Move a face by an activation.

    Parameters
    ----------
    face : Dataset
        Face model.
    activation : DataArray
        ``(muscle, time)`` [1] of all muscles of the face, values 0-1.
    parameters : SimulationParameters
        Laws, loads, solver and step.
    settled : Dataset, optional
        Result of `settle_face`, where the motion starts; computed when absent.
    progress : callable, optional
        Called as ``progress(done, total)`` after every step.

    Returns
    -------
    Dataset
        ``position(marker, axis, time)`` [m] of the lip markers from time 0, with ``smallest_J``,
        ``iterations``, ``lip_opening`` [m], energies [J]; attrs ``solver``, ``step`` [s],
        ``sigma_max`` [Pa], ``run_time_s``, ``origin`` "simulated", and where the motion lies in the
        recording: ``recorded_start`` [s], ``recorded_pace`` (recorded per simulated second).

    Raises
    ------
    ActivationError
        If a muscle of the face has no activation, a name is unknown, or there are fewer than two
        samples.
    ControlError
        If a value is not finite or outside 0-1.
    InvertedElement, NotConverged, SingularSystem
        If a step fails; ``element`` is the id in the face model.
    """
    system = compile_scene(compose_scene(face, parameters))
    control, duration, pace = _control(activation, system, parameters)
    if settled is None:
        settled = settle_face(face, parameters)
    rest = system.rest_state()
    start = State(0.0, np.ascontiguousarray(settled["node_position"].values), rest.v, rest.memory)
    converged = parameters.solver == "converged"
    with _face_elements(face):
        trajectory, _ = simulate(
            system,
            control,
            duration=duration,
            integrator=ConvergedEuler() if converged else LinearlyImplicitEuler(),
            steps=HalvingStep(parameters.step) if converged else FixedStep(parameters.step),
            probes=_probes(face),
            initial=start,
            work=Workspace(system, parameters.linear_solver),
            progress=progress,
        )
    trajectory.attrs |= {
        "solver": parameters.solver,
        "step": parameters.step,
        "sigma_max": parameters.sigma_max,
        "origin": "simulated",
        "face": str(face.attrs.get("name", "")),
        "recorded_start": float(activation["time"].values[0]),
        "recorded_pace": pace,
    }
    return trajectory


def _probes(face: xr.Dataset) -> tuple[Probe, ...]:
    names = tuple(map(str, face["marker"].values))
    probes: list[Probe] = [Markers(face["marker_node"].values.astype(np.int64), names)]
    if "lip_opening_node" in face:
        upper, lower = (int(node) for node in face["lip_opening_node"].values)
        probes.append(Opening(upper, lower))
    return (*probes, SmallestJ(), Energies(), Iterations())


def _control(
    activation: xr.DataArray, system: System, parameters: SimulationParameters
) -> tuple[Activation, float, float]:
    """Activation from time 0, duration [s], and recorded seconds per simulated second [1]."""
    given = [str(name) for name in activation["muscle"].values]
    missing = [name for name in system.muscles if name not in given]
    unknown = [name for name in given if name not in system.muscles]
    if missing or unknown:
        found = f"lacks {', '.join(missing)}" if missing else f"names {', '.join(unknown)}"
        raise ActivationError(
            f"the activation {found}, expected exactly the muscles of the face: "
            f"{', '.join(system.muscles)}"
        )
    values = activation.sel(muscle=list(system.muscles)).transpose("time", "muscle").values
    times = np.asarray(activation["time"].values, dtype=np.float64)
    if len(times) < 2:
        raise ActivationError(f"the activation has {len(times)} sample, expected at least two")
    h = parameters.step
    if parameters.timing == "normalised":
        simulated = h * np.arange(len(times), dtype=np.float64)
        pace = float((times[-1] - times[0]) / simulated[-1])
        return Activation(simulated, values), float(simulated[-1]), pace
    steps = round((times[-1] - times[0]) / h)  # held over at most half a step at its end
    if steps < 1:
        raise ActivationError(
            f"the activation lasts {times[-1] - times[0]:.4g} s, less than one step of {h:g} s: "
            "choose a shorter step or timing = 'normalised'"
        )
    return Activation(times - times[0], values), h * steps, 1.0


@contextmanager
def _face_elements(face: xr.Dataset) -> Iterator[None]:
    """Name an inverted element by its id in the face model instead of its place in the scene."""
    try:
        yield
    except InvertedElement as error:
        if error.element < 0:
            raise
        index = element_order(face).face_index[error.element]
        name = int(face["element_id"].values[index])
        raise InvertedElement(name, error.det_F, error.time) from error
