"""The face model as one labelled Dataset: build, check, save, load.

The Dataset holds nodes, elements, fixed nodes, muscle fibres, muscle elements with directions and
markers, as `data_schema/face_model.json` declares. Every face, imported or generated, is built
here, and every face is checked here before anyone uses it.
"""

import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError, FaceError
from emgface.face.quality import element_quality
from emgface.muscles import AXES, FACE_MARKERS, LIP_MARKERS, MUSCLES
from emgface.schema import validate

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

FRAME: Final = "x lateral (+x is the subject's right), y anterior, z superior; metres"
FREE, MANDIBLE, SKULL = 0, 1, 2
"""Values of `fixed`."""
INNER, CENTRE, OUTER = 0, 1, 2
"""Values of `layer`."""
LIPS: Final = ("upper", "lower")


@dataclass(frozen=True)
class Fibre:
    """One polyline of a muscle: name of the muscle with side, points (k, 3) [m]."""

    muscle: str
    position: Floats


@dataclass(frozen=True)
class Bundle:
    """Elements of one muscle: 0-based `element` (k,), unit `direction` (k, 3).

    `weight` (k,) is the share of each element that the muscle fills [1]; None stands for 1.
    """

    muscle: str
    element: Integers
    direction: Floats
    weight: Floats | None = None


@dataclass(frozen=True)
class Arch:
    """A rigid triangulated surface: bone that carries it, points (n, 3) [m], triangles (m, 3).

    `bone` is MANDIBLE or SKULL.
    """

    bone: int
    points: Floats
    triangles: Integers


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
    attrs: Mapping[str, str | int | float] | None = None,
) -> xr.Dataset:
    """Assemble a face_model Dataset and check it.

    Parameters
    ----------
    position : ndarray, shape (nodes, 3)
        Rest positions [m] in the frame x right, y anterior, z superior.
    connectivity : ndarray of int, shape (elements, 8)
        0-based, VTK order; a wedge ends in -1, -1.
    layer : ndarray of int, shape (elements,)
        0 inner, 1 centre, 2 outer.
    fixed : ndarray of int, shape (nodes,)
        0 free, 1 fixed to the mandible, 2 to the skull.
    fibres, bundles : sequence
        Muscle fibres, and one bundle per muscle of `emgface.muscles.MUSCLES`.
    marker_node : ndarray of int, shape (10,)
        Node of each of `emgface.muscles.LIP_MARKERS`.
    face_marker_position : ndarray, shape (6, 3)
        Rigid points [m] of `emgface.muscles.FACE_MARKERS`.
    lip_opening_node : ndarray of int, shape (2,)
        Midline node of the upper and of the lower lip margin.
    name, origin, source : str
        What the face is called, how it came about and from where.
    node_id, element_id : ndarray of int, optional
        Names in the source; counted from 1 if absent.
    facets : mapping, optional
        Parts of the boundary by name, such as the inner surface of a lip: nodes of each facet
        (facets, 4), outward.
    arches : sequence of Arch
        Rigid surfaces that the tissue may touch.
    attrs : mapping, optional
        Further attributes, such as the options of an import.

    Returns
    -------
    xarray.Dataset
        Of schema face_model.

    Raises
    ------
    FaceError, SchemaError, UnitsError
        As `check_face`.
    """
    n_nodes, n_elements = len(position), len(connectivity)
    if node_id is None:
        node_id = np.arange(1, n_nodes + 1)
    if element_id is None:
        element_id = np.arange(1, n_elements + 1)
    order = {muscle: k for k, muscle in enumerate(MUSCLES)}
    for muscle in [*(f.muscle for f in fibres), *(b.muscle for b in bundles)]:
        if muscle not in order:
            raise FaceError(f"unknown muscle {muscle!r}: expected one of {', '.join(MUSCLES)}")
    bundles = sorted(bundles, key=lambda bundle: order[bundle.muscle])
    sizes = [len(fibre.position) for fibre in fibres]
    counts = [len(bundle.element) for bundle in bundles]

    def stack(parts: list[Floats]) -> Floats:
        return np.concatenate(parts) if parts else np.empty((0, 3))

    weighted = [bundle.muscle for bundle in bundles if bundle.weight is not None]
    if weighted and len(weighted) < len(bundles):
        raise FaceError(
            f"{weighted[0]} has weights and {len(bundles) - len(weighted)} muscles have none, expected "
            "all or none"
        )
    ds = xr.Dataset(
        {
            "position": (("node", "axis"), _f(position)),
            "node_id": ("node", _i(node_id)),
            "connectivity": (("element", "element_node"), _i(connectivity)),
            "element_id": ("element", _i(element_id)),
            "layer": ("element", np.asarray(layer, dtype=np.int8)),
            "fixed": ("node", np.asarray(fixed, dtype=np.int8)),
            "fibre_position": (
                ("fibre_point", "axis"),
                stack([_f(fibre.position) for fibre in fibres]),
            ),
            "fibre_of_point": ("fibre_point", _i(np.repeat(np.arange(len(fibres)), sizes))),
            "fibre_muscle": ("fibre", _i([order[fibre.muscle] for fibre in fibres])),
            "bundle_muscle": (
                "bundle_element",
                _i(np.repeat([order[bundle.muscle] for bundle in bundles], counts)),
            ),
            "bundle_index": (
                "bundle_element",
                _i(np.concatenate([np.asarray(b.element) for b in bundles] or [[]])),
            ),
            "bundle_direction": (
                ("bundle_element", "axis"),
                stack([_f(bundle.direction) for bundle in bundles]),
            ),
            "marker_node": ("marker", _i(marker_node)),
            "face_marker_position": (("face_marker", "axis"), _f(face_marker_position)),
            "lip_opening_node": ("lip", _i(lip_opening_node)),
        },
        coords={
            "axis": list(AXES),
            "muscle": list(MUSCLES),
            "marker": list(LIP_MARKERS),
            "face_marker": list(FACE_MARKERS),
            "lip": list(LIPS),
        },
        attrs={
            "name": name,
            "origin": origin,
            "source": source,
            "frame": FRAME,
            "schema": "face_model",
            "schema_version": 1,
            **(attrs or {}),
        },
    )
    if weighted:
        weight = np.concatenate([_f(b.weight) for b in bundles if b.weight is not None])
        ds["bundle_weight"] = ("bundle_element", weight)
    if facets:
        ds = ds.assign_coords(surface=list(facets))
        sizes = [len(nodes) for nodes in facets.values()]
        ds["facet_node"] = (("facet", "facet_corner"), _i(np.concatenate(list(facets.values()))))
        ds["facet_surface"] = ("facet", _i(np.repeat(np.arange(len(facets)), sizes)))
    if arches:
        shift = np.cumsum([0, *(len(arch.points) for arch in arches[:-1])])
        rows = [arch.triangles + k for arch, k in zip(arches, shift, strict=True)]
        bones = np.repeat([arch.bone for arch in arches], [len(r) for r in rows])
        ds["arch_position"] = (("arch_point", "axis"), stack([_f(arch.points) for arch in arches]))
        ds["arch_triangle"] = (("arch_facet", "arch_corner"), _i(np.concatenate(rows)))
        ds["arch_bone"] = ("arch_facet", bones.astype(np.int8))
    for variable in ds.data_vars.values():
        variable.attrs["units"] = "1"
    metric = ("position", "fibre_position", "face_marker_position", "arch_position")
    for metres in (name for name in metric if name in ds):
        ds[metres].attrs["units"] = "m"
    return check_face(ds)


def check_face(ds: xr.Dataset) -> xr.Dataset:
    """Check a face against its schema and against mechanics.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model.

    Returns
    -------
    xarray.Dataset
        The face as the schema returns it.

    Raises
    ------
    SchemaError, UnitsError
        Names, dims, units or ranges differ from the schema.
    FaceError
        An element refers to a node that does not exist or mixes node counts, or is inverted at a
        quadrature point or corner; a node belongs to no element; a muscle owns no element or one
        twice; a marker or lip-opening node is fixed.
    """
    _check_indices(ds)
    ds = validate(ds, "face_model")
    _check_elements(ds)
    _check_muscles(ds)
    fixed = ds["fixed"].values
    for variable, dim in (("marker_node", "marker"), ("lip_opening_node", "lip")):
        if variable not in ds:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if fixed[node]:
                raise FaceError(
                    f"{dim} {label} sits on node {ds['node_id'].values[node]}, which is fixed: "
                    "expected a node that moves, choose another"
                )
    return ds


def save_face(ds: xr.Dataset, path: str | os.PathLike[str]) -> Path:
    """Check a face and write it as netCDF; an existing file is replaced only when that succeeds.

    Parameters
    ----------
    ds : xarray.Dataset
        A face_model.
    path : path-like
        File to write; its folder is made if absent.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    FaceError, SchemaError, UnitsError
        As `check_face`, or the file cannot be written.
    """
    ds = check_face(ds)
    path = Path(path)
    encoding = {str(name): {"zlib": True, "complevel": 4} for name in ds.data_vars}
    partial: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, text = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
        os.close(handle)
        partial = Path(text)
        ds.to_netcdf(partial, engine="netcdf4", encoding=encoding)
        # mkstemp makes a file that its owner alone may read.
        partial.chmod(0o666 & ~_umask())
        partial.replace(path)
    except OSError as error:
        raise FaceError(f"{path} cannot be written ({error}): check folder and space") from error
    finally:
        if partial is not None:
            partial.unlink(missing_ok=True)
    return path


def load_face(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a face_model netCDF into memory and check it.

    Raises
    ------
    FaceError
        The file is absent, truncated or no netCDF file, or as `check_face`.
    SchemaError, UnitsError
        As `check_face`.
    """
    path = Path(path)
    if not path.is_file():
        raise FaceError(
            f"no face model at {path}: expected a netCDF file made by 'emgface face import'"
        )
    try:
        with xr.open_dataset(path, engine="netcdf4") as opened:
            ds = opened.load()
    except (OSError, RuntimeError, ValueError) as error:
        raise FaceError(
            f"{path} cannot be read as netCDF ({error}): it is truncated or of another format, "
            "make it again"
        ) from error
    return check_face(ds)


def fibres_of(ds: xr.Dataset, muscle: str) -> list[Floats]:
    """Points (k, 3) [m] of each fibre of one muscle such as `ZYG_L`."""
    index = _muscle_index(ds, muscle)
    owner = ds["fibre_of_point"].values
    points = ds["fibre_position"].values
    return [points[owner == k] for k in np.flatnonzero(ds["fibre_muscle"].values == index)]


def elements_of(ds: xr.Dataset, muscle: str) -> NDArray[np.integer]:
    """0-based elements of one muscle such as `ZYG_L`, shape (k,)."""
    return ds["bundle_index"].values[ds["bundle_muscle"].values == _muscle_index(ds, muscle)]


def shares_of(ds: xr.Dataset, muscle: str) -> Floats:
    """Share of each element of `elements_of` that the muscle fills, shape (k,) [1]."""
    mine = ds["bundle_muscle"].values == _muscle_index(ds, muscle)
    if "bundle_weight" not in ds:
        return np.ones(int(mine.sum()))
    return ds["bundle_weight"].values[mine]


def surface_names(ds: xr.Dataset) -> list[str]:
    """Names of the parts of the boundary that the face names."""
    return [str(name) for name in ds["surface"].values] if "surface" in ds.coords else []


def facets_of(ds: xr.Dataset, surface: str) -> NDArray[np.integer]:
    """Nodes (facets, 4), outward, of one named part of the boundary, such as `upper_lip_inner`.

    Raises DataError if the face names no such part.
    """
    names = surface_names(ds)
    if surface not in names:
        raise DataError(
            f"unknown surface {surface!r}: expected one of {', '.join(names) or 'none'}"
        )
    return ds["facet_node"].values[ds["facet_surface"].values == names.index(surface)]


def arches_of(ds: xr.Dataset) -> list[Arch]:
    """Rigid surfaces that the tissue may touch; none if the face has no arches."""
    if "arch_position" not in ds:
        return []
    points, triangle = ds["arch_position"].values, ds["arch_triangle"].values
    arches: list[Arch] = []
    for bone in (SKULL, MANDIBLE):
        used, corner = np.unique(triangle[ds["arch_bone"].values == bone], return_inverse=True)
        if len(used):
            arches.append(Arch(bone, points[used], corner.reshape(-1, 3)))
    return arches


def _muscle_index(ds: xr.Dataset, muscle: str) -> int:
    names = [str(name) for name in ds["muscle"].values]
    if muscle not in names:
        raise DataError(f"unknown muscle {muscle!r}: expected one of {', '.join(names)}")
    return names.index(muscle)


def _check_indices(ds: xr.Dataset) -> None:
    """Check references between variables, naming nodes as the source names them."""
    needed = ("position", "node_id", "element_id", "connectivity", "marker_node", "bundle_index")
    if any(name not in ds for name in needed):
        return  # The schema names what is absent.
    n = ds.sizes.get("node", 0)
    connectivity = ds["connectivity"].values
    if connectivity.ndim != 2 or connectivity.shape[1] != 8:
        return
    wedge = (connectivity[:, 6:] == -1).all(axis=1)
    bad = (connectivity >= n) | (connectivity < 0)
    bad[wedge, 6:] = False
    if bad.any():
        row, column = (int(k[0]) for k in np.nonzero(bad))
        raise FaceError(
            f"element {ds['element_id'].values[row]} refers to node index "
            f"{connectivity[row, column]}, expected 0 to {n - 1}"
            + (" (-1 only in the last two of a wedge)" if connectivity[row, column] < 0 else "")
        )
    for variable, dim in (("marker_node", "marker"), ("lip_opening_node", "lip")):
        if variable not in ds or dim not in ds.coords:
            continue
        for label, node in zip(ds[dim].values, ds[variable].values, strict=True):
            if not 0 <= node < n:
                raise FaceError(f"{dim} {label} refers to node index {node}, expected 0 to {n - 1}")


def _check_elements(ds: xr.Dataset) -> None:
    connectivity = ds["connectivity"].values
    used = np.zeros(ds.sizes["node"], dtype=bool)
    used[connectivity[connectivity >= 0]] = True
    if not used.all():
        node = int(np.flatnonzero(~used)[0])
        on_it = [
            str(label)
            for label, place in zip(ds["marker"].values, ds["marker_node"].values, strict=True)
            if place == node
        ]
        raise FaceError(
            f"node {ds['node_id'].values[node]} belongs to no element"
            + (f" (marker {on_it[0]} sits on it)" if on_it else "")
            + ": expected every node in use, drop it"
        )
    smallest = element_quality(ds["position"].values, connectivity).smallest_det
    bad = np.flatnonzero(~(smallest > 0))
    if len(bad):
        worst = int(bad[np.argmin(smallest[bad])])
        others = f" ({len(bad)} such elements)" if len(bad) > 1 else ""
        raise FaceError(
            f"element {ds['element_id'].values[worst]} is inverted at rest{others}: its smallest "
            f"Jacobian determinant is {smallest[worst]:.3g} m3, expected a positive one; check its "
            "node order and positions"
        )


def _check_muscles(ds: xr.Dataset) -> None:
    owner, element = ds["bundle_muscle"].values, ds["bundle_index"].values
    for k, muscle in enumerate(ds["muscle"].values):
        mine = element[owner == k]
        if len(mine) == 0:
            raise FaceError(
                f"muscle {muscle} owns no element: expected at least one, try a larger radius or "
                "check its fibres"
            )
        values, counts = np.unique(mine, return_counts=True)
        if (counts > 1).any():
            raise FaceError(
                f"muscle {muscle} lists element {ds['element_id'].values[values[counts > 1][0]]} "
                "twice, expected once"
            )


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _f(values: Floats) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)


def _i(values: object) -> NDArray[np.int32]:
    return np.ascontiguousarray(values, dtype=np.int32)
