"""Reduced face compared with full order: time of a step, error of the markers, coverage of its bound.

    python -m benchmarks reduced FACE.nc FACE.rom.nc [--trials 20] [--out FOLDER]

The trials are sequences of the kind of the training that neither it nor the calibration contains
(`emgface.reduced.plan`), simulated at full order with the same steps and contact. Their full-order
motions are kept in the folder ``FACE.rom.test``, so that more trials can be added later. Times are
processor times of one core in one run. Stability: the energy without drive from a deformed state, all
muscles at once, and activations that are noise.
"""

import json
import resource
import time
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from analysis.scores import correlation_3d
from benchmarks.report import finish, say
from emgface.face.file import load_face
from emgface.reduced.full_order import TRAINING_STEP, FullOrder, stored_motion
from emgface.reduced.model import ReducedFace, parameters_of
from emgface.reduced.motion import simulate_reduced
from emgface.reduced.study_plan import sequences_of
from emgface.reduced.training import marker_errors
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf
from sim import Activation, Energies, FixedStep, Workspace, resting, simulate
from sim.errors import SimulationError
from sim.reduced import FusedEuler

SEED = 1  #: seed of the trials


def openings(reduced, simulated, motion):
    """Lip opening [m] of a reduced motion and of that at full order, at the snapshots of the latter."""
    upper, lower = reduced.face["lip_opening_node"].values.astype(int)
    nodes = motion["node_position"].values
    full = nodes[:, upper, 2] - nodes[:, lower, 2]
    stride = (simulated.sizes["time"] - 1) // len(full)
    return simulated["lip_opening"].values[stride::stride][: len(full)], full


def trial(reduced, drive, motion):
    """Errors, bound and times of one trial."""
    start = time.process_time()
    error, simulated = marker_errors(reduced, drive, motion)
    seconds = time.process_time() - start
    position = simulated["position"]
    whole = motion["marker_position"].transpose("time", "marker", "axis").values
    full = position.transpose("time", "marker", "axis").copy(data=whole)
    rho = correlation_3d(full, position)
    largest = error.max(axis=1)
    opening, whole_opening = openings(reduced, simulated, motion)
    steps = len(largest) - 1
    return {
        "trial": drive.label,
        "rms [mm]": 1e3 * float(np.sqrt((error**2).mean())),
        "largest [mm]": 1e3 * float(largest.max()),
        "bound [mm]": 1e3 * float(simulated["reduction_error"].max()),
        "motion [mm]": 1e3 * float(np.linalg.norm(whole - whole[0], axis=2).max()),
        "opening [mm]": 1e3 * float(opening.min()),
        "opening of full order [mm]": 1e3 * float(whole_opening.min()),
        "opening error [mm]": 1e3 * float(np.abs(opening - whole_opening).max()),
        "covered": bool((largest <= simulated["reduction_error"].values).all()),
        "trusted": simulated.attrs["reduction_doubt"] == "",
        "least rho": float(rho.min()),
        "reduced [ms/step]": 1e3 * seconds / steps,
        "full [ms/step]": 1e3 * float(motion.attrs["cost_s"]) / steps,
    }


def stability(reduced):
    """Rows on the behaviour of the reduced face outside of trials."""
    system = reduced.model.system
    work = Workspace(system)
    start = reduced.equilibrium
    n = len(system.muscles)
    pushed = Activation(np.array([0.0, 0.1]), np.array([np.zeros(n), np.full(n, 0.3)]))
    options = {
        "integrator": FusedEuler(reduced.contact),
        "steps": FixedStep(TRAINING_STEP),
        "work": work,
    }
    _, state = simulate(system, pushed, duration=0.3, initial=start, probes=(), **options)
    free, _ = simulate(
        system, resting(n), duration=1.0, initial=state, probes=(Energies(),), **options
    )
    energy = (free["kinetic_energy"] + free["potential_energy"]).values
    yield (
        "no drive: largest growth of energy over its fall",
        float(np.diff(energy).max() / (energy[0] - energy[-1])),
    )
    all_on = Activation(np.array([0.0, 0.1]), np.array([np.zeros(n), np.ones(n)]))
    rng = np.random.default_rng(SEED)
    times = TRAINING_STEP * np.arange(101)
    noise = Activation(times, rng.uniform(0.0, 1.0, (101, n)))
    for name, drive in (("all muscles at 1", all_on), ("white noise in 0-1", noise)):
        try:
            simulated = simulate_reduced(reduced, drive, 1.0)
            yield f"{name}: smallest J", float(simulated["smallest_J"].min())
            yield f"{name}: trusted", float(simulated.attrs["reduction_doubt"] == "")
        except SimulationError as error:
            yield f"{name}: {type(error).__name__}", float("nan")


def main(face: Path, rom: Path, trials: int = 20, out: Path | None = None):
    """Measure, print and store."""
    model, data = load_face(face), read_netcdf(rom, "reduced_face")
    parameters = parameters_of(data)
    started = time.process_time()
    reduced = ReducedFace.for_face(data, model, parameters)
    steps = reduced.model.system.pattern.n
    loading = time.process_time() - started
    full = FullOrder.from_face(model, parameters, reduced.rest)
    drives = sequences_of(json.loads(data.attrs["training"])["activations"])
    store = Store(rom.with_suffix(".test"))
    rows = []
    for drive in drives(full.system.muscles, trials, "test", SEED):
        motion, _ = stored_motion(store, full, drive, 0.1)
        if motion.attrs["scale"] > 0.0:
            rows.append(trial(reduced, drive.scaled(motion.attrs["scale"]), motion))
    table = pd.DataFrame(rows)
    dataset = xr.Dataset.from_dataframe(table)
    summary = [
        ("modes that move", steps),
        ("elements with a weight", data.sizes["sample"]),
        ("trials", len(table)),
        ("full order, ms per step of 10 ms", float(dataset["full [ms/step]"].median())),
        ("reduced, ms per step of 10 ms", float(dataset["reduced [ms/step]"].median())),
        ("training, simulated s", float(data.attrs["training_seconds"])),
        ("training, s", float(data.attrs["training_time_s"])),
        ("loading, s", loading),
        ("reduced face and its modes, MB", data.nbytes / 1e6),
        ("error of markers, rms, mm", float(np.sqrt((table["rms [mm]"] ** 2).mean()))),
        ("error of markers, median of largest, mm", float(table["largest [mm]"].median())),
        ("error of markers, largest, mm", float(table["largest [mm]"].max())),
        ("smallest lip opening, mm", float(table["opening [mm]"].min())),
        ("smallest at full order, mm", float(table["opening of full order [mm]"].min())),
        ("lip opening, largest difference, mm", float(table["opening error [mm]"].max())),
        ("bound, median of largest, mm", float(table["bound [mm]"].median())),
        ("trials within the bound, %", 100.0 * float(table["covered"].mean())),
        ("nominal, %", 100.0 * float(data.attrs["coverage"])),
        ("trials trusted by their activation, %", 100.0 * float(table["trusted"].mean())),
        ("1 - rho of reduced and full, median", 1.0 - float(table["least rho"].median())),
        ("1 - rho of reduced and full, largest", 1.0 - float(table["least rho"].min())),
        *stability(reduced),
    ]
    finish("reduced", pd.DataFrame(summary, columns=["quantity", "value"]), out)
    sizes = {
        "modes": data["basis_size"].values,
        "rms": 1e3 * data["projection_rms"].values,
        "largest": 1e3 * data["projection_largest"].values,
    }
    finish("reduced_modes", pd.DataFrame(sizes), out)
    if out is not None:
        table.to_csv(out / "reduced_trials.csv", index=False)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    say(f"largest memory of the process, with full order compiled: {used:.0f} MB")
