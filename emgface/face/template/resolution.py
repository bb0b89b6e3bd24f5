"""Number of elements of a template face, as a checked parameter."""

from typing import Annotated

from pydantic import AfterValidator

from emgface.errors import FaceError
from emgface.face.template.grid import make_grid


def _possible(value: str | int) -> str | int:
    try:
        make_grid(value)
    except FaceError as error:
        raise ValueError(str(error)) from error
    return value


Resolution = Annotated[str | int, AfterValidator(_possible)]
"""coarse, medium, fine or an approximate number of elements (`emgface.face.template.grid.make_grid`)."""
