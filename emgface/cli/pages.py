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
    """Collect overview pages and write them at the end; yields a function that adds one.

    That function receives a recording and its `emgface.recordings.check.check_recording`. `path` is
    the picture to write (png, pdf, svg), or None. Raises DataError if the format is unknown or has
    one page for several recordings, or the file cannot be written.
    """
    if path is None:
        yield lambda recording, table: None
        return
    # Importing the drawing library is slow, and most checks do not draw.
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
    if n_pages:  # zero if no recording could be read
        replace_file(path, lambda target: target.write_bytes(content.getvalue()))
        say(f"Wrote {path}.")
