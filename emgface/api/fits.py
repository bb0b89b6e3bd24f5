"""Public function that fits a face to a person."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from emgface.api.given import Data, File
    from emgface.fit.person import Given

    Marks = Mapping[str, Sequence[float]] | pd.DataFrame | File


def fit(
    face: "Data | None" = None,
    *,
    landmarks: "Marks",
    skin: "Given | None" = None,
    inner: "Given | None" = None,
    bone: "Given | None" = None,
    unit: str | None = None,
    on_face: "Marks | None" = None,
    rim: bool = False,
    noise: float = 0.8e-3,
    thickness: float = 0.0,
    courses: "Mapping[str, Any] | None" = None,
    volumes: Mapping[str, float] | None = None,
    name: str = "fitted face",
    simulated: bool = False,
    report: "File | None" = None,
    progress: Any = None,
) -> "xr.Dataset":
    """Fit a face to a person: landmarks and, if present, surfaces become a face that can be simulated.

    The mesh is pulled to the surfaces by springs while its tissue resists, so that no element inverts;
    muscles, attachments, markers and teeth follow. Surfaces need no correspondence.

    Parameters
    ----------
    face : Dataset or path-like, optional
        Face model that is fitted; default: the generated face.
    landmarks : mapping, DataFrame or path-like
        Points by name, (x, y, z) in metres unless `unit` is given, or a file (.csv, .mrk.json, .fcsv,
        .landmarkAscii). At least four have names of the face (`emgface.fit.inputs.points_of_face`) or
        of `on_face`.
    skin, inner, bone : path-like, Scan, or points and triangles, optional
        Surface of the skin, of the inside of the soft tissue, and of the bones to which it is fixed
        (.ply, .obj, .stl), in the frame of the landmarks.
    unit : str, optional
        Unit of all files that do not state it: "mm", "cm", "m".
    on_face : mapping, DataFrame or path-like, optional
        Places of landmarks on the face that is fitted, in its frame.
    rim : bool
        The surfaces end at the rim of the face, as those of another mesh do, and the rim is a contour
        like that of the mouth. A scan ends where it was cut off.
    noise : float
        Standard deviation of a landmark [m].
    thickness : float
        Thickness of the tissue where no data determine it, in standard deviations of its logarithm
        from the expected one; faces with -1, 0 and 1 show what its uncertainty means for a result.
    courses : mapping, optional
        Tractography by muscle, such as ``{"ZYG_L": "zygomaticus.trk"}``, which replaces the course of
        the muscle: files (.trk, .tck) in the frame of the landmarks, or arrays (k, 3) [m] in that of
        the face.
    volumes : mapping, optional
        Volumes of muscles with a new course [m3]; default: by the spread of the bundle.
    name : str
        Name of the fitted face.
    simulated : bool
        The inputs are simulated; the face and the report then say so.
    report : path-like, optional
        Page with the distances, the quality of the elements and the uncertainty (HTML).
    progress : callable, optional
        Called with the current stage, the completed number and the total.

    Returns
    -------
    Dataset
        Checked face model in the frame of the face.

    Warns
    -----
    FitWarning
        Landmarks without a counterpart were ignored, are too few, of a doubtful size, or of another
        pose than a surface; a part of a surface is far from the place that they suggest.

    Raises
    ------
    FitError
        An input is unusable (with its place), mirrored, in another unit or frame, or the fitted face
        misses a surface.

    Examples
    --------
    >>> import emgface as ef
    >>> person = ef.fit("face.nc", landmarks="person.csv", skin="scan.ply", unit="mm")  # doctest: +SKIP
    """
    import warnings

    from emgface.api.given import face_of, study_of, target_or_none
    from emgface.errors import FitWarning
    from emgface.fit.person import fit_face

    page = target_or_none(report)
    fitted = fit_face(
        face_of(face, study_of(None)), landmarks, skin=skin, inner=inner, bone=bone, unit=unit,
        on_face=on_face, rim=rim, noise=noise, thickness=thickness, name=name, simulated=simulated,
        courses=courses, volumes=volumes, progress=progress,
    )  # fmt: skip
    for doubt in fitted.doubts:
        warnings.warn(doubt, FitWarning, stacklevel=2)
    if page is not None:
        from emgface.fit.report import write_report

        write_report(fitted, page)
    return fitted.face
