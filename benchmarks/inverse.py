"""Activations of simulated volunteers from their markers and sEMG, by variant, and the cost of a step.

    python -m benchmarks inverse RECORDING.nc ... --out FIGURE.png [--emg-weights 0.01,0.1,1,10]
        [--form trajectory] [--calibration CALIBRATION.nc]
    python -m benchmarks inverse RECORDING.nc ... --known
    python -m benchmarks inverse RECORDING.nc ... --truth

The recordings contain their true activation. The face that inverts is the coarse template without
contact and gravity, so that shape, tissue and strength of every volunteer differ from it. Compared are
all twenty muscles over the whole trial. Two markers are left out of the targets. `--known` moves the
template itself by the true activation in 0.5 s around its onset, tracks all nodes with the same steps,
and prints the largest difference of any activation. `--truth` moves the template by the true activation
times the true strengths, with and without contact and the laws of the volunteer, and prints how far its
markers are from the recorded ones. The row "others" is the null hypothesis that needs
neither markers nor sEMG of the person: the mean true activation of the other volunteers in the same
instruction, shifted in time to the onset of the motion.
"""

import json
import time
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import typer
import xarray as xr

import sim
from analysis.figures.style import COLOURS, blank, styled
from emgface.face.motion import settle_face, simulate_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.inverse.calibration import Calibration
from emgface.inverse.markers import targets_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.inverse.variants import VARIANTS
from emgface.recordings.dataset import read_recording
from emgface.schema.netcdf import read_netcdf
from sim.inverse import PointTarget, Weights, track

HELD_OUT = ("upper_paramedian_left", "lower_lateral_right")
SIMULATION = SimulationParameters(
    solver="linearly_implicit", gravity=False, contact={"method": "none"}
)


def measures(found: xr.Dataset, recording: xr.Dataset, face: xr.Dataset, rest) -> dict:
    """Errors of activations against the truth, and of the markers of a forward simulation."""
    at = found["time"].values
    truth = recording["true_activation"].interp(time_true=at).sel(muscle=found["muscle"].values)
    a, b = found["activation"].values, truth.values
    moved = simulate_face(face, found["activation"], SIMULATION, settled=rest)
    wanted = targets_of(recording, face, rest, at)
    gap = moved["position"].transpose("time", "marker", "axis").values - wanted.values
    distance = np.sqrt(np.nanmean((gap**2).sum(axis=2), axis=0))
    out = np.isin(wanted["marker"].values, HELD_OUT)
    inferred = ("LAO", "BUC", "OOM", "DLI")
    recorded = np.array([not m.startswith(inferred) for m in found["muscle"].values])
    inside = np.nan
    if "activation_low" in found:
        inside = float(
            ((found["activation_low"].values <= b) & (b <= found["activation_high"].values)).mean()
        )
    return {
        "coverage": inside,
        "correlation": _correlation(a, b),
        "without electrode": _correlation(a[~recorded], b[~recorded]),
        "rms": np.sqrt(np.mean((a - b) ** 2)),
        "slope": np.polyfit(b.ravel(), a.ravel(), 1)[0],
        "tracked [mm]": 1e3 * np.sqrt(np.mean(distance[~out] ** 2)),
        "left out [mm]": 1e3 * np.sqrt(np.mean(distance[out] ** 2)),
    }


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return np.nan if a.std() == 0.0 else float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


def others(path: Path, recordings: list[Path], face: xr.Dataset, rest) -> xr.Dataset | None:
    """Mean true activation of the other volunteers in the same instruction, None if there are none."""
    recording = read_recording(path)
    at = recording["time_marker"].values
    names = [str(m) for m in face["muscle"].values]
    start, found = _onset(recording, face, rest), []
    for other in map(read_recording, recordings):
        if other.attrs["instruction"] != recording.attrs["instruction"]:
            continue
        if other.attrs["volunteer"] != recording.attrs["volunteer"]:
            shifted = at - start + _onset(other, face, rest)
            truth = other["true_activation"].sel(muscle=names)
            # Recordings begin and end at rest.
            truth = truth.interp(time_true=shifted, kwargs={"fill_value": 0.0})
            found.append(truth.transpose("muscle", ...).values)
    if not found:
        return None
    return xr.Dataset(
        {"activation": (("muscle", "time"), np.mean(found, axis=0), {"units": "1"})},
        {"muscle": names, "time": ("time", at, {"units": "s"})},
    )


def _onset(recording: xr.Dataset, face: xr.Dataset, rest) -> float:
    """Time at which the lip markers have made half of their largest displacement [s]."""
    at = recording["time_marker"].values
    moved = targets_of(recording, face, rest, at)
    size = np.sqrt(((moved - moved.isel(time=slice(0, 10)).mean("time")) ** 2).sum("axis"))
    size = size.mean("marker").values
    return float(at[int((size > 0.5 * np.nanmax(size)).argmax())])


def known_activation(face: xr.Dataset, path: Path) -> str:
    """Largest error of the activations if all nodes are tracked with the steps of the truth."""
    system = sim.compile_scene(compose_scene(face, SIMULATION))
    truth = read_recording(path)["true_activation"].sel(muscle=list(system.muscles))
    total = truth.sum("muscle").values
    onset = float(truth["time_true"][int((total > 0.5 * total.max()).argmax())])
    t = 0.01 * np.arange(51)
    true = truth.interp(time_true=max(onset - 0.2, 0.0) + t).transpose("time_true", ...).values
    motion, _ = sim.simulate(
        system, sim.Activation(t, true), duration=0.5, integrator=sim.LinearlyImplicitEuler(),
        steps=sim.FixedStep(0.01), probes=(sim.Positions(),),
    )  # fmt: skip
    q = motion["node_position"].transpose("time", ...).values
    target = PointTarget(np.arange(q.shape[1]), motion["time"].values, q, 1e-6)
    weights = Weights(size=0.0, change=1e-12, rounds=3)
    found, _ = track(system, [target], duration=0.5, weights=weights)
    error = np.abs(found["activation"].values.T - true[1:])
    worst = system.muscles[int(error.max(axis=0).argmax())]
    return f"{path.stem}: largest error {error.max():.1e} ({worst}), largest truth {true.max():.2f}"


def at_truth(face: xr.Dataset, path: Path) -> str:
    """Error of the markers over their motion, cosine and size of the motion, at the true activation."""
    recording, told = read_recording(path), [path.stem]
    at = recording["time_marker"].values
    person, mismatch = (json.loads(recording.attrs[k]) for k in ("person", "mismatch"))
    factor = person["sigma_max"] / SIMULATION.sigma_max
    a = recording["true_activation"].interp(time_true=at).rename(time_true="time")
    a = a.transpose("muscle", "time")
    strength = xr.DataArray(
        [factor * mismatch["strength"][str(m)] for m in a["muscle"].values], dims="muscle"
    )
    drive = (a * strength).clip(0.0, 1.0).assign_attrs(units="1")
    own = SIMULATION.model_dump() | {
        "fibre_law": "generic", "kappa": 4.0 * SIMULATION.kappa,
        "incompressibility": "element", "bulk_potential": "quadratic",
    }  # fmt: skip
    touching = {"contact": SimulationParameters().contact}
    laws = SimulationParameters.model_validate(own)
    for label, one in {
        "without contact": SIMULATION,
        "contact": SIMULATION.model_copy(update=touching),
        "laws of the volunteer": laws,
        "laws and contact": laws.model_copy(update=touching),
    }.items():
        rest = settle_face(face, one)
        moved = simulate_face(face, drive, one, settled=rest)["position"].interp(time=at)
        wanted = targets_of(recording, face, rest, at)
        x = moved.sel(marker=wanted["marker"]).transpose("time", "marker", "axis").values
        u = x - x[0]
        v = wanted.values - np.nanmean(wanted.values[:8], axis=0)
        seen = np.isfinite(u) & np.isfinite(v)
        u, v = u[seen], v[seen]
        size = np.linalg.norm(v)
        told.append(
            f"{label}: error {np.linalg.norm(u - v) / size:.2f}, cosine "
            f"{u @ v / np.linalg.norm(u) / size:.2f}, size {np.linalg.norm(u) / size:.2f}"
        )
    return "; ".join(told)


def cost(face: xr.Dataset) -> str:
    """Processor time of a tracked step over that of a forward step, kernels warm."""
    system = sim.compile_scene(compose_scene(face, SIMULATION))
    work, nodes = sim.Workspace(system), face["marker_node"].values.astype(np.int64)
    goal = system.mesh.X[nodes][None] + np.array([0.0, 0.0, 1e-3])
    target = PointTarget(nodes, np.zeros(1), goal, 1e-3)
    integrator, pairs = sim.LinearlyImplicitEuler(), []
    for k in range(5):
        state, begun = system.rest_state(), time.process_time()
        for i in range(10):
            control = sim.Control(np.full(20, 0.01 * i), state.t + 0.01)
            state, _ = integrator.step(system, state, control, 0.01, work)
        middle = time.process_time()
        track(system, [target], duration=0.1, weights=Weights(chase=0.05), work=work)
        if k:
            pairs.append((middle - begun, time.process_time() - middle))
    forward, tracked = np.median(pairs, axis=0) / 10
    return (
        f"forward step {1e3 * forward:.1f} ms, tracked step {1e3 * tracked:.1f} ms, ratio "
        f"{tracked / forward:.2f} (20 muscles, {system.pattern.n} unknowns)"
    )


@styled
def draw(found: dict[str, xr.Dataset], truth: xr.DataArray, title: str):
    """Activation of eight muscles over time for each variant, with the truth."""
    shown = truth.max("time_true").sortby(truth.max("time_true"), ascending=False)
    names = [str(m) for m in shown["muscle"].values[:8]]
    figure = blank(11.0, 5.2)
    axes = figure.subplots(2, 4, sharex=True, sharey=True).ravel()
    for panel, name in zip(axes, names, strict=True):
        panel.plot(truth["time_true"], truth.sel(muscle=name), color="black", lw=2.0, label="truth")
        for k, (variant, one) in enumerate(found.items()):
            panel.plot(
                one["time"], one["activation"].sel(muscle=name), color=COLOURS[k], label=variant
            )
        panel.set_title(name)
        panel.set_ylim(0.0, 1.0)
    for panel in axes[4:]:
        panel.set_xlabel("time [s]")
    for panel in axes[::4]:
        panel.set_ylabel("activation")
    axes[0].legend(fontsize=7)
    figure.suptitle(title)
    return figure


def main(
    recordings: list[Path],
    out: Annotated[Path, typer.Option()] = Path("inverse.png"),
    emg_weights: str = "0.1,1,10",
    form: Annotated[str, typer.Option(help="step, trajectory or quasi_static.")] = "step",
    calibration: Annotated[Path | None, typer.Option(help="Of the volunteer.")] = None,
    variants: str = ",".join(v for v in VARIANTS if v != "assisted"),
    known: Annotated[
        bool, typer.Option("--known", help="Track all nodes of the template.")
    ] = False,
    truth: Annotated[
        bool, typer.Option("--truth", help="Error of the template at the true activation.")
    ] = False,
) -> None:
    """Invert, compare, print and draw."""
    face = template_face(resolution="coarse")
    if known or truth:
        for path in recordings:
            print((known_activation if known else at_truth)(face, path), flush=True)
        return
    rest = settle_face(face, SIMULATION)
    calibrated = None
    if calibration is not None:
        calibrated = Calibration(read_netcdf(calibration, "emg_calibration"))
    print(cost(face), flush=True)
    rows, drawn = [], {}
    for path in recordings:
        recording = read_recording(path)
        settings = [
            InverseParameters(variant=v, form=form, left_out=HELD_OUT)
            for v in variants.split(",")
            if v
        ]
        settings += [
            InverseParameters(emg_weight=float(w), form=form, left_out=HELD_OUT)
            for w in emg_weights.split(",")
            if w
        ]
        world = str(recording.attrs.get("world", "")).removesuffix(" world")
        for p in settings:
            label = p.variant + (f" {p.emg_weight:g}" if p.variant == "assisted" else "")
            begin = {"world": world, "trial": path.stem, "variant": label}
            try:
                found = invert(
                    recording, face, SIMULATION, parameters=p, settled=rest, calibration=calibrated
                )
                rows.append(begin | measures(found, recording, face, rest))
            except sim.SimulationError as error:
                rows.append(begin | {"failure": type(error).__name__})
                continue
            if path == recordings[-1] and (p.variant != "assisted" or p.emg_weight == 1.0):
                drawn[label] = found
        if (mean := others(path, recordings, face, rest)) is not None:
            rows.append(
                {"world": world, "trial": path.stem, "variant": "others"}
                | measures(mean, recording, face, rest)
            )
        print(
            pd.DataFrame([r for r in rows if r["trial"] == path.stem]).round(3).to_string(),
            flush=True,
        )
    table = pd.DataFrame(rows)
    table.to_csv(out.with_suffix(".csv"), index=False)
    means = (
        table.drop(columns=["trial", "failure"], errors="ignore")
        .groupby(["world", "variant"])
        .mean()
    )
    print(f"\nmeans over {len(recordings)} simulated trials\n{means.round(2).to_string()}")
    truth = read_recording(recordings[-1])["true_activation"]
    title = f"SIMULATED volunteer {recordings[-1].stem}, {table['world'].iloc[-1]} world"
    draw(drawn, truth, title).savefig(out, dpi=110)
