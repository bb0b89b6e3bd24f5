"""Face of a person from landmarks and surfaces: the whole fit, its checks and its measures."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr

from emgface.errors import FaceError, FitError
from emgface.face.parts import FREE
from emgface.face.validity import check_face
from emgface.fit.carry import carry, rigid_points
from emgface.fit.columns import THICKNESS_SPREAD, Columns, ThicknessPrior
from emgface.fit.corners import Corners
from emgface.fit.courses import with_courses
from emgface.fit.deform import LANDMARK_NOISE, Deformed, Progress, deform
from emgface.fit.inputs import (
    LOCAL,
    Paired,
    facing,
    in_face_frame,
    outer_layer,
    pair_points,
    points_of_face,
    provenance,
)
from emgface.fit.likeness import changed_measures, nearer_face
from emgface.fit.measures import distances, quality_rows
from emgface.fit.places import (
    UNCOVERED_DISTANCE,
    check_landmarks_off,
    check_landmarks_on,
    implausible_thickness,
    missed_landmarks,
    other_side,
    second_layer,
    uncovered_points,
    unexpected_part,
)
from emgface.fit.readers.guard import FACE
from emgface.fit.readers.landmarks import Landmarks, landmarks_of
from emgface.fit.readers.surfaces import Scan, read_surface, surface_of
from emgface.fit.similarity import similarity
from emgface.fit.strays import left_out
from emgface.fit.targets import Target, sheets
from emgface.fit.triangulated import Floats

LARGEST_SURFACE_MISS: Final = {"skin": 1.0e-3, "inner": 1.5e-3, "bone": 1.5e-3}
"""Largest mean distance of the fitted face from a surface that is accepted [m].

One millimetre is the accuracy of the surfaces in Bucki et al. 2010.
"""

MOST_DEVIATIONS: Final = 3.0  #: largest thickness of a member of the ensemble, in deviations

Given = Scan | tuple[Any, Any] | str | os.PathLike[str]
Marks = Landmarks | Mapping[str, Sequence[float]] | pd.DataFrame | str | os.PathLike[str]


@dataclass(frozen=True)
class Fitted:
    """Fitted face with the measures of its report."""

    face: xr.Dataset  #: checked face model
    source: (
        xr.Dataset
    )  #: face whose mesh was deformed: of a generated one, that with the fitted measures
    targets: tuple[Target, ...]  #: surfaces in the frame of the face
    landmarks: pd.DataFrame  #: error at the landmark and of the spline without it [mm]
    distance: pd.DataFrame  #: distances of the surfaces by stage [mm]
    quality: pd.DataFrame  #: quality of the elements before and after
    fibres: pd.DataFrame  #: lengths of the fibres [mm]
    thickness: pd.DataFrame  #: thickness of the columns [mm] with interval, by node of the skin
    prior: ThicknessPrior | None
    notes: tuple[str, ...]
    deformed: Deformed
    doubts: tuple[str, ...] = ()  #: those of the notes that doubt an input

    def __repr__(self) -> str:
        """Name of the face instead of all tables."""
        return f"<{type(self).__name__} {self.face.attrs['name']!r}>"

    def _repr_png_(self) -> bytes:
        """Figure of the fit, which a notebook shows in place of the text."""
        from io import BytesIO

        from emgface.fit.picture import fit_figure
        from emgface.pictures.stills import NOTEBOOK_DPI

        drawn = BytesIO()
        fit_figure(self).savefig(drawn, format="png", dpi=NOTEBOOK_DPI)
        return drawn.getvalue()


def fit_face(
    face: xr.Dataset,
    landmarks: Marks,
    *,
    skin: Given | None = None,
    inner: Given | None = None,
    bone: Given | None = None,
    unit: str | None = None,
    on_face: Marks | None = None,
    rim: bool = False,
    noise: float = LANDMARK_NOISE,
    thickness: float = 0.0,
    courses: Mapping[str, Any] | None = None,
    volumes: Mapping[str, float] | None = None,
    name: str = "fitted face",
    simulated: bool = False,
    progress: Progress | None = None,
) -> Fitted:
    """Fit a face to landmarks and surfaces; arguments and errors as of `emgface.fit`."""
    _check_arguments(face, noise, thickness)
    marks = landmarks_of(landmarks, unit)
    places = None if on_face is None else landmarks_of(on_face)
    scans = {
        kind: scan_of(given, unit, kind)
        for kind, given in (("skin", skin), ("inner", inner), ("bone", bone))
        if given is not None
    }
    paired, targets, doubts, said = compared_inputs(face, marks, places, scans, rim, noise)
    notes = [*doubts, *(f"{s.source}: {note}" for s in scans.values() for note in s.notes), *said]
    if (nearer := nearer_face(face, paired, targets, noise)) is not face:
        moved = places
        if places is not None:
            at = rigid_points(face, places.position, nearer["position"].values)
            moved = replace(places, position=at)
        try:
            again = pair_points(nearer, marks, moved, noise)
        except FitError:
            pass  # few landmarks may lie in one plane of the face with these measures: keep the other
        else:
            notes += changed_measures(face, nearer)
            face, paired = nearer, again
            targets, _ = _targets(face, scans, paired, rim)
    source = face["position"].values
    corners = Corners.from_elements(face["connectivity"].values.astype(np.int64))
    columns = Columns.from_face(face)
    prior = _prior(columns, source, paired, targets, thickness)
    area = sheets(face)["skin"].at(source).point_areas

    def thick(q: Floats) -> Any:
        assert prior is not None
        return prior.rows(q, area)

    result = deform(
        source, corners, paired.points, targets, noise=noise, progress=progress,
        fixed_rows=thick if prior is not None and targets else None,
    )  # fmt: skip
    depth = THICKNESS_SPREAD * float(np.median(columns.thickness(source)))
    unexpected = [
        unexpected_part(
            target, result.stages["spline"], paired.points, noise,
            0.0 if target.name == "skin" else depth, scans[target.name].source,
        )
        for target in targets
    ]  # fmt: skip
    distance = _distances(face, targets, result)
    marked = _landmark_table(paired, source, result, noise)
    missed = missed_landmarks(paired.points.names, 1e-3 * marked["error"].to_numpy(), noise)
    sentences_on_fit = [doubt for doubt in (*unexpected, missed) if doubt] + _small(distance, scans)
    notes += sentences_on_fit
    carried = carry(face, result.position)
    inputs = {"landmarks": marks, **scans}
    fitted = carried.face.assign_attrs(provenance(face, name, inputs, paired.to_face, simulated))
    if thickness:
        fitted.attrs["fit_thickness_deviation"] = float(thickness)
    fitted.attrs.pop("muscle_radius", None)
    _check_corners(corners, result.position)
    beyond = _beyond(fitted, paired, targets, scans)
    sentences_on_fit, notes = sentences_on_fit + beyond, notes + beyond
    _check_fitted(fitted, (*doubts, *sentences_on_fit))
    fitted, sentences = with_courses(fitted, courses or {}, volumes)
    notes += sentences
    _check_distances(distance, scans)
    return Fitted(
        fitted, face, tuple(targets), marked, distance,
        quality_rows(face, fitted), carried.fibres,
        _thickness_table(columns, source, result.position, prior), prior, tuple(notes), result,
        (*doubts, *sentences_on_fit),
    )  # fmt: skip


def _check_arguments(face: xr.Dataset, noise: float, thickness: float) -> None:
    """Refuse a treated face, and numbers out of range."""
    check_face(face)
    if "stress_free_position" in face:
        raise FitError(
            f"the face {face.attrs['name']!r} has closed wounds, whose stress-free shapes belong to its "
            "own geometry; expected an untreated face: fit that one first, and then treat the result"
        )
    if not 1e-5 <= noise <= 1e-2:
        raise FitError(f"the noise of landmarks is {noise} m, expected 1e-5 to 1e-2")
    if not abs(thickness) <= MOST_DEVIATIONS:
        raise FitError(
            f"the thickness is {thickness} standard deviations from the expected one, expected "
            f"-{MOST_DEVIATIONS:g} to {MOST_DEVIATIONS:g}"
        )


def _prior(
    columns: Columns,
    source: Floats,
    paired: Paired,
    targets: Sequence[Target],
    thickness: float,
) -> ThicknessPrior | None:
    """Expected thickness where no surface beneath the skin determines it; None with an inner surface."""
    if any(target.name == "inner" for target in targets):
        return None
    known = [t.sheet.nodes if t.only is None else t.only for t in targets if t.name != "skin"]
    scale = similarity(paired.points.source, paired.points.target).scale
    determined = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *known]))
    return ThicknessPrior.scaled(columns, source, scale, determined, thickness)


def _check_fitted(fitted: xr.Dataset, doubts: tuple[str, ...]) -> None:
    """Refuse a fitted mesh that is not valid, with the doubts about its inputs as the reason."""
    try:
        check_face(fitted)
    except FaceError as error:
        why = "; ".join(doubts) or "the inputs are too far from the shape of a face"
        raise FitError(
            f"the fitted mesh is not usable ({error}), because: {why}. Expected surfaces and landmarks "
            "of the whole face: add landmarks on both sides, or leave the surface out"
        ) from error


def compared_inputs(
    face: xr.Dataset,
    marks: Landmarks,
    places: Landmarks | None,
    scans: Mapping[str, Scan],
    rim: bool,
    noise: float,
) -> tuple[Paired, list[Target], list[str], list[str]]:
    """Landmarks and surfaces in the frame of the face, doubts about them, and what was changed.

    This is all that is judged before the fit; FitError for inputs that cannot be right.
    """
    paired = pair_points(face, marks, places, noise)
    doubts: list[str | None] = [*paired.notes, *_check_places(scans, paired, noise)]
    targets, turned = _targets(face, scans, paired, rim)
    doubts += [other_side(kind, scans[kind].source) for kind in turned]
    skin = next((target.surface for target in targets if target.name == "skin"), None)
    for target in targets:
        if target.name != "skin" and skin is not None:
            name = scans[target.name].source
            doubts.append(implausible_thickness(face, paired.points, skin, target, name))
    said = [sentence for kind, sentence in turned.items() if kind == "skin"]
    return paired, targets, [doubt for doubt in doubts if doubt], said


def scan_of(given: Given, unit: str | None, name: str, least: float = FACE[0]) -> Scan:
    """Surface from a file, or from points and triangles (m without a unit), which have a `name`.

    `least` [m] is the smallest extent of the surface.
    """
    if isinstance(given, Scan):
        return given
    if isinstance(given, str | os.PathLike):
        return read_surface(given, unit=unit, least=least)
    if not isinstance(given, tuple | list) or len(given) != 2:  # pyright: ignore[reportUnnecessaryIsInstance]
        raise FitError(
            f"the surface {name!r} is of type {type(given).__name__}, expected points and triangles, "
            "or the path of a surface: pass one of them"
        )
    points, triangles = given
    return surface_of(points, triangles, unit=unit or "m", name=name, least=least)


def _check_places(scans: Mapping[str, Scan], paired: Paired, noise: float) -> list[str]:
    """Doubts about the places of the landmarks; FitError if a surface is not where they say."""
    doubts = []
    for kind, scan in scans.items():
        surface = in_face_frame(scan, paired.to_face)
        doubts.append(second_layer(surface, scan.source))
        if kind == "skin":
            doubts.append(check_landmarks_on(surface, paired.points, scan.source, noise))
        else:
            check_landmarks_off(surface, paired.points, scan.source, kind)
    return [doubt for doubt in doubts if doubt]


def _targets(
    face: xr.Dataset, scans: Mapping[str, Scan], paired: Paired, rim: bool
) -> tuple[list[Target], dict[str, str]]:
    """Surfaces in the frame of the face, with outward normals, and a note by kind on those turned."""
    source = face["position"].values
    start = similarity(paired.points.source, paired.points.target)(source)
    own = sheets(face)
    targets, notes = list[Target](), dict[str, str]()
    for kind, scan in scans.items():
        surface = in_face_frame(scan, paired.to_face)
        sheet = own["skin" if kind == "skin" else "inner"]
        attached = sheet.nodes[face["fixed"].values[sheet.nodes] != FREE]
        nodes, side = (attached, -1.0) if kind == "bone" else (sheet.nodes, 1.0)
        surface, turned = facing(surface, sheet.at(start), nodes, side, scan.source)
        if turned:
            notes[kind] = turned
        hidden = 0.0
        if kind == "skin":
            surface, hidden = outer_layer(surface, sheet.at(start))
        if hidden:
            left = f"{hidden:.0%} of {scan.source} lies beneath its outer layer and was left out"
            notes[kind] = f"{left}; {turned}" if turned else left
        only = attached if kind == "bone" else None
        targets.append(Target(kind, sheet, surface, only, side, rim, not hidden))
    return targets, notes


def _check_corners(corners: Corners, q: Floats) -> None:
    if not (corners.scaled_jacobians(q) > 0.0).all():
        raise FitError("an element of the fitted mesh is inverted at a corner, expected none")


def _beyond(
    fitted: xr.Dataset, paired: Paired, targets: Sequence[Target], scans: Mapping[str, Scan]
) -> list[str]:
    """Doubt about parts of a fitted face beyond the ends of the scan of the skin, if there is one."""
    for target in targets:
        if target.name == "skin":
            names = paired.points.names
            skin = target.sheet.at(fitted["position"].values)
            every = points_of_face(fitted)
            # markers of the forehead are beyond the mesh, whose shape they do not concern
            own = skin.nearest(np.array(list(every.values()))).distance <= UNCOVERED_DISTANCE
            points = {name: at for (name, at), on in zip(every.items(), own, strict=True) if on}
            doubt = uncovered_points(target.surface, points, names, scans["skin"].source)
            return [doubt] if doubt else []
    return []


def _distances(face: xr.Dataset, targets: Sequence[Target], result: Deformed) -> pd.DataFrame:
    rows = []
    for stage, q in result.stages.items():
        for target in targets:
            rows.append({"stage": stage, "surface": target.name, **distances(target, q)})
    return pd.DataFrame(rows, columns=["stage", "surface", "mean", "q95", "largest", "covered"])


def _small(table: pd.DataFrame, scans: Mapping[str, Scan]) -> list[str]:
    """Doubt about a scan of the skin that covers less than half of it."""
    return [
        f"{scans['skin'].source} covers {covered:.0%} of the skin; beyond it the shape is extrapolated "
        "from the landmarks: use a scan of the whole face, or add landmarks at its borders"
        for covered in table.loc[table["surface"] == "skin", "covered"].tail(1)
        if covered < LOCAL
    ]


def _check_distances(table: pd.DataFrame, scans: Mapping[str, Scan]) -> None:
    """Refuse a fit that misses one of its surfaces."""
    last = table[table["stage"] == "relaxed"]
    for row in last.to_dict("records"):
        limit = 1e3 * LARGEST_SURFACE_MISS[row["surface"]]
        if not row["mean"] <= limit:
            raise FitError(
                f"the fitted face misses {scans[row['surface']].source} by {row['mean']:.3g} mm in the "
                f"mean, expected at most {limit:.3g} mm: check that the surface is the {row['surface']} "
                "of the same person in the same pose as the landmarks, and repair intersections"
            )


def _landmark_table(paired: Paired, source: Floats, result: Deformed, noise: float) -> pd.DataFrame:
    points = paired.points
    miss = np.linalg.norm(points.at(result.position) - points.target, axis=1)
    out = left_out(points.source, points.target, noise)
    miss[~points.on_skin] = np.nan
    return pd.DataFrame({"landmark": points.names, "error": 1e3 * miss, "left_out": 1e3 * out})


def _thickness_table(
    columns: Columns, source: Floats, q: Floats, prior: ThicknessPrior | None
) -> pd.DataFrame:
    thickness = 1e3 * columns.thickness(q)
    low, high = thickness.copy(), thickness.copy()
    if prior is not None:
        a, b = prior.interval()
        ratio = columns.thickness(q) / prior.wanted
        low[prior.free] = 1e3 * (ratio * a)[prior.free]
        high[prior.free] = 1e3 * (ratio * b)[prior.free]
    return pd.DataFrame(
        {"node": columns.skin, "inner_node": columns.inner,
         "before": 1e3 * columns.thickness(source), "after": thickness, "low": low, "high": high}
    )  # fmt: skip
