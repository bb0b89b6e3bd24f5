"""Small real study, killed (SIGKILL) at random times and restarted until it ends."""

import random
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

from emgface.children import child_environment, python_command
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from emgface.run.digest import dataset_digest
from emgface.run.store import damage_of
from emgface.study.audit import content
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


DATES = ("history", "date_created")
"""Attributes of a cube that contain the date of its computation."""


def start(study: Path, out: Path) -> subprocess.Popen[bytes]:
    """Start the command in another process."""
    code = "from emgface.cli import main; main()"
    command = ["study", "run", str(study), "--out", str(out), "--workers", "1"]
    return subprocess.Popen(
        python_command("-c", code, *command),
        env=child_environment(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def results(out: Path) -> dict[str, str]:
    """Content of the cube and of every stored result, by name, without measured times and dates."""
    paths = [*(out / "store").rglob("*.nc"), *out.glob("cube.nc")]
    digests: dict[str, str] = {}
    for path in paths:
        dataset = content(path).drop_vars("computed", errors="ignore")
        dataset.attrs = {k: v for k, v in dataset.attrs.items() if k not in DATES}
        digests[path.relative_to(out).as_posix()] = dataset_digest(dataset)
    return digests


def damaged(out: Path) -> list[str]:
    """Results that differ from their index; those without one are only to be complete."""
    names: list[str] = []
    for path in (out / "store").rglob("[!.]*.nc"):
        if path.with_suffix(".json").exists():
            names += [path.name] if damage_of(path) is not None else []
        else:
            content(path)  # raises unless the file is complete
    return names


def kills(folder: Path, count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Kill studies `count` times; compare every stored result with its index, and the ends."""
    rng, folder = random.Random(seed), folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    make_volunteers(
        template_face(resolution="coarse"), folder / "volunteers",
        n=1, instructions=("A", "B"), seed=5,
        parameters=SimulationParameters(step=0.02), settings=VolunteerParameters(emg="noise"),
    )  # fmt: skip
    study = folder / "study.toml"
    study.write_text(STUDY.format(folder=folder / "volunteers" / "recordings"))
    start(study, folder / "warm").wait()  # compiles the kernels if need be
    began = time.monotonic()
    start(study, folder / "whole").wait()
    lasted, whole = time.monotonic() - began, results(folder / "whole")
    killed = studies = wrong = different = 0
    while killed < count:
        out, code = folder / f"killed_{studies:03d}", None
        while code is None:
            process = start(study, out)
            try:
                code = process.wait(rng.uniform(0.2, 1.0) * lasted if killed < count else None)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed, wrong = killed + 1, wrong + len(damaged(out))
        studies += 1
        different += code != 0 or results(out) != whole
        shutil.rmtree(out)
    assert whole, "the undisturbed study has no results"
    rows = [("kills", killed), ("studies", studies), ("results of a study", len(whole)),
            ("results that differ from their index after a kill", wrong),
            ("studies that differ from the undisturbed one", different)]  # fmt: skip
    return [{"quantity": name, "value": value} for name, value in rows]
