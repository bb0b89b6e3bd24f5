"""Status, explanation, removal, copies and repetition of a finished study."""

import json
import os
import shutil
from collections.abc import Sequence
from pathlib import Path

import netCDF4
import pytest
import xarray as xr
from typer.testing import CliRunner

from emgface.cli import app
from emgface.errors import DataError, StoreError
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.results import open_results, study_cube
from emgface.run.digest import file_digest
from emgface.run.journal import SCALARS, Journal
from emgface.run.lines import lines, run_files, written
from emgface.run.retention import export, unused_files, used_results
from emgface.run.state import State, read_state
from emgface.run.store import store_netcdf
from emgface.study.audit import explain, reproduce
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture
def folder(shown: Path, tmp_path: Path) -> Path:
    """Copy of a finished study of one trial under two strategies, which names its own store."""
    copy = tmp_path / "study"
    export(shown, copy)
    return copy


def configuration(folder: Path) -> StudyConfiguration:
    return StudyConfiguration.model_validate_json(study_cube(folder).attrs["configuration"])


def with_simulation(study: StudyConfiguration, **changes) -> StudyConfiguration:
    return study.model_copy(update={"simulation": study.simulation.model_copy(update=changes)})


def test_status_counts_trials_and_sizes_as_text_and_json(shown: Path) -> None:
    result = CliRunner().invoke(app, ["study", "status", str(shown)])
    assert result.exit_code == 0, result.output
    assert "2 of 2 trials have an outcome (2 ok)" in result.stdout and "finished" in result.stdout
    state = json.loads(CliRunner().invoke(app, ["study", "status", str(shown), "--json"]).stdout)
    assert state["status"] == {"ok": 2} and state["running"] == [] and state["failures"] == []
    size = sum(path.stat().st_size for path in (shown / "store" / "motion").glob("*.nc"))
    assert state["stored"]["motion"] == {"results": 2, "bytes": size}
    with pytest.raises(DataError, match="has no journal"):
        read_state(shown / "store")


def test_status_does_not_count_outcomes_of_another_configuration_in_silence(tmp_path: Path) -> None:
    """A parameter is changed after the trials of a run, and the next run is interrupted."""
    facts = {"study": "s", "trials": 4, "workers": 1, "store": "store", "code": "c"}
    ok = {name: None for name in SCALARS} | {"muted": False, "stages": [], "reason": ""}

    def run(configuration: str, trials: Sequence[int], outcome: str, total: int = 4) -> State:
        journal = Journal(tmp_path, facts | {"configuration": configuration, "trials": total})
        for k in trials:
            named = {
                "trial": ["V1", "A", k, "act_all"],
                "variant": "",
                "key": f"{configuration}{k}",
            }
            journal.write("trial", **named, status="ok", **ok)
        journal.end(outcome, [])
        return read_state(tmp_path)

    def shown() -> tuple[str, dict]:
        call = ["study", "status", str(tmp_path)]
        text = CliRunner().invoke(app, call).stdout
        return text, json.loads(CliRunner().invoke(app, [*call, "--json"]).stdout)

    assert run("a", [1, 2, 3, 4], "finished").earlier == 0
    assert "earlier runs" not in shown()[0]
    state = run("b", [1], "interrupted")
    assert (state.earlier, state.remaining) == (3, None)
    text, data = shown()
    assert "4 of 4 trials" in text and "3 of these outcomes are of earlier runs" in text
    assert data["earlier"] == 3
    # The outcomes that a finished run has not computed are those that it has read.
    assert run("b", [2, 3], "finished").earlier == 0
    assert run("c", [], "finished", total=3).earlier == 1
    assert run("d", [1, 2, 3], "finished", total=3).earlier == 1


def test_damaged_and_unfinished_lines_of_a_journal_are_ignored(folder: Path) -> None:
    (path,) = run_files(folder)
    whole = path.read_bytes().splitlines(keepends=True)
    trials = [k for k, line in enumerate(whole) if b'"event":"trial"' in line]
    changed = whole[trials[0]].replace(b'"status":"ok"', b'"status":"on"')
    path.write_bytes(b"".join([*whole[: trials[0]], changed, whole[trials[1]][:300]]))
    assert [line["event"] for _, line in lines(path)] == ["run", "begin"]
    assert read_state(folder).runs[-1].state == "running"  # by this process, which wrote it
    again = run_study(configuration(folder), folder)
    assert again.computed() == [] and (again.cube["status"] == "ok").all()
    assert read_state(folder).status == {"ok": 2}


def test_runs_are_in_order_although_a_clock_jumped(folder: Path) -> None:
    (first,) = run_files(folder)
    later = first.stat().st_mtime + 86400
    os.utime(first, (later, later))
    again = run_study(configuration(folder), folder)
    assert run_files(folder) == [first, again.journal]
    assert read_state(folder).runs[-1].path == again.journal


def test_a_journal_of_another_version_is_ignored(folder: Path) -> None:
    (path,) = run_files(folder)
    made = [json.loads(line) for line in path.read_bytes().splitlines()]
    other = [{**line, "format": 2, "scores": "new"} for line in made]
    path.write_bytes(
        b"".join(written({k: line[k] for k in line if k != "check"}) for line in other)
    )
    with pytest.raises(DataError, match="of another version of emgface"):
        read_state(folder)
    again = run_study(configuration(folder), folder)
    assert again.computed() == [] and read_state(folder).status == {"ok": 2}


def test_explain_names_what_changed(folder: Path) -> None:
    study, store = configuration(folder), folder / "store"
    sentences = explain(study, folder, store, ["S01"])
    assert len(sentences) == 2 and all("is up to date (ok" in sentence for sentence in sentences)
    (sentences,) = explain(
        with_simulation(study, sigma_max=90e3), folder, store, "S01 B 1 act_rel".split()
    )
    assert "from stage motion on: sigma_max changed from 100000.0 to 90000.0" in sentences
    victim = next((store / "scores").glob("*.nc"))
    victim.write_bytes(victim.read_bytes()[:100])
    sentences = explain(study, folder, store, [])
    assert (
        sum("from stage scores on: its result has 100 bytes, but" in text for text in sentences)
        == 1
    )
    with pytest.raises(DataError, match="there is no trial 'S02'"):
        explain(study, folder, store, ["S02"])


def test_gc_finds_what_no_study_uses_and_nothing_else(folder: Path) -> None:
    line, store = run_files(folder)[0], folder / "store"
    assert unused_files([folder]).files == []
    unused = [store / "motion" / f"{'0' * 32}.nc", store / "scores" / ".x.nc.12.ab.part"]
    for path in unused:
        path.write_bytes(b"12345")
    collected = unused_files([folder])
    assert sorted(collected.files) == sorted(unused) and collected.size == 10
    result = CliRunner().invoke(app, ["study", "gc", str(folder)])
    assert "2 files" in result.stdout and all(path.exists() for path in unused)
    CliRunner().invoke(app, ["study", "gc", str(folder), "--delete"])
    assert not any(path.exists() for path in unused)
    whole = line.read_bytes().splitlines(keepends=True)
    line.write_bytes(b"".join(whole[:-1]))  # the run of this process has not ended
    with pytest.raises(StoreError, match="is running"):
        unused_files([folder])


def test_results_of_an_outcome_that_was_replaced_are_unused(folder: Path) -> None:
    """But for the state of rest, which trials share; the results of the last outcome are used."""
    (path,) = run_files(folder)
    made = [{k: v for k, v in json.loads(line).items() if k != "check"}
            for line in path.read_bytes().splitlines()]  # fmt: skip
    first = next(k for k, line in enumerate(made) if line["event"] == "trial")
    old = "0" * 32
    stages = [{**stage, "digest": old} for stage in made[first]["stages"]]
    made.insert(first, {**made[first], "stages": stages})
    before = used_results([folder])[(folder / "store").resolve()]
    path.write_bytes(b"".join(map(written, made)))
    after = used_results([folder])[(folder / "store").resolve()]
    assert {"motion", "scores", "rest"} <= {stage["stage"] for stage in stages}
    assert after - before == {("rest", old)} and before <= after


def test_an_exported_study_is_complete(shown: Path, folder: Path, tmp_path: Path) -> None:
    again = run_study(configuration(folder), folder)
    assert again.computed() == []
    xr.testing.assert_identical(study_cube(folder), study_cube(shown))
    export(folder, tmp_path / "small", without=["skin"])
    assert not (tmp_path / "small" / "store" / "skin").exists()
    with pytest.raises(DataError, match="expected a new folder"):
        export(folder, tmp_path / "small")


def test_a_copied_study_uses_the_recordings_next_to_it_and_says_so(
    shown: Path, laboratory: Path, tmp_path: Path
) -> None:
    above = Path(os.path.commonpath([shown, laboratory]))
    folder = tmp_path / "copy" / shown.relative_to(above)
    export(shown, folder)
    adjacent = tmp_path / "copy" / laboratory.relative_to(above) / "recordings"

    def output_of(*words: str) -> str:
        result = CliRunner().invoke(app, ["study", *words, str(folder), "S01 B 1 act_rel"])
        assert result.exit_code == 0, result.output
        return " ".join(result.output.split())

    text = output_of("explain")
    assert f"{laboratory / 'recordings'} is used as before, because there is no {adjacent}" in text
    assert "up to date" in text
    shutil.copytree(laboratory / "recordings", adjacent)
    text = output_of("explain")
    assert f"{adjacent} is used in place of {laboratory / 'recordings'}" in text
    assert "up to date" in text
    path = adjacent / "S01_B_1.nc"
    write_recording(read_recording(path).assign_attrs(comment="another"), path)
    assert "its input recording changed" in output_of("explain")
    assert any(f"{adjacent} is used" in note for note in open_results(folder).notes)


def test_reproduce_passes_and_detects_a_planted_change(folder: Path) -> None:
    study, store = configuration(folder), folder / "store"
    choice = {"wanted": ["S01", "B", "1", "act_rel"], "report": lambda text: None}
    (reproduced,) = reproduce(study, folder, store, **choice)
    assert reproduced.differences == [] and reproduced.equal == 5
    cube = folder / "cube.nc"
    with netCDF4.Dataset(cube, "a") as opened:
        rho = opened["rho"][..., 1, 3].item()
        opened["rho"][..., 1, 3] = rho + 1e-12
    (reproduced,) = reproduce(study, folder, store, **choice)
    assert reproduced.equal == 5 and reproduced.differences == [
        "cube: rho differs by up to 1e-12 1"
    ]
    cube.unlink()
    line = next(
        line for _, line in lines(run_files(folder)[0]) if line.get("trial", [""])[-1] == "act_rel"
        and line["event"] == "trial"
    )  # fmt: skip
    digest = next(s["digest"] for s in line["stages"] if s["stage"] == "motion")
    path = store / "motion" / f"{digest}.nc"
    motion = xr.load_dataset(path, decode_times=False).drop_encoding()
    motion["position"][2, 1, 5] += 1e-9
    store_netcdf(motion, path)
    index = json.loads(path.with_suffix(".json").read_text())
    index |= {"bytes": path.stat().st_size, "sha256": file_digest(path)}
    path.with_suffix(".json").write_text(json.dumps(index))
    (reproduced,) = reproduce(study, folder, store, **choice)
    assert reproduced.equal == 4 and reproduced.differences == [
        "motion: position differs by up to 1e-09 m"
    ]


def test_a_trial_is_computed_again_if_its_results_are_gone(folder: Path) -> None:
    study = configuration(folder)
    shutil.rmtree(folder / "store" / "aligned")
    assert {event.stage for event in run_study(study, folder).computed()} == {"aligned"}


def test_trials_that_found_their_motion_are_compared_stage_by_stage(folder: Path) -> None:
    """The line of such a trial does not name the skin, from which its motion follows."""
    study, store = configuration(folder), folder / "store"
    shutil.rmtree(folder / "runs")
    run_study(study, folder)
    for reproduced in reproduce(study, folder, store, count=None, report=lambda text: None):
        assert reproduced.differences == [] and reproduced.equal == 5
