"""Published jaw model: posterior of the parameters that publications do not state.

A part of ``python -m benchmarks jaw``; it needs the published model. Approximate Bayesian computation by
the adaptive population Monte Carlo of Lenormand, Jabot and Deffuant 2013 (Comput. Stat. 28, 2777): of
`POPULATION` sets with weights the nearest `KEPT` are kept, and the others are drawn around them. The
distance is the largest excess of an outcome over its published range, in units of 10 % of that outcome.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import sim
from benchmarks.jaw_variants import PROBES, chewed, published
from benchmarks.report import say
from emgface.anatomy.jaw.outcomes import displacement, separation
from emgface.anatomy.jaw.run import run_task
from emgface.anatomy.jaw.series import Excitation, read_probes
from emgface.anatomy.jaw.tasks import TASKS, Task
from emgface.errors import EmgfaceError

POPULATION, KEPT = 120, 48
STEP = 2e-3
"""Time step [s]; outcomes differ from those of 1 ms by at most 0.2 mm."""

PRIOR = {
    "curved path": (0.0, 1.0),
    "passive fraction": (0.005, 0.03),
    "closers when opening": (0.0, 1.0),
    "tone %": (0.0, 0.15),
    "lateral pterygoids": (0.5, 1.0),
    "muscle damping N s/m": (0.0, 8.0),
    "body damping": (1.0, 3.0),
    "hyoid mm": (0.0, 8.0),
    "depressors": (0.0, 0.5),
    "membranes, log": (0.0, 1.0),
    "centre forward mm": (-20.0, 20.0),
    "centre up mm": (-20.0, 20.0),
}
"""Bounds of uniform priors.

The condyles are on a plane below 0.5 of "curved path". Factors apply to the passive forces of closers in
opening, which Stavness et al. 2006 reduce, to the force of the lateral pterygoids and to the damping of
bodies. Membranes have 385.6 N/m as run at 0, and the 6000 N/m of the class at 1 of their logarithm. The
hyoid at rest is lower and further back, its depressors are active in opening, and the centre of the
rotation of the head is elsewhere.
"""

WANTED = {
    "rest": (3.0, 5.0),
    "open": (35.0, 38.0),
    "head back": (50.0, 51.0),
    "larynx down": (0.5, 1.5),
    "down": (18.1, 22.1),
    "back": (5.2, 6.4),
    "lateral": (2.07, 2.53),
    "largest lateral": (5.5, 6.7),
    "time s": (0.314, 0.354),
    "hyoid up": (2.4, 4.4),
    "hyoid forward": (1.1, 2.1),
}
"""Published outcomes [mm]; chewing with 10 %, the hyoid with 30 %, the time with 20 ms."""


def changed(jaw: xr.Dataset, own: dict[str, float]) -> xr.Dataset:
    """The model with the parameters of a set."""
    jaw = jaw.copy(deep=True)
    names = jaw["muscle"].values.astype(str)
    lateral = np.array([n[:3] in ("ip_", "sp_") for n in names])
    jaw["muscle_passive_fraction"][:] = own["passive fraction"]
    jaw["muscle_damping"][:] = own["muscle damping N s/m"]
    jaw["muscle_force_max"][lateral] = own["lateral pterygoids"] * jaw["muscle_force_max"][lateral]
    jaw["body_damping"][:] = own["body damping"] * jaw["body_damping"]
    membranes = np.array(["Mem" in str(n) for n in jaw["spring"].values])
    stiffer = (6000.0 / 385.6) ** own["membranes, log"]
    jaw["spring_stiffness"][membranes] = stiffer * jaw["spring_stiffness"][membranes]
    hyoid = [str(b) for b in jaw["body"].values].index("hyoid")
    moved = 1e-3 * own["hyoid mm"] * np.array([0.0, -1.0, -1.0])
    on = (jaw["muscle_body"] == hyoid).values[..., None]
    jaw["muscle_position"][:] = np.where(on, jaw["muscle_position"] + moved, jaw["muscle_position"])
    centre = jaw["point_position"].sel(point="head_centre").values
    turned = [0.0, 1e-3 * own["centre forward mm"], 1e-3 * own["centre up mm"]]
    jaw["point_position"].loc[{"point": "head_centre"}] = centre + turned
    return jaw


def outcomes_of(jaw: xr.Dataset, own: dict[str, float]) -> dict[str, float]:
    """Outcomes of rest, opening and chewing [mm]."""
    jaw = changed(jaw, own)
    rest = run_task(jaw, TASKS["rest"], duration=1.5, step=STEP, output=0.05, check=False)
    found = {"rest": float(separation(rest)[-1])}
    found |= openings_of(jaw, own)
    series = read_probes(PROBES)
    tone = np.full(len(series.time), 0.01 * own["tone %"])
    drive = Excitation(series.time, {**series.values, "bi_close": tone})
    chew = run_task(
        jaw, Task("", 0.5, morsel="L"), excitation=drive, step=STEP, output=0.004, check=False
    )
    return found | {name.removeprefix("chew, "): x for name, x in chewed(chew).items()}


def openings_of(jaw: xr.Dataset, own: dict[str, float]) -> dict[str, float]:
    """Openings with the head still and back, and lowering of the larynx, of a changed model [mm]."""
    found = dict[str, float]()
    weak = jaw.copy(deep=True)
    closers = [n[:3] in ("at_", "mt_", "pt_", "sm_", "dm_", "mp_") for n in jaw["muscle"].values]
    weak["muscle_passive_fraction"][closers] = own["passive fraction"] * own["closers when opening"]
    wide = dict(TASKS["open"].excitation) | {
        "bi_infrahyoid": [(0.0, 0.0), (0.2, own["depressors"])]
    }
    for name, head in (("open", 0.0), ("head back", 15.0)):
        motion = run_task(weak, Task("", 0.8, wide, head=head), step=STEP, output=0.02, check=False)
        found[name] = float(separation(motion).max())
        if not head:
            found["larynx down"] = -float(displacement(motion, "thyroid")[-1, 2])
    return found


def excess(found: dict[str, float]) -> dict[str, float]:
    """Distance of every outcome from its published range, in units of 10 % of its middle."""
    far = {n: max(low - found[n], found[n] - high, 0.0) for n, (low, high) in WANTED.items()}
    return {n: far[n] / (0.05 * sum(WANTED[n])) for n in WANTED}


def drawn(generation: int, kept: pd.DataFrame, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Sets (n, parameters) of a generation and their weights."""
    rng, low, high = np.random.default_rng([3, generation]), *np.array(list(PRIOR.values())).T
    if not len(kept):
        return rng.uniform(low, high, (n, len(low))), np.ones(n)
    centres, weights = kept[[*PRIOR]].to_numpy(), (kept["weight"] / kept["weight"].sum()).to_numpy()
    middle = weights @ centres
    wide = np.sqrt(2.0 * weights @ (centres - middle) ** 2)
    found = list[np.ndarray]()
    while len(found) < n:
        x = centres[rng.choice(len(centres), p=weights)] + wide * rng.standard_normal(len(low))
        if ((x >= low) & (x <= high)).all():
            found.append(x)
    own = np.array(found)
    z = (own[:, None] - centres) / wide
    density = np.exp(-0.5 * (z * z).sum(axis=2)) @ weights
    return own, 1.0 / (density * np.prod((high - low) / wide) / (2.0 * np.pi) ** (0.5 * len(low)))


def posterior(samples: int, out: Path) -> pd.DataFrame:
    """Sets with outcomes, distance, generation and weight; continues a table in the folder."""
    path = out / "jaw_posterior.csv"
    rows = list[dict[str, Any]]()
    if path.exists():
        rows = [dict(row) for _, row in pd.read_csv(path).iterrows()]
    models = [published("larynx", condyle=c) for c in ("planar", "curved")]
    kept, generation, passed = pd.DataFrame(), 0, 0
    while passed < samples:
        n = POPULATION - len(kept)
        own, weights = drawn(generation, kept, n)
        for k in range(passed, min(passed + n, samples)):
            if k < len(rows):
                continue
            x = dict(zip(PRIOR, own[k - passed].tolist(), strict=True))
            row = x | {"generation": generation, "weight": float(weights[k - passed])}
            try:
                found = outcomes_of(models[int(x["curved path"] >= 0.5)], x)
                row |= found | {"distance": max(excess(found).values())}
            except (EmgfaceError, sim.SimulationError) as error:
                say(f"{x}: {error}")
                row |= dict.fromkeys(WANTED, np.nan) | {"distance": np.inf}
            rows.append(row)
            pd.DataFrame(rows).to_csv(path, index=False)
            say(f"{k + 1} of {samples}, generation {generation}: distance {row['distance']:.2f}")
        passed += n
        new = pd.DataFrame(rows[passed - n : passed])
        kept = pd.concat([kept, new]).nsmallest(KEPT, "distance")
        generation += 1
    return pd.DataFrame(rows)


def summary(sets: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Posterior of the parameters from the nearest sets, and their outcomes beside the published."""
    near = sets.nsmallest(KEPT, "distance")
    best, weights = near.iloc[0], (near["weight"] / near["weight"].sum()).to_numpy()

    def between(name: str) -> str:
        order = np.argsort(near[name].to_numpy())
        ends = np.interp([0.05, 0.95], np.cumsum(weights[order]), near[name].to_numpy()[order])
        return " to ".join(f"{x:.3g}" for x in ends)

    effective = 1.0 / float((weights**2).sum())
    met = sum(sets[n].between(low, high).astype(int) for n, (low, high) in WANTED.items())
    say(f"outcomes met by a set: {pd.Series(met).value_counts().to_dict()}")
    say(f"{len(sets)} sets; of the nearest {KEPT} the distance is at most")
    say(f"{near['distance'].max():.2f}, effective number {effective:.1f}")
    parameters = [
        {
            "parameter": name,
            "prior": f"{low:g} to {high:g}",
            "posterior, 90 %": between(name),
            "nearest set": f"{best[name]:.3g}",
            "spread / prior": round(_spread(near[name], weights) * 12**0.5 / (high - low), 2),
        }
        for name, (low, high) in PRIOR.items()
    ]
    outcomes = [
        {
            "outcome": name,
            "published": f"{low:g} to {high:g}",
            "prior, 90 %": " to ".join(
                f"{x:.3g}" for x in np.nanquantile(sets[name][:POPULATION], [0.05, 0.95])
            ),
            "posterior, 90 %": between(name),
            "nearest set": f"{best[name]:.3g}",
            "met by": int(sets[name].between(low, high).sum()),
        }
        for name, (low, high) in WANTED.items()
    ]
    return pd.DataFrame(parameters), pd.DataFrame(outcomes)


def _spread(values: pd.Series, weights: np.ndarray) -> float:
    x = values.to_numpy()
    return float(np.sqrt(weights @ (x - weights @ x) ** 2))


def figure(sets: pd.DataFrame, out: Path) -> None:
    """Parameters and outcomes of all sets over their distance from the published outcomes."""
    from analysis.figures.style import COLOURS, blank, grid, save

    canvas, names = blank(12.0, 10.0), [*PRIOR, *WANTED]
    panels = grid(canvas, 4, 6)
    near = sets.nsmallest(KEPT, "distance")
    for k, name in enumerate(names):
        panel = panels[k // 6][k % 6]
        low, high = PRIOR.get(name, WANTED.get(name, (0.0, 1.0)))
        if name in WANTED:
            panel.axvspan(low, high, color="0.85")
        for group, colour in ((sets, "0.6"), (near, COLOURS[4])):
            panel.plot(group[name], group["distance"].clip(0.02), ".", ms=4, color=colour)
        panel.set_yscale("log")
        unit = "" if name in PRIOR or name.endswith(" s") else " mm"
        panel.set_xlabel(name + unit, fontsize="small")
    for row in panels:
        row[0].set_ylabel("distance")
    panels[3][5].set_visible(False)
    canvas.suptitle("Parameters and outcomes (simulated) over the distance from published outcomes")
    save(canvas, out / "jaw_posterior.png", dpi=100)
