"""Pictures of datasets and files: recordings, activations, motions, scores, cubes, models, sound."""

import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import xarray as xr

from analysis.figures.style import COLOURS, blank, grid, heading, styled
from analysis.tables import origin_of
from emgface.errors import DataError
from emgface.files import write_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGES: Final = (".html", ".htm")
Parts = Mapping[str, xr.Dataset]  #: parts of a head, which its file holds as groups


@dataclass(frozen=True)
class Drawing:
    """Pictures of one kind of dataset: a figure, and a page if it is not that of the figure.

    Both are functions of the dataset and, where there are some, of its parts. They are stated as
    "module:name" and imported when they are used, like the function that reads a file with parts.
    """

    figure: str
    page: str = ""
    parts: str = ""


def draw(data: xr.Dataset, path: Path, parts: Parts | None = None) -> Path:
    """Write a dataset as a page, a picture or, for a motion with its surface, a movie.

    The suffix determines the format. Raises DataError if it is unknown, the file cannot be written,
    or the dataset is not of this package.
    """
    from emgface.pictures.movie import MOVIE_SUFFIXES, write_movie
    from emgface.pictures.stills import write_figure

    if path.suffix.lower() in PAGES:
        write_text(path, page(data, parts))
        return path
    if path.suffix.lower() in MOVIE_SUFFIXES:
        return write_movie(data, path)
    return write_figure(figure(data, parts), path)


def page(data: xr.Dataset, parts: Parts | None = None) -> str:
    """Return the page of a dataset as HTML without network requests (`emgface.show`)."""
    from emgface.pictures.page import figure_page

    drawing = DRAWINGS[kind(data)]
    if not drawing.page or _only_markers(data):
        return figure_page(figure(data, parts))
    return _drawn(drawing.page, data, parts)


def figure(data: xr.Dataset, parts: Parts | None = None) -> "Figure":
    """Return the figure of a dataset (`emgface.show`)."""
    return _drawn(DRAWINGS[kind(data)].figure, data, parts)


def _drawn(stated: str, data: xr.Dataset, parts: Parts | None) -> Any:
    if not DRAWINGS[kind(data)].parts:
        return _function(stated)(data)
    if not parts:
        raise DataError(
            "the dataset is the root group of the file of a model, without its parts, expected both: "
            "show the file itself"
        )
    return _function(stated)(data, parts)


def _function(stated: str) -> Callable[..., Any]:
    module, _, name = stated.partition(":")
    return getattr(import_module(module), name)


def kind(data: xr.Dataset) -> str:
    """Identify the kind of a dataset, one of `DRAWINGS`, by its variables; DataError for others."""
    if (named := data.attrs.get("schema", "")) in DRAWINGS and named != "recording":
        return named
    signs = {
        "face_model": "connectivity" in data,
        "cube": "status" in data,
        "scores": "rho" in data,
        "recording": "emg" in data,
        "activation": "activation" in data,
        "trajectory": "position" in data and "sigma_max" in data.attrs,
        "markers": "position" in data,
    }
    matched = next((name for name, here in signs.items() if here), "")
    if not matched:
        names = ", ".join(map(str, data.data_vars)) or "no variable"
        raise DataError(
            f"the dataset contains {names}, expected a recording, activation, trajectory, scores, cube "
            "or a model of this package"
        )
    return "recording" if matched == "markers" else matched


def opened(
    shown: xr.Dataset | str | os.PathLike[str],
    mapping: str | Path | Mapping[str, Any] | None = None,
) -> tuple[xr.Dataset, Parts]:
    """Dataset to be shown, read if a path is passed, and its parts (`emgface.show`); models checked."""
    from emgface.anatomy.checked import checked_model, read_model
    from emgface.recordings.dataset import read_recording
    from emgface.schema.netcdf import kind_of
    from emgface.schema.validation import kinds

    if isinstance(shown, xr.Dataset):
        return checked_model(shown, kind(shown)), {}
    path = Path(shown)
    if path.is_dir() and (path / "cube.nc").is_file():
        path = path / "cube.nc"
    if path.suffix.lower() == ".nc":
        named = kind_of(path)
        if named in DRAWINGS and named != "recording":
            if reader := DRAWINGS[named].parts:
                return _function(reader)(path)
            return read_model(path, named), {}
        if named in kinds() and named != "recording":
            raise DataError(
                f"{path} is of the kind {named!r}, which has no picture, expected one of "
                f"{', '.join(DRAWINGS)}"
            )
    return read_recording(path, mapping=mapping), {}


def check_display() -> None:
    """Raise DataError on Linux without DISPLAY and WAYLAND_DISPLAY, before a window is opened."""
    here = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not here:
        raise DataError(
            "there is no display for a window, expected DISPLAY or WAYLAND_DISPLAY to be set: write "
            "a picture or a page (--out picture.png, --out page.html)"
        )


def _only_markers(data: xr.Dataset) -> bool:
    return kind(data) == "trajectory" and "surface_position" not in data


def motion_figure(data: xr.Dataset) -> "Figure":
    """Draw the face at the start and at its largest displacement, or the paths of the markers."""
    if _only_markers(data):
        return marker_figure(data)
    from emgface.pictures.page import trial_name
    from emgface.pictures.stills import body_figure
    from emgface.pictures.surface import drawn_surface

    body, _, frames = drawn_surface(data)
    far = int(np.argmax(((frames - frames[0]) ** 2).sum(axis=(1, 2))))
    times = data["frame_time"].values
    shown = {f"{times[k]:.2f} s": frames[k] for k in dict.fromkeys((0, far))}
    return body_figure(
        body, shown, title=f"{trial_name(data)}, simulated: start and largest displacement"
    )


@styled
def marker_figure(data: xr.Dataset) -> "Figure":
    """Draw the displacement of every marker of a trajectory from its start along x, y and z."""
    position = 1e3 * data["position"].transpose("axis", "time", "marker")
    moved = (position - position.isel(time=0)).values
    drawn = blank(7.5, 5.5)
    panels = grid(drawn, 3, 1, sharex=True, sharey=True)
    names = [str(name).replace("_", " ") for name in data["marker"].values]
    for (panel,), axis, values in zip(panels, "xyz", moved, strict=True):
        for k, name in enumerate(names):
            panel.plot(data["time"], values[:, k], label=name, color=COLOURS[k % len(COLOURS)],
                       linestyle="-" if k < len(COLOURS) else "--")  # fmt: skip
        panel.set_ylabel(f"{axis} [mm]")
    panels[-1][0].set_xlabel("time [s]")
    panels[0][0].legend(fontsize="x-small", ncols=2)
    drawn.suptitle("displacement of the markers, simulated motion")
    return drawn


@styled
def score_figure(data: xr.Dataset) -> "Figure":
    """Draw rho of every marker of a trial."""
    drawn = blank(6.0, 3.6)
    panel = grid(drawn)[0][0]
    names = [str(name).replace("_", " ") for name in data["marker"].values]
    rho = np.asarray(data["rho"].values, dtype=np.float64)
    panel.barh(names, rho, color=COLOURS[0])
    for place in np.flatnonzero(~np.isfinite(rho)):
        panel.text(0.01, place, "undefined", va="center", fontsize="small", color="0.4")
    panel.invert_yaxis()
    panel.set(xlim=(float(np.nanmin(rho, initial=0.0)), 1.0), xlabel="rho")
    heading(drawn, "3D correlation of simulated with recorded markers", origin_of(data))
    return drawn


def cube_figure(data: xr.Dataset) -> "Figure":
    """Draw the scores of a study, varied choices at their reference."""
    from analysis.axes import reference_cube
    from analysis.figures import box_plots

    return box_plots(reference_cube(data))


DRAWINGS: Final[Mapping[str, Drawing]] = {
    "recording": Drawing(
        "emgface.recordings.quality.figure:overview_figure", "emgface.view.recording:recording_page"
    ),
    "activation": Drawing("analysis.figures:activation_heat_map"),
    "trajectory": Drawing(f"{__name__}:motion_figure", "emgface.pictures.page:motion_page"),
    "scores": Drawing(f"{__name__}:score_figure"),
    "cube": Drawing(f"{__name__}:cube_figure"),
    "face_model": Drawing("emgface.pictures.stills:face_figure", "emgface.pictures.page:face_page"),
    "jaw_motion": Drawing(
        "emgface.anatomy.jaw.picture:jaw_figure", "emgface.anatomy.jaw.picture:jaw_page"
    ),
    "tongue_motion": Drawing(
        "emgface.anatomy.tongue.picture:tongue_figure",
        "emgface.anatomy.tongue.picture:tongue_page",
    ),
    "head_motion": Drawing(
        "emgface.anatomy.head.picture:head_figure",
        "emgface.anatomy.head.picture:head_page",
        parts="emgface.anatomy.head.run:read_motion",
    ),
    "jaw_model": Drawing("emgface.anatomy.head.still:jaw_model_figure"),
    "tongue_model": Drawing("emgface.anatomy.head.still:tongue_model_figure"),
    "head_model": Drawing(
        "emgface.anatomy.head.still:head_model_figure",
        parts="emgface.anatomy.head.model:read_lists",
    ),
    "sound": Drawing("emgface.anatomy.airway.figure:draw_sound"),
}
"""By the kind of dataset that ``data_schema`` declares."""
