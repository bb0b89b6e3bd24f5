"""Published jaw model: motions that its authors' program recorded, compared with those of this package.

Part of ``python -m benchmarks jaw``; it needs the published model and the recorded motions.
"""

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.jaw_published import SHARED, published
from emgface.anatomy.jaw.run import simulate_jaw
from emgface.anatomy.jaw.series import Excitation, ramps, read_probes

TO_MM = np.array([-1e3, -1e3, 1e3])


MARKERS = {
    "lowerincisor": "lower_incisor",
    "ltmj": "condyle_L",
    "rtmj": "condyle_R",
    "lbite": "bite_L",
    "rbite": "bite_R",
    "hyoidRef": "hyoid",
    "thyroidRef": "thyroid",
}


INTEGRATORS = {
    "BackwardEuler": sim.LinearlyImplicitEuler,
    "ConstrainedBackwardEuler": sim.LinearlyImplicitEuler,
}
FINEST = 1e-3  # s, for motions that the other program integrated with shorter explicit steps


def here(name: str) -> str:
    """Name in this package of a muscle or group of the other program."""
    return name if name.startswith("bi_") else name[1:] + {"l": "_L", "r": "_R"}[name[0]]


def reference() -> pd.DataFrame:
    """Largest distance of a marker from every recorded motion, while it moves and at the end [mm]."""
    folder, rows = SHARED / "artisynth_reference" / "jaw", list[dict[str, Any]]()
    models = {v: published(v, values="program") for v in ("fixed", "larynx")}
    for path in sorted(folder.glob("*.npz")):
        case = json.loads(path.with_suffix(".json").read_text())
        if "_CBE" not in path.stem and case["variant"] == "fixed":
            continue  # its plain backward Euler lets condyles leave their planes
        rows.append({"case": path.stem, **compared(models[case["variant"]], case, path)})
    return pd.DataFrame(rows)


def driven(case: dict[str, Any], duration: float) -> tuple[Excitation, str | None]:
    """Excitations of a recorded motion, and the side of its morsel."""
    changes = " ".join(case.get("changes_against_the_model_file", []))
    if match := re.search(r"jaw_larynx/(probes/\w+)", changes):
        folder = SHARED / "artisynth_models" / "jaw_larynx" / match[1]
        eaten = re.match(r"(left|right) bolus active", case.get("food_bolus", ""))
        return read_probes(folder, duration=duration), eaten[1][0].upper() if eaten else None
    drive = dict[str, list[tuple[float, float]]]()
    for e in case["excitations"]:
        start, ramp = e["start_s"], e["ramp_s"]
        corners = [(start, 0.0), (start + ramp, e["amax"])] if ramp else [(0.0, e["amax"])]
        drive[here(e["target"])] = corners
    return ramps(drive or {"bi_close": [(0.0, 0.0)]}), None


def compared(jaw: xr.Dataset, case: dict[str, Any], path: Path) -> dict[str, Any]:
    """Distances from one recorded motion [mm], and the processor time per simulated second."""
    with np.load(path) as arrays:
        t, theirs = arrays["t"], arrays["marker_pos_mm"]
    excitation, morsel = driven(case, float(t[-1]))
    step = case["h_s"] if case["integrator"] in INTEGRATORS else max(case["h_s"], FINEST)
    began = time.process_time()
    motion = simulate_jaw(
        jaw,
        excitation,
        duration=float(t[-1]),
        step=step,
        output=float(t[1] - t[0]),
        morsel=morsel,
        check=False,
    )
    spent = time.process_time() - began
    known = [(k, MARKERS[m]) for k, m in enumerate(case["markers"]) if m in MARKERS]
    known = [(k, m) for k, m in known if m in motion["marker"]]
    ours = motion["position"].sel(marker=[m for _, m in known]).transpose("time", "marker", "axis")
    n = min(motion.sizes["time"], len(t))
    apart = np.linalg.norm(ours.values[:n] * TO_MM - theirs[:n, [k for k, _ in known]], axis=2)
    worst = apart.max(axis=1)
    return {
        "step ms": 1e3 * case["h_s"],
        "our step ms": 1e3 * step,
        "moving": f"{worst.max():.2g}",
        "at the end": f"{worst[-1]:.2g}",
        "times real time": round(float(t[-1]) / spent, 1),
    }
