"""Kill a study at random times and compare the resumed results with those of an uninterrupted run.

    python -m benchmarks interruptions FOLDER [--kills 50] [--workers 1] [--seed 0]

A small study of simulated volunteers runs once without interruption, and then repeatedly in new
folders, where each run is killed (SIGKILL) at a random time and restarted until it ends. After
every kill each stored result is compared with its index. The cube and all stored results must be
bitwise equal to those of the uninterrupted run, except measured computing times. Exit status 1 if
any differs.
"""

import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.files import replace_file
from emgface.study.audit import content
from emgface.study.digest import dataset_digest
from emgface.study.store import damage_of
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers

STUDY = """name = "interrupted"
strategies = ["act_rel", "act_all"]
[recordings]
folder = "{folder}"
[signals.normalisation]
silent = "zero"
[simulation]
step = 0.02
sigma_max = 100e3
[face.template]
resolution = "coarse"
"""


def start(study: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    """Start the command line in a separate process."""
    code = "from emgface.cli import main; main()"
    command = [sys.executable, "-c", code, "study", "run", str(study), "--out", str(out),
               "--workers", str(workers)]  # fmt: skip
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def results(out: Path) -> dict[str, str]:
    """Content of the cube and of every stored result, by name."""
    files = [
        *(out / "store").rglob("*.nc"),
        *([out / "cube.nc"] if (out / "cube.nc").exists() else []),
    ]
    return {path.relative_to(out).as_posix(): dataset_digest(content(path)) for path in files}


def damage(out: Path) -> tuple[list[str], int]:
    """Results that do not agree with their index, and the number of those without one.

    A result is written before its index. A result without index is computed again, because its
    inputs are unknown.
    """
    wrong: list[str] = []
    alone = 0
    for path in (out / "store").rglob("*.nc"):
        if path.name.startswith("."):
            continue
        if not path.with_suffix(".json").exists():
            alone += 1
            content(path)  # raises unless the file is complete
        elif damage_of(path) is not None:
            wrong.append(path.name)
    return wrong, alone


def main(out: Path, kills: int = 50, workers: int = 1, seed: int = 0) -> None:
    """Run all studies and print the findings."""
    rng = random.Random(seed)
    out = out.resolve()
    shutil.rmtree(out, ignore_errors=True)
    make_volunteers(
        template_face(resolution="coarse"), out / "volunteers",
        n=1, instructions=("A", "B", "C"), seed=5,
        parameters=SimulationParameters(step=0.02), settings=VolunteerParameters(emg="noise"),
    )  # fmt: skip
    study = out / "study.toml"
    text = STUDY.format(folder=out / "volunteers" / "recordings")
    replace_file(study, lambda path: path.write_text(text))
    start(study, out / "warm", workers).wait()  # compiles the kernels if need be
    began = time.monotonic()
    start(study, out / "whole", workers).wait()
    lasted = time.monotonic() - began
    whole = results(out / "whole")
    print(f"undisturbed: {lasted:.1f} s, {len(whole)} results", flush=True)
    killed = bad = unindexed = studies = early = 0
    while killed < kills:
        folder = out / f"killed_{studies:03d}"
        while True:
            process = start(study, folder, workers)
            try:
                code = process.wait(timeout=rng.uniform(0.2, 1.0) * lasted)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed += 1
                early += not (folder / "store").is_dir()
                wrong, alone = damage(folder)
                bad, unindexed = bad + len(wrong), unindexed + alone
                for name in wrong:
                    print(f"kill {killed}: {name} differs from its index", flush=True)
                if killed < kills:
                    continue
                code = start(study, folder, workers).wait()
            break
        studies += 1
        found = results(folder)
        same = found == whole and code == 0
        bad += not same
        print(f"study {studies}: {killed} kills so far, exit {code}, "
              f"{'equal bit for bit' if same else 'DIFFERENT'}", flush=True)  # fmt: skip
        shutil.rmtree(folder)
    print(
        f"{killed} kills ({early} before anything was stored) in {studies} studies: {bad} faults; "
        f"{unindexed} complete results without an index were computed again"
    )
    raise SystemExit(1 if bad else 0)
