"""Results depend on the code of all modules that a stage reaches, so that no outdated one is used."""

import importlib.util
from pathlib import Path

import pytest

from emgface.anatomy.head.sweep import ROW
from emgface.inverse.calibrate_many import FITTED
from emgface.inverse.many import INVERTED
from emgface.reduced.full_order import SNAPSHOTS
from emgface.run import dependencies
from emgface.run.dependencies import PASSIVE, reached
from emgface.study.baselines import BASELINES, TYPICAL
from emgface.study.formants import SOUND
from emgface.study.skin import SKIN_STAGE
from emgface.study.stage_code import (
    ACTIVATION,
    ALIGNED,
    INVERSE,
    MOTION,
    MOTION_OF_HEAD,
    RANGE,
    SCORES,
    SCORES_OF_HEAD,
    STAGES,
)
from emgface.volunteers.motions import VOLUNTEER_MOTION

FINDINGS = ("check", "finding_codes", "kinds", "labels", "quality.emg", "verdicts")
SIGNALS = ("doubtful", "envelope", "features", "filters", "mapping", "montage", "normalisation")
EXPECTED = {  # modules on which the results of a stage certainly depend
    **{stage: [f"emgface.signals.{name}" for name in SIGNALS] for stage in (RANGE, ACTIVATION)},
    MOTION: ["sim", "emgface.face.recipe", "emgface.face.waypoints", "emgface.reduced.motion"],
    MOTION_OF_HEAD: ["emgface.anatomy.jaw.scene", "emgface.anatomy.tongue.scene"],
    ALIGNED: ["analysis.lag", "analysis.matching", "emgface.recordings.head"],
    SCORES: ["analysis.trajectory", *(f"emgface.recordings.{name}" for name in FINDINGS)],
    SCORES_OF_HEAD: ["emgface.anatomy.jaw.recorded", "analysis.align"],
    INVERSE: ["emgface.inverse.refine", "emgface.inverse.posterior", "emgface.face.measured"],
    FITTED: ["emgface.inverse.calibration_trial", "emgface.inverse.markers"],
    SKIN_STAGE: ["emgface.pictures.surface", "emgface.pictures.subdivision"],
    SOUND: ["emgface.acoustics", "emgface.anatomy.airway.sound"],
    BASELINES: ["analysis.baselines", "analysis.registration", "emgface.study.against_baselines"],
    ROW: ["emgface.anatomy.tongue.template.shape", "emgface.face.template.surface"],
    SNAPSHOTS: ["emgface.face.motion", "sim.contact", "sim._kernels.solid"],
}  # fmt: skip


@pytest.mark.parametrize("stage", EXPECTED, ids=lambda stage: stage.name)
def test_a_stage_reaches_the_code_of_its_results(stage) -> None:
    names = stage.reached
    for name in EXPECTED[stage]:
        assert any(name == one or name.startswith(f"{one}.") for one in names), name
    assert all(importlib.util.find_spec(name) for name in names)
    assert not PASSIVE & (set(names) - set(stage.modules))


def test_what_only_shows_or_starts_results_is_no_part_of_their_code() -> None:
    for stage in (*STAGES, INVERTED, TYPICAL, VOLUNTEER_MOTION):
        for name in ("emgface.cli", "emgface.report", "emgface.view", "emgface.fit"):
            assert not [one for one in stage.reached if one.startswith(name)], (stage.name, name)
    assert not [name for name in SNAPSHOTS.reached if ".reduced" in name]
    assert not [name for name in SKIN_STAGE.reached if name.startswith("emgface.anatomy")]


def test_imports_are_followed_also_in_functions_and_those_of_packages(
    tmp_path: Path, monkeypatch
) -> None:
    package = tmp_path / "stages_of_a_test"
    (package / "inner").mkdir(parents=True)
    texts = {
        "__init__": "", "a": "def f():\n    from stages_of_a_test import b\n",
        "b": "import stages_of_a_test.c as c\nfrom stages_of_a_test.inner import x\n",
        "c": "import numpy\nfrom stages_of_a_test.d import NAME\n", "d": "NAME = 1\n",
        "other": "", "inner/__init__": "x = 1\n", "inner/e": "from stages_of_a_test import g\n",
        "g": "",
    }  # fmt: skip
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(dependencies, "FOLLOWED_PACKAGES", ("stages_of_a_test",))
    monkeypatch.setattr(dependencies, "PASSIVE", frozenset({"stages_of_a_test.d"}))
    names = {name.partition(".")[2] for name in reached(("stages_of_a_test.a",))}
    assert names == {"a", "b", "c", "inner", "g"}
    kept = reached(("stages_of_a_test.a",), ("stages_of_a_test.inner.e",))
    assert {name.partition(".")[2] for name in kept} == {"a", "b", "c"}
    named = reached(("stages_of_a_test.d",))
    assert named == ("stages_of_a_test.d",)
