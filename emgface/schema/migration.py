"""Conversion of datasets of older versions of a declaration to the present one."""

import json
from collections.abc import Callable, Mapping
from typing import Any, Final

import xarray as xr

from emgface.errors import SchemaError

Migration = Callable[[xr.Dataset], xr.Dataset]


def _cube_1_to_2(cube: xr.Dataset) -> xr.Dataset:
    """Version 2 distinguishes excluded trials and describes its statuses."""
    status = cube["status"].assign_attrs(long_name="ok, missing, excluded, or failed")
    return cube.assign(status=status)


BEFORE_RENEWALS: Final = {"simulation": {"contact": {"renewals": 0}}}
"""Values in effect where the configuration of a study lacks the names, which is complete otherwise."""


def _cube_2_to_3(cube: xr.Dataset) -> xr.Dataset:
    """Version 3 renews the rows of contact by default; earlier studies ran without, if unspecified."""
    text = cube.attrs.get("configuration")
    if text is None:
        return cube
    whole = _completed(json.loads(str(text)), BEFORE_RENEWALS)
    return cube.assign_attrs(configuration=json.dumps(whole))


def _completed(values: Mapping[str, Any], absent: Mapping[str, Any]) -> dict[str, Any]:
    """Nested values with those of `absent` where they lack a name; tables that they lack stay absent."""
    own = dict(values)
    for name, value in absent.items():
        if not isinstance(value, Mapping):
            own.setdefault(name, value)
        elif isinstance(own.get(name), Mapping):
            own[name] = _completed(own[name], value)
    return own


def _trajectory_1_to_2(trajectory: xr.Dataset) -> xr.Dataset:
    """Version 1 contained the unsigned distance of the lips, which cannot be converted."""
    return trajectory.drop_vars("lip_opening", errors="ignore")


MIGRATIONS: Final[Mapping[tuple[str, int], Migration]] = {
    ("cube", 1): _cube_1_to_2,
    ("cube", 2): _cube_2_to_3,
    ("trajectory", 1): _trajectory_1_to_2,
}
"""Conversion to the next version, by kind and version."""


def migrate(
    dataset: xr.Dataset,
    kind: str,
    version: int,
    *,
    migrations: Mapping[tuple[str, int], Migration] = MIGRATIONS,
) -> xr.Dataset:
    """Convert a dataset to a version of its declaration, one version after the other.

    Without the attribute ``schema_version`` the present version is assumed; otherwise the result is
    a copy, whose attribute ``migrated_from`` is the version in which it was written. Raises
    SchemaError if the version is newer, is not a number, or cannot be converted.
    """
    stored = dataset.attrs.get("schema_version", version)
    if stored == version:
        return dataset
    try:
        at = int(stored)
    except (TypeError, ValueError):
        at = -1
    if at > version:
        raise SchemaError(
            f"The {kind} follows version {stored} of its schema, which this package does not "
            f"support; expected version {version} or older: install a newer package, or "
            "write it again."
        )
    result = dataset
    for step in range(max(at, 0), version):
        if at < 1 or (kind, step) not in migrations:
            raise SchemaError(
                f"The {kind} follows version {stored} of its schema, which cannot be "
                f"migrated; expected version {version}: write it again with this version of "
                "the package."
            )
        result = migrations[kind, step](result)
    return result.assign_attrs(schema_version=version, migrated_from=at)
