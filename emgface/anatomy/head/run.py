"""Motion of a head under excitations: simulation and its labelled result."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

import sim
from emgface.anatomy.head.model import GROUP_SCHEMAS, HEAD_DIGEST, Head, head_digest, read_parts
from emgface.anatomy.head.scene import TONGUE, HeadScene, head_scene
from emgface.anatomy.jaw.series import Excitation, ramps
from emgface.anatomy.step_error import motion_of
from emgface.anatomy.tongue.parameters import TongueParameters
from emgface.anatomy.tongue.scene import LINE_ENDING
from emgface.errors import HeadError
from emgface.face.lip_shape import UP_DIRECTION, has_mouth
from emgface.face.mouth import Mouth
from emgface.face.simulation_parameters import SimulationParameters
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.schema.validation import validate
from sim.integrators import Integrator
from sim.probes import Probe

HEAD_STEP, HEAD_OUTPUT = 5e-3, 10e-3
"""Largest time step and time between outputs [s]."""
CLOSERS: Final = ("bi_close", 4e-4)
"""Exciter and level that hold the jaw at rest (Stavness et al. 2006, section 3.1)."""


def simulate_head(
    head: Head,
    excitation: Excitation,
    *,
    duration: float,
    face: SimulationParameters | None = None,
    tongue: TongueParameters = TONGUE,
    law: str = "peck",
    gravity: bool = True,
    step: float = HEAD_STEP,
    output: float = HEAD_OUTPUT,
    integrator: Integrator | None = None,
    scene: HeadScene | None = None,
    check: bool = True,
    tolerance: float | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> xr.Dataset:
    """Simulate a head.

    Parameters
    ----------
    head : Head
    excitation : Excitation
        Of muscles and groups of all parts.
    duration : float
        [s]
    face, tongue, law, gravity
        As of `emgface.anatomy.head.scene.head_scene`.
    step, output : float
        Largest time step, halved where it fails, and time between outputs [s].
    integrator : optional
        `sim.LinearlyImplicitEuler` by default, which supports contact with moving bones.
    scene : HeadScene, optional
        Of the head, for several motions. It has its own face, tongue, law and gravity, which must not
        be specified in addition.
    check, tolerance
        Repetition with other steps, which gives ``numerical_error``, and desired error [m], as of
        `emgface.anatomy.step_error.with_step_error`.
    progress : callable, optional
        As of `sim.simulate`, of every repetition.

    Returns
    -------
    xarray.Dataset
        Of schema head_motion.

    Raises
    ------
    JawError
        An exciter is unknown.
    HeadError
        A property of the scene is specified in addition to it.
    HeadError, SceneError, ContactFailure
        As `head_scene`.
    SimulationError
        As `sim.simulate`.
    """
    own_properties = {
        "face": face is not None,
        "tongue": tongue is not TONGUE,
        "law": law != "peck",
    }
    own_properties["gravity"] = not gravity
    if scene is not None and any(own_properties.values()):
        named = " and ".join(name for name, given in own_properties.items() if given)
        raise HeadError(
            f"{named} specified in addition to a scene, which already contains it: pass it to head_scene"
        )
    parts = scene or head_scene(head, face=face, tongue=tongue, law=law, gravity=gravity)
    system = parts.system
    drive, given, negative = scene_activation(head, system, excitation)
    motion = motion_of(
        system, drive, probes(head, parts), duration=duration, step=step, output=output,
        integrator=sim.LinearlyImplicitEuler() if integrator is None else integrator,
        check=check, tolerance=tolerance, progress=progress,
    )  # fmt: skip
    if "node_position" in motion:
        n = parts.scene.mesh.n_nodes
        motion = motion.isel(node=slice(0, n))
    sizes = [head.parts[tissue].sizes["node"] for tissue in parts.first]
    own = sim.Activation(excitation.time, given.values.T)
    at = own.at_all(motion["time"].values)
    motion = motion.assign(
        tissue_nodes=("tissue", np.array(sizes, dtype=np.int32), {"units": "1"}),
        activation=(("muscle", "time"), at.T, {"units": "1"}),
    )
    motion = motion.assign_coords(
        muscle=given["muscle"].values,
        tissue=np.array(list(parts.first), dtype="U8"),
        named=list(head.named),
    )
    motion.attrs |= {
        "origin": "simulated",
        "head": head.lists.attrs["name"],
        HEAD_DIGEST: head_digest(head.parts),
        "clipped_excitation": negative,
    }
    return validate(motion, "head_motion")


def scene_activation(
    head: Head, system: sim.System, excitation: Excitation
) -> tuple[sim.Activation, xr.DataArray, float]:
    """Activation of the muscles of the scene and of the head, and the clipped excitation."""
    given, negative = excitation.activation(head.lists)
    column = {str(m): k for k, m in enumerate(given["muscle"].values)}
    own = [column.get(name.removesuffix(LINE_ENDING), -1) for name in system.muscles]
    padded = np.concatenate([given.values.T, np.zeros((len(excitation.time), 1))], axis=1)
    return sim.Activation(excitation.time, padded[:, own]), given, negative


def probes(head: Head, parts: HeadScene) -> tuple[Probe, ...]:
    """Markers of all parts, nodes, frames of bodies, smallest J and the opening of the mouth."""
    nodes, names = list[int](), list[str]()
    for tissue, first in parts.first.items():
        own = head.parts[tissue]
        nodes += (own["marker_node"].values + first).tolist()
        names += [str(name) for name in own["marker"].values]
    if parts.jaw is not None:
        nodes += parts.jaw.points.values()
        names += parts.jaw.points
    recorded: list[Probe] = [sim.Markers(np.array(nodes, dtype=np.int64), tuple(names))]
    if parts.first:
        recorded += [sim.Positions(), sim.SmallestJ()]
    if parts.jaw is not None and parts.jaw.bodies:
        recorded.append(sim.Frames(parts.jaw.bodies))
    if "face" in head.parts:
        face = head.parts["face"]
        upper, lower = (int(node) for node in face["lip_opening_node"].values)
        recorded.append(sim.Opening(upper, lower, UP_DIRECTION))
        if has_mouth(face):
            recorded.append(Mouth.from_face(face))
    return tuple(recorded)


def raised(levels: dict[str, float], *, rise: float = 0.2, jaw: bool = True) -> Excitation:
    """Excitations that rise linearly from 0 and are held, with the tone of the closers of a jaw."""
    corners = {name: [(0.0, 0.0), (rise, level)] for name, level in levels.items()}
    if jaw and CLOSERS[0] not in corners:
        corners[CLOSERS[0]] = [(0.0, CLOSERS[1])]
    return ramps(corners)


def write_motion(motion: xr.Dataset, head: Head, path: str | Path) -> Path:
    """Write a motion with the parts of its head as groups, which are drawn."""
    parts = {group: (part, GROUP_SCHEMAS[group]) for group, part in head.parts.items()}
    return write_netcdf(motion, path, "head_motion", groups=parts)


def read_motion(path: str | Path) -> tuple[xr.Dataset, dict[str, xr.Dataset]]:
    """Read a motion and the parts of its head, whose digest earlier files do not state."""
    motion = read_netcdf(path, "head_motion")
    parts = read_parts(path, motion["named"].values.tolist())
    motion.attrs.setdefault(HEAD_DIGEST, head_digest(parts))
    return motion, parts
