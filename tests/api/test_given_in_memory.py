"""Datasets passed in memory: what xarray, dask and users make of them, walked over all kinds."""

import copy
import pickle

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import emgface as ef
from emgface.errors import DataError, SchemaError, UnitsError
from emgface.face.measured import check_motion
from emgface.recordings.belonging import of_recording
from emgface.schema.in_memory import usable
from emgface.schema.validation import declaration

SECONDS = {"units": "s"}
KINDS = ("recording", "activation", "trajectory")


def made(kind: str, count: int = 6) -> xr.Dataset:
    """Dataset with every required or alternative array of a kind, in the canonical order."""
    declared = declaration(kind)
    sizes: dict[str, int] = {}
    arrays = declared.arrays()
    wanted = [n for n, a in declared.variables.items() if a.required or n in declared.any_of]
    rng = np.random.default_rng(1)
    coords, variables = {}, {}
    for name in wanted:
        for dim in arrays[name].dims:
            own = arrays[dim]
            labels = list(own.names or ()) if own.complete else [f"{dim}{k}" for k in range(count)]
            values = 0.01 * np.arange(count) if own.units == "s" else labels
            sizes[dim] = len(values)
            coords[dim] = (dim, values, SECONDS if own.units == "s" else {})
        shape = tuple(sizes[dim] for dim in arrays[name].dims)
        units = {} if arrays[name].units is None else {"units": arrays[name].units}
        variables[name] = (arrays[name].dims, rng.uniform(size=shape), units)
    return xr.Dataset(variables, coords, {"origin": "simulated"})


def first(kind: str) -> str:
    return next(iter(made(kind).data_vars))


def clocks(given: xr.Dataset) -> list[str]:
    return [str(dim) for dim in given.dims if str(dim).startswith("time")]


def changed(given: xr.Dataset, **numbers) -> xr.Dataset:
    return given.map(lambda array: array.astype(**numbers), keep_attrs=True)


SAME = {
    "transposed": lambda x: x.transpose(*reversed(list(x.dims))),
    "dask": lambda x: x.chunk({name: 2 for name in clocks(x)}),
    "durations": lambda x: x.assign_coords(
        {name: pd.to_timedelta(x[name].values, unit="s") for name in clocks(x)}
    ),
    "axes in another order": lambda x: x.isel(axis=[2, 0, 1]) if "axis" in x.dims else x,
    "pickled": lambda x: pickle.loads(pickle.dumps(x)),
    "deep copy": copy.deepcopy,
    "big endian": lambda x: changed(x, dtype=">f8"),
    "Fortran order": lambda x: x.map(lambda a: a.copy(data=np.asfortranarray(a)), keep_attrs=True),
    "object labels": lambda x: x.assign_coords(
        {n: x[n].astype(object) for n in x.coords if x[n].dtype.kind == "U"}
    ),
    "without units of time": lambda x: x.assign_coords({n: (n, x[n].values) for n in clocks(x)}),
}
"""Changes of a dataset that do not change what it states."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", list(SAME))
def test_what_has_one_meaning_is_converted(kind: str, change: str) -> None:
    given = made(kind)
    converted = usable(SAME[change](given), kind)
    for name in given.data_vars:
        assert converted[name].dims == given[name].dims
        np.testing.assert_allclose(
            converted[name].sel(
                {d: given[d].values for d in given[name].dims if given[d].dtype.kind == "U"}
            ).values,
            given[name].values,
        )  # fmt: skip
        assert isinstance(converted[name].data, np.ndarray)
    for name in clocks(given):
        np.testing.assert_allclose(converted[name].values.astype(float), given[name].values)


def test_a_recording_is_checked_in_any_order_of_its_dims() -> None:
    """Rows were taken for channels: the check ended with a ValueError."""
    given = made("recording", 40)
    turned = given.map(lambda array: array.transpose(*reversed(array.dims)))
    for table, other in zip(ef.check(given).values(), ef.check(turned).values(), strict=True):
        pd.testing.assert_frame_equal(table, other)


def assigned(given: xr.Dataset, name: str, **attrs) -> xr.Dataset:
    return given.assign({name: given[name].assign_attrs(attrs)})


REFUSED = {
    "another unit": (lambda x, n: assigned(x, n, units="furlong"), UnitsError, "furlong"),
    "times in ms": (
        lambda x, n: x.assign_coords({c: (c, x[c].values, {"units": "ms"}) for c in clocks(x)}),
        UnitsError, "'ms'",
    ),
    "dates": (
        lambda x, n: x.assign_coords({c: pd.Timestamp("2026") + pd.to_timedelta(x[c], unit="s")
                                      for c in clocks(x)}),
        SchemaError, "dates",
    ),
    "complex": (lambda x, n: changed(x, dtype=complex), SchemaError, "expected numbers"),
    "texts": (lambda x, n: changed(x, dtype=str), SchemaError, "expected numbers"),
    "objects": (lambda x, n: changed(x, dtype=object), SchemaError, "expected numbers"),
    "a further dim": (lambda x, n: x.expand_dims("trial"), SchemaError, "dims"),
    "a lost dim": (lambda x, n: x.isel({clocks(x)[0]: 0}, drop=True), SchemaError, "dims"),
    "no instants": (lambda x, n: x.isel({clocks(x)[0]: slice(0)}), SchemaError, "no instant"),
    "no times": (lambda x, n: x.drop_vars(clocks(x)), SchemaError, "no coordinate"),
    "a name twice": (
        lambda x, n: x.isel({d: [0, *range(x.sizes[d])] for d in x[n].dims[:1]}),
        SchemaError, "more than once",
    ),
}  # fmt: skip
"""Changes that leave a dataset without one meaning, the error, and what it states."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("change", list(REFUSED))
def test_what_has_no_meaning_is_refused(kind: str, change: str) -> None:
    made_of, error, said = REFUSED[change]
    with pytest.raises(error, match=said):
        usable(made_of(made(kind), first(kind)), kind)


@pytest.mark.parametrize(("kind", "name"), [("recording", "emg"), ("trajectory", "position")])
def test_a_quantity_without_its_unit_is_refused(kind: str, name: str) -> None:
    """Arithmetic of xarray removes the unit, and the size with it."""
    given = made(kind)
    given[name].attrs.pop("units")
    with pytest.raises(UnitsError, match="has no unit"):
        usable(given, kind)


def test_axes_without_names_are_refused() -> None:
    with pytest.raises(SchemaError, match="without names"):
        usable(made("trajectory").drop_vars("axis"), "trajectory")


def test_the_given_dataset_is_not_changed() -> None:
    given = made("recording").chunk()
    usable(given, "recording")
    assert given["emg"].chunks is not None


def test_callable_packages_can_be_sent_to_another_process() -> None:
    assert pickle.loads(pickle.dumps(ef.face)) is ef.face
    assert pickle.loads(pickle.dumps(ef.study)) is ef.study


def face_and_motion() -> tuple[xr.Dataset, xr.Dataset]:
    from emgface.muscles import LIP_MARKERS

    place = np.array([
        [0.03 * ("right" in m) - 0.015 + 0.005 * ("paramedian" in m) * (1 - 2 * ("right" in m)),
         0.1, 0.01 * (("upper" in m) - ("lower" in m))] for m in LIP_MARKERS
    ])  # fmt: skip
    names = ("marker", list(LIP_MARKERS))
    face = xr.Dataset(
        {"position": (("node", "axis"), place), "marker_node": ("marker", np.arange(len(place)))},
        {"marker": names},
    )
    moving = np.repeat(place[:, :, None], 3, axis=2)
    motion = xr.Dataset(
        {"position": (("marker", "axis", "time"), moving)},
        {"marker": names, "axis": ["x", "y", "z"], "time": [0.0, 0.1, 0.2]},
    )
    return face, motion


def test_the_lips_of_a_motion_have_the_size_and_the_sides_of_their_face() -> None:
    """Millimetres taken for metres left rho as it was, and the amplitude ratio 1000 times too large."""
    face, motion = face_and_motion()
    check_motion(motion, face)
    for factor in (1e3, 1e-3, 2.1):
        with pytest.raises(UnitsError, match="of the motion"):
            check_motion(motion.assign(position=factor * motion["position"]), face)
    names = [str(m) for m in motion["marker"].values]
    for one, other in (("left", "right"), ("upper", "lower")):
        swapped = [n.replace(one, "?").replace(other, one).replace("?", other) for n in names]
        with pytest.raises(DataError, match="exchange the two names in the motion"):
            check_motion(motion.assign_coords(marker=swapped), face)


@pytest.mark.parametrize(("own", "same"), [(1, True), ("01", True), (1.0, True), ("1", True),
                                           (2, False), ("1a", False), (np.int64(1), True)])  # fmt: skip
def test_repetitions_are_compared_as_numbers(own, same) -> None:
    findings = of_recording(
        {"repetition": 1, "volunteer": "V1"}, {"repetition": own, "volunteer": "V1"}
    )
    assert (not findings) is same
    assert of_recording({"volunteer": "V1"}, {"volunteer": "v1"})
