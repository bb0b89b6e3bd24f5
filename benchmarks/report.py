"""Table of a measurement: Markdown on the terminal, CSV in a folder."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from PIL import Image

Row = tuple[str, str, str, bool]  #: of a check: what, measured, required, met


def say(text: str) -> None:
    """Print the progress of a measurement on the error stream."""
    print(text, file=sys.stderr, flush=True)


def face_of(path: Path | None, resolution: str = "coarse") -> xr.Dataset:
    """Face model of a file, by default the template face."""
    from emgface.face.file import load_face
    from emgface.face.template import template_face

    return template_face(resolution=resolution) if path is None else load_face(path)


def markdown(table: pd.DataFrame, form: str = ".4g") -> str:
    """Table in Markdown; floats in the given format, undefined values empty."""

    def cell(value: object) -> str:
        if isinstance(value, float):
            return "" if np.isnan(value) else format(value, form)
        return str(value)

    rows = [list(map(str, table.columns)), ["---"] * len(table.columns)]
    rows += [[cell(value) for value in row] for row in table.itertuples(index=False)]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def shrink(picture: Path) -> Path:
    """Store a picture with 128 colours."""
    with Image.open(picture) as opened:
        opened.convert("RGB").quantize(128).save(picture, optimize=True)
    return picture


def finish(name: str, table: pd.DataFrame, out: Path | None = None) -> None:
    """Print a table and, if a folder is given, store it there as ``name.csv``."""
    print(markdown(table), flush=True)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        table.to_csv(out / f"{name}.csv", index=False)
        say(f"written: {out / f'{name}.csv'}")
