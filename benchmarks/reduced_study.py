"""Study with a reduced face beside the same trials at full order.

    python -m benchmarks reduced_study FACE.nc FACE.rom.nc OUT [--workers 2] [--full 2]

Recordings of simulated volunteers in the mismatched world are made with the mechanics of the same
reduced face (`emgface.volunteers`; sEMG as modulated noise), so that they take little time. The study of
all of them with act_all, act_3 and act_rel uses the reduced face and falls back to full order; the first
`--full` volunteers, first repetition, are then studied at full order. Both studies use `--workers`
processes. Times are by the clock; processor times are known with one process only. A second call uses
what is stored, and does not measure the times again.
"""

import time
from pathlib import Path

import numpy as np
import pandas as pd

import emgface as ef
from benchmarks.report import finish, say
from emgface.face.file import load_face
from emgface.muscles import INSTRUCTIONS
from emgface.recordings.dataset import write_recording
from emgface.recordings.events import cut_trials
from emgface.reduced.model import parameters_of
from emgface.reduced.study_plan import PUBLISHED
from emgface.schema.netcdf import read_netcdf
from emgface.volunteers.mismatch import draw_mismatch
from emgface.volunteers.person import draw_volunteer
from emgface.volunteers.session import (
    amplifier_noise,
    session_events,
    simulate_session,
    trial_activation,
)
from emgface.volunteers.settings import VolunteerParameters

FIRST = 400_001  #: index of the first volunteer, beyond those of training, calibration and tests
VOLUNTEERS, REPETITIONS = 6, 4
SEED = 0  #: of the volunteers


def record(face, simulation, folder):
    """Write the recordings of all volunteers."""
    world = VolunteerParameters().world.without("mesh", "courses", "laws", "pick-up")
    settings = VolunteerParameters(world=world, emg="noise", cameras="direct")
    for index in range(FIRST, FIRST + VOLUNTEERS):
        person = draw_volunteer(index, SEED)
        noise = amplifier_noise(person, settings, pools=None, conduction=None)
        mismatch = draw_mismatch(person.seed, person.index, settings.world)
        for instruction in INSTRUCTIONS:
            plan = range(1, REPETITIONS + 1)
            activations = [trial_activation(person, instruction, k, settings) for k in plan]
            motions = [
                ef.simulate(mismatch.driven(a).rename(time_true="time"), face, **simulation)
                for a in activations
            ]
            rest = face["face_marker_position"]
            about = person, instruction, activations, motions, rest, settings
            session = simulate_session(*about, noise=noise)
            events = session_events(instruction, REPETITIONS, settings)
            for k, trial in enumerate(cut_trials(session, events), 1):
                trial.attrs["true_sigma_max"] = session.attrs["true_sigma_max"][k - 1]
                write_recording(trial, folder / f"{person.name}_{instruction}_{k}.nc")


def main(
    face: Path,
    rom: Path,
    out: Path,
    full: int = 2,
    workers: int = 1,
):
    """Record, study, compare, print and store."""
    parameters = parameters_of(read_netcdf(rom, "reduced_face"))
    contact = {"method": parameters.contact.method}
    simulation = {"sigma_max": parameters.sigma_max, "contact": contact, "accuracy": "published"}
    simulation |= {"step": 0.01, "output": 0.01}
    reduced = {"reduced": {"file": str(rom.resolve())}}
    folder = out / "recordings"
    begun = time.process_time()
    if not folder.is_dir():
        record(load_face(face), simulation | reduced, folder)
    recorded = time.process_time() - begun
    plan = {"strategies": list(PUBLISHED), "face": {"path": str(face.resolve())}}

    def study(name, recordings, mechanics):
        start, begun = time.process_time(), time.monotonic()
        result = ef.study(
            plan,
            out / name,
            recordings={"folder": str(folder.resolve()), **recordings},
            simulation=mechanics,
            workers=workers,
            progress=False,
        )
        wall = time.monotonic() - begun
        seconds = time.process_time() - start if workers == 1 else float("nan")
        say(f"{name}: {wall:.0f} s by the clock")
        return result.cube, seconds, wall

    cube, seconds, wall = study("reduced", {}, simulation | reduced)
    names = [draw_volunteer(FIRST + k, SEED).name for k in range(full)]
    some = {"volunteers": names, "repetitions": [1]}
    whole, seconds_full, wall_full = study("full", some, simulation)
    apart = (cube["rho"] - whole["rho"]).values
    apart = np.abs(apart[np.isfinite(apart)])
    trials = int(cube["status"].size)
    compared = int(whole["status"].size)
    rows = [
        ("trials", trials),
        ("with a result", int((cube["status"] == "ok").sum())),
        ("of these at full order after all", int((cube["reduced"] == 0.0).sum())),
        ("processes", workers),
        ("processor time of the study, s", seconds),
        ("time of the study by the clock, s", wall),
        ("processor time of recordings, s", recorded),
        ("trials at full order", compared),
        ("processor time of these, s", seconds_full),
        ("time of these by the clock, s", wall_full),
        ("full order for all trials by the clock, s", wall_full * trials / compared),
        ("rho compared", apart.size),
        *((f"difference of rho, {q} %", float(np.percentile(apart, q))) for q in (50, 90, 95, 99)),
        ("difference of rho, largest", float(apart.max())),
    ]
    finish("reduced_study", pd.DataFrame(rows, columns=["quantity", "value"]), out)
