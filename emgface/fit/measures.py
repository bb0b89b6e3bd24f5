"""Measures of a fit: distances between surfaces, quality of the elements, mass."""

import numpy as np
import pandas as pd
import xarray as xr

from emgface.face.check import TISSUE_DENSITY
from emgface.face.quality import element_quality, is_wedge
from emgface.fit.targets import Target
from emgface.fit.triangulated import Floats, Surface

#: largest number of points of a surface whose distances are measured
MOST_MEASURED_POINTS = 200_000


def distances(target: Target, q: Floats) -> dict[str, float]:
    """Mean, 95 % and largest distance [mm] of a sheet and its target, and the covered share [1].

    Points of the sheet are compared with the target and, if it attracts the whole sheet, those of the
    target with the sheet. Points whose nearest point lies on an open edge are not covered and omitted:
    a scan may have holes, or extend beyond the face.
    """
    moving = target.sheet.at(q)
    if target.only is None:
        first = _of_points(target.surface, *_some(moving))
        second = _of_points(moving, *_some(target.surface))
        d = np.concatenate([first[0], second[0]])
        w = np.concatenate([first[1], second[1]])
        mean = 0.5 * sum(float(np.average(a, weights=b)) for a, b, _ in (first, second) if len(a))
        covered = first[2]
    else:
        d, w, covered = _of_points(target.surface, q[target.only], np.ones(len(target.only)))
        mean = float(np.average(d, weights=w)) if len(d) else np.nan
    if not len(d):
        return {"mean": np.nan, "q95": np.nan, "largest": np.nan, "covered": 0.0}
    order = np.argsort(d)
    share = np.cumsum(w[order])
    q95 = float(d[order][np.searchsorted(share, 0.95 * share[-1])])
    return {
        "mean": 1e3 * mean,
        "q95": 1e3 * q95,
        "largest": 1e3 * float(d.max()),
        "covered": covered,
    }


def _some(surface: Surface) -> tuple[Floats, Floats]:
    """Samples of a surface and their areas, `MOST_MEASURED_POINTS` at equal steps of a larger one."""
    points, _, weight = surface.samples
    step = -(-len(points) // MOST_MEASURED_POINTS)
    return points[::step], weight[::step]


def _of_points(surface: Surface, points: Floats, weight: Floats) -> tuple[Floats, Floats, float]:
    near = surface.nearest(points)
    use = ~surface.at_border(near) if len(surface.open_edges) else np.ones(len(points), dtype=bool)
    return near.distance[use], weight[use], float(weight[use].sum() / weight.sum())


def quality_rows(before: xr.Dataset, after: xr.Dataset) -> pd.DataFrame:
    """Quality of the elements, volume and mass of both faces."""
    columns = {}
    for name, face in (("before", before), ("after", after)):
        quality = element_quality(face["position"].values, face["connectivity"].values)
        wedge = is_wedge(face["connectivity"].values)
        rows: dict[str, float] = {}
        for kind, chosen in (("hexahedra", ~wedge), ("wedges", wedge)):
            if not chosen.any():
                continue
            s = quality.scaled_jacobian[chosen]
            rows[f"smallest scaled Jacobian of {kind}"] = float(s.min())
            rows[f"1 % of scaled Jacobian of {kind}"] = float(np.quantile(s, 0.01))
            rows[f"{kind} below 0.1"] = int((s < 0.1).sum())
            rows[f"{kind} below 0.2"] = int((s < 0.2).sum())
        rows["inverted corners and points"] = int((quality.smallest_det <= 0).sum())
        rows["volume [cm3]"] = 1e6 * float(quality.volume.sum())
        rows["mass [g]"] = 1e3 * TISSUE_DENSITY * float(quality.volume.sum())
        columns[name] = rows
    return pd.DataFrame(columns).rename_axis("quantity")
