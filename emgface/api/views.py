"""The function that shows datasets, in notebooks and in files."""

import os
from collections.abc import Mapping, Sequence
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from pathlib import Path

    import xarray as xr
    from matplotlib.figure import Figure

    from emgface.api.given import Data, File

HEIGHT: Final = 620  #: height of a moving face in a notebook [CSS pixels]
STILL_COLOURS: Final = 256
"""Colours of a still picture, chosen by k-means: a third of the bytes in a stored notebook."""


def show(
    shown: "Data",
    out: "File | None" = None,
    *,
    activation: "Data | None" = None,
    recording: "Data | None" = None,
    compare: "Data | None" = None,
    mapping: "Mapping[str, Any] | File | None" = None,
    face: "Data | None" = None,
    baseline: "Sequence[File]" = (),
) -> "View":
    """Show a recording, activation, motion, scores, cube, model or sound.

    Parameters
    ----------
    shown : Dataset or path-like
        A dataset of this package, its file, the folder of a finished study, or a recording in any
        supported format. The face of a trajectory moves if it was simulated with ``surface=True``.
    out : path-like, optional
        File to write in addition: a page (``*.html``), a picture (``*.png``, ``*.pdf``, ``*.svg``) or a
        movie (``*.gif``, ``*.mp4``).
    activation : Dataset or path-like, optional
        Activation (muscle, time) [1] that caused a trajectory, shown next to the face.
    recording : Dataset or path-like, optional
        Recording of a trajectory, whose lip markers are aligned with it, shown and scored.
    compare : Dataset or path-like, optional
        Second trajectory of the same face, whose markers are shown with those of the first.
    mapping : mapping or path-like, optional
        As for `read`, if `shown` is a recording, or for `recording`.
    face : Dataset or path-like, optional
        Face of the trajectory, whose face markers place the head of `recording`; default: the generated
        face.
    baseline : sequence of path-like, optional
        Motions of a jaw by other excitations, which are scored by the recording, too.

    Returns
    -------
    View
        Object that displays itself in a notebook: faces as a page on which they can be rotated and move,
        with a still picture where pages cannot be displayed; other datasets as a figure.

    Raises
    ------
    DataError
        The dataset or file is none of these, or `out` cannot be written.

    Examples
    --------
    >>> import emgface as ef
    >>> ef.show(ef.face(resolution="coarse"), "face.html")  # doctest: +SKIP
    """
    import xarray as xr

    from emgface.api.given import dataset_of, path_of, target_or_none
    from emgface.pictures.show import kind, opened

    target = target_or_none(out)
    if not isinstance(shown, xr.Dataset):
        path_of(shown, "something to show")
    named = os.fspath(mapping) if isinstance(mapping, os.PathLike) else mapping
    data, parts = opened(shown, named)
    further = _further(data, recording, compare, mapping, face, baseline)
    if activation is not None:
        activation = dataset_of(activation, "activation", "activation")
    _warn_of_others(data, activation, further.get("compared"))
    view = View(data, kind(data), activation, parts, further)
    if target is not None:
        view.save(target)
    return view


def _further(
    motion: "xr.Dataset",
    recording: "Data | None",
    compare: "Data | None",
    mapping: "Mapping[str, Any] | File | None",
    face: "Data | None",
    baseline: "Sequence[File]",
) -> dict[str, Any]:
    """Measured markers, scores and the second motion of a page, or what a jaw is compared with."""
    from emgface.api.given import dataset_of, recording_of
    from emgface.errors import ConfigurationError, listed
    from emgface.pictures.show import kind

    additions: dict[str, Any] = {}
    if kind(motion) == "jaw_motion" and recording is not None:
        from emgface.anatomy.jaw.compared import compare_with_recording
        from emgface.models.jaw import baselines

        given = recording_of(recording, mapping)
        return {"comparison": compare_with_recording(given, motion, baselines(baseline))}
    if baseline:
        raise ConfigurationError(
            "baselines are scored by a recording of a jaw, expected the motion of a jaw and its "
            "recording: specify both, or leave the baselines out"
        )
    if kind(motion) != "trajectory":
        given_too = {"recording": recording, "compare": compare, "face": face}
        if idle := [name for name, value in given_too.items() if value is not None]:
            raise ConfigurationError(
                f"a {kind(motion).replace('_', ' ')} is shown without {listed(idle)}, expected the "
                "motion of a face with it: leave it out"
            )
        return additions
    alone = {"mapping": mapping, "face": face}
    if recording is None and (idle := [name for name, x in alone.items() if x is not None]):
        raise ConfigurationError(
            f"{listed(idle)} of a trajectory has no effect without a recording, whose head the "
            "face places, expected both: pass both, or leave it out"
        )
    if recording is not None:
        from emgface.api.recordings import aligned_and_scored

        additions["aligned"], additions["scores"] = aligned_and_scored(
            recording, motion, face=face, mapping=mapping
        )
    if compare is not None:
        additions["compared"] = dataset_of(compare, "trajectory", "position")
    return additions


def _warn_of_others(
    motion: "xr.Dataset", activation: "xr.Dataset | None", compared: "xr.Dataset | None"
) -> None:
    """Warn if the activation or the second motion shown with a motion is of another face or trial."""
    from emgface.recordings.belonging import of_recording, of_times, of_two
    from emgface.recordings.repeated import warn_of

    if compared is not None:
        warn_of(of_two(compared.attrs, motion.attrs, "second motion"), stacklevel=4)
    if activation is not None:
        findings = of_recording(motion.attrs, activation.attrs)
        if "time" in motion.coords:
            findings += of_times(motion, activation, "time", "activation")
        warn_of(findings, stacklevel=4)


class View:
    """A dataset that displays itself, with the activation shown next to a moving face.

    `kind` is that of the dataset, such as "trajectory".
    """

    def __init__(
        self,
        data: "xr.Dataset",
        kind: str,
        activation: "xr.Dataset | None",
        parts: "Mapping[str, xr.Dataset]",
        further: "Mapping[str, Any] | None" = None,
    ) -> None:
        self._data, self._kind, self._activation, self._parts = data, kind, activation, parts
        self._further = dict(further or {})

    @property
    def moving(self) -> bool:
        """Return True if the view is an interactive page: a face, or a recording to browse."""
        return (
            self._kind == "recording"
            or self._kind == "face_model"
            or "surface_position" in self._data
        )

    @cached_property
    def page(self) -> str:
        """Page as HTML without network requests."""
        from emgface.pictures.page import motion_page
        from emgface.pictures.show import page

        if self._kind == "trajectory" and self.moving:
            return motion_page(self._data, self._activation, **self._further)
        if self._kind == "jaw_motion":
            from emgface.anatomy.jaw.picture import jaw_page

            return jaw_page(self._data, **self._further)
        return page(self._data, self._parts)

    @cached_property
    def figure(self) -> "Figure":
        """Still picture."""
        from emgface.pictures.show import figure

        if self._kind == "jaw_motion":
            from emgface.anatomy.jaw.picture import jaw_figure

            return jaw_figure(self._data, **self._further)
        return figure(self._data, self._parts)

    def save(self, path: "File") -> "Path":
        """Write a page, a picture or, for a moving face, a movie, according to the suffix.

        Raises
        ------
        DataError
            The suffix is unknown, or the file cannot be written.
        """
        from emgface.files import expressible, write_text
        from emgface.pictures.show import PAGES, draw

        path = expressible(path)
        if path.suffix.lower() not in PAGES:
            if self._kind == "jaw_motion":
                from emgface.pictures.stills import write_figure

                return write_figure(self.figure, path)
            return draw(self._data, path, self._parts)
        write_text(path, self.page)
        return path

    def open(self) -> "Path":
        """Open the page in a browser.

        Raises
        ------
        DataError
            There is no display, or no browser could be opened.
        """
        import tempfile
        import webbrowser
        from pathlib import Path

        from emgface.errors import DataError
        from emgface.pictures.show import check_display

        check_display()
        path = self.save(Path(tempfile.mkdtemp(prefix="emgface-")) / "shown.html")
        if not webbrowser.open(path.as_uri()):
            raise DataError(
                f"no browser could be opened, expected one that shows {path}: open this file, or "
                "write a picture (--out)"
            )
        return path

    def __repr__(self) -> str:
        """State what is shown and how it can be displayed."""
        return (
            f"<emgface.View of a {self._kind}: save('view.html') writes it, open() opens a browser>"
        )

    def _repr_mimebundle_(self, **_: Any) -> dict[str, Any]:
        """Still picture and, for a moving face, the page in a separate frame."""
        bundle: dict[str, Any] = {"text/plain": repr(self), "image/png": self._png()}
        if self.moving:
            bundle["text/html"] = (
                f'<iframe srcdoc="{escape(self.page)}" title="{escape(self._kind)}" '
                f'style="width:100%;height:{HEIGHT}px;border:0"></iframe>'
            )
        return bundle

    def _png(self) -> str:
        from base64 import b64encode
        from io import BytesIO

        from PIL import Image

        from emgface.pictures.stills import NOTEBOOK_DPI

        drawn, small = BytesIO(), BytesIO()
        self.figure.savefig(drawn, format="png", dpi=NOTEBOOK_DPI)
        picture = Image.open(drawn).convert("RGB").quantize(STILL_COLOURS, kmeans=3)
        picture.save(small, format="png", optimize=True)
        return b64encode(small.getvalue()).decode("ascii")
