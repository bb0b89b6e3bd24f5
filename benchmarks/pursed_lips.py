"""Reasons why step by step inversion misses the activations of pursed lips.

    python -m benchmarks pursed-lips RECORDING.nc

Printed are, for the coarse template, the response of the markers to each muscle at rest and its cosine
with the largest displacement wanted, the same for finite activations with and without contact, and the
activations found step by step at this time.
"""

from pathlib import Path

import numpy as np
import xarray as xr

from benchmarks.inverse import SIMULATION
from emgface.errors import DataError
from emgface.face.motion import settle_face, simulate_face
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.inverse.markers import targets_of
from emgface.inverse.parameters import InverseParameters
from emgface.inverse.run import invert
from emgface.muscles import LIP_MARKERS, MUSCLES
from emgface.recordings.dataset import read_recording
from sim import Control, Workspace, compile_scene
from sim.inverse import ActiveForces, equilibrium_response

FINITE = ({"OOP": 0.8}, {"OOM": 0.8}, {"OOP": 0.6, "BUC": 0.6, "DAO": 0.4})


def cosine(a: np.ndarray, b: np.ndarray) -> float:
    """Cosine of the angle between two displacements of all markers."""
    return float(a.ravel() @ b.ravel() / np.linalg.norm(a) / np.linalg.norm(b))


def main(path: Path) -> None:
    """Print the responses and the activations."""
    recording, face = read_recording(path), template_face(resolution="coarse")
    if "true_activation" not in recording:
        raise DataError(f"{path} has no true activation, expected a simulated volunteer")
    settled = settle_face(face, SIMULATION)
    p = InverseParameters(variant="motion", form="step")
    found = invert(recording, face, SIMULATION, parameters=p, settled=settled)
    wanted = targets_of(recording, face, settled, found["time"].values)
    moved = (wanted - wanted.isel(time=slice(0, 5)).mean("time")).transpose("time", ...).values
    peak = int((moved**2).sum(axis=(1, 2)).argmax())
    goal = moved[peak]

    system = compile_scene(compose_scene(face, SIMULATION))
    muscles, state = list(system.muscles), system.rest_state()
    silent = Control(np.zeros(len(muscles)))
    J = equilibrium_response(system, state, silent, Workspace(system), ActiveForces(system))
    nodes = face["marker_node"].sel(marker=list(LIP_MARKERS)).values.astype(np.int64)
    P = (system.kinematics.matrix(state.pose) @ J).reshape(-1, 3, len(muscles))[nodes]
    flat = P.reshape(-1, len(muscles))
    true = recording["true_activation"].interp(time_true=found["time"].values)
    print("muscle   cosine at rest   found   true (both sides, largest displacement)")
    both = {}
    for name in dict.fromkeys(m[:-2] for m in muscles):
        sides = [f"{name}_L", f"{name}_R"]
        both[name] = sum(flat[:, muscles.index(m)] for m in sides)
        a = float(found["activation"].sel(muscle=sides).isel(time=peak).mean())
        b = float(true.sel(muscle=sides).isel(time_true=peak).mean())
        print(f"{name:8s} {cosine(both[name], goal):8.2f} {a:14.2f} {b:7.2f}")
    a, b = found["activation"].values, true.sel(muscle=found["muscle"].values).values
    r, rms = np.corrcoef(a.ravel(), b.ravel())[0, 1], np.sqrt(np.mean((a - b) ** 2))
    print(f"correlation {r:.2f}, rms {rms:.3f}")
    least = 1e3 * np.linalg.svd(flat, compute_uv=False).min()
    print(f"cosine of OOP and OOM {cosine(both['OOP'], both['OOM']):.2f}; ", end="")
    print(f"smallest singular value of the response {least:.1f} mm per unit of activation")
    contact = SimulationParameters(gravity=False)
    for title, simulation in (("without contact", SIMULATION), ("with contact", contact)):
        for levels in FINITE:
            print(
                f"{title}, {levels}: cosine {cosine(_displaced(face, levels, simulation), goal):.2f}"
            )


def _displaced(face: xr.Dataset, levels: dict, simulation: SimulationParameters) -> np.ndarray:
    """Displacement of the markers after 0.5 s, of which the activation rises in the first half."""
    t = np.linspace(0.0, 0.5, 51)
    muscles = list(MUSCLES)
    rise = np.clip(t / 0.25, 0.0, 1.0)
    a = np.array([levels.get(m[:-2], 0.0) * rise for m in muscles])
    drive = xr.DataArray(a, dims=("muscle", "time"), coords={"muscle": muscles, "time": t})
    x = simulate_face(face, drive, simulation)["position"].sel(marker=list(LIP_MARKERS))
    x = x.transpose("time", "marker", "axis").values
    return x[-1] - x[0]
