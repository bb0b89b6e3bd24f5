"""Reduced faces of the face before and after a treatment: which belongs to which, and their bounds."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import xarray as xr

from emgface.errors import FaceError, SchemaError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.reduced.model import ReducedFace
from emgface.run.digest import dataset_digest
from emgface.schema.netcdf import kind_of, read_netcdf


def refuse_reduced(*models: Path) -> None:
    """Raise SchemaError if a file in place of a face is a reduced face."""
    for path in models:
        if path.is_file() and kind_of(path) == "reduced_face":
            raise SchemaError(
                f"{path.name} is a reduced face, expected a face: specify the face of its training, and "
                f"this file as --reduced {path.name}, with one for the other face"
            )


def reduced_pair(
    files: Sequence[Path], intact: xr.Dataset, treated: xr.Dataset, parameters: SimulationParameters
) -> tuple[Path, Path]:
    """Files of the reduced faces of the intact and the treated face, by their digests.

    Raises FaceError if one of them has none, because the modes and the bound of a reduced face are
    those of the face of its training; if a file belongs to neither; or if one was trained for other
    parameters.
    """
    given = {path: read_netcdf(path, "reduced_face") for path in files}
    matched: list[Path] = []
    for when, face in (("before", intact), ("after", treated)):
        own = [p for p, data in given.items() if data.attrs["face_digest"] == dataset_digest(face)]
        if not own:
            raise FaceError(
                f"none of the reduced faces {', '.join(p.name for p in files)} belongs to the face "
                f"{when} the treatment, {str(face.attrs['name'])!r}, expected one of each: the "
                "modes and the bound of the error are those of one face, reduce this one as well "
                "(emgface reduce)"
            )
        ReducedFace.for_face(given[own[0]], face, parameters)
        matched.append(own[0])
    if left := [p.name for p in files if p not in matched]:
        raise FaceError(
            f"the reduced face {left[0]} is not used, expected one of the face before and one of that "
            "after the treatment: omit it"
        )
    return matched[0], matched[1]


def notes_of_reduction(
    before: Mapping[str, xr.Dataset], after: Mapping[str, xr.Dataset]
) -> tuple[str, ...]:
    """Sentences on the bounds of the reduced motions, and on those repeated at full order."""
    notes: list[str] = []
    for when, motions in (("before", before), ("after", after)):
        bounds = {
            n: float(m.attrs["reduction_error"]) for n, m in motions.items() if m.attrs["reduced"]
        }
        if bounds:
            worst = max(bounds, key=lambda name: bounds[name])
            notes.append(
                f"The face {when} is reduced in {', '.join(bounds)}: the bound of the error of a "
                f"marker is at most {1e3 * bounds[worst]:.2g} mm ({worst}). A difference of both faces "
                "may have the sum of their bounds as its error."
            )
        notes += [
            f"The movement {name} {when} was simulated at full order: {m.attrs['reduction_doubt']}."
            for name, m in motions.items()
            if not m.attrs["reduced"]
        ]
    return tuple(notes)
