"""sigma_max calibrated by other repetitions: true values, no leak, refusals, and its default."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import typer
import xarray as xr

import emgface as ef
from emgface.choices import configure
from emgface.cli import options
from emgface.errors import ConfigurationError, DataError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.methods import methods
from emgface.study.calibrated import COMPARED_STRESSES, stress_of
from emgface.study.run import run_study
from emgface.volunteers.settings import VolunteerParameters
from emgface.volunteers.simulate import make_volunteers
from emgface.volunteers.world import MATCHED
from tests.study_run.conftest import MECHANICS
from tests.study_run.test_run import configured

STIFF = MECHANICS | {"C10": 20e3, "P1": 0.0}
"""Stiff tissue and fibres without passive stress: the motion depends on the strength of the muscles."""
pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture(scope="module")
def people(slab: xr.Dataset, laboratory: Path, tmp_path_factory) -> Path:
    """Two repetitions of B and E of one volunteer with the face of the study."""
    folder = tmp_path_factory.mktemp("calibrated")
    shutil.copy(laboratory / "face.nc", folder / "face.nc")
    make_volunteers(
        slab,
        folder,
        n=1,
        repetitions=2,
        instructions=("B", "E"),
        seed=2,
        parameters=configure(SimulationParameters, STIFF),
        settings=VolunteerParameters(world=MATCHED),
    )
    return folder


def calibrated(folder: Path, **changes):
    policy = {"sigma_max_policy": {"calibration": "repetitions"}}
    return configured(folder, simulation=STIFF | {"sigma_max": 300e3} | policy, **changes)


@pytest.fixture(scope="module")
def studied(people: Path, tmp_path_factory) -> Path:
    """Folder of the study of these people, computed by one process; read by a repeated run."""
    folder = tmp_path_factory.mktemp("studied")
    run_study(calibrated(people), folder)
    return folder


@pytest.mark.parametrize("true", [50e3, 60e3, 120e3, 150e3, 300e3])
@pytest.mark.parametrize("power", [0.5, 1.0, 1.6])
def test_the_stress_of_a_power_law_is_found(true: float, power: float) -> None:
    """Ratio (s / s0)^p: ln ratio is linear in ln s."""
    curve = tuple(power * np.log(np.array(COMPARED_STRESSES) / true))
    assert stress_of([curve] * 3) == pytest.approx(true)
    spread = [tuple(np.array(curve) + shift) for shift in (-0.7, 0.0, 0.1)]
    assert stress_of(spread) == pytest.approx(true)  # the median trial
    lost = (curve[0], np.nan, curve[2])
    assert stress_of([lost]) == pytest.approx(true)


def test_the_stress_is_not_extrapolated_and_is_nan_without_evidence() -> None:
    assert stress_of([tuple(np.log(np.array(COMPARED_STRESSES) / 1e6))]) == pytest.approx(
        COMPARED_STRESSES[-1]
    )
    assert stress_of([tuple(np.log(np.array(COMPARED_STRESSES) / 1e3))]) == pytest.approx(
        COMPARED_STRESSES[0]
    )
    assert np.isnan(stress_of([]))
    assert np.isnan(stress_of([(np.nan, np.nan, 0.1)]))
    assert np.isnan(stress_of([(0.2, 0.1, -0.1)]))  # stronger muscles that move less


def test_the_true_activation_recovers_the_stress_of_the_volunteer(people: Path, tmp_path) -> None:
    study = calibrated(people, activation_source="true")
    cube = run_study(study, tmp_path / "study").cube
    true = read_recording(people / "recordings" / "S01_B_1.nc").attrs["true_sigma_max"]
    assert np.unique(cube["sigma_max"]).size == 2  # one value per repetition
    # The tissue of the volunteer is 15 % stiffer than that of the study, and the face 6 % larger.
    assert cube["sigma_max"].values == pytest.approx(np.full((1, 2, 2, 1), true), rel=0.15)
    assert float(cube["amplitude_ratio"].median()) == pytest.approx(1.0, abs=0.05)
    assert "was calibrated for each volunteer" in str(methods(study, cube))


def test_markers_of_a_repetition_do_not_affect_its_own_value(
    people: Path, studied: Path, tmp_path
) -> None:
    """Motion of repetition 1 doubled: its value stays bit for bit, that of repetition 2 does not."""
    other = tmp_path / "other"
    shutil.copytree(people, other, ignore=shutil.ignore_patterns("store", "runs"))
    for path in sorted((other / "recordings").glob("*_1.nc")):
        recording = read_recording(path)
        lips = [m for m in recording["marker"].values if not str(m).startswith("face")]
        position = recording["position"].copy()
        own = position.sel(marker=lips)
        first = own.isel(time_marker=0, drop=True)
        position.loc[{"marker": lips}] = (first + 2.0 * (own - first)).transpose(*own.dims)
        path.unlink()
        write_recording(recording.assign(position=position), path)
    before = run_study(calibrated(people), studied).cube["sigma_max"]
    after = run_study(calibrated(other), tmp_path / "b").cube["sigma_max"]
    assert (before.sel(repetition=1) == after.sel(repetition=1)).all()
    assert (after.sel(repetition=2) > 1.2 * before.sel(repetition=2)).all()


def test_two_processes_and_a_repeated_run_give_the_same_values(
    people: Path, studied: Path, tmp_path
) -> None:
    one = run_study(calibrated(people), studied)
    assert one.computed() == []
    two = run_study(calibrated(people), tmp_path / "two", workers=2)
    assert (one.cube["sigma_max"] == two.cube["sigma_max"]).all()
    assert (one.cube["rho"] == two.cube["rho"]).all()


def test_one_repetition_cannot_be_calibrated(laboratory: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="0 trials of other repetitions"):
        run_study(calibrated(laboratory), tmp_path / "study")


def test_strategies_that_follow_markers_are_refused(laboratory: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be combined with the strategy assisted"):
        calibrated(laboratory, strategies=["act_rel", "assisted"])


def test_the_published_stress_has_a_name() -> None:
    named = configure(SimulationParameters, {"sigma_max": "published"})
    assert named.sigma_max == 300e3
    with pytest.raises(ConfigurationError, match="sigma_max"):
        configure(SimulationParameters, {"sigma_max": "strong"})


def test_simulate_calibrates_from_other_trials_and_refuses_its_own(
    people: Path, studied: Path
) -> None:
    recording = people / "recordings"
    activation = ef.activate(recording / "S01_B_1.nc", strategy="act_rel")
    given = {"face": people / "face.nc", **STIFF}
    others = [recording / f"S01_{one}.nc" for one in ("B_2", "E_2")]
    moved = ef.simulate(activation, calibrate=others, progress=False, **given)
    cube = run_study(calibrated(people), studied).cube
    of_study = float(cube["sigma_max"].sel(instruction="B", repetition=1).squeeze())
    assert 50e3 <= moved.attrs["sigma_max"] <= 300e3
    assert moved.attrs["sigma_max"] == pytest.approx(of_study, rel=0.15)
    with pytest.raises(ConfigurationError, match="is the trial that is simulated"):
        ef.simulate(activation, calibrate=[recording / "S01_B_1.nc"], progress=False, **given)
    with pytest.raises(ConfigurationError, match="does not state its volunteer"):
        ef.simulate(activation["activation"].assign_attrs(volunteer=None).drop_attrs(),
                    calibrate=others, progress=False, **given)  # fmt: skip
    renamed = activation.assign_attrs(volunteer="S09")
    with pytest.raises(ConfigurationError, match="expected recordings of S09"):
        ef.simulate(renamed, calibrate=others, progress=False, **given)


def test_the_published_stress_has_a_name_on_the_command_line() -> None:
    assert options.stress("published") == 300e3 and options.stress("115e3") == 115e3
    with pytest.raises(typer.BadParameter, match="expected a stress in Pa"):
        options.stress("weak")
