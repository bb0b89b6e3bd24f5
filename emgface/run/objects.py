"""Copies of stored results in object storage, of any protocol that fsspec knows, such as s3.

A result is an object, and its index is another one that is written last, so that a result without
index does not exist. Objects are called by the digest of their content: of several writers of one
result, the index of the last is valid, and so is the object that it names. Trajectories are written
as zarr, in chunks that are compressed without loss, other results as netCDF files.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import xarray as xr

from emgface.errors import ConfigurationError, DataError, StoreError
from emgface.files import replace_file
from emgface.run.digest import dataset_digest, file_digest

ZARR_FORMAT = 2
"""Version of zarr whose texts have a fixed length, so that every reader of zarr knows them."""


class Objects:
    """Folder of an object storage, such as ``s3://bucket/folder``, with the results of studies.

    Credentials and address of the service are those of the protocol, such as the variables
    AWS_ACCESS_KEY_ID and AWS_ENDPOINT_URL of s3. Raises ConfigurationError if the protocol is unknown
    or not installed, and StoreError if the storage cannot be reached.
    """

    def __init__(self, url: str) -> None:
        try:
            import zarr  # noqa: F401  # used by xarray
            from fsspec.core import url_to_fs
            from fsspec.utils import get_protocol
        except ImportError as error:
            package = str(error.name).partition(".")[0]
            raise ConfigurationError(
                f"object storage requires the package {package}, which is not installed: install "
                "'emgface[objects]', or use --store without --objects"
            ) from error
        self.url = url.rstrip("/")
        try:
            with _reached(self.url):
                local = get_protocol(self.url) in ("file", "local")
                options = {"auto_mkdir": True} if local else {}  # others have no folders
                self._files, self._root = url_to_fs(self.url, **options)
                self._files.exists(self._root)
        except (ImportError, ValueError) as error:
            raise ConfigurationError(
                f"{url} cannot be used ({error}), expected the address of a folder such as "
                "s3://bucket/folder, and its protocol installed (s3fs for s3)"
            ) from error

    def fetch(self, path: Path) -> str | None:
        """Copy a result to its file `path` and return its index as text; None if it is absent.

        Raises DataError if the object is damaged, StoreError if the storage cannot be read.
        """
        stage, digest = path.parent.name, path.stem
        with _reached(self.url):
            try:
                text = self._files.cat_file(f"{self._root}/{stage}/{digest}.json")
            except FileNotFoundError:
                return None
        try:
            index = json.loads(text)
            name, content = str(index["object"]), str(index["content"])
        except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
            raise DataError(f"has an index in {self.url} that cannot be read") from error
        path.parent.mkdir(parents=True, exist_ok=True)
        read = self._read_chunks if name.endswith(".zarr") else self._read_file
        try:
            stored = read(f"{stage}/{digest}/{name}", path)
        except (DataError, OSError, ValueError, KeyError, RuntimeError) as error:
            with _reached(self.url):  # a storage that answers has a damaged object
                self._files.exists(f"{self._root}/{stage}")
            raise DataError(f"has an object in {self.url} that cannot be read ({error})") from error
        if stored != content:
            path.unlink(missing_ok=True)
            raise DataError(f"has an object in {self.url} that differs from the written result")
        local = {key: value for key, value in index.items() if key not in ("object", "content")}
        local |= {"bytes": path.stat().st_size, "sha256": file_digest(path)}
        return json.dumps(local, indent=2) + "\n"

    def publish(self, path: Path) -> None:
        """Copy the stored file `path` and its index.

        Raises StoreError if the storage cannot be written.
        """
        index = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        folder = f"{path.parent.name}/{path.stem}"
        dataset = xr.load_dataset(path, engine="netcdf4", decode_times=False).drop_encoding()
        moving = is_trajectory(dataset)
        content = dataset_digest(dataset) if moving else str(index["sha256"])
        name = f"{content}.{'zarr' if moving else 'nc'}"
        with _reached(self.url):
            if moving:
                texts = [n for n, v in dataset.variables.items() if v.dtype.kind in "OT"]
                fixed = dataset.assign({n: dataset[n].astype(str) for n in texts})
                fixed.to_zarr(self._chunks(f"{folder}/{name}"), mode="w", zarr_format=ZARR_FORMAT)
            else:
                self._files.put_file(str(path), f"{self._root}/{folder}/{name}")
            text = json.dumps(index | {"object": name, "content": content}, indent=2)
            self._files.pipe_file(f"{self._root}/{folder}.json", text.encode())

    def add_missing(self, store: Path) -> int:
        """Copy the complete results of a store that the storage lacks; return their number.

        These are results of runs without object storage. Errors as of `publish`.
        """
        with _reached(self.url):
            there = {name.rsplit("/", 1)[-1] for name in self._files.find(self._root)}
        lacking = [
            index.with_suffix(".nc")
            for index in sorted(store.glob("*/*.json"))
            if index.name not in there and index.with_suffix(".nc").is_file()
        ]
        for path in lacking:
            self.publish(path)
        return len(lacking)

    def _chunks(self, name: str) -> Any:
        return self._files.get_mapper(f"{self._root}/{name}")

    def _read_file(self, name: str, path: Path) -> str:
        replace_file(path, lambda own: self._files.get_file(f"{self._root}/{name}", str(own)))
        return file_digest(path)

    def _read_chunks(self, name: str, path: Path) -> str:
        with xr.open_zarr(self._chunks(name), chunks=None, decode_times=False) as opened:
            dataset = opened.load().drop_encoding()
        replace_file(path, lambda own: dataset.to_netcdf(own, engine="netcdf4"))
        return dataset_digest(dataset)


def is_trajectory(dataset: xr.Dataset) -> bool:
    """Return True if a dataset holds positions over time."""
    return any(
        "axis" in variable.dims and {"time", "frame"} & set(variable.dims)
        for variable in dataset.data_vars.values()
    )


@contextmanager
def _reached(url: str) -> Iterator[None]:
    """Report the failure of a storage as one sentence; every protocol has errors of its own."""
    try:
        yield
    except (ImportError, ValueError):
        raise
    except Exception as error:
        raise StoreError(
            f"{url} cannot be used ({type(error).__name__}: {error}), expected a storage that can be "
            "reached, read and written: check address, credentials and connection, and run the same "
            "command again"
        ) from error
