"""A face for each volunteer in a study, as an axis of its cube, and what goes wrong with it."""

from pathlib import Path

import numpy as np
import pytest

from emgface.choices import configure
from emgface.errors import FaceError
from emgface.face.file import load_face, save_face
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.results import open_results
from emgface.run.digest import dataset_digest
from emgface.run.store import Store
from emgface.schema.netcdf import read_netcdf
from emgface.study.audit import explain, planned_trials
from emgface.study.configuration import Axis, StudyConfiguration
from emgface.study.file import face_file, study_face
from emgface.study.run import run_study
from emgface.volunteers.person import person_face
from tests.study_run.conftest import MECHANICS

PATTERN = "own/{volunteer}.nc"


def study(recordings: Path, **face: object) -> StudyConfiguration:
    given = {
        "strategies": ["act_rel"],
        "recordings": {"folder": str(recordings), "instructions": ["B"]},
        "signals": {"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}},
        "simulation": MECHANICS,
    }
    return configure(StudyConfiguration, given | {"face": face})


@pytest.fixture(scope="module")
def recordings(laboratory: Path, tmp_path_factory) -> Path:
    """One recording, as that of two volunteers."""
    folder = tmp_path_factory.mktemp("two")
    given = read_recording(next((laboratory / "recordings").glob("S01_B_*.nc")))
    for name in ("S01", "S02"):
        write_recording(given.assign_attrs(volunteer=name), folder / f"{name}_B_1.nc")
    return folder


@pytest.fixture(scope="module")
def compared(
    laboratory: Path, recordings: Path, tmp_path_factory
) -> tuple[Path, StudyConfiguration]:
    """Study with the generic face, and with a face per volunteer, the first of which is generic."""
    folder = tmp_path_factory.mktemp("own_faces")
    generic = load_face(laboratory / "face.nc")
    save_face(generic, folder / "own" / "S01.nc")
    save_face(person_face(generic, 1.1), folder / "own" / "S02.nc")
    levels = [str(laboratory / "face.nc"), str(folder / PATTERN)]
    plain = study(recordings, path=levels[0])
    axis = Axis(parameters=("face.path",), levels=tuple(levels), name="geometry")
    plan = plain.model_copy(update={"axis": (axis,)})
    run_study(plan, folder)
    return folder, plan


def test_every_volunteer_is_simulated_with_the_own_face(compared, recordings, tmp_path) -> None:
    folder, _ = compared
    cube = read_netcdf(folder / "cube.nc", "cube")
    assert cube["geometry"].values.tolist() == ["face", "own"]
    assert (cube["status"] == "ok").all()
    rho = cube["rho"].sel(geometry="own")
    same = cube["rho"].sel(geometry="face")
    np.testing.assert_array_equal(rho.sel(volunteer="S01"), same.sel(volunteer="S01"))
    assert (rho.sel(volunteer="S02") != same.sel(volunteer="S02")).any()
    # the same as a study whose only face is that of the second volunteer
    run_study(study(recordings, path=str(folder / "own" / "S02.nc")), tmp_path)
    alone = read_netcdf(tmp_path / "cube.nc", "cube")
    for name in ("rho", "amplitude_ratio", "rms_error"):
        if name in alone:
            np.testing.assert_array_equal(
                cube[name].sel(geometry="own", volunteer="S02"), alone[name].sel(volunteer="S02")
            )


def test_processes_compute_the_same(compared, tmp_path) -> None:
    folder, plan = compared
    run_study(plan, tmp_path, workers=2)
    one, two = (read_netcdf(f / "cube.nc", "cube") for f in (folder, tmp_path))
    np.testing.assert_array_equal(one["rho"], two["rho"])


def test_a_changed_face_concerns_its_volunteer_only(compared) -> None:
    folder, plan = compared
    path = folder / "own" / "S02.nc"
    kept = load_face(path)
    before = {one.label: one.key for one in planned_trials(plan, folder, _store(folder))}
    try:
        path.unlink()
        save_face(person_face(kept, 1.01), path)
        after = {one.label: one.key for one in planned_trials(plan, folder, _store(folder))}
    finally:
        path.unlink()
        save_face(kept, path)
    changed = {label for label in before if before[label] != after[label]}
    assert changed and all("own" in label and "S02" in label for label in changed)
    assert len(explain(plan, folder, folder / "store", ["S02"])) == 2 * len(changed)


def test_the_report_uses_the_face_of_the_volunteer(compared) -> None:
    folder, plan = compared
    swapped = plan.axis[0].model_copy(update={"levels": plan.axis[0].levels[::-1]})
    study_ = plan.model_copy(update={"axis": (swapped,)})
    other = folder / "swapped"
    run_study(study_, other, store=folder / "store")
    results = open_results(other)
    assert results.laboratory is not None and not results.notes
    digests = {v: dataset_digest(load_face(folder / "own" / f"{v}.nc")) for v in ("S01", "S02")}
    assert {v: results.laboratory.for_volunteer(v).face_digest for v in digests} == digests
    trial = results.trial(("S02", "B", 1), "act_rel")
    expected = results.base["rho"].sel(volunteer="S02", instruction="B", repetition=1)
    np.testing.assert_allclose(trial.scores["rho"], expected.squeeze(), atol=1e-12)


def test_files_of_volunteers_are_found_by_name(tmp_path, laboratory, recordings) -> None:
    plan = study(recordings, path=str(tmp_path / PATTERN))
    assert face_file(plan.face, "S01") == tmp_path / "own" / "S01.nc"
    for evil in ("../S01", "/etc/passwd", "a\\b", "..", "x\0y"):
        path = face_file(plan.face, evil)
        assert path.parent == tmp_path / "own" and ".." not in path.parts
    with pytest.raises(FaceError, match="a face of each volunteer"):
        study_face(plan.face)
    with pytest.raises(FaceError, match=r"S01\.nc"):
        run_study(plan, tmp_path / "out")
    # brackets in a folder are no pattern
    folder = tmp_path / "[a]"
    save_face(load_face(laboratory / "face.nc"), folder / "S01_face.nc")
    plan = study(recordings, path=str(folder / "{volunteer}_face.nc"))
    assert dataset_digest(study_face(plan.face)) == dataset_digest(
        load_face(laboratory / "face.nc")
    )


@pytest.mark.parametrize(
    ("path", "label"),
    [("a/generic.nc", "generic"), ("fitted/{volunteer}.nc", "fitted"),
     ("faces/{volunteer}_scan.nc", "scan"), ("{volunteer}/own.nc", "own"),
     ("faces\\{volunteer}.nc", "faces")],
)  # fmt: skip
def test_labels_of_faces(path: str, label: str) -> None:
    axis = Axis(parameters=("face.path",), levels=(path, "x.nc"))
    assert axis.labels()[0] == label


def _store(folder: Path) -> Store:
    return Store(folder / "store", report=print)
