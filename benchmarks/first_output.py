"""Process that simulates a face and prints the end of every phase: child of `benchmarks.start`."""

import importlib
import json
import sys
from typing import Any, Final

import numpy as np
import xarray as xr

PHASES: Final = ("imports", "face", "equilibrium", "first output")
DURATION: Final = 0.1  #: time simulated after the first output, for the measurement of memory [s]
LEVEL: Final = 0.2  #: activation of all muscles at its end


def work() -> None:
    """Simulate a face in this process and print the end of every phase; the task is an argument."""
    task: dict[str, Any] = json.loads(sys.argv[-1])
    path, volume = task["face"], task["volume"]
    name = "emgface.face.template" if path is None else "emgface.face.file"
    source = importlib.import_module(name)  # a face from a file needs no template
    from emgface.face.contact_parameters import NO_CONTACT
    from emgface.face.motion import settle_face, simulate_face
    from emgface.face.simulation_parameters import SimulationParameters

    print(PHASES[0])
    face = source.template_face(resolution="coarse") if path is None else source.load_face(path)
    print(PHASES[1])
    parameters = SimulationParameters(
        sigma_max=100e3,
        contact=NO_CONTACT,
        incompressibility=volume,
        bulk_potential="logarithmic" if volume == "pointwise" else "quadratic",
    )
    settled = settle_face(face, parameters)
    print(PHASES[2])
    for end, duration in ((PHASES[3], parameters.step), ("", DURATION)):
        muscles = face["muscle"].values
        rise = np.outer(np.full(len(muscles), LEVEL), [0.0, duration / DURATION])
        coords = {"muscle": muscles, "time": [0.0, duration]}
        activation = xr.DataArray(rise, coords, ("muscle", "time"))
        simulate_face(face, activation, parameters, settled=settled)
        print(end)
    print(f"peak={peak_memory()}")


def peak_memory() -> float:
    """Largest resident memory of this process so far [B]; NaN if the system does not report it."""
    try:
        import resource
    except ImportError:  # Windows
        return float("nan")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak if sys.platform == "darwin" else 1024 * peak)


if __name__ == "__main__":
    work()
