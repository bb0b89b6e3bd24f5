"""Names of the parts of a face, and access to them in the Dataset."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError

Floats = NDArray[np.float64]
Integers = NDArray[np.integer]

FACE_FRAME: Final = "x lateral (+x is the subject's right), y anterior, z superior; metres"
FREE, MANDIBLE, SKULL = 0, 1, 2  #: values of `fixed`
INNER, CENTRE, OUTER = 0, 1, 2  #: values of `layer`
LIPS: Final = ("upper", "lower")


@dataclass(frozen=True)
class Fibre:
    """One polyline of a muscle: name of the muscle with side, points (k, 3) [m].

    Of a tongue, `node` (k,) are the nodes at the points, -1 of points outside the mesh or inside an
    element, and points outside the mesh lie on the `body`.
    """

    muscle: str
    position: Floats
    node: Integers | None = None
    body: str | None = None


@dataclass(frozen=True)
class Bundle:
    """Elements of one muscle: 0-based `element` (k,), unit `direction` (k, 3).

    `weight` (k,) is the fraction of each element filled by the muscle [1]; None is 1.
    """

    muscle: str
    element: Integers
    direction: Floats
    weight: Floats | None = None


@dataclass(frozen=True)
class Arch:
    """Rigid triangulated surface: bone that carries it, points (n, 3) [m], triangles (m, 3).

    `bone` is MANDIBLE or SKULL.
    """

    bone: int
    points: Floats
    triangles: Integers


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
    """Fraction of each element of `elements_of` filled by the muscle, shape (k,) [1]."""
    mine = ds["bundle_muscle"].values == _muscle_index(ds, muscle)
    if "bundle_weight" not in ds:
        return np.ones(int(mine.sum()))
    return ds["bundle_weight"].values[mine]


def surface_names(ds: xr.Dataset) -> list[str]:
    """Names of the parts of the boundary of a face."""
    return [str(name) for name in ds["surface"].values] if "surface" in ds.coords else []


def facets_of(ds: xr.Dataset, surface: str) -> NDArray[np.integer]:
    """Nodes (facets, 4), outward, of a named part of the boundary, such as `upper_lip_inner`.

    Raises DataError if the face has no such part.
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
