"""A simulated volunteer: contents of its recording, and reproducibility."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters
from emgface.muscles import FACE_MARKERS, LIP_MARKERS
from emgface.recordings.dataset import read_recording
from emgface.run.state import read_state
from emgface.schema.validation import declaration
from emgface.volunteers.person import (
    POWERS,
    draw_volunteer,
    person_face,
    person_parameters,
)
from emgface.volunteers.simulate import make_volunteers
from tests.study_run.conftest import MECHANICS

PARAMETERS = configure(SimulationParameters, MECHANICS)


@pytest.fixture
def made(laboratory: Path) -> list[Path]:
    """Recordings of B and E."""
    return sorted((laboratory / "recordings").glob("*.nc"))


def test_a_recording_follows_the_schema_and_is_labelled_simulated(made) -> None:
    for path, instruction in zip(made, "BE", strict=True):
        recording = read_recording(path, study=True)
        assert recording.attrs["origin"] == "simulated"
        assert recording.attrs["instruction"] == instruction
        assert "simulated" in recording.attrs["source"]
        assert recording["true_activation"].sizes == {"muscle": 20, "time_true": 1801}
        assert float(recording["time_emg"][-1]) == pytest.approx(1.8, abs=1e-3)
        assert recording.sizes["time_marker"] == 181


def test_sessions_are_recorded_as_jobs_of_a_run(laboratory: Path, tmp_path: Path) -> None:
    state = read_state(laboratory)
    assert state.total == 2 and state.status == {"ok": 2} and state.runs[-1].state == "finished"
    motions = list((state.store(laboratory) / "volunteer_motion").glob("*.nc"))
    size = sum(path.stat().st_size for path in motions)
    assert state.sizes["volunteer_motion"] == (2, size)
    with pytest.raises(KeyboardInterrupt):
        make_volunteers(None, tmp_path, n=1, instructions=("B",), stopping=lambda: True)
    stopped = read_state(tmp_path)
    assert stopped.runs[-1].state == "interrupted" and stopped.status == {} and stopped.total == 1


def lips_in_head_frame(recording: xr.Dataset) -> np.ndarray:
    """Independent removal of head motion: orthogonal Procrustes frame by frame."""
    seen = recording["position"].interpolate_na("time_marker")  # markers are lost for moments
    seen = seen.transpose("time_marker", "marker", "axis")
    face = seen.sel(marker=list(FACE_MARKERS)).values
    lips = seen.sel(marker=list(LIP_MARKERS)).values
    still = face[0] - face[0].mean(axis=0)
    result = np.empty_like(lips)
    for k in range(len(face)):
        centre = face[k].mean(axis=0)
        u, _, vt = np.linalg.svd((face[k] - centre).T @ still)
        d = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
        result[k] = (lips[k] - centre) @ u @ d @ vt
    return result


def test_lips_move_within_the_head_while_the_instruction_lasts(made) -> None:
    recording = read_recording(made[0])
    lips = lips_in_head_frame(recording)
    moved = np.linalg.norm(lips - lips[:10].mean(axis=0), axis=-1)
    assert moved[:10].mean() < 5e-4  # marker noise 0.1 mm, also in the head frame
    upper = list(LIP_MARKERS).index("upper_paramedian_left")
    assert moved[80:100, upper].mean() > 1e-3  # raise upper lip


@pytest.mark.slow
def test_the_same_seed_gives_the_same_files_and_stored_motions_are_reused(
    made, slab, tmp_path: Path
) -> None:
    again = make_volunteers(slab, tmp_path, n=1, instructions=("E",), seed=2, parameters=PARAMETERS)
    first, second = read_recording(made[1]), read_recording(again[0])
    drop = ["source_digest"]
    for dataset in (first, second):
        for name in drop:
            dataset.attrs.pop(name, None)
    xr.testing.assert_identical(first, second)
    stored = {p: p.stat().st_mtime_ns for p in (tmp_path / "store").rglob("*.nc")}
    make_volunteers(slab, tmp_path, n=1, instructions=("E",), seed=2, parameters=PARAMETERS)
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "store").rglob("*.nc")} == stored


@pytest.mark.slow
def test_two_processes_write_the_files_of_one(made, slab, tmp_path: Path) -> None:
    paths = make_volunteers(
        slab, tmp_path, n=1, instructions=("B", "E"), seed=2, parameters=PARAMETERS, workers=2
    )
    assert [path.name for path in paths] == ["S01_B_1.nc", "S01_E_1.nc"]
    for path, other in zip(paths, made, strict=True):
        first, second = read_recording(path), read_recording(other)
        # The number of threads may affect the last digits of a product (emg of 1e-4 V) and of a
        # factorisation, and therefore the end of an iteration.
        np.testing.assert_allclose(first["emg"], second["emg"], rtol=0, atol=1e-15)
        np.testing.assert_allclose(first["position"], second["position"], atol=2e-6)


def test_a_person_has_a_scaled_face_and_tissue_of_its_own(slab) -> None:
    person = draw_volunteer(1, 4)
    face = person_face(slab, person.geometry_scale)
    np.testing.assert_allclose(face["position"], slab["position"] * person.geometry_scale)
    for name in face.data_vars:  # every length, also of teeth and of a stress-free shape
        factor = person.geometry_scale if face[name].attrs.get("units") == "m" else 1.0
        np.testing.assert_allclose(face[name], slab[name] * factor)
        assert face[name].attrs == slab[name].attrs
    units = {one.units for one in declaration("face_model").arrays().values()}
    assert units == {*POWERS}
    own = person_parameters(person, PARAMETERS)
    assert own.sigma_max == person.sigma_max and own.C10 == 2500.0 * person.stiffness
