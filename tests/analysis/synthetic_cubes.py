"""Small cubes with known scores, for the tests of the analysis."""

import numpy as np
import xarray as xr

from analysis.cube import build_cube
from analysis.trial import Trial

ABSENT = (("v1", "B", 2, "act_3"), ("v2", "A", 1, "act_rel"))
FAILED = (("v2", "A", 1, "act_all"), ("v2", "A", 2, "act_all"), ("v2", "B", 2, "act_all"))
MARKERS = ("corner_left", "upper_lateral_left", "lower_lateral_left")


def scores(seed: int, markers: tuple[str, ...] = MARKERS, **attrs: object) -> xr.Dataset:
    rng = np.random.default_rng(seed)
    n = len(markers)
    return xr.Dataset(
        {
            "rho": ("marker", rng.uniform(-1, 1, n), {"units": "1"}),
            "amplitude_ratio": ("marker", rng.uniform(0, 2, n), {"units": "1"}),
            "rmse": ("marker", rng.uniform(0, 5e-3, n), {"units": "m"}),
            "reason": ("marker", np.full(n, "", dtype="U40")),
            "shift": ((), rng.normal(0, 0.02), {"units": "s"}),
        },
        coords={"marker": list(markers)},
        attrs={"origin": "simulated", "form": "consistent", **attrs},
    )


class Inverted(Exception):
    """Represents a failure of the mechanics."""


def results() -> list[Trial]:
    """2 volunteers x 2 instructions x 2 repetitions x 3 strategies, 3 failed, 2 absent."""
    made: list[Trial] = []
    seed = 0
    for volunteer in ("v1", "v2"):
        for instruction in ("A", "B"):
            for repetition in (1, 2):
                for strategy in ("act_all", "act_3", "act_rel"):
                    seed += 1
                    label = (volunteer, instruction, repetition, strategy)
                    if label in ABSENT:
                        continue
                    if label in FAILED:
                        error = Inverted(f"element {seed} inverted")
                        made.append(
                            Trial.failed(*label, error, sigma_max=240e3, origin="simulated")
                        )
                        continue
                    scored = scores(seed)
                    if label == ("v1", "A", 1, "act_all"):
                        scored["rho"][1] = np.nan
                        scored["amplitude_ratio"][1] = 0.0
                        scored["reason"][1] = "the simulated marker does not move"
                    made.append(
                        Trial(*label, scored, sigma_max=300e3, steps=160, run_time=1.5 * seed)
                    )
    return made


def cube() -> xr.Dataset:
    return build_cube(results())
