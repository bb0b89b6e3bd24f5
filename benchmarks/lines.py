"""Lines of code by folder, lengths of modules and functions, and modules that a step runs through.

    python -m benchmarks lines

The modules of a step are those whose functions run in it, and the modules of kernels that these import:
of tissue with a body, without and with contact between them.
"""

import ast
import statistics
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import FrameType

import pandas as pd

import sim
from benchmarks.report import finish
from benchmarks.stability.rigid_rows import plate_on_tissue

ROOT = Path(__file__).parent.parent
PARTS = sorted(p.parent.name for p in (ROOT / "sim").glob("*/__init__.py"))
OTHERS = "emgface", "analysis", "benchmarks", "studies", "tests"
FOLDERS = ("sim", *(f"sim/{name}" for name in PARTS), *OTHERS)


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


def modules_of(run: Callable[[], object]) -> set[str]:
    """Modules of `sim` whose functions run in a call."""
    found, base = set[str](), str(ROOT / "sim")

    def note(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename.startswith(base):
            found.add(Path(frame.f_code.co_filename).relative_to(ROOT).as_posix())

    sys.setprofile(note)
    try:
        run()
    finally:
        sys.setprofile(None)
    return {name for name in found if not name.startswith("sim/_kernels")}


def kernels_of(modules: set[str]) -> set[str]:
    """Modules of kernels that modules import."""
    found = set[str]()
    for name in modules:
        for node in ast.walk(ast.parse((ROOT / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("sim._kernels"):
                of_folder = node.module == "sim._kernels"
                names = (
                    [f"sim._kernels.{a.name}" for a in node.names] if of_folder else [node.module]
                )
                found |= {str(n) for n in names}
    return found - {"sim._kernels.options"}


def step_modules() -> Iterator[dict[str, object]]:
    """Modules of a linearly implicit step without and with contact, and those that contact adds."""
    system, start = plate_on_tissue()
    terms = tuple(t for t in system.scene.terms if not isinstance(t, sim.ConstraintContact))
    without = sim.compile_scene(replace(system.scene, terms=terms))
    used: list[set[str]] = []
    for of, state in ((without, replace(start, memory={})), (system, start)):

        def step(of: sim.System = of, state: sim.State = state) -> None:
            sim.simulate(
                of, sim.resting(0), duration=1e-3, initial=state,
                integrator=sim.LinearlyImplicitEuler(), steps=sim.FixedStep(1e-3), probes=(),
            )  # fmt: skip

        step()
        used.append(modules_of(step))
    plain, touching = used
    for name, some in (
        ("step without contact", plain),
        ("step with contact", touching),
        ("added by contact", touching - plain),
    ):
        yield {
            "modules of": name,
            "count": len(some),
            "kernels": len(kernels_of(some)),
            "names": ", ".join(sorted(s.removeprefix("sim/") for s in some))
            if "added" in name
            else "",
        }


def main(out: Path | None = None) -> None:
    """Print, and with a folder store, both tables."""
    finish("lines", pd.DataFrame([folder(name) for name in FOLDERS]), out)
    finish("lines_step", pd.DataFrame(list(step_modules())), out)
