"""Opening of generated jaws after resection of one side, with the reconstructions and scars of plans.

    python -m benchmarks treatment --only jaw

Simulated data; a research model, not validated on patients.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from benchmarks.report import Row
from emgface.anatomy.jaw.template import template_jaw
from emgface.treatment.jaw_outcomes import deviation_at, opened_by_load, opened_by_muscles
from emgface.treatment.plan import Resection
from emgface.treatment.resection import resect


def jaw() -> list[Row]:
    """Opening of a jaw after resection of one side, by muscles and by a load, with its variants.

    Deviations are those of the incisor to the right at equal gape; at the largest gape, a stiff scar
    deviates less because it opens less.
    """
    whole = template_jaw()
    scars, gape = (0.0, 100.0, 800.0), 5.0

    def deviations(
        drive: Callable[[xr.Dataset], Any] = opened_by_muscles, **given: Any
    ) -> list[float]:
        treated = (resect(whole, Resection(scar_stiffness=k, **given))[0] for k in scars)
        return [deviation_at(drive(one), gape) for one in treated]

    def formatted(values: list[float]) -> str:
        return ", ".join("not reached" if np.isnan(v) else f"{v:+.2f}" for v in values)

    rows: list[Row] = []
    head = f"incisor to the right at {gape:g} mm, scars of 0, 100, 800 N/m"
    by_kind = {kind: deviations(reconstruction=kind) for kind in ("none", "plate", "graft")}
    loaded = {kind: deviations(opened_by_load, reconstruction=kind) for kind in by_kind}
    for kind, values in by_kind.items():
        rows.append((f"{kind}, by muscles: {head}" if kind == "none" else f"{kind}, by muscles",
                     formatted(values) + " mm", "to the left, more with scar",
                     bool((np.diff(values) < 0.0).all()) and values[-1] < 0.0))  # fmt: skip
    for kind, values in loaded.items():
        rows.append((f"{kind}, by a load on the incisor", formatted(values) + " mm",
                     "to the left with scar", values[-1] < 0.0 and values[-1] < values[0]))  # fmt: skip
    right = deviations(side="right")
    apart = float(np.nanmax(np.abs(np.add(right, by_kind["none"]))))
    rows.append(("right side, mirrored", f"{apart:.3f} mm", "0.05 mm", apart < 0.05))
    graft, none = by_kind["graft"], by_kind["none"]
    rows.append(("graft and none without scar", f"{graft[0]:+.2f}, {none[0]:+.2f} mm",
                 "graft deviates less", abs(graft[0]) < abs(none[0])))  # fmt: skip
    rows.append(("graft and none, scar of 800 N/m", f"{graft[2]:+.2f}, {none[2]:+.2f} mm",
                 "reported", True))  # fmt: skip
    silent = deviations(
        lambda one: opened_by_muscles(one, without="bi_ip"), reconstruction="graft", hyoid="fixed"
    )
    hyoid_fixed = deviations(reconstruction="graft", hyoid="fixed")
    rows.append(("graft, fixed hyoid, with and without lateral pterygoids, 800 N/m",
                 f"{hyoid_fixed[2]:+.2f}, {silent[2]:+.2f} mm", "reported", True))  # fmt: skip
    border = deviations(scar_place="border")
    rows.append(
        (
            "none, scars at the lower border of the ramus",
            formatted(border) + " mm",
            "reported",
            True,
        )
    )
    return rows
