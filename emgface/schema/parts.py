"""Writing of a dataset part by part, so that it is never in memory as a whole."""

from collections.abc import Callable, Iterable, Mapping
from itertools import chain
from pathlib import Path
from typing import Any, Final

import netCDF4
import xarray as xr

from emgface.errors import SchemaError
from emgface.files import replace_file
from emgface.schema.netcdf import ready_to_write, write_netcdf

CACHE: Final = 2**16
"""Cache of each variable [bytes]; by default all of up to 64 MB would remain in memory."""


def write_netcdf_parts(
    parts: Iterable[xr.Dataset],
    path: Path,
    kind: str,
    dim: str,
    attrs: Callable[[], Mapping[str, Any]],
) -> Path:
    """Check the parts of a dataset along `dim`, write them one after another and return the path.

    `attrs` returns the attributes of the whole; it is called after the last part. The file is that
    of `emgface.schema.netcdf.write_netcdf` except that, with several parts, `dim` is unlimited and
    the chunks have the size of the first part. An existing file is replaced when the new one is
    complete. Raises SchemaError if a part does not fulfil the declaration of `kind` or has other
    variables than the first, and DataError if the file cannot be written.
    """
    given = iter(parts)
    first = next(given)
    second = next(given, None)
    if second is None:
        return write_netcdf(first.assign_attrs(attrs()), path, kind)

    def write(target: Path) -> None:
        ready, encoding = ready_to_write(first, kind)
        for name, variable in ready.variables.items():
            if dim in variable.dims:
                encoding.setdefault(name, {})["chunksizes"] = variable.shape
        ready.to_netcdf(target, engine="netcdf4", encoding=encoding, unlimited_dims=[dim])
        start = first.sizes[dim]
        with netCDF4.Dataset(target, "a") as opened:
            opened.set_auto_maskandscale(False)
            for variable in opened.variables.values():
                variable.set_var_chunk_cache(size=CACHE)
            for part in chain([second], given):
                own, _ = ready_to_write(part, kind)
                if set(own.variables) != set(ready.variables):
                    odd = ", ".join(sorted(map(str, set(own.variables) ^ set(ready.variables))))
                    raise SchemaError(f"parts of {path.name} differ in {odd}, expected the same")
                _append(opened, own, dim, start)
                start += part.sizes[dim]
            whole, _ = ready_to_write(first.assign_attrs(attrs()), kind)
            opened.setncatts(whole.attrs)

    replace_file(path, write)
    return path


def _append(opened: netCDF4.Dataset, part: xr.Dataset, dim: str, start: int) -> None:
    """Write the variables of a part behind those before it."""
    place = slice(start, start + part.sizes[dim])
    for name, variable in part.variables.items():
        if dim in variable.dims:
            values = variable.values
            values = values.astype(object) if values.dtype.kind == "U" else values
            opened[str(name)][tuple(place if d == dim else slice(None) for d in variable.dims)] = (
                values
            )
