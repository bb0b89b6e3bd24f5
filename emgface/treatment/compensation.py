"""Activations of a treated face that restore the movement of the intact one, as far as any can."""

from dataclasses import replace
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

import sim
from emgface.face.identity import treatments_between
from emgface.face.motion import settle_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.inverse.parameters import without_contact
from sim.inverse import PointTarget, Weights, equilibria

Floats = NDArray[np.float64]

MOVEMENT_STEPS: Final = 4  #: equilibria on the way to the full movement
SIZE: Final = 0.5e-3  #: deviation of a marker that counts as one [m]


def compensated(
    intact: xr.Dataset,
    treated: xr.Dataset,
    levels: dict[str, float],
    parameters: SimulationParameters,
) -> xr.Dataset:
    """Find activations in 0-1 whose equilibria move the markers as those of the intact face.

    `levels` are the activations of muscles of the intact face, which rise in `MOVEMENT_STEPS`. The
    targets are the displacements of the lip markers of the intact face from its rest, added to the
    rest of the treated face; contact is omitted. The result contains ``activation`` (muscle, time)
    [1] of the treated face, and the root mean square distances of a marker from its target [m]:
    ``uncompensated`` with the activations of the intact face, ``residual`` with those found, which
    no other activation near them removes, and ``motion``, the displacement itself (time). Raises
    DataError if `treated` is not a treatment of `intact`.
    """
    treatments_between(intact, treated)
    p = without_contact(parameters)
    names = [str(m) for m in intact["muscle"].values]
    full = np.array([levels.get(name, 0.0) for name in names])
    shares = np.arange(1, MOVEMENT_STEPS + 1) / MOVEMENT_STEPS
    systems, rests, moved = [], [], []
    for face in (intact, treated):
        system = sim.compile_scene(replace(compose_scene(face, p), damping=None))
        rest = settle_face(face, p)["node_position"].values
        nodes = face["marker_node"].values.astype(np.int64)
        state, work = replace(system.rest_state(), q=rest), sim.Workspace(system)
        path: list[Floats] = []
        for share in shares:
            state, _ = sim.Static().step(system, state, system.control(share * full), 1.0, work)
            path.append(state.q[nodes] - rest[nodes])
        systems.append(system)
        rests.append(rest)
        moved.append(np.array(path))
    nodes = treated["marker_node"].values.astype(np.int64)
    wanted = rests[1][nodes] + moved[0]
    target = PointTarget(
        nodes, np.append(0.0, shares), np.concatenate([rests[1][nodes][None], wanted]), SIZE
    )
    start = replace(systems[1].rest_state(), q=rests[1])
    solution, _ = equilibria(
        systems[1], [target], shares, weights=Weights(size=1e-2, change=1e-3), initial=start,
    )  # fmt: skip
    left = np.sqrt(3.0) * SIZE * solution["misfit"].values  # of coordinates, over SIZE
    apart = np.linalg.norm(moved[1] - moved[0], axis=2)
    return xr.Dataset(
        {
            "activation": solution["activation"].transpose("muscle", "time"),
            "uncompensated": ("time", np.sqrt((apart**2).mean(axis=1)), {"units": "m"}),
            "residual": ("time", left, {"units": "m"}),
            "motion": (
                "time", np.sqrt((moved[0] ** 2).sum(axis=2).mean(axis=1)), {"units": "m"},
            ),
        },
        attrs={"origin": "simulated"},
    )  # fmt: skip
