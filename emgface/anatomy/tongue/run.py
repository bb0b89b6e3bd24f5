"""Motion of a tongue under excitations: simulation and its labelled result."""

from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.jaw.series import Excitation
from emgface.anatomy.step_error import motion_of
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.anatomy.tongue.scene import tongue_activation, tongue_scene
from emgface.face.parts import Floats
from emgface.face.quality import element_quality
from emgface.schema.validation import validate
from sim.integrators import Integrator
from sim.kinematics.members import NodeMotion

TONGUE_STEP, TONGUE_OUTPUT = 5e-3, 10e-3
"""Largest time step and time between outputs [s]."""
INSIDE = 0.02
"""Tolerance for fibre points outside an element, as a negative shape function [1]."""


def simulate_tongue(
    tongue: xr.Dataset,
    excitation: Excitation,
    *,
    duration: float,
    parameters: TongueParameters | None = None,
    paths: Mapping[str, NodeMotion] | None = None,
    step: float = TONGUE_STEP,
    output: float = TONGUE_OUTPUT,
    integrator: Integrator | None = None,
    check: bool = True,
    tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate a tongue on bodies that stay or move along given paths.

    Parameters
    ----------
    tongue : xarray.Dataset
        A tongue_model.
    excitation : Excitation
    duration : float
        [s]
    parameters : TongueParameters, optional
    paths : mapping, optional
        Motion of the nodes that follow a body, as of `emgface.anatomy.tongue.scene.tongue_scene`.
    step, output : float
        Largest time step, halved where it fails, and time between outputs [s].
    integrator : optional
        `sim.ConvergedEuler` by default.
    check, tolerance
        Repetition with other steps, which gives ``numerical_error``, and desired error [m], as of
        `emgface.anatomy.step_error.with_step_error`.
    progress : callable, optional
        As of `sim.simulate`, of every repetition.

    Returns
    -------
    xarray.Dataset
        Of schema tongue_motion.

    Raises
    ------
    JawError
        An exciter is unknown.
    TongueError, SceneError
        As `tongue_scene`.
    SimulationError
        As `sim.simulate`.
    """
    p = parameters or TongueParameters()
    system = sim.compile_scene(tongue_scene(tongue, p, paths=paths))
    given, negative = excitation.activation(tongue)
    values = given.transpose("time", "muscle").values
    markers = tuple(map(str, tongue["marker"].values))
    points = sim.Markers(tongue["marker_node"].values.astype(np.int64), markers)
    motion = motion_of(
        system,
        sim.Activation(excitation.time, tongue_activation(tongue, system, values)),
        (points, sim.Positions(), sim.SmallestJ()),
        duration=duration, step=step, output=output,
        integrator=sim.ConvergedEuler() if integrator is None else integrator,
        check=check, tolerance=tolerance, progress=progress,
    )  # fmt: skip
    return validate(_labelled(tongue, motion, excitation, values, p, negative), "tongue_motion")


def _labelled(
    tongue: xr.Dataset,
    motion: xr.Dataset,
    excitation: Excitation,
    values: Floats,
    p: TongueParameters,
    negative: float,
) -> xr.Dataset:
    """Motion with activations, volume, and the fibres that are drawn."""
    q = motion["node_position"].transpose("time", "node", "axis").values
    nodes = tongue.sizes["node"]
    lines, q = fibre_points(tongue, q), q[:, :nodes]
    drive = sim.Activation(excitation.time, values)
    at = drive.at_all(motion["time"].values)
    connectivity = tongue["connectivity"].values
    volume = [element_quality(x, connectivity).volume.sum() for x in q]
    metre = {"units": "m"}
    labelled = motion.drop_vars("node_position").assign(
        node_position=(("node", "axis", "time"), q.transpose(1, 2, 0), metre),
        line_position=(("fibre_point", "axis", "time"), lines.transpose(1, 2, 0), metre),
        activation=(("muscle", "time"), at.T, {"units": "1"}),
        volume=("time", np.array(volume), {"units": "m^3"}),
    )
    for name in ("fibre_of_point", "fibre_muscle", "connectivity", "contour_node"):
        if name in tongue:
            labelled[name] = tongue[name].variable
    labelled = labelled.assign_coords(muscle=tongue["muscle"].values)
    labelled.attrs |= {
        "origin": "simulated",
        "tongue": tongue.attrs["name"],
        "muscles": p.muscles,
        "clipped_excitation": negative,
    }
    return labelled


def fibre_points(tongue: xr.Dataset, q: Floats) -> Floats:
    """Positions (time, fibre_point, 3) of the points of all fibres.

    `q` (time, k, 3) are positions of at least the nodes [m]. Points on bodies stay.
    """
    node, X = tongue["fibre_node"].values, tongue["fibre_position"].values
    points = np.repeat(X[None], len(q), axis=0)
    points[:, node >= 0] = q[:, node[node >= 0]]
    inside = np.flatnonzero((node < 0) & (tongue["fibre_body"].values < 0))
    if len(inside):
        rest = tongue["position"].values
        mesh = sim.mesh_from_arrays(rest, hex8=tongue["connectivity"].values)
        embedded = sim.embed(mesh, X[inside], tolerance=INSIDE)
        points[:, inside] = np.einsum("pk,tpki->tpi", embedded.weights, q[:, embedded.nodes])
    return points
