"""Lines of code by folder, lengths of modules and functions, and modules that a step runs through.

    python -m benchmarks lines

The modules of a step are those whose functions run in it, and the modules of kernels that these import,
with the number of calls from one module to another: of tissue with a body under a linearly implicit
method, and of the coarse face under SDIRK2 at the preset of studies, both without and with contact.
"""

import ast
import statistics
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np
import pandas as pd

import sim
from benchmarks.report import finish
from benchmarks.stability.rigid_rows import plate_on_tissue
from emgface.face.accuracy import ACCURACY_PRESETS
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.integration import integrator_of
from emgface.face.recipe import compose_scene
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template import template_face
from sim.integrators import Integrator

ROOT = Path(__file__).parent.parent
PARTS = sorted(p.parent.name for p in (ROOT / "sim").glob("*/__init__.py"))
OTHERS = "emgface", "analysis", "benchmarks", "studies", "tests"
FOLDERS = ("sim", *(f"sim/{name}" for name in PARTS), *OTHERS)

DRIVE = 0.1  #: activation of all muscles in the traced steps


def functions(path: Path) -> Iterator[int]:
    """Lines of every function and method of a module."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (node.end_lineno or node.lineno) - node.lineno + 1


def folder(name: str) -> dict[str, object]:
    """Sizes of the modules in a folder and those below it."""
    paths = [p for p in sorted((ROOT / name).rglob("*.py")) if "__pycache__" not in p.parts]
    modules = [len(p.read_text(encoding="utf-8").splitlines()) for p in paths]
    parts = [n for p in paths for n in functions(p)] or [0]
    return {
        "folder": name,
        "lines": sum(modules),
        "modules": len(modules),
        "median module": round(statistics.median(modules)),
        "over 300 lines": sum(n > 300 for n in modules),
        "longest": max(modules),
        "functions": len(parts),
        "median function": round(statistics.median(parts)),
        "over 40 lines": sum(n > 40 for n in parts),
        "over 80 lines": sum(n > 80 for n in parts),
    }


def modules_of(run: Callable[[], object]) -> tuple[set[str], int]:
    """Modules of `sim` other than kernels whose functions run, and calls between them."""
    modules, calls, base = set[str](), 0, str(ROOT / "sim")

    def note(frame: FrameType, event: str, _: object) -> None:
        nonlocal calls
        name = frame.f_code.co_filename
        if event == "call" and name.startswith(base) and "_kernels" not in name:
            modules.add(Path(name).relative_to(ROOT).as_posix())
            before = frame.f_back.f_code.co_filename if frame.f_back is not None else name
            calls += before != name and before.startswith(base)

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return modules, calls


def kernels_of(modules: set[str]) -> set[str]:
    """Modules of kernels that modules import."""
    kernels = set[str]()
    for name in modules:
        for node in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sim._kernels"):
                of_folder = node.module == "sim._kernels"
                names = (
                    [f"sim._kernels.{a.name}" for a in node.names] if of_folder else [node.module]
                )
                kernels |= {str(n) for n in names}
    return kernels - {"sim._kernels.options"}


def scenes() -> Iterator[tuple[str, Integrator, float, sim.System, sim.State]]:
    """Method, step [s], scene and state of traced steps, in pairs without and with contact."""
    system, start = plate_on_tissue()
    terms = tuple(t for t in system.scene.terms if not isinstance(t, sim.ConstraintContact))
    without, h = sim.compile_scene(replace(system.scene, terms=terms)), 1e-3
    for scene, state in ((without, replace(start, memory={})), (system, start)):
        yield "plate on tissue, linearly implicit", sim.LinearlyImplicitEuler(), h, scene, state
    face = template_face(resolution="coarse")
    for contact in ({"contact": NO_CONTACT}, {}):
        own = ACCURACY_PRESETS["study"] | {"step": 0.01, "output": 0.01, "gravity": False} | contact
        p = SimulationParameters(**own)
        scene = sim.compile_scene(compose_scene(face, p))
        yield "coarse face, SDIRK2", integrator_of(p), p.step, scene, scene.rest_state()


def step_modules() -> Iterator[dict[str, object]]:
    """Modules of a step without and with contact, and those that contact adds."""
    plain = set[str]()
    for k, (name, method, h, system, state) in enumerate(scenes()):
        work, control = sim.Workspace(system), system.control(np.full(len(system.muscles), DRIVE))

        def step(
            scene: sim.System = system,
            state: sim.State = state,
            method: Integrator = method,
            h: float = h,
            work: sim.Workspace = work,
            control: sim.Control = control,
        ) -> tuple[sim.State, object]:
            return method.step(scene, state, control, h, work)

        step()
        used, calls = modules_of(step)
        added = sorted(s.removeprefix("sim/") for s in used - plain) if k % 2 else []
        yield {
            "step": f"{name}, {'with' if k % 2 else 'without'} contact",
            "modules": len(used),
            "kernels": len(kernels_of(used)),
            "calls between modules": calls,
            "added": ", ".join(added),
        }
        plain = used


def main(out: Path | None = None) -> None:
    """Print, and with a folder store, both tables."""
    finish("lines", pd.DataFrame([folder(name) for name in FOLDERS]), out)
    finish("lines_step", pd.DataFrame(list(step_modules())), out)
