"""Template as a face model: a checked Dataset for given measures and a resolution."""

from collections.abc import Callable, Mapping
from dataclasses import asdict

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import FaceError
from emgface.face.model import build_face
from emgface.face.parts import Arch, Bundle, Fibre
from emgface.face.quality import element_centres
from emgface.face.template.arches import arches_behind
from emgface.face.template.attachments import (
    face_marker_positions,
    fixed_nodes,
    lip_marker_nodes,
    lip_opening_nodes,
    lip_surfaces,
)
from emgface.face.template.calibrate import calibrated_surfaces
from emgface.face.template.grid import Grid, make_grid
from emgface.face.template.measures import Measures, least_usual
from emgface.face.template.muscles import (
    MUSCLE_RADIUS,
    CourseShift,
    Muscles,
    Ring,
    draw_course_shift,
    place_muscles,
)
from emgface.face.template.surface import Surfaces
from emgface.face.template.volunteers import preset_measures, random_measures

Floats = NDArray[np.float64]
Warp = Callable[[Floats], Floats]

_LARGEST_SKIN_SHARE = 0.35  #: largest fraction of the skin in thin tissue
_MIDLINE = 5e-3  #: width over which the two sides of an asymmetric face blend [m]
_STREAM = 4  #: random stream of faces, separate from other properties of the same volunteer
_COURSES = 5  #: random stream of muscles
_ATTEMPTS = 100


def template_face(
    *,
    resolution: str | int | Grid = "medium",
    measures: Measures | Mapping[str, float] | None = None,
    preset: str = "adult",
    seed: int | None = None,
    radius: float = MUSCLE_RADIUS,
    courses: CourseShift | None = None,
    rings: Mapping[str, Ring] | None = None,
    name: str = "",
) -> xr.Dataset:
    """Generate a lower face from the eyes to the chin, with ten muscle pairs and the markers.

    `resolution` is "coarse" (576 elements), "medium" (2448), "fine" (6480), an approximate number
    of elements, or a grid, for example from `emgface.face.template.grid.refined_grid`. `measures`
    [m] are all measures, or some that replace those of the preset or of the random volunteer;
    `preset` is a group of people (`emgface.face.template.volunteers.PRESETS`), of which `seed`
    draws a member; without it the measures are the means of the group. Tissue within `radius` [m]
    of a fibre is muscle, and `courses` are the deviations of the muscle courses of a person from
    those of the template; `rings` replace parts of orbicularis oris (OOP, OOM) by those of another
    depth, place or with gaps (`emgface.face.template.muscles.parse_ring`).

    The result is of schema face_model, origin "generated", with the measures [m] as attributes. The
    face is exactly symmetric unless `width_asymmetry` or `droop` is specified. The frame has y = 0
    at the tragia and z = 0 between the lips. Raises FaceError if a measure is impossible, a name
    unknown, the resolution out of range, a muscle outside the tissue, or the face fails
    `emgface.face.validity.check_face`.

    Examples
    --------
    >>> face = template_face(resolution="coarse", measures={"mouth_width": 0.052})
    >>> face.attrs["origin"], face.sizes["element"]
    ('generated', 576)
    """
    if isinstance(measures, Measures):
        if seed is not None:
            raise FaceError(
                "both a full set of measures and a seed are specified, expected one of "
                "them: pass a mapping to replace single measures of a volunteer"
            )
        own = measures
    else:
        drawn = preset_measures(preset) if seed is None else random_measures(seed, preset=preset)
        own = drawn.with_values(measures or {})
    if not radius > 0:
        raise FaceError(f"the muscle radius is {radius} m, expected a positive length")

    grid = make_grid(resolution)
    if not name:
        name = f"template face ({preset}" + ("" if seed is None else f", volunteer {seed}") + ")"
    attrs = {"muscle_radius": radius, "preset": preset, "seed": "" if seed is None else seed}
    try:
        return _built(own, grid, radius, (courses, rings), name, attrs)
    except FaceError as error:
        if any(measure in str(error) for measure in asdict(own)):
            raise
        raise FaceError(
            f"{least_usual(own)} does not yield a valid face with the other measures "
            f"({error}): choose a value closer to the mean"
        ) from error


def _built(
    own: Measures,
    grid: Grid,
    radius: float,
    variant: tuple[CourseShift | None, Mapping[str, Ring] | None],
    name: str,
    attrs: Mapping[str, str | int | float],
) -> xr.Dataset:
    """Assemble surfaces, muscles of a variant (courses, rings), attachments, markers and arches."""
    courses, rings = variant
    surfaces = calibrated_surfaces(own)
    position = node_positions(surfaces, grid)
    muscles = place_muscles(surfaces, grid, position, radius=radius, shift=courses, rings=rings)
    if rings:
        attrs = {**attrs, **{f"ring_{muscle}": ring.description for muscle, ring in rings.items()}}
    if courses is not None:
        attrs = {**attrs, **{f"course_shift_{k}": v for k, v in muscles.shifted.items()}}
    face_markers = face_marker_positions(surfaces)
    arches = arches_behind(surfaces, own)
    if own.width_asymmetry or own.droop:
        warp = _asymmetry(own, surfaces.mouth_half_width)
        muscles = _warped(muscles, element_centres(position, grid.connectivity), warp)
        position, face_markers = warp(position), warp(face_markers)
        # Teeth are within a millimetre of the tissue and are deformed with it.
        arches = tuple(Arch(a.bone, warp(a.points), a.triangles) for a in arches)
    return build_face(
        position=position,
        connectivity=grid.connectivity,
        layer=grid.layer,
        fixed=fixed_nodes(surfaces, grid),
        fibres=muscles.fibres,
        bundles=muscles.bundles,
        marker_node=lip_marker_nodes(grid),
        face_marker_position=face_markers,
        lip_opening_node=lip_opening_nodes(grid),
        facets=lip_surfaces(grid, position, 0.5 * own.mouth_width),
        arches=arches,
        name=name,
        origin="generated",
        source="emgface.face.template",
        attrs={
            **attrs,
            "rays": grid.rays,
            "rings": grid.n_rings,
            **{f"measure_{key}": value for key, value in asdict(own).items()},
        },
    )


def volunteer_face(
    seed: int,
    index: int,
    *,
    resolution: str | int | Grid = "medium",
    preset: str = "adult",
    spread: float = 1.0,
    asymmetry: float = 0.0,
    course_shift: float = 0.0,
) -> tuple[xr.Dataset, Measures]:
    """Draw the face of one volunteer of a set.

    `seed` is that of the set, and `index` is 1 for the first volunteer; equal numbers result in the
    same person at every resolution. `resolution` and `preset` are those of
    `template_face`. `spread` and `asymmetry` are factors, at least 0, on the published standard
    deviations and on those of the differences between the sides
    (`emgface.face.template.volunteers.ASYMMETRY`); `course_shift` is the standard deviation of the
    random shift of the ends of the muscles along the skin [m]. Returns the face, with seed, index
    and measures [m] as attributes, and the measures. Raises FaceError as `template_face` and
    `emgface.face.template.volunteers.random_measures`.

    Examples
    --------
    >>> face, measures = volunteer_face(2017, 1, resolution="coarse")
    >>> face.attrs["measure_mouth_width"] == measures.mouth_width
    True
    """
    measures = _possible(seed, index, preset=preset, spread=spread, asymmetry=asymmetry)
    face = template_face(
        resolution=resolution,
        measures=measures,
        preset=preset,
        courses=(
            draw_course_shift(np.random.default_rng((seed, index, _COURSES)), course_shift)
            if course_shift
            else None
        ),
        name=f"template face ({preset}, volunteer {index} of seed {seed})",
    )
    face.attrs |= {"seed": seed, "index": index, "spread": spread, "asymmetry": asymmetry}
    return face, measures


def _possible(seed: int, index: int, *, preset: str, spread: float, asymmetry: float) -> Measures:
    """Draw measures until a surface can be built."""
    if seed < 0 or index < 0:
        raise FaceError(f"seed and index are {seed} and {index}, expected numbers >= 0")
    attempt = 0
    while True:
        measures = random_measures(
            (seed, index, _STREAM, attempt), preset=preset, spread=spread, asymmetry=asymmetry
        )
        attempt += 1
        try:
            calibrated_surfaces(measures)
        except FaceError:
            if attempt == _ATTEMPTS:
                raise
        else:
            return measures


def shaped_positions(measures: Measures, grid: Grid) -> Floats:
    """Positions (nodes, 3) of an asymmetric face [m]; errors as of `calibrated_surfaces`."""
    return constructed_positions(calibrated_surfaces(measures), grid)


def constructed_positions(surfaces: Surfaces, grid: Grid) -> Floats:
    """Positions (nodes, 3) of the face of these surfaces, with the asymmetry of their measures [m]."""
    position, own = node_positions(surfaces, grid), surfaces.measures
    if own.width_asymmetry or own.droop:
        position = _asymmetry(own, surfaces.mouth_half_width)(position)
    return position


def node_positions(surfaces: Surfaces, grid: Grid) -> Floats:
    """Positions (nodes, 3) of the symmetric face [m]."""
    q, lip = grid.left_rays
    skin, inner = surfaces.sheets(q, lip, grid.s)
    thickness = np.linalg.norm(skin - inner, axis=-1)
    share = np.minimum(surfaces.measures.skin_thickness / thickness, _LARGEST_SKIN_SHARE)
    return grid.positions(skin, inner, share)


def _asymmetry(m: Measures, corner: float) -> Warp:
    """Widen the right side, narrow the left side, and lower the left mouth corner."""

    def warp(points: Floats) -> Floats:
        x, y, z = points.T
        wider = 0.5 * m.width_asymmetry * (np.hypot(x, _MIDLINE) - _MIDLINE)
        side = 0.5 * (1.0 + np.tanh(-x / (0.5 * corner)))
        near = np.exp(-((z / 0.022) ** 2) - ((np.abs(x) - corner) / 0.030) ** 2)
        return np.column_stack([x + wider, y, z - m.droop * side * near])

    return warp


def _warped(muscles: Muscles, centres: Floats, warp: Warp) -> Muscles:
    """Transform fibres and directions by a deformation."""
    step = 1e-6
    bundles: list[Bundle] = []
    for bundle in muscles.bundles:
        at, along = centres[bundle.element], step * bundle.direction
        direction = warp(at + along) - warp(at - along)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        bundles.append(Bundle(bundle.muscle, bundle.element, direction, bundle.weight))
    fibres = [Fibre(f.muscle, warp(f.position)) for f in muscles.fibres]
    return Muscles(fibres, bundles)
