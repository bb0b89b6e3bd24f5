"""Unfinished fits of recordings, kept in a file next to the result so that the next run continues."""

import hashlib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from emgface.files import replace_file
from emgface.inverse.refine import Begun
from sim.state import Array


@dataclass(frozen=True)
class Kept:
    """File with the state of a fit; states of other inputs, and damaged files, are ignored."""

    path: Path

    @classmethod
    def for_result(cls, result: Path) -> "Kept":
        """File of an unfinished result, hidden in its folder."""
        return cls(result.with_name(f".{result.name}.unfinished.npz"))

    def read(self, inputs: str) -> Begun | None:
        """State that was kept for these inputs."""
        try:
            with np.load(self.path, allow_pickle=False) as file:
                if str(file["inputs"]) != inputs:
                    return None
                error = float(file["model_error"])
                coefficients = np.asarray(file["coefficients"], dtype=np.float64)
                return Begun(coefficients, int(file["done"]), None if np.isnan(error) else error)
        except (OSError, KeyError, ValueError, EOFError, zipfile.BadZipFile):
            return None

    def write(self, inputs: str, state: Begun) -> None:
        """Replace the file; DataError if it cannot be written."""
        error = np.nan if state.model_error is None else state.model_error

        def save(path: Path) -> None:
            with path.open("wb") as stream:
                np.savez(
                    stream, inputs=np.array(inputs), coefficients=state.coefficients,
                    done=state.done, model_error=error,
                )  # fmt: skip

        replace_file(self.path, save)

    def remove(self) -> None:
        """Delete the file."""
        self.path.unlink(missing_ok=True)


def digest_of(*inputs: Array | object) -> str:
    """SHA-256 of arrays and of the representations of other inputs."""
    digest = hashlib.sha256()
    for one in inputs:
        raw = (
            np.ascontiguousarray(one).tobytes()
            if isinstance(one, np.ndarray)
            else repr(one).encode()
        )
        digest.update(raw)
    return digest.hexdigest()
