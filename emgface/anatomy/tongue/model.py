"""Model of a tongue as one Dataset: elements, muscles with fibres, and attachments to bodies.

All tongues, imported or generated, are assembled by `build_tongue` (`data_schema/tongue_model.json`).
Elements, fibres, bundles and facets are those of a face; exciters and bodies are those of a jaw.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.anatomy.frame import check_frame
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import JAW_FRAME
from emgface.anatomy.mesh_model import (
    check_elements,
    check_muscles,
    check_references,
    facet_arrays,
    float_array,
    integers,
    muscle_arrays,
    muscles_to_the_right,
)
from emgface.errors import TongueError
from emgface.face.parts import Bundle, Fibre, Floats, Integers
from emgface.muscles import AXES
from emgface.schema.validation import declared_variables, validate
from sim.indices import indices

TONGUE_MARKERS = ("tip", "back", "base")
"""Named nodes of every tongue: tip, highest part of the dorsum, and lowest part of the root."""


def build_tongue(
    *,
    position: Floats,
    connectivity: Integers,
    attachments: Mapping[str, Integers],
    fibres: Sequence[Fibre],
    bundles: Sequence[Bundle],
    force_max: Mapping[str, float],
    markers: Mapping[str, int],
    name: str,
    origin: str,
    source: str,
    node_id: Integers | None = None,
    element_id: Integers | None = None,
    facets: Mapping[str, Integers] | None = None,
    contour: Integers | None = None,
    postures: Mapping[str, Floats] | None = None,
    attrs: Mapping[str, str | int | float] | None = None,
) -> xr.Dataset:
    """Assemble a tongue_model Dataset and check it; errors as of `check_tongue`.

    Parameters
    ----------
    position : (nodes, 3) rest positions in the frame x right, y anterior, z superior [m].
    connectivity : (elements, 8) nodes in VTK order, 0-based; a wedge ends in -1, -1.
    attachments : nodes (k,) that follow each body, with the names of a jaw_model such as "jaw" and
        "hyoid"; a body that stays, such as "skull", holds them fixed.
    fibres : polylines with nodes, see `emgface.face.parts.Fibre`.
    bundles : one per muscle.
    force_max : largest active force of every muscle [N]; its keys are the muscles, in order, with
        ``_L`` or ``_R`` where they have sides.
    markers : nodes by name; at least `TONGUE_MARKERS`.
    name, origin, source : description.
    node_id, element_id : ids in the source; by default counted from 1.
    facets : nodes (facets, 4), outward, of named parts of the boundary.
    contour : (k,) nodes of the midline contour from front to back, over the dorsum.
    postures : displacements (nodes, 3) from rest by name [m].
    attrs : further attributes, such as the options of an import.

    Returns
    -------
    xarray.Dataset
        Of schema tongue_model, with the exciters of `emgface.anatomy.jaw.exciters.exciters_of`.
    """
    muscles, bodies = list(force_max), list(attachments)
    bodies += [b for b in dict.fromkeys(f.body for f in fibres) if b and b not in bodies]
    exciters = exciters_of(muscles, {})
    gain = np.array([[own.get(m, 0.0) for m in muscles] for own in exciters.values()])
    node_id = np.arange(1, len(position) + 1) if node_id is None else node_id
    element_id = np.arange(1, len(connectivity) + 1) if element_id is None else element_id
    attachments = {
        body: indices(f"the attachment to {body}", "node", nodes, len(position), error=TongueError)
        for body, nodes in attachments.items()
    }
    counts = [len(nodes) for nodes in attachments.values()]
    arrays: dict[str, Any] = {
        "axis": AXES,
        "muscle": muscles,
        "exciter": list(exciters),
        "body": bodies,
        "marker": list(markers),
        "position": float_array(position),
        "node_id": integers(node_id),
        "connectivity": integers(connectivity),
        "element_id": integers(element_id),
        "attachment_node": integers(np.concatenate(list(attachments.values()))),
        "attachment_body": integers(np.repeat(np.arange(len(counts)), counts)),
        **muscle_arrays(fibres, bundles, muscles, len(connectivity), TongueError),
        **_places(fibres, bodies),
        "muscle_force_max": float_array(np.array(list(force_max.values()))),
        "exciter_gain": float_array(gain),
        "marker_node": integers(list(markers.values())),
        **facet_arrays(facets),
    }
    if contour is not None:
        arrays["contour_node"] = integers(contour)
    if postures:
        arrays["posture"] = list(postures)
        arrays["posture_displacement"] = float_array(np.array(list(postures.values())))
    described = {"name": name, "origin": origin, "source": source, "frame": JAW_FRAME}
    described |= {"schema": "tongue_model", "schema_version": 1}
    variables = declared_variables("tongue_model", **arrays)
    ds = xr.Dataset(variables, attrs={**described, **(attrs or {})})
    return check_tongue(ds)


def check_tongue(ds: xr.Dataset) -> xr.Dataset:
    """Check a tongue against its schema and the requirements of the mechanics, and return it.

    Raises SchemaError or UnitsError as the schema does, and TongueError if an element refers to a
    node that does not exist or is inverted at a quadrature point at rest (a stored shape may invert
    corners), a node belongs to no element, a muscle has no element, one twice or no fibre, a
    marker of `TONGUE_MARKERS` is absent, or the tongue is turned or mirrored relative to its frame.
    """
    check_references(ds, (("marker_node", "marker"),), TongueError)
    ds = validate(ds, "tongue_model")
    check_elements(ds, TongueError, corners=False)
    check_muscles(ds, TongueError)
    for name in TONGUE_MARKERS:
        if name not in ds["marker"].values:
            raise TongueError(
                f"marker {name} is absent, expected the nodes {', '.join(TONGUE_MARKERS)}"
            )
    without = np.setdiff1d(np.arange(ds.sizes["muscle"]), ds["fibre_muscle"].values)
    if without.size:
        raise TongueError(f"muscle {ds['muscle'].values[without[0]]} has no fibre, expected one")
    apart = (ds["fibre_node"].values >= 0) & (ds["fibre_body"].values >= 0)
    if apart.any():
        raise TongueError(
            f"fibre point {int(np.argmax(apart))} is a node and lies on a body, expected one of them"
        )
    node = dict(zip(map(str, ds["marker"].values), ds["marker_node"].values, strict=True))
    tip, back, base = (ds["position"].values[node[name]] for name in TONGUE_MARKERS)
    directions = {
        "right": muscles_to_the_right(ds),
        "superior": back - (tip + base) / 2,
        "anterior": tip - base,
    }
    check_frame("tongue", directions, TongueError)
    return ds


def attached_nodes(tongue: xr.Dataset) -> dict[str, NDArray[np.int64]]:
    """Nodes (k,) that follow each body, by its name."""
    node, owner = (
        tongue["attachment_node"].values.astype(np.int64),
        tongue["attachment_body"].values,
    )
    by_body = {str(body): node[owner == k] for k, body in enumerate(tongue["body"].values)}
    return {body: nodes for body, nodes in by_body.items() if len(nodes)}


def _places(fibres: Sequence[Fibre], bodies: Sequence[str]) -> dict[str, Any]:
    """Nodes and bodies of the points of fibres."""
    nodes, owners = list[Integers](), list[Integers]()
    for fibre in fibres:
        n = len(fibre.position)
        node = np.full(n, -1) if fibre.node is None else np.asarray(fibre.node)
        outside = -1 if fibre.body is None else bodies.index(fibre.body)
        nodes.append(node)
        owners.append(np.where(node < 0, outside, -1))
    return {
        "fibre_node": integers(np.concatenate(nodes)),
        "fibre_body": integers(np.concatenate(owners)),
    }
