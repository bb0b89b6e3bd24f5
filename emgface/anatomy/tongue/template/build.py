"""Generated tongue of the person of a face and a jaw."""

from collections.abc import Mapping
from dataclasses import fields

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.template.landmarks import landmarks
from emgface.anatomy.jaw.template.measures import jaw_measures
from emgface.anatomy.tongue.model import build_tongue
from emgface.anatomy.tongue.template.muscles import place_tongue_muscles
from emgface.anatomy.tongue.template.palate import palate
from emgface.anatomy.tongue.template.shape import Index, TongueMesh, tongue_mesh
from emgface.face.parts import Arch, Floats, Integers
from emgface.face.template.arches import dental_arches
from emgface.face.template.measures import Measures
from emgface.face.template.volunteers import preset_measures, random_measures

JAW_ROOT, JAW_LINE, HYOID_TOP = 0.3, 0.46, 0.7
"""Ends of the attachments: height v in front, on the mandible; way u along the mylohyoid line; height v
at the back, on the hyoid. That in front is 4 to 7 mm above the origin of genioglossus; tissue that is
held higher up is crushed between the bone and the floor of the mouth."""


def template_tongue(
    *,
    resolution: str | int = "medium",
    measures: Mapping[str, float] | None = None,
    preset: str = "adult",
    seed: int | None = None,
    name: str = "",
) -> xr.Dataset:
    """Generate the tongue of the person whose face and jaw have the same preset, seed and measures.

    Parameters
    ----------
    resolution : str or int
        "coarse" (400 elements), "medium" (980), "fine" (2800), or an approximate number.
    measures, preset, seed, name
        As `emgface.anatomy.jaw.template.template_jaw`.

    Returns
    -------
    xarray.Dataset
        Of schema tongue_model, origin "generated", exactly symmetric, in the frame of the generated
        face, with the parts ``dorsum``, ``left``, ``right``, ``front``, ``back`` and ``floor`` of its
        boundary.

    Raises
    ------
    TongueError
        The resolution is unknown or out of range, or the tongue does not fit.
    JawError, FaceError
        As `template_jaw`.
    """
    places, arches = person(measures, preset, seed)
    mesh = tongue_mesh(places, arches, resolution)
    fibres, bundles, force = place_tongue_muscles(mesh, places)
    middle = mesh.shape[2] // 2
    contour = mesh.node[:, -1, middle]
    heights = mesh.position[contour, 2]
    return build_tongue(
        position=mesh.position,
        connectivity=mesh.connectivity,
        attachments=_attachments(mesh),
        fibres=fibres,
        bundles=bundles,
        force_max=force,
        markers={
            "tip": int(contour[0]),
            "back": int(contour[np.argmax(heights)]),
            "base": int(mesh.node[-1, 0, middle]),
        },
        name=name
        or f"template tongue ({preset}" + ("" if seed is None else f", volunteer {seed}") + ")",
        origin="generated",
        source="emgface.anatomy.tongue.template",
        facets=_facets(mesh.node),
        contour=contour,
        attrs={"preset": preset, "seed": "" if seed is None else seed},
    )


def template_palate(*, preset: str = "adult", seed: int | None = None) -> Arch:
    """Closed body of the palate of a person, as `template_tongue`."""
    return palate(*person(None, preset, seed))


def person(
    measures: Mapping[str, float] | None, preset: str, seed: int | None
) -> tuple[Mapping[str, Floats], tuple[Arch, Arch]]:
    """Landmarks and dental arches of a person, as `template_jaw`."""
    given, own = dict(measures or {}), {field.name for field in fields(Measures)}
    drawn = preset_measures(preset) if seed is None else random_measures(seed, preset=preset)
    face = drawn.with_values({k: v for k, v in given.items() if k in own})
    jaw = jaw_measures(face, preset, {k: v for k, v in given.items() if k not in own})
    arches = dental_arches(face)
    return landmarks(face, jaw, arches), arches


def _attachments(mesh: TongueMesh) -> dict[str, Integers]:
    """Nodes on the mandible (genial tubercles and mylohyoid line) and on the hyoid."""
    nu, nv, _ = mesh.shape
    front = mesh.node[0, : int(JAW_ROOT * nv) + 1].ravel()
    line = mesh.node[: int(JAW_LINE * nu) + 1, 0][:, [0, -1]].ravel()
    back = mesh.node[-1, : int(HYOID_TOP * nv) + 1].ravel()
    return {"jaw": np.unique(np.concatenate([front, line])), "hyoid": np.unique(back)}


def _facets(node: Index) -> dict[str, Integers]:
    """Outward quadrilaterals of the six sides of the block."""

    def quads(sheet: Index, turned: bool) -> Integers:
        order = sheet[:-1, :-1], sheet[1:, :-1], sheet[1:, 1:], sheet[:-1, 1:]
        corners = np.stack(order, axis=-1).reshape(-1, 4)
        return corners[:, ::-1] if turned else corners

    return {
        "dorsum": quads(node[:, -1], False),
        "left": quads(node[:, :, 0], False),
        "right": quads(node[:, :, -1], True),
        "front": quads(node[0], False),
        "back": quads(node[-1], True),
        "floor": quads(node[:, 0], True),
    }
