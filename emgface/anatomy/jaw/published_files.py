"""Files of the published jaw model: lists, landmarks and surfaces."""

import shlex
from pathlib import Path

import numpy as np

from emgface.anatomy.jaw.exciters import Groups
from emgface.anatomy.jaw.model import Floats
from emgface.errors import JawError
from emgface.texts import read_text

MM_TO_FRAME = np.array([-1e-3, -1e-3, 1e-3])
"""From millimetres in the frame of the files to metres in that of the package."""


class PublishedJawFiles:
    """Files of the published model."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._surfaces: dict[str, tuple[Floats, np.ndarray]] = {}
        if not (folder / "muscleInfo.txt").is_file():
            raise JawError(
                f"{folder} contains no muscleInfo.txt: expected the data folder of the published jaw"
            )

    def lines(self, name: str) -> list[list[str]]:
        """Words of the lines that are not disabled."""
        try:
            text = read_text(self.folder / name)
        except (OSError, UnicodeDecodeError) as error:
            raise JawError(f"{self.folder / name} cannot be read: {error}") from error
        rows = (line.strip() for line in text.splitlines())
        return [shlex.split(row) for row in rows if row and not row.startswith("#")]

    def landmarks(self, name: str) -> Floats:
        """Landmarks (n, 3) in the frame of the package [m]."""
        path = self.folder / "landmarks" / f"{name}.landmarkAscii"
        try:
            text = read_text(path).rsplit("@1", 1)[1]
            cm = np.array(
                [[float(x) for x in row.split()] for row in text.split("\n") if row.strip()]
            )
            return cm.reshape(-1, 3) * 10.0 * MM_TO_FRAME
        except (OSError, IndexError, ValueError) as error:
            raise JawError(
                f"{path} contains no landmarks ({error}), expected x y z after @1"
            ) from error

    def surface(self, name: str) -> tuple[Floats, np.ndarray]:
        """Vertices [m] and triangles of an OBJ file."""
        rows = [row.split() for row in read_text(self.folder / name).splitlines()]
        X = np.array([row[1:4] for row in rows if row[:1] == ["v"]], dtype=np.float64) * MM_TO_FRAME
        faces = [[int(x.split("/")[0]) - 1 for x in row[1:]] for row in rows if row[:1] == ["f"]]
        triangles = [(f[0], f[i], f[i + 1]) for f in faces for i in range(1, len(f) - 1)]
        self._surfaces[name] = X, np.array(triangles, dtype=np.int64)
        return self._surfaces[name]

    def groups(self) -> Groups:
        """Muscles or groups by the name of a group."""
        return {row[0]: tuple(row[2:]) for row in self.lines("muscleGroupsInfo.txt")}
