"""Published jaw model: the nearest openings to both published ones within bounds of its parameters.

A part of ``python -m benchmarks jaw``; it needs the published model. Differential evolution minimises
the larger distance of the two openings, with the head still and 15 degrees back, from their published
ranges.
"""

from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.optimize import Bounds, differential_evolution

from benchmarks.jaw_posterior import PRIOR, WANTED, changed, openings_of
from benchmarks.jaw_variants import published
from benchmarks.report import say
from emgface.errors import EmgfaceError
from sim.errors import SimulationError

IRRELEVANT = "curved path", "tone %"
"""Parameters that an opening does not depend on, or that name the variant."""
GENERATIONS, POPULATION = 16, 32
SEED = 5


def miss(found: dict[str, float]) -> float:
    """Larger distance of the two openings from their published ranges [mm]."""
    far = (max(WANTED[n][0] - found[n], found[n] - WANTED[n][1]) for n in ("open", "head back"))
    return max(0.0, *far)


def nearest(
    jaw: xr.Dataset, bounds: dict[str, tuple[float, float]], generations: int = GENERATIONS
) -> tuple[dict[str, float], dict[str, float], int]:
    """Parameters with the smallest miss, their openings [mm] and the number of sets."""
    names, tried = list(bounds), list[tuple[float, dict[str, float], dict[str, float]]]()
    others = {n: 0.0 for n in PRIOR if n not in bounds}

    def of(x: np.ndarray) -> float:
        own = dict(zip(names, map(float, x), strict=True))
        try:
            found = openings_of(changed(jaw, others | own), others | own)
        except (EmgfaceError, SimulationError) as error:
            say(f"{own}: {error}")
            return 1e3
        tried.append((miss(found), own, found))
        return tried[-1][0]

    def told(_x: np.ndarray, convergence: Any) -> None:
        best = min(tried, key=lambda one: one[0])
        say(f"{len(tried)} sets: miss {best[0]:.2f} mm, {best[2]}")

    size = max(1, POPULATION // len(names))
    differential_evolution(
        of,
        Bounds(*np.array(list(bounds.values())).T),
        maxiter=generations,
        popsize=size,
        seed=SEED,
        polish=False,
        init="sobol",
        tol=0.0,
        callback=told,
    )
    _, own, found = min(tried, key=lambda one: one[0])
    return own, found, len(tried)


def openings() -> pd.DataFrame:
    """Nearest openings within the prior of the posterior, for each condylar path [mm]."""
    bounds = {n: b for n, b in PRIOR.items() if n not in IRRELEVANT}
    rows = list[dict[str, Any]]()
    for condyle in ("planar", "curved"):
        own, found, n = nearest(published("larynx", condyle=condyle), bounds)
        rows.append(
            {"condyles": condyle, "sets": n, "miss": round(miss(found), 2)}
            | {k: round(x, 1) for k, x in found.items()}
            | {k: f"{x:.3g}" for k, x in own.items()}
        )
    return pd.DataFrame(rows).set_index("condyles").T.reset_index(names="nearest set")
