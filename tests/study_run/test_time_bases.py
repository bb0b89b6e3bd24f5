"""Time bases that are wrong by a factor are reported or refused everywhere: memory, files, study."""

import json
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from analysis.cube import TRIAL_DIMS
from emgface.anatomy.jaw.series import read_excitation
from emgface.cli import app
from emgface.errors import DataError, EmgfaceError, FeatureWarning
from emgface.recordings.belonging import of_times
from emgface.recordings.dataset import read_recording, write_recording
from emgface.schema.netcdf import write_netcdf
from tests.study_run.test_interrupted import STUDY

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

CLOCKS = {
    "markers at half the rate": {"time_marker": 2.0},
    "markers at twice the rate": {"time_marker": 0.5},
    "markers in ms": {"time_marker": 1e3},
    "sEMG at half the rate": {"time_emg": 2.0},
}
"""Factors of the clocks of a recording that are wrong."""
COMMON = ("little_in_common", "nothing_in_common")


def with_clocks(recording: xr.Dataset, factors: dict[str, float]) -> xr.Dataset:
    return recording.assign_coords({
        name: (name, factor * recording[name].values, recording[name].attrs)
        for name, factor in factors.items()
    })  # fmt: skip


@pytest.fixture(scope="module")
def trial(laboratory: Path, tmp_path_factory) -> dict[str, Path]:
    """Recording, study, activation and motion of one trial."""
    folder = tmp_path_factory.mktemp("trial")
    paths = {name: folder / f"{name}.nc" for name in ("activation", "motion")}
    paths["recording"] = next((laboratory / "recordings").glob("*_B_*.nc"))
    paths["face"], paths["study"] = laboratory / "face.nc", folder / "study.toml"
    (folder / "recordings").mkdir()
    paths["study"].write_text(STUDY.format(folder=folder / "recordings", face=paths["face"]))
    for line in (
        "activate {recording} --study {study} --out {activation}",
        "simulate {activation} --study {study} --out {motion}",
    ):
        result = CliRunner().invoke(app, line.format(**paths).split())
        assert result.exit_code == 0, result.output
    return paths


def as_csv(recording: xr.Dataset, folder: Path) -> Path:
    """Write a recording as two tables with the rates that its times have."""
    emg, position = recording["emg"], recording["position"]
    names = [str(name) for name in emg["channel"].values]
    emg.transpose("time_emg", "channel").to_pandas().set_axis(names, axis=1).to_csv(
        folder / "emg.csv", index=False
    )
    markers = [f"{m}_{a}" for m in position["marker"].values for a in "xyz"]
    rows = position.transpose("time_marker", "marker", "axis").values.reshape(
        position.sizes["time_marker"], -1
    )
    lines = [",".join(map(repr, row)) for row in rows.tolist()]
    (folder / "markers.csv").write_text("\n".join([",".join(markers), *lines]) + "\n")
    rates = [1.0 / float(np.diff(recording[t].values[:2])[0]) for t in ("time_emg", "time_marker")]
    sidecar = folder / "recording.toml"
    sidecar.write_text(
        'schema = "recording"\norigin = "simulated"\n'
        + "".join(f"{name} = {json.dumps(recording.attrs[name])}\n" for name in TRIAL_DIMS
                  if name in recording.attrs)
        + f'[emg]\nfile = "emg.csv"\nrate = {rates[0]!r}\nunit = "V"\n'
        + f'[position]\nfile = "markers.csv"\nrate = {rates[1]!r}\nunit = "m"\n'
    )  # fmt: skip
    return sidecar


def as_netcdf(recording: xr.Dataset, folder: Path) -> Path:
    write_recording(recording, folder / "recording.nc")
    return folder / "recording.nc"


ENTRANCES: dict[str, Callable[[xr.Dataset, Path], xr.Dataset | Path]] = {
    "memory": lambda recording, _: recording,
    "netCDF": as_netcdf,
    "CSV": as_csv,
}


def text_of(act: Callable[[], xr.Dataset | None]) -> str:
    """Findings, warnings and the refusal of a step."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            result = act()
        except (EmgfaceError, ValueError) as error:
            return f"refused: {error}"
    stored = "" if result is None else str(result.attrs.get("findings", ""))
    return " ".join([stored, *(str(one.message) for one in caught)])


@pytest.mark.parametrize("wrong", list(CLOCKS))
@pytest.mark.parametrize("entrance", list(ENTRANCES))
def test_clocks_of_a_recording_are_compared(entrance, wrong, trial, tmp_path) -> None:
    """A score of markers at half their rate was 0.68 in place of 0.95, without a word."""
    right = read_recording(trial["recording"])
    given = ENTRANCES[entrance](with_clocks(right, CLOCKS[wrong]), tmp_path)
    options = {"face": trial["face"], "study": trial["study"]}
    score = text_of(lambda: ef.score(given, trial["motion"], **options))
    assert any(code in score for code in COMMON) or score.startswith("refused"), score
    assert "in common" in score or score.startswith("refused"), "and stated where a person reads it"
    activate = text_of(lambda: ef.activate(given, strategy="act_rel", study=trial["study"]))
    assert any(code in activate for code in COMMON) or activate.startswith("refused"), activate
    if not isinstance(given, xr.Dataset):
        checked = CliRunner().invoke(app, ["check", str(given)])
        assert "in common" in " ".join(checked.output.split())


@pytest.mark.parametrize("entrance", list(ENTRANCES))
def test_right_clocks_are_not_doubted(entrance, trial, tmp_path) -> None:
    given = ENTRANCES[entrance](read_recording(trial["recording"]), tmp_path)
    options = {"face": trial["face"], "study": trial["study"]}
    for act in (
        lambda: ef.score(given, trial["motion"], **options),
        lambda: ef.activate(given, strategy="act_rel", study=trial["study"]),
    ):
        text = text_of(act)
        assert not text.startswith("refused") and "in common" not in text and "_times" not in text


def test_a_study_stores_what_it_found_about_the_clocks(trial, tmp_path) -> None:
    right = read_recording(trial["recording"])
    folder = tmp_path / "recordings"
    folder.mkdir()
    write_recording(with_clocks(right, CLOCKS["markers at half the rate"]), folder / "a.nc")
    text = STUDY.format(folder=folder, face=trial["face"])
    (tmp_path / "study.toml").write_text(text)
    for line in (
        "study run {0}/study.toml --out {0}/out --workers 1",
        "report {0}/out --out {0}/r.html",
    ):
        result = CliRunner().invoke(app, line.format(tmp_path).split())
        assert result.exit_code == 0, result.output
    assert "little in common" in (tmp_path / "r.html").read_text(encoding="utf-8")


FACTORS = (0.5, 2.0, 1e3, 1e-3, 1.2)


@pytest.mark.parametrize("factor", FACTORS)
@pytest.mark.parametrize("entrance", ["memory", "file", "command"])
def test_a_motion_with_other_times_is_reported(entrance, factor, trial, tmp_path) -> None:
    """Its times are not those of its simulation, or of the recording with which it is scored."""
    motion = ef.read(trial["motion"])
    changed = motion.assign_coords(time=("time", factor * motion["time"].values, {"units": "s"}))
    if entrance != "memory":
        write_netcdf(changed, tmp_path / "motion.nc", "trajectory")
    if entrance == "command":
        line = f"score {trial['recording']} {tmp_path / 'motion.nc'} --study {trial['study']}"
        line += f" --out {tmp_path / 'scores.nc'}"
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            output = CliRunner().invoke(app, line.split()).output
        text = " ".join([*output.split(), *(str(one.message) for one in caught)])
        assert "were changed by a factor" in text or "expected the recording" in text, text
        return
    given = changed if entrance == "memory" else tmp_path / "motion.nc"
    options = {"face": trial["face"], "study": trial["study"]}
    text = text_of(lambda: ef.score(trial["recording"], given, **options))
    assert "changed_times" in text or text.startswith("refused"), text


def test_a_motion_without_its_interval_is_compared_with_the_recording(trial) -> None:
    motion, recording = ef.read(trial["motion"]), read_recording(trial["recording"])
    motion.attrs.pop("output")
    assert of_times(motion, recording, "time_marker", "recording") == []
    slow = motion.assign_coords(time=3.0 * motion["time"].values)
    (finding,) = of_times(slow, recording, "time_marker", "recording of the markers")
    assert finding.code == "other_times" and 0.2 < finding.values["share"] < 0.6
    assert "the recording of the markers from 0 to" in finding.clause
    assert of_times(motion.isel(time=slice(5, 20)), recording, "time_marker", "recording") == []


def test_an_activation_of_other_times_is_reported_with_a_motion(trial) -> None:
    motion, activation = ef.read(trial["motion"]), ef.read(trial["activation"])
    stretched = activation.assign_coords(
        time=("time", 0.5 * activation["time"].values, {"units": "s"})
    )
    with pytest.warns(FeatureWarning, match="the activation from"):
        ef.show(motion, activation=stretched)
    with warnings.catch_warnings():
        warnings.simplefilter("error", FeatureWarning)
        ef.show(motion, activation=activation)


DRIVES = {
    "few instants": np.array([0.0, 0.1, 0.3]),
    "short": np.arange(0.0, 0.1, 0.001),
    "usual": np.arange(0.0, 2.0, 0.005),
    "coarse": np.arange(0.0, 2.0, 0.04),
}
"""Times of drives [s]."""


def drive(times: np.ndarray, units: dict[str, str]) -> xr.DataArray:
    from emgface.muscles import MUSCLES

    values = np.zeros((len(MUSCLES), len(times)))
    coords = {"muscle": list(MUSCLES), "time": ("time", times, units)}
    return xr.DataArray(values, coords, ("muscle", "time"), attrs={"units": "1"})


@pytest.mark.parametrize("times", list(DRIVES))
@pytest.mark.parametrize("entrance", ["array", "dataset", "netCDF", "CSV"])
def test_milliseconds_without_a_unit_are_refused(entrance, times, trial, tmp_path) -> None:
    """They would be simulated as seconds, or for hours; stated milliseconds are refused, too."""
    options = {"face": trial["face"], "study": trial["study"]}
    for units in ({}, {"units": "ms"}):
        given = drive(1e3 * DRIVES[times], units)
        if entrance == "CSV":
            table = tmp_path / "drive.csv"
            rows = [f"{t!r},0.1" for t in given["time"].values.tolist()]
            table.write_text("\n".join(["time,zygo", *rows]))
            with pytest.raises(EmgfaceError, match="milliseconds"):
                read_excitation(table)
            continue
        dataset = given.to_dataset(name="activation").assign_attrs(origin="simulated")
        if entrance == "netCDF":
            with pytest.raises(DataError, match=r"has no unit|is in 'ms'"):
                write_netcdf(dataset, tmp_path / "a.nc", "activation")
            dataset.to_netcdf(tmp_path / "a.nc")
            with pytest.raises(DataError, match=r"has no unit|is in 'ms'"):
                ef.simulate(tmp_path / "a.nc", **options)
            continue
        one = given if entrance == "array" else dataset
        with pytest.raises(DataError, match=r"no unit of its time|is in 'ms'"):
            ef.simulate(one, **options)


@pytest.mark.parametrize("times", list(DRIVES))
@pytest.mark.parametrize("units", [{}, {"units": "s"}], ids=["without a unit", "s"])
def test_seconds_are_accepted_with_and_without_their_unit(times, units, trial) -> None:
    from emgface.schema.in_memory import usable

    given = (
        drive(DRIVES[times], units).to_dataset(name="activation").assign_attrs(origin="simulated")
    )
    np.testing.assert_array_equal(usable(given, "activation")["time"].values, DRIVES[times])
