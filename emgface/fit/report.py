"""Page of a fit: maps from three sides, landmarks left out, quality, fibres, mass and provenance."""

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from emgface.files import write_text
from emgface.fit.carry import LISTED_STRAIN
from emgface.fit.columns import THICKNESS_SPREAD
from emgface.fit.person import Fitted
from emgface.fit.picture import fit_figure
from emgface.pictures.page import environment, laid_out, policy, style, svg_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIT_STAGES = {
    "similarity": "after the similarity",
    "spline": "thin-plate spline",
    "mechanics": "spline by mechanics",
    "surfaces": "surfaces by mechanics",
    "relaxed": "elements relaxed",
}


def write_report(fitted: Fitted, path: str | os.PathLike[str]) -> Path:
    """Write the page (HTML without network requests); DataError if it cannot be written."""
    return write_fit_page(fitted_face_page(fitted), path)


def write_fit_page(page: "FitPage", path: str | os.PathLike[str]) -> Path:
    """Write the page of any fitted model; DataError if it cannot be written."""
    write_text(Path(path), render_fit(page))
    return Path(path)


@dataclass(frozen=True)
class FitPage:
    """Contents of the page of a fitted model."""

    model: xr.Dataset
    summary: Sequence[str]
    notes: Sequence[str]
    title: str  #: of the figure
    figure: "Figure"
    caption: str
    tables: Mapping[str, tuple[str, pd.DataFrame]]  #: title and table by identifier


def fitted_face_page(fitted: Fitted) -> FitPage:
    """Page of a fitted face."""
    return FitPage(
        fitted.face, summary(fitted), fitted.notes, "Surface and thickness", fit_figure(fitted),
        "Colours end at the 98 % quantile. Crosses are the landmarks of the person. Grey skin has no "
        "counterpart on the scan.", _tables(fitted),
    )  # fmt: skip


def render_fit(page: FitPage) -> str:
    """Render the page."""
    attributes = page.model.attrs
    inputs = json.loads(attributes["fit_inputs"])
    sources = pd.DataFrame({"input": list(inputs), "file and SHA-256": list(inputs.values())})
    tables = {**page.tables, "provenance": ("Provenance", sources)}
    values: dict[str, Any] = {
        "title": str(attributes["name"]),
        "origin": str(attributes["fit_of"]),
        "summary": list(page.summary),
        "notes": list(page.notes),
        "shown": page.title,
        "caption": page.caption,
        "figure": svg_of(page.figure, "maps", page.title),
        "tables": {key: _cells(title, t) for key, (title, t) in tables.items() if len(t)},
        "style": style(),
        "policy": policy(""),
    }
    return environment("emgface.fit").get_template("fit.html").render(**values)


def summary(fitted: Fitted) -> list[str]:
    """Sentences with the main measures."""
    quality = fitted.quality
    said: list[str] = []
    last = fitted.distance[fitted.distance["stage"] == "relaxed"]
    for row in last.to_dict("records"):
        said.append(
            f"The {row['surface']} is {row['mean']:.2f} mm from its surface in the mean, 95 % within "
            f"{row['q95']:.2f} mm; the surface covers {row['covered']:.0%} of it."
        )
    if not len(last):
        said.append(
            "Only landmarks were given: the shape between them is that of the source face (of a "
            "generated one, with the measures that the landmarks suggest), which bends only as far as "
            "their noise cannot explain."
        )
    smallest = "smallest scaled Jacobian of hexahedra"
    said.append(
        f"No corner of an element is inverted; the smallest scaled Jacobian of the hexahedra is "
        f"{quality.loc[smallest, 'after']:.3f} (before {quality.loc[smallest, 'before']:.3f})."
    )
    out = fitted.landmarks["left_out"].median()
    said.append(f"A landmark left out is predicted by the others to {out:.1f} mm (median).")
    if fitted.prior is not None:
        said.append(
            "No data determine the thickness of the tissue where neither an inner surface nor bone was "
            f"given. It is that of the source face times the scale of the landmarks, with a standard "
            f"deviation of {THICKNESS_SPREAD:.0%} from published norms; the interval in the figure "
            "contains 90 % of people of such a group."
        )
    changed = fitted.fibres[np.abs(fitted.fibres["change"]) > LISTED_STRAIN]
    said.append(
        f"{len(changed)} of {len(fitted.fibres)} fibres differ in length from the affine prediction by "
        f"more than {LISTED_STRAIN:.0%}."
    )
    return said


def _tables(fitted: Fitted) -> dict[str, tuple[str, pd.DataFrame]]:
    distance = fitted.distance.assign(
        stage=fitted.distance["stage"].map(FIT_STAGES), covered=100.0 * fitted.distance["covered"]
    ).rename(columns={"mean": "mean [mm]", "q95": "95 % [mm]", "largest": "largest [mm]",
                      "covered": "covered [%]"})  # fmt: skip
    landmarks = fitted.landmarks.rename(
        columns={"error": "distance [mm]", "left_out": "left out [mm]"}
    )
    fibres = fitted.fibres.assign(change=100.0 * fitted.fibres["change"]).rename(
        columns={"before": "before [mm]", "predicted": "affine prediction [mm]",
                 "after": "after [mm]", "change": "change [%]"}
    )  # fmt: skip
    return {
        "distances": ("Distances from the surfaces by stage", distance),
        "quality": ("Elements before and after", fitted.quality.reset_index()),
        "landmarks": ("Landmarks", landmarks),
        "fibres": ("Lengths of the fibres", fibres),
    }


def _cells(title: str, frame: pd.DataFrame) -> dict[str, Any]:
    heads = [str(name) for name in frame.columns]
    numbers = [frame[name].dtype.kind in "fi" for name in frame.columns]
    return laid_out(
        title, heads, numbers, [[_text(v) for v in row] for row in frame.itertuples(index=False)]
    )


def _text(value: Any) -> str:
    if isinstance(value, float | np.floating):
        if not np.isfinite(value):
            return "–"
        return f"{value:.0f}" if value == round(value) and abs(value) >= 1 else f"{value:.3g}"
    return str(value)
