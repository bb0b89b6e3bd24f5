"""Pages of fitted jaws and tongues: distances by colour from three sides, landmarks, masses, fibres."""

from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize

from analysis.figures.style import blank, grid, styled
from emgface.face.surface import boundary_faces, triangles
from emgface.fit.bones import FittedBones, surfaces_of
from emgface.fit.carry import LISTED_STRAIN
from emgface.fit.picture import COLOUR_QUANTILE, MISSING, distance_at
from emgface.fit.report import FitPage, write_fit_page
from emgface.fit.tongue import FittedTongue
from emgface.fit.triangulated import Floats, Surface
from emgface.pictures.body import Body
from emgface.pictures.render import DISPLACEMENT, PICTURE_VIEWS, VIEWS, window_of
from emgface.pictures.stills import marks, paint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIT_CAPTION: Final = (
    "Distance of the fitted surface from that of the person, by colour up to the 98 % quantile. Grey "
    "parts have no counterpart among the given surfaces."
)


def fitted_bones_page(fitted: FittedBones) -> FitPage:
    """Page of a fitted jaw."""
    distance = fitted.distance.rename(columns={"mean": "mean [mm]", "q95": "95 % [mm]"})
    bodies = fitted.bodies.rename(
        columns={"mass before": "mass before [g]", "mass after": "mass after [g]"}
    )
    landmarks = fitted.landmarks.rename(columns={"error": "distance [mm]"})
    parts = surfaces_of(fitted.jaw)
    return FitPage(
        fitted.jaw, bones_summary(fitted), fitted.notes, "Surfaces of the bones",
        distance_figure(parts, dict(fitted.targets), fitted.jaw.attrs["fit_of"], fitted.crosses),
        FIT_CAPTION + " Crosses are the landmarks of the person.",
        {
            "distances": ("Distances from the surfaces", distance),
            "landmarks": ("Landmarks", landmarks),
            "masses": ("Bodies", bodies),
        },
    )  # fmt: skip


def bones_summary(fitted: FittedBones) -> list[str]:
    """Sentences with the main measures of a fitted jaw."""
    said = [
        f"The {row['body']} is {row['mean']:.2f} mm from its surface in the mean, 95 % within "
        f"{row['q95']:.2f} mm."
        for row in fitted.distance[fitted.distance["stage"] == "fitted"].to_dict("records")
    ]
    if not said:
        said.append("Only landmarks were given: the shape between them is that of the source.")
    if len(fitted.landmarks):
        error = fitted.landmarks["error"]
        said.append(
            f"The landmarks are {error.median():.1f} mm from their places (median; largest "
            f"{error.max():.1f} mm)."
        )
    without = [b for b in fitted.bodies["body"] if b not in set(fitted.distance["body"])]
    if without:
        said.append(
            f"No surface was given of {', '.join(without)}: they follow the smooth map of the others, "
            "and their size is not determined by data."
        )
    said.append("Largest forces of muscles are those of the source: no input determines them.")
    return said


def fitted_tongue_page(fitted: FittedTongue) -> FitPage:
    """Page of a fitted tongue."""
    q = fitted.tongue["position"].values
    faces, _ = boundary_faces(fitted.tongue["connectivity"].values.astype(np.int64))
    used, corner = np.unique(triangles(faces, q), return_inverse=True)
    own = Surface(q[used], corner.reshape(-1, 3).astype(np.int64))
    targets = {} if fitted.target is None else {"tongue": fitted.target.surface}
    distance = fitted.distance.assign(covered=100.0 * fitted.distance["covered"]).rename(
        columns={"mean": "mean [mm]", "q95": "95 % [mm]", "largest": "largest [mm]",
                 "covered": "covered [%]"}
    )  # fmt: skip
    fibres = fitted.fibres.assign(change=100.0 * fitted.fibres["change"]).rename(
        columns={"before": "before [mm]", "after": "after [mm]", "change": "change [%]"}
    )
    return FitPage(
        fitted.tongue, tongue_summary(fitted), fitted.notes, "Surface of the tongue",
        distance_figure({"tongue": own}, targets, fitted.tongue.attrs["fit_of"], None), FIT_CAPTION,
        {
            "distances": ("Distances from the surface", distance),
            "quality": ("Elements before and after", fitted.quality.reset_index()),
            "fibres": ("Total lengths of the fibres of every muscle", fibres),
        },
    )  # fmt: skip


def tongue_summary(fitted: FittedTongue) -> list[str]:
    """Sentences with the main measures of a fitted tongue."""
    said: list[str] = []
    for row in fitted.distance[fitted.distance["stage"] == "fitted"].to_dict("records"):
        said.append(
            f"The tongue is {row['mean']:.2f} mm from its surface in the mean, 95 % within "
            f"{row['q95']:.2f} mm."
        )
    if not said:
        said.append("No surface was given: the bones alone carried the tongue.")
    smallest = fitted.quality.loc["smallest scaled Jacobian of hexahedra"]
    said.append(
        f"No corner of an element is inverted; the smallest scaled Jacobian of the hexahedra is "
        f"{smallest['after']:.3f} (before {smallest['before']:.3f})."
    )
    changed = int((np.abs(fitted.fibres["change"]) > LISTED_STRAIN).sum())
    said.append(
        f"The fibres of {changed} of {len(fitted.fibres)} muscles changed their length by more than "
        f"{LISTED_STRAIN:.0%}; largest forces are those of the source."
    )
    return said


@styled
def distance_figure(
    parts: dict[str, Surface], targets: dict[str, Surface], origin: str, crosses: Floats | None
) -> "Figure":
    """Draw surfaces from three sides, coloured by their distance from targets of the same names."""
    points = np.concatenate([p.points for p in parts.values()])
    offset = np.cumsum([0, *(len(p.points) for p in parts.values())])
    triangle = np.concatenate(
        [p.triangles + start for p, start in zip(parts.values(), offset, strict=False)]
    )
    value = np.concatenate([
        distance_at(targets[name], part.points) if name in targets else np.full(len(part.points), np.nan)
        for name, part in parts.items()
    ])  # fmt: skip
    known = np.isfinite(value)
    norm = Normalize(
        0.0, max(float(np.quantile(value[known], COLOUR_QUANTILE)) if known.any() else 0.0, 0.05)
    )
    colours = LinearSegmentedColormap.from_list("", DISPLACEMENT)
    colour = np.asarray(colours(norm(np.nan_to_num(value))))[:, :3]
    colour[~known] = MISSING
    none = np.zeros((0, 3))
    body = Body(len(points), np.zeros((0, 4), dtype=np.int64), none, triangle, colour, len(points))
    figure = blank(8.6, 3.3)
    cast(Any, figure).suptitle(f"{', '.join(parts)} (fitted to {origin} data)")
    panels = grid(figure, 1, len(PICTURE_VIEWS))[0]
    for panel, side in zip(panels, PICTURE_VIEWS, strict=True):
        paint(panel, body, points, VIEWS[side], window_of(points, VIEWS[side], 0.01), colour=colour)
        panel.set_title(side)
        if crosses is not None:
            marks(panel, crosses, VIEWS[side], marker="x", markersize=3.5, color="black")
    bar = cast(Any, figure).colorbar(
        ScalarMappable(norm, colours), ax=np.array(panels), shrink=0.8, pad=0.01, extend="max"
    )
    bar.set_label("distance [mm]")
    return figure


__all__ = [
    "fitted_bones_page",
    "bones_summary",
    "fitted_tongue_page",
    "tongue_summary",
    "write_fit_page",
]
