"""Coverage of the 90 % intervals of inverse tracking, on trials simulated with the face that inverts.

    python -m benchmarks intervals RECORDING.nc ... --out FIGURE.png

Every recording of a simulated volunteer provides a true activation, of which 0.8 s around its onset
move the coarse template without contact. Markers have white noise of 0.3 mm, and the sEMG an error of
0.1 that is correlated over 0.2 s.
"""

import time
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
import xarray as xr

from analysis.figures.style import COLOURS
from benchmarks.inverse import ACTIVE, SIMULATION, correlation, most_active
from emgface.face.motion import settle_face, simulate_face
from emgface.face.recipe import compose_scene
from emgface.face.template import template_face
from emgface.inverse.assumptions import Assumptions, emg_precision
from emgface.inverse.refine import Refined, refine
from emgface.inverse.variants import trust_of
from emgface.muscles import LIP_MARKERS
from emgface.recordings.dataset import read_recording
from sim import State, Workspace, compile_scene
from sim.inverse import PointTarget

NOISE, EMG_ERROR, EMG_TIME = 3e-4, 0.1, 0.1
H, STEPS = 0.01, 80
ZERO = 5e-4
"""True activation below which it is silent."""


def emg_of_truth(true: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """True activations (n, n_muscles) with an error whose autocorrelation decays in `EMG_TIME`."""
    error = rng.standard_normal(true.shape)
    keep = np.exp(-H / EMG_TIME)
    for k in range(1, len(error)):
        error[k] = keep * error[k - 1] + np.sqrt(1.0 - keep**2) * error[k]
    return np.clip(true + EMG_ERROR * error, 0.0, 1.0)


def draw(found: Refined, true: np.ndarray, emg: np.ndarray, muscles: list[str], title: str):
    """Truth, sEMG, estimate and interval of the eight most active muscles."""

    def one(panel, i: int) -> None:
        band = found.low[:, i], found.high[:, i]
        panel.fill_between(found.time, *band, color=COLOURS[0], alpha=0.3, label="90 % interval")
        panel.plot(found.time, found.activation[:, i], color=COLOURS[0], label="estimate")
        panel.plot(found.time, emg[1:, i], color="0.6", lw=0.8, label="sEMG")
        panel.plot(found.time, true[1:, i], color="black", ls="--", label="truth")

    return most_active(muscles, true.max(axis=0), title, one)


def main(
    recordings: list[Path],
    out: Annotated[Path, typer.Option()],
    variants: str = "assisted,motion",
) -> None:
    """Simulate, invert, count and draw."""
    face = template_face(resolution="coarse")
    system = compile_scene(compose_scene(face, SIMULATION))
    settled, muscles = settle_face(face, SIMULATION), list(system.muscles)
    nodes = face["marker_node"].sel(marker=list(LIP_MARKERS)).values.astype(np.int64)
    q = np.ascontiguousarray(settled["node_position"].values)
    state, work = State(0.0, q, system.rest_state().v, {}), Workspace(system)
    assumed, t = Assumptions(model_error=0.0, strength=0.0), H * np.arange(STEPS + 1)
    counts: list[tuple[int, int]] = []
    for number, path in enumerate(recordings):
        rng = np.random.default_rng(number)
        truth = read_recording(path)["true_activation"].sel(muscle=muscles)
        total = truth.sum("muscle")
        onset = float(total["time_true"][int((total > 0.5 * total.max()).argmax())])
        true = truth.interp(time_true=max(onset - 0.35, 0.0) + t).transpose("time_true", ...).values
        drive = xr.DataArray(true.T, dims=("muscle", "time"), coords={"muscle": muscles, "time": t})
        moved = simulate_face(face, drive, SIMULATION)["position"].interp(time=t)
        x = moved.sel(marker=list(LIP_MARKERS)).transpose("time", "marker", "axis").values
        x = x - x[0] + q[nodes] + NOISE * rng.standard_normal(x.shape)
        target, emg = PointTarget(nodes, t, x, 1e-3), emg_of_truth(true, rng)
        for variant in variants.split(","):
            begun = time.process_time()
            trust = trust_of(variant, muscles, 1.0)
            weight = emg_precision(assumed, np.full(len(muscles), EMG_ERROR), trust, H)
            found = refine(
                system, target, assumed.density(emg[1:], weight, H), NOISE, assumed, h=H,
                initial=state, work=work, iterations=12,
            )  # fmt: skip
            a, b = found.activation, true[1:]
            inside, active, zero = (found.low <= b) & (b <= found.high), b > ACTIVE, b < ZERO
            print(
                f"{path.stem} {variant}: correlation {correlation(a, b):.3f}, rms "
                f"{_rms(a - b):.3f}, coverage {inside.mean():.1%} (above {ACTIVE} "
                f"{inside[active].mean():.1%}, lower {inside[~active & ~zero].mean():.1%}, silent "
                f"{inside[zero].mean():.1%} of {zero.mean():.0%}), width "
                f"{(found.high - found.low).mean():.3f}, misfit "
                f"{_rms(found.linearised.residual):.3f} mm, {time.process_time() - begun:.0f} s\n"
                f"    {'; '.join(found.undetermined) or 'all directions determined'}",
                flush=True,
            )
            counts.append((int(inside.sum()), inside.size))
        title = f"SIMULATED trial, truth of {path.stem} on the template, {variant}"
        name = out.with_stem(f"{out.stem}_{path.stem}") if number else out
        draw(found, true, emg, muscles, title).savefig(name, dpi=110)
    print(f"coverage over all trials {sum(c for c, _ in counts) / sum(n for _, n in counts):.1%}")


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(x**2)))
