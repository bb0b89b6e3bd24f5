"""Assembly of the face model as one labelled Dataset.

The Dataset contains nodes, elements, fixed nodes, muscle fibres, muscle elements with directions,
and markers (`data_schema/face_model.json`). All faces, imported or generated, are assembled here.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from emgface.anatomy.mesh_model import (
    codes,
    facet_arrays,
    float_array,
    integers,
    muscle_arrays,
    stacked,
)
from emgface.errors import FaceError
from emgface.face.parts import FACE_FRAME, LIPS, Arch, Bundle, Fibre, Floats, Integers
from emgface.face.validity import check_face
from emgface.muscles import AXES, FACE_MARKERS, LIP_MARKERS, MUSCLES
from emgface.schema.validation import declared_variables


def build_face(
    *,
    position: Floats,
    connectivity: Integers,
    layer: Integers,
    fixed: Integers,
    fibres: Sequence[Fibre],
    bundles: Sequence[Bundle],
    marker_node: Integers,
    face_marker_position: Floats,
    lip_opening_node: Integers,
    name: str,
    origin: str,
    source: str,
    node_id: Integers | None = None,
    element_id: Integers | None = None,
    facets: Mapping[str, Integers] | None = None,
    arches: Sequence[Arch] = (),
    lips: Mapping[str, Integers] | None = None,
    attrs: Mapping[str, str | int | float] | None = None,
) -> xr.Dataset:
    """Assemble a face_model Dataset and check it; errors as of `check_face`.

    `position` (nodes, 3) [m] are at rest in the frame x right, y anterior, z superior.
    `connectivity` (elements, 8) is 0-based in VTK order; a wedge ends in -1, -1. `layer`
    (elements,) is 0 inner, 1 centre, 2 outer; `fixed` (nodes,) is 0 free, 1 fixed to the mandible,
    2 to the skull. There is one of the `bundles` per muscle of `emgface.muscles.MUSCLES`.
    `marker_node` (10,) are the nodes of `LIP_MARKERS`, `face_marker_position` (6, 3) [m] the rigid
    points of `FACE_MARKERS`, and `lip_opening_node` (2,) the midline nodes of the upper and the
    lower lip margin. `name`, `origin` and `source` describe the face.

    `node_id` and `element_id` are ids in the source (default: counted from 1). `facets` are nodes
    (facets, 4), outward, of named parts of the boundary; `arches` rigid surfaces that the tissue
    may touch; `lips` nodes (m, 3) of the outward triangles of the closed surface of each lip,
    "upper" and "lower"; `attrs` further attributes, such as the options of an import.
    """
    node_id = np.arange(1, len(position) + 1) if node_id is None else node_id
    element_id = np.arange(1, len(connectivity) + 1) if element_id is None else element_id
    variables = declared_variables(
        "face_model",
        axis=AXES,
        muscle=MUSCLES,
        marker=LIP_MARKERS,
        face_marker=FACE_MARKERS,
        lip=LIPS,
        position=float_array(position),
        node_id=integers(node_id),
        connectivity=integers(connectivity),
        element_id=integers(element_id),
        layer=codes(layer),
        fixed=codes(fixed),
        **muscle_arrays(fibres, bundles, MUSCLES, len(connectivity), FaceError),
        marker_node=integers(marker_node),
        face_marker_position=float_array(face_marker_position),
        lip_opening_node=integers(lip_opening_node),
        **facet_arrays(facets),
        **_rigid(arches),
        **_lips(lips),
    )
    described = {"name": name, "origin": origin, "source": source, "frame": FACE_FRAME}
    described |= {"schema": "face_model", "schema_version": 1}
    return check_face(xr.Dataset(variables, attrs={**described, **(attrs or {})}))


def _rigid(arches: Sequence[Arch]) -> dict[str, Any]:
    """Points and triangles of the rigid surfaces, one after the other."""
    if not arches:
        return {}
    shift = np.cumsum([0, *(len(arch.points) for arch in arches[:-1])])
    rows = [integers(arch.triangles) + k for arch, k in zip(arches, shift, strict=True)]
    bones = np.repeat([arch.bone for arch in arches], [len(r) for r in rows])
    return {
        "arch_position": stacked([arch.points for arch in arches]),
        "arch_triangle": integers(np.concatenate(rows)),
        "arch_bone": bones.astype(np.int8),
    }


def _lips(lips: Mapping[str, Integers] | None) -> dict[str, Any]:
    """Triangles of the closed surfaces of the lips."""
    if not lips:
        return {}
    sizes = [len(lips[lip]) for lip in LIPS]
    return {
        "lip_triangle": np.concatenate([integers(lips[lip]) for lip in LIPS]),
        "lip_of_triangle": integers(np.repeat(np.arange(len(LIPS)), sizes)),
    }
