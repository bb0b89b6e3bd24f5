"""Equilibria of a face under held activations, by the quasi-static solver with load stepping."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

import sim
from emgface.errors import ActivationError
from emgface.face.recipe import compose_scene, displacement_scene, named_elements
from emgface.face.simulation_parameters import SimulationParameters
from sim.state import State

LEVELS = tuple(round(0.1 * k, 1) for k in range(11))
"""Fractions of the activation at which equilibria are stored."""


def equilibria(
    face: xr.Dataset,
    activation: Mapping[str, float],
    parameters: SimulationParameters,
    *,
    levels: Sequence[float] = LEVELS,
) -> xr.Dataset:
    """Raise an activation in steps and compute the equilibrium of the face after each.

    `activation` maps a muscle such as ``ZYG_L`` to its activation at level 1 [1]; the others are
    inactive. `parameters` contain laws and loads; step, solver and damping are not used. `levels`
    are increasing fractions of the activation, from 0 to 1; the displacement at level 0 is due to
    gravity and prestress. Returns ``node_position(level, node, axis)`` [m] and
    ``smallest_J(level)``; attrs ``origin`` "simulated", ``face``, ``sigma_max`` [Pa]. After
    buckling, the solution is the equilibrium found by descent from that of the previous level.

    Raises ActivationError if a muscle is unknown or the levels do not increase, ControlError if an
    activation lies outside 0-1, and InvertedElement, NotConverged or SingularSystem if a step fails
    even when divided; ``element`` is the id in the face model.
    """
    if not len(levels) or not (np.diff(levels) > 0.0).all():
        raise ActivationError(
            f"the levels {tuple(levels)} do not ascend, expected shares from 0 to 1"
        )
    system = sim.compile_scene(compose_scene(face, parameters))
    unknown = [name for name in activation if name not in system.muscles]
    if unknown:
        raise ActivationError(
            f"unknown muscle {unknown[0]!r}, expected some of {', '.join(system.muscles)}"
        )
    peak = np.array([activation.get(name, 0.0) for name in system.muscles])
    work = sim.Workspace(system, parameters.linear_solver)
    state = system.rest_state()
    positions, smallest = list[np.ndarray](), list[float]()
    last = 0.0
    with named_elements(face):
        if parameters.prestress.method == "displaced":
            first = sim.compile_scene(displacement_scene(face, parameters))
            state = sim.displace_held(first, state, face["position"].values)
        for level in levels:
            ramp = sim.Activation(np.array([0.0, 1.0]), np.stack([last * peak, level * peak]))
            state = State(0.0, state.q, np.zeros_like(state.q), state.memory)
            _, state = sim.simulate(
                system,
                ramp,
                duration=1.0,
                integrator=sim.Static(),
                steps=sim.HalvingStep(1.0),
                probes=(),
                initial=state,
                work=work,
            )
            last = level
            positions.append(state.q)
            smallest.append(system.smallest_J(state.q)[0])
    return xr.Dataset(
        {
            "node_position": (("level", "node", "axis"), np.stack(positions), {"units": "m"}),
            "smallest_J": ("level", np.array(smallest), {"units": "1"}),
        },
        coords={
            "level": ("level", np.asarray(levels, dtype=np.float64), {"units": "1"}),
            "axis": face["axis"].values,
        },
        attrs={
            "origin": "simulated",
            "face": str(face.attrs.get("name", "")),
            "sigma_max": parameters.sigma_max,
        },
    )
