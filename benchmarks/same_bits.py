"""Digests of results over processes with other threads, hash seeds, environments and kernel caches.

    python -m benchmarks same_bits --processes 20

The first process compiles the kernels into an empty cache, from which the others load them. Prints
a line for each process and result, and fails unless every result has one digest. Simulated data
throughout.
"""

import hashlib
import os
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

from emgface.children import python_command

THREADS = (1, 2, 4)
RESTARTED = " restarted"
ROOT = Path(__file__).resolve().parents[1]


def digest(*arrays: object) -> str:
    """Digest (12 hexadecimal digits) of the bits of arrays."""
    import numpy as np

    hasher = hashlib.blake2b(digest_size=6)
    for array in arrays:
        hasher.update(np.ascontiguousarray(array).tobytes())
    return hasher.hexdigest()


def of_blocks() -> dict[str, str]:
    """Contact of small bodies, without and with a restart from a file."""
    import numpy as np

    import sim
    from tests.verification.test_same_bits import CONVERGED, falling

    digests: dict[str, str] = {}
    for friction, integrator in ((0.0, CONVERGED), (0.3, replace(CONVERGED, tolerance=1e-6))):
        system, name = falling(friction), f"contact of blocks with friction {friction:g}"
        none = sim.Activation(np.zeros(1), np.zeros((1, 0)))
        options = {"integrator": integrator, "probes": (), "checkpoint": 8}
        _, end = sim.simulate(system, none, duration=0.16, **options)
        _, middle = sim.simulate(system, none, duration=0.08, **options)
        with tempfile.TemporaryDirectory() as folder:
            sim.save_state(middle, Path(folder) / "state.nc")
            middle = sim.read_state(Path(folder) / "state.nc")
        _, again = sim.simulate(falling(friction), none, duration=0.08, initial=middle, **options)
        digests[name] = digest(end.q, end.v)
        digests[f"{name}{RESTARTED}"] = digest(again.q, again.v)
    return digests


def of_face() -> dict[str, str]:
    """Results of the coarse generated face: equilibrium, short motions of two presets, and a score."""
    import numpy as np
    import xarray as xr

    from analysis.align import align
    from analysis.scores import score
    from emgface.face.contact_parameters import NO_CONTACT
    from emgface.face.motion import settle_face, simulate_face
    from emgface.face.simulation_parameters import SimulationParameters
    from emgface.face.template import template_face
    from emgface.muscles import MUSCLES

    face = template_face(resolution="coarse")
    base = SimulationParameters(contact=NO_CONTACT)
    rest = settle_face(face, base)
    digests = {"rest of the face": digest(rest["node_position"])}
    time = np.linspace(0.0, 0.2, 21)
    size = np.where([name.startswith(("ZYG", "OOP")) for name in MUSCLES], 0.3, 0.02)
    values = size[:, None] * np.sin(np.pi * time / 0.2) ** 2
    drive = xr.DataArray(values, {"muscle": list(MUSCLES), "time": time}, ("muscle", "time"))
    motions = {}
    for accuracy in ("published", "study"):
        motion = simulate_face(face, drive, base.as_accurate(accuracy), settled=rest)
        motions[accuracy] = motion["position"]
        digests[f"motion, {accuracy}"] = digest(motion["position"], motion["smallest_J"])
    aligned = align(motions["published"], motions["study"])
    scores = score(aligned, motions["study"])
    digests["score"] = digest(*(scores[name] for name in sorted(map(str, scores.data_vars))))
    return digests


def environment(number: int, cache: str) -> dict[str, str]:
    """Threads, hash seed and size of the environment of a process."""
    threads = str(THREADS[number % len(THREADS)])
    pools = ("MKL", "OMP", "OPENBLAS", "NUMBA")
    own = {f"{name}_NUM_THREADS": threads for name in pools}
    own["NUMBA_NUM_THREADS"] = str(min(int(threads), os.cpu_count() or 1))
    own |= {"PYTHONHASHSEED": str(number), "PADDING": "x" * (37 * number), "EMGFACE_CACHE": cache}
    own |= {"OMP_WAIT_POLICY": "passive", "KMP_BLOCKTIME": "0", "PYTHONPATH": str(ROOT)}
    return {**os.environ, **own}


def main(processes: int = 20, child: bool = False) -> None:
    """Compare processes; --child computes what one of them does."""
    if child:
        for name, value in (of_blocks() | of_face()).items():
            print(f"{name}: {value}")
        return
    digests: dict[str, set[str]] = {}
    with tempfile.TemporaryDirectory() as cache:
        for number in range(processes):
            own = environment(number, cache)
            command = python_command("-m", "benchmarks", "same_bits", "--child")
            lines = subprocess.run(
                command, env=own, check=True, text=True, stdout=subprocess.PIPE, cwd=ROOT
            ).stdout.splitlines()
            for line in lines:
                name, value = line.rsplit(": ", 1)
                digests.setdefault(name.removesuffix(RESTARTED), set()).add(value)
                print(f"process {number}, {own['MKL_NUM_THREADS']} threads, {line}", flush=True)
    for name, values in digests.items():
        print(f"{name}: {len(values)} digest(s) in {processes} processes")
    if any(len(values) > 1 for values in digests.values()):
        raise SystemExit("results differ between processes")
