"""Cubes with further dimensions, one for each choice varied by a study."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import xarray as xr

from analysis.cube import MARKER_DIMS
from analysis.errors import CubeError
from analysis.trajectory import names
from analysis.typed import floats, selected

NOT_IN_DESIGN: Final = "not in the design: one choice is varied at a time"
"""Reason for missing trials at which several axes differ from their reference."""

Label = str | float


def combine_cubes(
    cubes: Mapping[tuple[Label, ...], xr.Dataset], axes: Mapping[str, Sequence[Label]]
) -> xr.Dataset:
    """Combine cubes of the same trials, scored with different choices, into one.

    Parameters
    ----------
    cubes : mapping of tuple of label to xarray.Dataset
        Results of `build_cube` by one label per axis.
    axes : mapping of str to sequence of label
        Labels of every axis, the reference first.

    Returns
    -------
    xarray.Dataset
        As `build_cube`, every variable with the axes before its own dims. Combinations without a
        cube are missing, with the reason `NOT_IN_DESIGN`. Attributes are those of the reference.

    Raises
    ------
    CubeError
        No axis, the name of an existing dim, unknown labels, no reference, or different trials.
    """
    first = next(iter(cubes.values()), xr.Dataset())
    taken = [name for name in axes if name in MARKER_DIMS or name in first]
    if taken or not axes:
        raise CubeError(
            f"cannot add the axes {names(taken) or 'none'}, expected names that the cube "
            "does not have"
        )
    reference = tuple(labels[0] for labels in axes.values())
    if reference not in cubes:
        raise CubeError(f"there is no cube of the reference {names(list(map(str, reference)))}")
    base = cubes[reference]
    place = [{label: k for k, label in enumerate(labels)} for labels in axes.values()]
    shape = tuple(map(len, axes.values()))
    arrays: dict[str, np.ndarray] = {}
    for name, data in base.data_vars.items():
        fill: Any = np.nan
        if data.dtype.kind not in "fiu":
            fill = {"status": "missing", "reason": NOT_IN_DESIGN}.get(str(name), "")
        kind = np.float64 if data.dtype.kind in "fiu" else object
        arrays[str(name)] = np.full((*shape, *data.shape), fill, dtype=kind)
    for labels, cube in cubes.items():
        try:
            index = tuple(known[label] for known, label in zip(place, labels, strict=True))
        except (KeyError, ValueError):
            raise CubeError(
                f"a cube is labelled {names(list(map(str, labels)))}, expected one label of each "
                f"of the axes {names([*axes])}"
            ) from None
        if any(not cube[dim].equals(base[dim]) for dim in MARKER_DIMS):
            raise CubeError(
                f"the cube of {names(list(map(str, labels)))} has other trials or markers than the "
                "reference: run the same trials under every choice"
            )
        for name, values in arrays.items():
            values[index] = cube[name].transpose(*base[name].dims).values
    result = xr.Dataset(coords={**{k: list(v) for k, v in axes.items()}, **base.coords})
    for name in axes:
        if result[name].dtype.kind in "iuf":
            result[name] = floats(result[name])
    for name, values in arrays.items():
        data = base[name]
        values = values if values.dtype != object else values.astype(str)
        result[name] = ((*axes, *data.dims), values, data.attrs)
    return result.assign_attrs(base.attrs)


def further_axes(cube: xr.Dataset) -> list[str]:
    """Return the dims of a cube beyond those of trials and markers."""
    return [str(dim) for dim in cube["rho"].dims if dim not in MARKER_DIMS]


def reference_cube(cube: xr.Dataset) -> xr.Dataset:
    """Return the trials of a cube at the reference, the first label of every further axis."""
    further = further_axes(cube)
    if not further:
        return cube
    chosen = selected(cube, {axis: cube[axis].values[0] for axis in further})
    return chosen.drop_vars(further).assign_attrs(cube.attrs)
