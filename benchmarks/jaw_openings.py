"""Published jaw model: parameters within their prior with the nearest outcomes to the published ones.

Parts of ``python -m benchmarks jaw``; they need the published model. Differential evolution minimises
the larger distance of the two openings, with the head still and 15 degrees back, from their published
ranges, or the largest excess of all outcomes. Samples of the prior rarely come near: its parameters are
twelve.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import Bounds, differential_evolution

from benchmarks.jaw_posterior import PRIOR, WANTED, changed, excess, openings_of, outcomes_of
from benchmarks.jaw_variants import published
from benchmarks.report import say
from emgface.errors import EmgfaceError
from sim.errors import SimulationError

IRRELEVANT = "curved path", "tone %"
"""Parameters that an opening does not depend on, or that name the variant."""
GENERATIONS, GENERATIONS_OF_ALL, POPULATION = 16, 19, 32
SEED = 5


def miss(found: dict[str, float]) -> float:
    """Larger distance of the two openings from their published ranges [mm]."""
    far = (max(WANTED[n][0] - found[n], found[n] - WANTED[n][1]) for n in ("open", "head back"))
    return max(0.0, *far)


Outcomes = Callable[[dict[str, float]], dict[str, float]]


def nearest(
    outcomes: Outcomes,
    distance: Callable[[dict[str, float]], float],
    names: list[str],
    generations: int = GENERATIONS,
) -> tuple[dict[str, float], dict[str, float], int]:
    """Parameters with the smallest distance, their outcomes, and the number of sets."""
    tried = list[tuple[float, dict[str, float], dict[str, float]]]()
    others = {n: 0.0 for n in PRIOR if n not in names}

    def of(x: np.ndarray) -> float:
        own = others | dict(zip(names, map(float, x), strict=True))
        try:
            found = outcomes(own)
        except (EmgfaceError, SimulationError) as error:
            say(f"{own}: {error}")
            return 1e3
        tried.append((distance(found), own, found))
        return tried[-1][0]

    def told(_x: np.ndarray, convergence: Any) -> None:
        far, _, found = min(tried, key=lambda one: one[0])
        say(f"{len(tried)} sets: {far:.2f}, " + ", ".join(f"{k} {x:.3g}" for k, x in found.items()))

    differential_evolution(
        of,
        Bounds(*np.array([PRIOR[n] for n in names]).T),
        maxiter=generations,
        popsize=max(1, POPULATION // len(names)),
        seed=SEED,
        polish=False,
        init="sobol",
        tol=0.0,
        callback=told,
    )
    _, own, found = min(tried, key=lambda one: one[0])
    return own, found, len(tried)


def openings() -> pd.DataFrame:
    """Nearest openings within the prior, for each condylar path [mm]."""
    names, rows = [n for n in PRIOR if n not in IRRELEVANT], list[dict[str, Any]]()
    for condyle in ("planar", "curved"):
        jaw = published("larynx", condyle=condyle)
        own, found, n = nearest(lambda x, jaw=jaw: openings_of(changed(jaw, x), x), miss, names)
        rows.append(
            {"condyles": condyle, "sets": n, "miss": round(miss(found), 2)}
            | {k: round(x, 1) for k, x in found.items()}
            | {k: f"{own[k]:.3g}" for k in names}
        )
    return pd.DataFrame(rows).set_index("condyles").T.reset_index(names="nearest set")


def together() -> pd.DataFrame:
    """Nearest outcomes of all tasks within the prior, condyles on the curved path [mm].

    The distance is that of the posterior, the largest excess of an outcome over its published range in
    units of 10 % of the outcome.
    """
    jaw, names = published("larynx", condyle="curved"), [n for n in PRIOR if n != "curved path"]
    own, found, n = nearest(
        lambda x: outcomes_of(jaw, x), lambda f: max(excess(f).values()), names, GENERATIONS_OF_ALL
    )
    far = excess(found)
    rows: list[dict[str, Any]] = [
        {
            "nearest set": k,
            "published or prior": "{:g} to {:g}".format(*(WANTED | PRIOR)[k]),
            "value": f"{(found | own)[k]:.3g}",
            "excess": f"{far[k]:.2f}" if k in far else "",
        }
        for k in (*WANTED, *names)
    ]
    return pd.DataFrame([*rows, {"nearest set": "sets", "value": str(n)}]).fillna("")
