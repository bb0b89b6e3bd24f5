"""Way points of a motion: complete states at equal times, from which other motions branch."""

import tomllib
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Final

import sim
from emgface.errors import ConfigurationError, DataError
from emgface.files import is_part, replace_file, write_text

INDEX: Final = "waypoints.toml"
"""File that lists the way points of a folder with their times, digests and interval."""


@dataclass(frozen=True)
class WayPoints:
    """Folder of the states of a motion every `every` seconds, without its start and its end.

    A motion with way points forgets the memory of its solver at each of them. A motion that branches
    from one with the same activation is therefore bitwise identical to it.
    """

    folder: Path
    every: float

    def outputs(self, output: float) -> int:
        """Number of outputs [s] between way points; ConfigurationError if it is not whole."""
        count = round(self.every / output)
        if count < 1 or abs(count * output - self.every) > 1e-9:
            raise ConfigurationError(
                f"way points every {self.every:g} s do not fit outputs every {output:g} s, expected a "
                "whole multiple"
            )
        return count

    def clear(self) -> None:
        """Begin anew; ConfigurationError if the folder contains anything but way points."""
        self.folder.mkdir(parents=True, exist_ok=True)
        known = {INDEX, *(path.name for path in self.folder.glob("[0-9]*.[0-9]*.nc"))}
        every = [path for path in self.folder.iterdir() if not is_part(path)]
        if foreign := sorted(path.name for path in every if path.name not in known):
            raise ConfigurationError(
                f"{self.folder} contains {foreign[0]}, expected a new or empty folder for way points"
            )
        for name in known:
            (self.folder / name).unlink(missing_ok=True)
        write_text(self.folder / INDEX, f"every = {self.every!r}  # s\n")

    def keep(self, state: sim.State) -> None:
        """Write the state at a checkpoint."""
        path = self.folder / f"{state.t:.6f}.nc"
        replace_file(path, lambda part: sim.save_state(state, part))
        index = self.folder / INDEX
        entry = f'\n[[points]]\ntime = {state.t!r}\ndigest = "{_digest(path)}"\n'
        write_text(index, index.read_text(encoding="utf-8") + entry)


@dataclass(frozen=True)
class Branch:
    """State of a way point, from which a motion starts, its digest, and its folder."""

    state: sim.State
    digest: str
    points: WayPoints

    def require_use(self, written: WayPoints | None, duration: float) -> None:
        """ConfigurationError if a motion of a duration [s] would end before, or replaces this folder."""
        if self.state.t >= duration:
            raise ConfigurationError(
                f"the motion branches at {self.state.t:g} s, expected a way point before its end at "
                f"{duration:g} s: choose an earlier one, or a longer activation"
            )
        folder = self.points.folder
        if written is not None and written.folder.resolve() == folder.resolve():
            raise ConfigurationError(
                f"{folder} is the folder of the way point at which the motion begins, expected another "
                "one for its own way points, which would replace it"
            )

    @classmethod
    def from_folder(cls, folder: Path, at: float) -> "Branch":
        """Read the way point at a time [s].

        Raises
        ------
        DataError
            The folder has no list of way points or none at this time, or its file is not the one
            that was written.
        """
        path = folder / INDEX
        try:
            index = tomllib.loads(path.read_text(encoding="utf-8"))
            every = float(index["every"])
            points = {float(p["time"]): str(p["digest"]) for p in index.get("points", [])}
        except (
            OSError,
            UnicodeDecodeError,
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
        ) as error:
            raise DataError(
                f"{path} contains no list of way points ({type(error).__name__}), expected a folder of "
                "'simulate --waypoints'"
            ) from error
        near = [t for t in points if abs(t - at) < 1e-6]
        if not near:
            known = ", ".join(f"{t:g}" for t in sorted(points)) or "none"
            raise DataError(f"{folder} has no way point at {at:g} s, expected one of {known}")
        file = folder / f"{near[0]:.6f}.nc"
        if not file.is_file() or _digest(file) != points[near[0]]:
            raise DataError(
                f"{file} is not the way point that was written (digest {points[near[0]][:12]}): "
                "simulate again with --waypoints"
            )
        return cls(sim.read_state(file), points[near[0]], WayPoints(folder, every))


def _digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()
