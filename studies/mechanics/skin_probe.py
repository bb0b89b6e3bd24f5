"""Stiffness of the skin of a face, measured by a small probe along and across the tension lines."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.check import sheet_nodes
from emgface.face.parts import OUTER
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.tension_lines import skin_axes
from sim import Fixed, Static, Workspace, compile_scene

Floats = NDArray[np.float64]

RADIUS = 0.003  #: radius of the patch under each foot of the probe [m]
GAUGE = 0.016  #: distance of the two feet of the probe [m]
RING = 0.03  #: radius of the ring around the probe, outside which all nodes are fixed [m]


def probe_skin(
    face: xr.Dataset,
    parameters: SimulationParameters,
    *,
    elements: Sequence[int] | None = None,
    places: int = 8,
) -> pd.DataFrame:
    """Pull two patches of skin apart and compute force per growth of their distance.

    All nodes further than `RING` from the centre of an element are fixed; the tissue inside is
    in equilibrium without activation. The two feet of the probe, at the distance `GAUGE`, then
    pull with opposite forces, each distributed equally among the skin nodes within `RADIUS`;
    the growth of their distance follows from one solution with the tangent. `parameters` contain
    laws and loads, including prestress. `elements` are those of the skin to probe; by default
    `places` of those furthest from fixed nodes.

    The table has one row per element: stiffness along and across the tension line [N/m]. Raises
    FaceError if an element is not on the skin, and InvertedElement, NotConverged or SingularSystem
    if the tissue within a ring has no stable equilibrium. Source of the experiment, in which skin
    is stiffest along its tension lines: Stavness et al., Anisotropic in-vivo measurements, by a
    probe within a ring that is glued to the skin.
    """
    scene = compose_scene(face, parameters)
    position = face["position"].values
    own, axes = skin_axes(face)
    connectivity = face["connectivity"].values[own]
    skin = sheet_nodes(face, OUTER)
    used = np.isin(connectivity, skin)
    place = (position[connectivity] * used[..., None]).sum(axis=1) / used.sum(axis=1)[:, None]
    if elements is None:
        # Elements far from fixed nodes.
        fixed = position[face["fixed"].values > 0]
        free = np.linalg.norm(place[:, None] - fixed[None], axis=2).min(axis=1)
        freest = np.sort(np.argsort(-free, kind="stable")[: max(len(own) // 3, places)])
        row = freest[np.linspace(0, len(freest) - 1, places).round().astype(int)]
    else:
        missing = np.setdiff1d(elements, own)
        if missing.size:
            raise FaceError(f"element index {missing[0]} is not on the skin")
        row = np.searchsorted(own, np.asarray(elements))
    rows: list[dict[str, float]] = []
    for k in row:
        far = np.flatnonzero(np.linalg.norm(position - place[k], axis=1) > RING)
        system = compile_scene(replace(scene, reductions=(*scene.reductions, Fixed(far))))
        control = system.control(np.zeros(len(system.muscles)))
        work = Workspace(system, parameters.linear_solver)
        state, _ = Static().step(system, system.rest_state(), control, 1.0, work)
        solve, _ = work.steps.factorised(system.tangent(state.q, control)[1])
        stiffness: dict[str, float] = {"element": int(own[k])}
        for name, axis in (("along (N/m)", 0), ("across (N/m)", 1)):
            load = np.zeros_like(position)
            for sign in (-1.0, 1.0):
                foot = place[k] + sign * 0.5 * GAUGE * axes[k, axis]
                away = np.linalg.norm(position[skin] - foot, axis=1)
                patch = skin[away <= max(RADIUS, float(away.min()) + 1e-9)]
                load[patch] += sign * axes[k, axis] / len(patch)
            rhs = system.kinematics.generalised_force(load, state.pose)
            stiffness[name] = 1.0 / float(rhs @ solve(rhs))
        rows.append(stiffness)
    return pd.DataFrame(rows)
