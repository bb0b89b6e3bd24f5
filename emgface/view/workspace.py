"""Workspace of the live face: a folder with curves, view and notes, bound to its data by digest."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

from emgface.errors import DataError, EmgfaceError
from emgface.files import is_part, write_text
from emgface.recordings.dataset import source_digest
from emgface.texts import read_text, read_toml
from emgface.view.curves import Curves, curves_from, read_curves, write_curves
from emgface.view.server import Answer

VERSION: Final = 1
RECIPE, CURVES_FILE, NOTES = "workspace.toml", "curves.csv", "notes.md"
"""Files of a workspace; no other file of the folder is read or written."""
VIEW: Final = {"yaw": 720.0, "pitch": 90.0, "zoom": 10.0}
"""Numbers of a view, with their largest absolute values."""
LONGEST_NOTES: Final = 100_000  #: largest number of characters of the notes


@dataclass
class Workspace:
    """Folder of a session.

    `digests` are the SHA-256 of the files that the session uses, by role (face, reduced, recording). A
    folder that was made with other files is refused. The folder contains no paths, so that it can be
    moved; the files are named when it is opened.
    """

    folder: Path
    digests: Mapping[str, str]
    muscles: Sequence[str]
    curves: Curves | None = None
    view: dict[str, float] = field(default_factory=dict[str, float])
    notes: str = ""

    @classmethod
    def open(
        cls, folder: Path, files: Mapping[str, Path | None], muscles: Sequence[str]
    ) -> "Workspace":
        """Open a workspace, or begin one in a new or empty folder.

        Raises
        ------
        DataError
            The folder contains other files only, its data differ, or a file of it is a link or is not
            valid.
        """
        digests = {role: _digest(path, role) for role, path in files.items() if path is not None}
        made = cls(folder, digests, muscles)
        for name in (RECIPE, CURVES_FILE, NOTES):
            if (folder / name).is_symlink():
                raise DataError(
                    f"{folder / name} is a link, expected a file: links are not followed, "
                    "copy the file into it"
                )
        if not (folder / RECIPE).exists():
            if folder.exists() and not (folder.is_dir() and all(map(is_part, folder.iterdir()))):
                raise DataError(
                    f"{folder} contains no {RECIPE}, expected a workspace or a new or empty folder"
                )
            folder.mkdir(parents=True, exist_ok=True)
            made._write()
            return made
        made._read()
        return made

    def _read(self) -> None:
        path = self.folder / RECIPE
        recipe = read_toml(path)
        if unknown := sorted(set(recipe) - {"version", "data", "view"}):
            raise DataError(f"{path} contains {unknown[0][:60]!r}, expected version, data and view")
        if recipe.get("version") != VERSION:
            raise DataError(
                f"{path} has version {str(recipe.get('version'))[:20]}, expected {VERSION}"
            )
        data = recipe.get("data")
        known = data if isinstance(data, dict) else {}
        for role in sorted({*known, *self.digests}):
            if known.get(role) != self.digests.get(role):
                given = "another one was given" if role in self.digests else "none was given"
                state = "was made with a file" if role in known else "was made without a file"
                raise DataError(
                    f"{self.folder} {state} for {role[:40]!r} (digest {str(known.get(role))[:12]}) and "
                    f"{given} ({self.digests.get(role, 'none')[:12]}): open it with its own files, or "
                    "begin another workspace"
                )
        self.view = _view(recipe.get("view", {}), str(path))
        if (self.folder / CURVES_FILE).exists():
            self.curves = read_curves(self.folder / CURVES_FILE)
            self.curves.activation(self.muscles)
        if (self.folder / NOTES).exists():
            try:
                text = read_text(self.folder / NOTES)
            except (OSError, UnicodeDecodeError) as error:
                raise DataError(f"{self.folder / NOTES} contains no text ({error})") from error
            self.notes = _notes(text, str(self.folder / NOTES))

    def save(self, body: bytes) -> Answer:
        """Store ``curves``, ``view`` and ``notes`` of a page; answer what was written, or why not."""
        try:
            said = json.loads(body)
            said = said if isinstance(said, dict) else {}
            curves = curves_from(said.get("curves") or {}, self.muscles)
            view, notes = (
                _view(said.get("view"), "the message"),
                _notes(said.get("notes"), "the message"),
            )
            self.curves, self.view, self.notes = curves, view, notes
            self._write()
            answer = {"wrote": self.folder.name}
        except (EmgfaceError, ValueError, RecursionError, AttributeError) as error:
            answer = {"why": str(error)[:300]}
        return Answer(json.dumps(answer).encode(), "application/json")

    def _write(self) -> None:
        lines = [f"version = {VERSION}", "", "[data]"]
        lines += [f'{role} = "{digest}"' for role, digest in self.digests.items()]
        if self.view:
            lines += ["", "[view]", *(f"{name} = {value!r}" for name, value in self.view.items())]
        write_text(self.folder / RECIPE, "\n".join(lines) + "\n")
        if self.curves is not None:
            write_curves(self.curves, self.folder / CURVES_FILE)
        write_text(self.folder / NOTES, self.notes)


def _view(given: Any, where: str) -> dict[str, float]:
    if not isinstance(given, dict) or not set(given) <= set(VIEW):
        raise DataError(f"{where} contains no view of {', '.join(VIEW)}")
    for name, value in given.items():
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value) or abs(value) > VIEW[name]:
            raise DataError(
                f"{name} of {where} is {str(value)[:20]}, expected at most {VIEW[name]:g}"
            )
    return {name: float(value) for name, value in given.items()}


def _notes(given: Any, where: str) -> str:
    if not isinstance(given, str) or len(given) > LONGEST_NOTES:
        raise DataError(f"the notes of {where} are no text of at most {LONGEST_NOTES} characters")
    try:
        given.encode("utf-8")
    except UnicodeEncodeError as error:
        raise DataError(f"the notes of {where} contain no valid character ({error})") from error
    return given


def _digest(path: Path, role: str) -> str:
    try:
        if role == "recording":
            return source_digest(path)
        if path.is_dir():
            files = sorted(p for p in path.iterdir() if p.is_file())
            parts = [f"{p.name} {sha256(p.read_bytes()).hexdigest()}" for p in files]
            return sha256("\n".join(parts).encode()).hexdigest()
        return sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise DataError(
            f"{path} cannot be read ({error}), expected a file of the workspace"
        ) from error
