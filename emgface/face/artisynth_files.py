"""Locations of the files of the published reference face, with a record of those read."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from emgface.errors import FaceError

_PLACES: Final = (
    ".",
    "face_reference",
    "src/artisynth/models/face/geometry/refmodel",
    "src/artisynth/models/face/geometry",
    "face/geometry/refmodel",
    "face/geometry",
)


class PublishedFiles:
    """Locator of the files of the model in the known layouts, with a record of those used."""

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise FaceError(
                f"no folder {folder}: expected a checkout of artisynth_models or its files"
            )
        self._places = [folder / place for place in _PLACES]
        if folder.resolve().name == "refmodel":
            self._places.append(folder.resolve().parent)
        self._used: dict[str, Path] = {}

    def __getitem__(self, name: str) -> Path:
        """Path of a required file; FaceError with the folders searched if it is absent."""
        for place in self._places:
            if (place / name).is_file():
                self._used[name] = place / name
                return place / name
        sought = ", ".join(str(place) for place in self._places if place.is_dir())
        raise FaceError(
            f"{name} of the reference face not found in {sought}: specify a complete checkout"
            " of artisynth_models or the folder that contains face_reference"
        )

    def optional_files(self, names: Sequence[str]) -> list[Path] | None:
        """Paths of optional files: all, or None; FaceError if some are present and others not."""
        there = [any((place / name).is_file() for place in self._places) for name in names]
        return [self[name] for name in names] if any(there) else None

    def digest(self) -> str:
        """SHA-256 over names and contents of the files used."""
        total = hashlib.sha256()
        for name in sorted(self._used):
            total.update(name.encode())
            total.update(hashlib.sha256(self._used[name].read_bytes()).digest())
        return total.hexdigest()
