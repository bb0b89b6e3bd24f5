"""Every stage lists all code that affects its results, so that no outdated result is used."""

import ast
import importlib.util
from pathlib import Path

import pytest

from emgface.anatomy.head.sweep import ROW
from emgface.inverse.calibrate_many import FITTED
from emgface.inverse.many import INVERTED
from emgface.study.baselines import BASELINES, TYPICAL
from emgface.study.formants import SOUND
from emgface.study.skin import SKIN
from emgface.study.stage_code import INVERSE, STAGES
from emgface.volunteers.motions import MOTION, REST

PACKAGES = ("emgface", "sim", "analysis")
PASSIVE = {
    "emgface.plugins",  # finds the code of other packages, which enters the digest by itself
    "emgface.errors",  # names of failures, which are not stored
    "analysis.errors",
    "emgface.muscles",  # names that stand in the datasets themselves
    "emgface.choices",  # values, which enter the digest as parameters
    "emgface.signals.parameters",
    "emgface.face.simulation_parameters",
    "emgface.face.accuracy",
    "emgface.face.contact_parameters",
    "sim._kernels.cache",  # location of compiled kernels
}
KEPT = {  # find and store inputs, whose digests are part of that of the result
    *(f"emgface.run.{name}" for name in ("digest", "journal", "mechanics", "store")),
    *(
        f"emgface.study.{name}"
        for name in ("laboratory", "motions", "outcomes", "stage_code", "stages", "table")
    ),
}
TRACT = {  # make the tract, whose digest is part of that of formants, or what follows from these
    "emgface.anatomy.airway.sections",
    "emgface.face.artisynth_contact",
    "emgface.face.lip_shape",
    "emgface.files",
    "emgface.schema.netcdf",
    "analysis.cube",
    "analysis.tables",
}
HEAD = {"emgface.anatomy.head.recorded"}  # of heads, whose stages list it
NAMES = {"emgface._callable", "emgface.api"}  # public names, of which sweeps use none
ALLOWED = {
    **{stage: set() for stage in (*STAGES, INVERSE, INVERTED, FITTED, REST, MOTION)},
    **{stage: KEPT for stage in (TYPICAL, BASELINES)},
    SKIN: KEPT | HEAD,
    SOUND: KEPT | TRACT,
    ROW: NAMES,
}


def source(module: str) -> Path:
    spec = importlib.util.find_spec(module)
    assert spec is not None and spec.origin is not None, module
    return Path(spec.origin)


def imported(module: str) -> set[str]:
    """First-party modules imported by the text of a module."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source(module).read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                is_first = node.module.split(".")[0] in PACKAGES
                exists = is_first and importlib.util.find_spec(node.module) is not None
                try:
                    is_module = exists and importlib.util.find_spec(inner) is not None
                except ModuleNotFoundError:
                    is_module = False
                found.add(inner if is_module else node.module)
    return {name for name in found if name.split(".")[0] in PACKAGES}


@pytest.mark.parametrize("stage", ALLOWED, ids=lambda stage: stage.name)
def test_the_code_version_covers_everything_a_stage_imports(stage) -> None:
    passive = PASSIVE | ALLOWED[stage]

    def covered(module: str) -> bool:
        return module in passive or any(
            module == named or module.startswith(f"{named}.") for named in stage.modules
        )

    waiting, seen, uncovered = list(stage.modules), set(), set()
    while waiting:
        module = waiting.pop()
        if module in seen or module in passive or module.split(".")[0] == "sim":
            continue  # sim is listed whole, and imports nothing of the other two packages
        seen.add(module)
        for name in imported(module):
            if not covered(name):
                uncovered.add(f"{module} imports {name}")
            else:
                waiting.append(name)
    assert not uncovered


def test_an_import_that_is_not_listed_is_found() -> None:
    assert "emgface.signals.filters" in imported("emgface.signals.resampling")
    assert "emgface.face.simulation_parameters" in imported("emgface.face.recipe")
