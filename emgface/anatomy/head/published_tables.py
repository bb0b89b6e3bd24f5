"""Tables of the published coupled head."""

from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

from emgface.errors import HeadError
from emgface.face.parts import Integers
from emgface.schema.rules import one_line
from emgface.texts import labelled, open_text, read_text

HEAD_SOURCE: Final = (
    "Stavness et al., Coupled biomechanical modeling of the face, jaw, skull, tongue, and hyoid bone; "
    "Nazari et al. 2010; Buchaillard et al. 2009; artisynth_models, jaw_tongue_face"
)


def numbers_of(path: Path) -> Integers:
    """Numbers of a list with any number of them in a line."""
    words = read_text(file_of(path)).split()
    try:
        return np.array([int(word) for word in words], dtype=np.int64)
    except ValueError as error:
        raise HeadError(f"{path}: {one_line(error)}, expected whole numbers") from error


def table_of(path: Path, columns: list[str]) -> pd.DataFrame:
    """Columns of a CSV table; HeadError if it is absent or lacks one."""
    try:
        return pd.read_csv(labelled(open_text(file_of(path))))[columns]
    except (KeyError, ValueError) as error:
        raise HeadError(
            f"{path} cannot be read ({one_line(error)}): expected a table with the columns "
            f"{', '.join(columns)}"
        ) from error


def file_of(path: Path) -> Path:
    """Return a path of the published models, or raise HeadError if there is no such file."""
    if not path.is_file():
        raise HeadError(
            f"{path} not found: specify the folder of the published models with jaw_tongue_face, "
            "face_badin, face_reference and tongue"
        )
    return path
