"""Tables and page of a study, kept in its store while cube, recordings and code are unchanged.

An unchanged report requires neither xarray nor the statistics, whose import takes seconds.
"""

import json
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from emgface.errors import DataError
from emgface.files import write_text
from emgface.run.digest import code_version, file_digest, text_digest


@dataclass(frozen=True)
class Page:
    """Written report: path, size in bytes, and notes on missing parts."""

    path: Path
    size: int
    notes: list[str] = field(default_factory=list)


class KeptReport:
    """Printed tables and page of a study that were computed from the present data.

    Each file ends with a digest of cube, recordings, code and templates. `folder` is the
    folder of the study.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._digest = folder, _digest(folder)

    def text(self) -> str | None:
        """Return the printed tables, or None if they, or the files of the tables, are not kept."""
        path, mark = self._folder / "store" / "report.txt", self._mark("text")
        if not (self._folder / "tables").is_dir() or not _ends_with(mark, path):
            return None
        return path.read_text(encoding="utf-8").removesuffix(mark)

    def keep_text(self, text: str) -> None:
        """Keep the printed tables, unless the folder of the study is read-only."""
        with suppress(DataError):
            write_text(self._folder / "store" / "report.txt", text + self._mark("text"))

    def page(self, out: Path, *, faces: bool) -> Page | None:
        """Return the page `out`, copied from the store if necessary, or None if it is not kept."""
        mark, kept = self._mark(f"page {faces}"), self._folder / "store" / "page.html"
        if not _ends_with(mark, out):
            if not _ends_with(mark, kept):
                return None
            write_text(out, kept.read_text(encoding="utf-8"))
        return Page(out, out.stat().st_size)

    def keep_page(self, text: str, *, faces: bool) -> str:
        """Keep a page, unless the folder of the study is read-only; return the page with its digest."""
        text = text.rstrip() + "\n" + self._mark(f"page {faces}")
        with suppress(DataError):
            write_text(self._folder / "store" / "page.html", text)
        return text

    def _mark(self, what: str) -> str:
        return f"<!-- {self._digest} {what} -->\n"


def study_folder(folder: Path) -> Path:
    """Return the folder of a study: the specified one, or the only one inside it with a cube."""
    if (folder / "cube.nc").is_file():
        return folder
    inside = [path.parent for path in folder.glob("*/cube.nc")]
    return inside[0] if len(inside) == 1 else folder


def _ends_with(mark: str, path: Path) -> bool:
    """Test if a file ends with the digest of its origin."""
    return path.is_file() and path.read_bytes().endswith(mark.encode())


def _digest(folder: Path) -> str:
    """Digest of all data on which a report depends: cube, recordings, code and templates."""
    cube, package = folder / "cube.nc", Path(__file__).parents[1]
    parts = [code_version(("analysis", "emgface"))]
    pages = [*package.glob("report/page/*"), *package.glob("pictures/page/*")]
    parts += [file_digest(path) for path in sorted(pages)]
    if cube.is_file():
        parts.append(file_digest(cube))
        recordings = _recordings(cube)
        for path in sorted(recordings.glob("**/*")) if recordings else ():
            parts.append(f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}")
    return text_digest("\n".join(parts))


def _recordings(cube: Path) -> Path | None:
    """Folder of the recordings of a cube; None if the cube states none or is damaged."""
    import netCDF4

    try:
        with netCDF4.Dataset(cube) as opened:
            text = str(getattr(opened, "configuration", "{}"))
        folder = Path(json.loads(text).get("recordings", {}).get("folder", ""))
    except (OSError, RuntimeError, ValueError, AttributeError):
        return None
    return folder if folder.is_dir() else None
