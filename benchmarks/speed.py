"""Processor time of steps in units U compared with stored values, for the log of every change.

    python -m benchmarks speed            # about a minute
    python -m benchmarks speed --store    # stores the values as those of later comparisons
    python -m benchmarks speed --only 3b,4c --threads 2
    python -m benchmarks speed --memory   # with the largest memory of every case, twice the time

U is one numerical factorisation plus one solution, in double precision and on one thread, of the
published face with pointwise bulk, measured in the same process before and after the cases. Cases 1
to 4c are those recorded with another simulator: steps of 5 ms, excitation from 0 at the start to its
end value at 0.1 s, absolute tolerance of the iteration 1e-9 m. The tongue and the coupled head are those
of other recorded motions, in steps of 10 and 5 ms; the condyles stay on the planes of their start. The
values are of steps 9 to 16. With --memory, every case is repeated in a process of its own, whose
largest resident memory is printed.
Without the published face, the same is measured on the coarse generated face. Nothing is asserted,
because run times depend on the machine; a ratio to the stored value above 1.3 deserves a look.
"""

import resource
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Final

import numpy as np
import pandas as pd

import sim
from benchmarks.other_simulator import BLEMKER, EULER, SHARED, TRAPEZOIDAL, Case, their_face
from benchmarks.report import markdown, say
from benchmarks.tongue import recorded_tongue
from benchmarks.tongue_coupled import recorded_motion
from benchmarks.unit import unit_seconds
from emgface.children import safe_children
from emgface.face.accuracy import ACCURACY_PRESETS
from emgface.face.artisynth import import_artisynth
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.integration import integrator_of, steps_of
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from sim.integrators import Integrator
from sim.steps import StepControl

STORED: Final = Path(__file__).with_name("speed.csv")
H, RAMP, FIRST, LAST = 5e-3, 0.1, 9, 16
GENERIC: Final = sim.Generic(100e3)
RECORDED: Final = {
    "1 soft nodal": Case("", "nodal", "ZYG", 0.5, EULER, BLEMKER),
    "2 soft element": Case("", "element", "ZYG", 0.5, EULER, BLEMKER),
    "3a hard, trapezoidal": Case("", "hard", "ZYG", 0.5, TRAPEZOIDAL, GENERIC, gravity=True),
    "3b the same with contact": Case(
        "", "hard", "ZYG", 0.5, TRAPEZOIDAL, GENERIC, gravity=True, contact=True
    ),
    "4c OOP 0.1 with contact": Case("", "hard", "OOP", 0.1, TRAPEZOIDAL, GENERIC, contact=True),
}
"""Cases of the comparison with another simulator, on the published face."""
OTHERS: Final[dict[str, tuple[Callable[..., tuple[sim.System, sim.Activation]], str, float]]] = {
    "tongue, element, 10 ms": (recorded_tongue, "element_GGP_0.2", 1e-2),
    "head, no contact": (recorded_motion, "jhtface_nocontact_GGP_0.2", H),
    "head, all contacts": (recorded_motion, "jhtface_contact_GGP_0.2", H),
}
"""Scene with its activation, recorded motion and step [s] of other comparisons."""
FREE, TOUCHING = "study preset, 10 ms", "study preset, 10 ms, with contact"


@dataclass(frozen=True)
class Run:
    """Processor times [s] of successive outputs."""

    seconds: tuple[float, ...]

    def row(self, unit: float) -> dict[str, float]:
        """Median and mean of the later ones, and the first one, in units and milliseconds."""
        late = self.seconds[FIRST - 1 : LAST]
        middle, mean = statistics.median(late), statistics.fmean(late)
        return {
            "median U": middle / unit,
            "mean U": mean / unit,
            "first U": self.seconds[0] / unit,
            "median ms": 1e3 * middle,
            "mean ms": 1e3 * mean,
        }


def rising(system: sim.System, group: str, level: float) -> sim.Activation:
    """Muscles of a group rising to a level in `RAMP`."""
    peak = np.array([level * name.startswith(group) for name in system.muscles])
    return sim.Activation(np.array([0.0, RAMP]), np.stack([0.0 * peak, peak]))


def timed(
    system: sim.System,
    activation: sim.Activation,
    h: float,
    integrator: Integrator,
    threads: int,
    steps: StepControl | None = None,
) -> Run:
    """Processor time of every step, of length `h` [s] without step control."""
    clock: Callable[[], float] = time.process_time if threads == 1 else time.perf_counter
    ends: list[float] = []
    for count in (1, LAST):  # the single step loads or compiles the kernels
        ends[:] = [clock()]
        sim.simulate(
            system,
            activation,
            duration=count * h,
            integrator=integrator,
            steps=steps or sim.FixedStep(h),
            progress=lambda *_: ends.append(clock()),
            solver_threads=threads,
        )
    return Run(tuple(np.diff(ends)))


def recorded(only: tuple[str, ...], threads: int) -> Iterator[tuple[str, Run]]:
    """Cases of the published face."""
    for name, case in RECORDED.items():
        if chosen(name, only):
            say(name)
            system = their_face(SHARED / "artisynth_reference", case)
            drive = rising(system, case.group, case.level)
            yield name, timed(system, drive, H, case.integrator, threads)
    for name, (of_scene, motion, h) in OTHERS.items():
        if chosen(name, only):
            say(name)
            yield name, timed(*of_scene(motion), h, EULER, threads)


def generated(only: tuple[str, ...], threads: int) -> Iterator[tuple[str, Run]]:
    """Cases of the coarse generated face: linearly implicit steps, and the preset of studies."""
    face, soft = template_face(resolution="coarse"), {"bulk_potential": "quadratic"}
    cases = {
        "generated, soft nodal": soft | {"incompressibility": "nodal"},
        "generated, soft element": soft | {"incompressibility": "element"},
        "generated, hard": {"incompressibility": "hard"},
        "generated, hard, with contact": {"incompressibility": "hard"},
        FREE: ACCURACY_PRESETS["study"],
        TOUCHING: ACCURACY_PRESETS["study"],
    }
    for name, options in cases.items():
        if not chosen(name, only):
            continue
        say(name)
        own = {"solver": "linearly_implicit", "step": H} | options
        own |= {"output": own["step"], "sigma_max": 100e3, "gravity": False}
        own |= {} if name.endswith("contact") else {"contact": NO_CONTACT}
        p = SimulationParameters(**own)
        system, method = sim.compile_scene(compose_scene(face, p)), integrator_of(p)
        yield (
            name,
            timed(system, rising(system, "OOP", 0.2), p.step, method, threads, steps_of(face, p)),
        )


def largest_memory() -> float:
    """Largest resident memory [MB] of this process, without that of the process that started it."""
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:  # not Linux
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return next(float(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024


def alone(name: str, published: bool, threads: int) -> float:
    """Largest memory [MB] of this process after one case."""
    next((recorded if published else generated)((name,), threads))
    return largest_memory()


def memory_of(name: str, published: bool, threads: int) -> float:
    """Largest memory [MB] of a process that computes one case."""
    with safe_children(), get_context("spawn").Pool(1) as pool:
        return pool.apply(alone, (name, published, threads))


def chosen(name: str, only: tuple[str, ...]) -> bool:
    """Test if a case begins with one of the names, of which none means all."""
    return not only or name.startswith(only)


def matrix_of_unit() -> tuple[sim.System, str]:
    """Published face with pointwise bulk, or the generated one, and its name."""
    where = SHARED / "artisynth_models"
    here = where.is_dir()
    face = import_artisynth(where) if here else template_face(resolution="coarse")
    p = SimulationParameters(sigma_max=100e3, gravity=False, contact=NO_CONTACT)
    return sim.compile_scene(compose_scene(face, p)), "published" if here else "generated"


def stored(face: str) -> dict[str, float]:
    """Stored medians in U of cases whose unit is that of a face."""
    if not STORED.exists():
        return {}
    table = pd.read_csv(STORED)
    own = table[table["unit"] == face]
    return dict(zip(own["case"], own["median U"], strict=True))


def main(only: str = "", threads: int = 1, store: bool = False, memory: bool = False) -> None:
    """Measure and print; with --store, the values become those of later comparisons."""
    system, face = matrix_of_unit()
    units = [unit_seconds(system, time.process_time)]
    which = tuple(name for name in only.split(",") if name)
    runs = list(recorded(which, threads)) if face == "published" else []
    runs += generated(which, threads)
    units.append(unit_seconds(system, time.process_time))
    unit, before = statistics.fmean(units), stored(face)
    rows = [{"case": name, **run.row(unit)} for name, run in runs]
    for row in rows:
        row["stored U"] = before.get(str(row["case"]), float("nan"))
        row["ratio"] = float(row["median U"]) / row["stored U"]
        if memory:
            row["MB"] = memory_of(str(row["case"]), row["case"] in {*RECORDED, *OTHERS}, threads)
    table = pd.DataFrame(rows)
    clock = "processor time" if threads == 1 else "wall time"
    print(
        f"U = {1e3 * unit:.1f} ms ({1e3 * units[0]:.1f} before, {1e3 * units[1]:.1f} after), one "
        f"factorisation and solution of the {face} face on one thread. Steps {FIRST} to {LAST}, "
        f"{clock}, {threads} solver thread(s):\n{markdown(table, '.3g')}"
    )
    means = {name: run.row(unit)["mean U"] for name, run in runs}
    if FREE in means and TOUCHING in means:
        print(f"study preset, contact over without: {means[TOUCHING] / means[FREE]:.2f}")
    print(f"largest memory of the process: {largest_memory():.0f} MB")
    if store:
        _store(table.drop(columns=["stored U", "ratio", "MB"], errors="ignore"), face)


def _store(table: pd.DataFrame, face: str) -> None:
    """Replace the stored rows of the same unit and cases."""
    table = table.assign(unit=face)
    if STORED.exists():
        known = pd.read_csv(STORED)
        same = (known["unit"] == face) & known["case"].isin(table["case"])
        table = pd.concat([known[~same], table])
    table.round(3).to_csv(STORED, index=False)
    say(f"written: {STORED}")
