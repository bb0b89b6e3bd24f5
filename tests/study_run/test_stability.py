"""Reports of motions that depend on rounding."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import sim
from analysis.cube import build_cube
from emgface.face.stability import NOTICED, rounding_sensitivity, stability_warning
from emgface.report.study_tables import write_tables
from tests.analysis.synthetic_cubes import results
from tests.verification.test_rounding import buckled, column


def moved(by: float) -> xr.Dataset:
    """A motion of one marker, displaced along y at its last instant [m]."""
    position = np.zeros((1, 3, 4))
    position[0, 1, 3] = by
    return xr.Dataset({"position": (("marker", "axis", "time"), position)})


def test_the_change_by_rounding_is_measured() -> None:
    system = column(5e4)
    nodes, names = np.array([40, 41]), ("a", "b")
    probes = (sim.Markers(nodes, names),)

    def again(start: sim.State) -> xr.Dataset:
        assert 0.0 < np.abs(start.q - system.rest_state().q).max() < 2e-14
        return buckled(system, sim.Sdirk2(), "superlu", 2, *probes)

    motion = buckled(system, sim.Sdirk2(), "superlu", 1, *probes)
    other = buckled(system, sim.Sdirk2(), "superlu", 2, *probes)
    expected = np.sqrt(((motion["position"] - other["position"]).values ** 2).sum(axis=1)).max()
    sensitivity = rounding_sensitivity(system, system.rest_state(), motion, again)
    assert sensitivity == pytest.approx(expected, rel=1e-12)
    assert sensitivity > 1e-3

    def failing(start: sim.State) -> xr.Dataset:
        raise sim.InvertedElement(3, -0.1, 0.1)

    assert rounding_sensitivity(system, system.rest_state(), motion, failing) == np.inf


def test_the_warning_names_times_and_size_and_is_silent_where_nothing_changes() -> None:
    motion = moved(0.0)
    assert stability_warning(motion) == ""
    motion.attrs = {"unstable_from_s": 0.05, "unstable_until_s": 0.123}
    motion.attrs["rounding_sensitivity"] = 0.5 * NOTICED
    assert stability_warning(motion) == ""
    motion.attrs["rounding_sensitivity"] = 1.2e-4
    warning = stability_warning(motion)
    assert "lost stability between 0.05 and 0.123 s" in warning
    assert "depends on rounding at the level of 0.12 mm" in warning
    motion.attrs["rounding_sensitivity"] = np.inf
    assert "fails from a start displaced by 1e-14 m" in stability_warning(motion)


def test_the_summary_of_a_study_names_scored_trials_that_rounding_decides(tmp_path: Path) -> None:
    trials = results()
    scored = next(k for k, trial in enumerate(trials) if trial.status == "ok")
    before = write_tables(build_cube(trials), tmp_path).failures
    trials[scored] = replace(trials[scored], reason="the motion there depends on rounding")
    after = write_tables(build_cube(trials), tmp_path).failures
    one = trials[scored]
    label = f"{one.volunteer} {one.instruction} {one.repetition} {one.strategy}"
    assert [line for line in after if line not in before] == [
        f"1 trial ({label}) ok: the motion there depends on rounding"
    ]
