"""Jaw model: comparison with another simulator, effect of its parameters, error and cost of steps.

    python -m benchmarks jaw --part reference      # table of docs/jaw.md; needs the published model
    python -m benchmarks jaw --part damping        # muscle damping in chewing; needs it, too
    python -m benchmarks jaw --part variants       # outcomes of every variant; needs it, too
    python -m benchmarks jaw --part causes         # under changes of one setting; needs it, too
    python -m benchmarks jaw --part cost           # chewing: error and time over the step; needs it, too
    python -m benchmarks jaw --part parameters --samples 60 --out FOLDER    # needs it, too
    python -m benchmarks jaw --part steps          # the generated jaw: error and time over the step
    python -m benchmarks jaw --part stability      # the generated jaw under bad parameters
    python -m benchmarks jaw --part extremes       # and with extreme measures
    python -m benchmarks jaw --part emg            # and driven by simulated sEMG

Motions are simulated. "reference" repeats every recorded motion with the recorded step and the values
of that program; "parameters" draws parameters that publications do not state, and compares the outcome
of the tasks with the published one; it continues a table in the folder. Times are processor times,
kernels warm.
"""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks import jaw_generated, jaw_variants
from benchmarks.jaw_variants import PROBES, SHARED, published
from benchmarks.report import finish
from emgface.anatomy.jaw.outcomes import displacement, separation
from emgface.anatomy.jaw.run import run_task, simulate_jaw
from emgface.anatomy.jaw.series import Excitation, ramps, read_probes
from emgface.anatomy.jaw.tasks import TASKS, Task

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


def compared(jaw: xr.Dataset, case: dict[str, Any], path: Path) -> dict[str, Any]:
    """Distances from one recorded motion [mm], and the processor time per simulated second."""
    with np.load(path) as arrays:
        t, theirs = arrays["t"], arrays["marker_pos_mm"]
    drive = dict[str, list[tuple[float, float]]]()
    for e in case["excitations"]:
        start, ramp = e["start_s"], e["ramp_s"]
        corners = [(start, 0.0), (start + ramp, e["amax"])] if ramp else [(0.0, e["amax"])]
        drive[here(e["target"])] = corners
    excitation, morsel = ramps(drive or {"bi_close": [(0.0, 0.0)]}), None
    if "probes" in path.stem:
        excitation = read_probes(
            SHARED / "artisynth_models" / "jaw_larynx" / "probes" / "rightchew"
        )
        morsel = "R"
    step = case["h_s"] if case["integrator"] in INTEGRATORS else max(case["h_s"], FINEST)
    began = time.process_time()
    motion = simulate_jaw(
        jaw, excitation, duration=float(t[-1]), step=step, output=float(t[1] - t[0]), morsel=morsel
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


PRIOR = {
    "passive": (0.005, 0.03),
    "damping": (0.5, 15.0),
    "tone": (0.0, 1.5e-3),
    "body": (1.0, 3.0),
    "hyoid": (0.0, 8.0),
}
"""Ranges of passive fraction, muscle damping [N s/m], tone of closers, factor on the damping of bodies,
and displacement of the hyoid at rest downwards and backwards [mm]."""
WANTED = {
    "rest": (3.0, 5.0),
    "open": (35.0, 38.0),
    "head back": (50.0, 51.0),
    "chew down": (18.1, 22.1),
    "chew back": (5.2, 6.4),
    "chew side": (2.07, 2.53),
}
"""Published outcomes [mm], those of chewing with 10 % (Stavness et al. 2006; Hannam et al. 2008)."""


def outcomes_of(jaw: xr.Dataset, tone: float) -> dict[str, float]:
    """Outcomes of rest, opening and chewing [mm]."""
    rest = run_task(jaw, TASKS["rest"], duration=1.5)
    found = {"rest": float(separation(rest)[-1])}
    for name, task in (("open", "open"), ("head back", "open_head")):
        found[name] = float(separation(run_task(jaw, TASKS[task], duration=0.8)).max())
    series = read_probes(PROBES)
    toned = Excitation(series.time, {**series.values, "bi_close": np.full(len(series.time), tone)})
    chew = displacement(run_task(jaw, Task("", 0.45), excitation=toned), "lower_incisor")
    k = int(np.argmin(chew[:, 2]))
    return found | {
        "chew down": -chew[k, 2],
        "chew back": -chew[k, 1],
        "chew side": abs(chew[k, 0]),
    }


def parameters(samples: int, out: Path | None = None) -> pd.DataFrame:
    """Outcomes over drawn parameters, with the number of published ranges that they meet."""
    rng, rows = np.random.default_rng(1), list[dict[str, Any]]()
    kept = None if out is None else out / "jaw_parameters.csv"
    if kept is not None and kept.exists():
        rows = [dict(row) for _, row in pd.read_csv(kept).iterrows()][:samples]
    models = {c: published("larynx", condyle=c) for c in ("planar", "curved")}
    for k in range(samples):
        own = {name: float(rng.uniform(*ends)) for name, ends in PRIOR.items()}
        if k < len(rows):
            continue
        condyle = ("planar", "curved")[k % 2]
        jaw = models[condyle].copy(deep=True)
        jaw["muscle_passive_fraction"][:] = own["passive"]
        jaw["muscle_damping"][:] = own["damping"]
        jaw["body_damping"][:] = own["body"] * jaw["body_damping"]
        moved = 1e-3 * own["hyoid"] * np.array([0.0, -1.0, -1.0])
        hyoid = [str(b) for b in jaw["body"].values].index("hyoid")
        jaw["muscle_position"][:] = np.where(
            (jaw["muscle_body"] == hyoid).values[..., None],
            jaw["muscle_position"] + moved,
            jaw["muscle_position"],
        )
        try:
            found = outcomes_of(jaw, own["tone"])
        except sim.SimulationError as error:
            print(f"{condyle}, {own}: {error}", flush=True)
            found = dict.fromkeys(WANTED, np.nan)
        met = sum(low <= found[name] <= high for name, (low, high) in WANTED.items())
        rows.append({"condyle": condyle, **own, **found, "met": met})
        if kept is not None:
            kept.parent.mkdir(parents=True, exist_ok=True)
            pd.DataFrame(rows).to_csv(kept, index=False)
        print(f"{k + 1} of {samples}: {met} of {len(WANTED)} met", flush=True)
    return pd.DataFrame(rows)


def damping() -> pd.DataFrame:
    """Largest opening of the published chewing cycle over muscle damping and tone of closers."""
    series = read_probes(PROBES)
    jaw, rows = published("larynx"), list[dict[str, Any]]()
    for damped, tone in ((1.0, 0.0), (1.0, 1e-3), (5.0, 1e-3), (8.0, 1e-3), (10.0, 0.0)):
        jaw["muscle_damping"][:] = damped
        toned = {**series.values, "bi_close": np.full(len(series.time), tone)}
        motion = run_task(jaw, Task("", 0.42), excitation=Excitation(series.time, toned))
        d = displacement(motion, "lower_incisor")
        k = int(np.argmin(d[:, 2]))
        found = {"down": -d[k, 2], "back": -d[k, 1], "lateral": abs(d[k, 0])}
        rows.append(
            {"muscle damping, N s/m": damped, "tone, %": 100.0 * tone}
            | {name: round(float(x), 1) for name, x in found.items()}
            | {"time, s": round(float(motion["time"][k]), 3)}
        )
    return pd.DataFrame(rows)


def correlations(table: pd.DataFrame) -> pd.DataFrame:
    """Rank correlation of every outcome with every drawn parameter."""
    drawn = [*PRIOR]
    found = table[[*drawn, *WANTED]].corr(method="spearman").loc[[*WANTED], drawn].round(2)
    planar = table["condyle"] == "planar"
    found["planar - curved [mm]"] = [
        round(float(table.loc[planar, n].mean() - table.loc[~planar, n].mean()), 1) for n in WANTED
    ]
    return found.rename_axis("outcome").reset_index()


def main(part: str = "steps", samples: int = 60, out: Path | None = None) -> None:
    """Measure one part, print and store."""
    if part == "parameters":
        drawn = parameters(samples, out)
        finish("jaw_parameters", drawn, out)
        finish("jaw_parameters_ranks", correlations(drawn), out)
        if out is not None:
            _figure(drawn, out)
        return
    parts = {
        "reference": reference,
        "damping": damping,
        "variants": jaw_variants.variants,
        "causes": jaw_variants.causes,
        "cost": jaw_variants.cost,
        **{n: getattr(jaw_generated, n) for n in ("steps", "stability", "extremes", "emg")},
    }
    finish(f"jaw_{part}", parts[part](), out)


def _figure(drawn: pd.DataFrame, out: Path) -> None:
    """Outcomes over the drawn parameters, with their published ranges."""
    from analysis.figures.style import COLOURS, blank, grid, save

    figure = blank(11.0, 10.0)
    panels = grid(figure, len(WANTED), len(PRIOR), sharex="col", sharey="row")
    for row, (name, (low, high)) in enumerate(WANTED.items()):
        for column, parameter in enumerate(PRIOR):
            panel = panels[row][column]
            panel.axhspan(low, high, color="0.85")
            for condyle, colour in zip(("planar", "curved"), COLOURS[4:], strict=False):
                own = drawn[drawn["condyle"] == condyle]
                panel.plot(own[parameter], own[name], "o", ms=3, color=colour, label=condyle)
            if column == 0:
                panel.set_ylabel(f"{name} [mm]")
            if row == len(WANTED) - 1:
                panel.set_xlabel(
                    parameter + {"damping": " [N s/m]", "hyoid": " [mm]"}.get(parameter, "")
                )
    panels[0][0].legend(fontsize="x-small")
    figure.suptitle("Outcomes of tasks over drawn parameters (simulated); grey: published range")
    save(figure, out / "jaw_parameters.png", dpi=110)
