"""Overview pages of recordings: one picture, or a PDF with a page for each recording."""

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import xarray as xr

from emgface.cli.console import say
from emgface.errors import DataError
from emgface.files import replace_file

AddPage = Callable[[xr.Dataset, pd.DataFrame], None]


@contextmanager
def overview_pages(path: Path | None, n_recordings: int) -> Iterator[AddPage]:
    """Collect overview pages and write them at the end.

    Parameters
    ----------
    path : Path or None
        Picture (png, pdf, svg) to write; an existing one is replaced. None: no picture.
    n_recordings : int
        Number of recordings; more than one require a PDF.

    Yields
    ------
    callable
        Takes a recording and its result of `emgface.recordings.check.check_recording`.

    Raises
    ------
    DataError
        If the format is unknown or holds one page where several come, or the file cannot be
        written.
    """
    if path is None:
        yield lambda recording, table: None
        return
    # Drawing is slow to load, and most checks draw nothing.
    from matplotlib.backend_bases import FigureCanvasBase
    from matplotlib.backends.backend_pdf import PdfPages

    from emgface.recordings.quality.figure import overview_figure

    form = path.suffix.lower().removeprefix(".")
    known = FigureCanvasBase.get_supported_filetypes()
    if form not in known:
        raise DataError(
            f"{path.name} has the suffix {path.suffix!r}, expected a picture format: use the "
            "suffix .png, .svg or .pdf"
        )
    if n_recordings > 1 and form != "pdf":
        raise DataError(
            f"{path.name} contains one page, expected a PDF for {n_recordings} recordings: "
            "use the suffix .pdf"
        )
    content = io.BytesIO()
    n_pages = 0
    if form == "pdf":
        with PdfPages(content) as pages:

            def add(recording: xr.Dataset, table: pd.DataFrame) -> None:
                nonlocal n_pages
                pages.savefig(overview_figure(recording, table))
                n_pages += 1

            yield add
    else:

        def draw(recording: xr.Dataset, table: pd.DataFrame) -> None:
            nonlocal n_pages
            overview_figure(recording, table).savefig(content, format=form, dpi=150)
            n_pages += 1

        yield draw
    if n_pages:  # none where no recording could be read
        replace_file(path, lambda target: target.write_bytes(content.getvalue()))
        say(f"Wrote {path}.")
