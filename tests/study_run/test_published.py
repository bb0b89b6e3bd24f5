"""The published study on simulated folders in the layouts of its recordings, and printed values."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import xarray as xr
from typer.testing import CliRunner

from analysis.published import PRINTED, printed_statements, printed_table, used_stress
from emgface.cli import app
from emgface.errors import DataError
from emgface.muscles import INSTRUCTIONS
from emgface.recordings.dataset import read_recording
from emgface.schema.netcdf import read_netcdf
from emgface.study.published import join_recordings, published_study
from emgface.study.run import run_study
from tests.data.test_poly5 import make_poly5
from tests.study_run.conftest import MECHANICS

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


def marker_table(recording: xr.Dataset, path: Path) -> list[str]:
    """Write the markers in mm, separated by tabs; return the names of the markers."""
    names = [str(m) for m in recording["marker"].values]
    values = 1e3 * recording["position"].transpose("time_marker", "marker", "axis").values
    head = "\t".join(f"{name}_{axis}" for name in names for axis in "xyz")
    rows = values.reshape(len(values), -1)
    np.savetxt(path, rows, fmt="%.6f", delimiter="\t", header=head, comments="")
    return names


def sidecar(path: Path, recording: xr.Dataset, *tables: str) -> None:
    """Write a sidecar of a trial, labelled simulated."""
    place = [f"{k} = {json.dumps(recording.attrs[k])}" for k in ("volunteer", "instruction")]
    place.append(f"repetition = {int(recording.attrs['repetition'])}")
    head = ['schema = "recording"', 'origin = "simulated"', *place]
    path.write_text("\n\n".join(["\n".join(head), *tables]) + "\n", encoding="utf-8")


def position_table(name: str) -> str:
    return f'[position]\nfile = "{name}"\ndelimiter = "\\t"\nrate = 100.0\nunit = "mm"'


def rates(recording: xr.Dataset) -> tuple[list[str], float]:
    names = [str(c) for c in recording["channel"].values]
    return names, 1.0 / float(np.diff(recording["time_emg"].values).mean())


def as_poly5(recording: xr.Dataset, folder: Path, stem: str) -> None:
    """EMG as Poly5 [uV], markers as a table with a sidecar: two files of one trial."""
    names, rate = rates(recording)
    values = 1e6 * recording["emg"].values
    channels = [(n, b"uV", v.astype(np.float32)) for n, v in zip(names, values, strict=True)]
    make_poly5(folder / f"{stem}.poly5", channels, rate=round(rate))
    marker_table(recording, folder / f"{stem}_markers.txt")
    sidecar(folder / f"{stem}.toml", recording, position_table(f"{stem}_markers.txt"))


def as_matlab(recording: xr.Dataset, folder: Path, stem: str) -> None:
    """EMG as a MATLAB array [uV], markers as a table: one sidecar names both."""
    names, rate = rates(recording)
    scipy.io.savemat(folder / f"{stem}.mat", {"emg": 1e6 * recording["emg"].values.T})
    marker_table(recording, folder / f"{stem}_markers.txt")
    table = (
        f'[emg]\nfile = "{stem}.mat"\nvariable = "emg"\ndims = ["time", "channel"]\n'
        f'columns = {json.dumps(names)}\nrate = {rate!r}\nunit = "uV"'
    )
    sidecar(folder / f"{stem}.toml", recording, table, position_table(f"{stem}_markers.txt"))


def as_text(recording: xr.Dataset, folder: Path, stem: str) -> None:
    """EMG and markers as text tables: one sidecar names both."""
    names, rate = rates(recording)
    np.savetxt(folder / f"{stem}.csv", 1e6 * recording["emg"].values.T, fmt="%.6f", delimiter=",",
               header=",".join(names), comments="")  # fmt: skip
    marker_table(recording, folder / f"{stem}_markers.txt")
    table = f'[emg]\nfile = "{stem}.csv"\nrate = {rate!r}\nunit = "uV"'
    sidecar(folder / f"{stem}.toml", recording, table, position_table(f"{stem}_markers.txt"))


LAYOUTS: dict[str, Callable[[xr.Dataset, Path, str], None]] = {
    "poly5": as_poly5, "matlab": as_matlab, "text": as_text,
}  # fmt: skip


@pytest.fixture
def folder(laboratory: Path, tmp_path: Path, layout: str) -> Path:
    """Recordings of the simulated volunteer in one layout."""
    made = tmp_path / layout
    made.mkdir()
    for path in sorted((laboratory / "recordings").glob("*.nc")):
        LAYOUTS[layout](read_recording(path), made, path.stem)
    return made


def pattern(layout: str) -> str | None:
    """Pattern of the names of Poly5 files, which do not state the trial."""
    return "{volunteer}_{instruction}_{repetition}.poly5" if layout == "poly5" else None


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_recordings(folder: Path, laboratory, layout, tmp_path) -> None:
    mapping = tmp_path / "mapping.toml"
    if pattern(layout):
        mapping.write_text(f'names = "{pattern(layout)}"\n')
    given = mapping if pattern(layout) else None
    joined = join_recordings(folder, tmp_path / "joined", mapping=given)
    assert [p.name for p in joined.paths] == ["S01_B_1.nc", "S01_E_1.nc"], joined.omitted
    for path in joined.paths:
        one, same = read_recording(path), read_recording(laboratory / "recordings" / path.name)
        assert one.attrs["origin"] == "simulated"
        emg = one["emg"].sel(channel=same["channel"].values).values
        np.testing.assert_allclose(emg, same["emg"].values, atol=1e-11)
        position = one["position"].sel(marker=same["marker"].values)
        ours, theirs = (
            p.transpose("marker", "axis", "time_marker") for p in (position, same["position"])
        )
        np.testing.assert_allclose(ours.values, theirs.values, atol=1e-8)


@pytest.mark.parametrize("layout", ["text"])
def test_the_study_runs_from_such_a_folder_and_is_compared(
    folder: Path, laboratory, layout, tmp_path
):
    joined = join_recordings(folder, tmp_path / "recordings")
    study = published_study(
        tmp_path / "recordings",
        face={"path": str(laboratory / "face.nc")},
        signals={"normalisation": {"silent": "zero"}, "resampling": {"steps": 40}},
        simulation=MECHANICS,
    )
    assert len(joined.paths) == 2 and study.simulation.sigma_max == 300e3
    cube = run_study(study, tmp_path / "study").cube
    table = printed_table(cube)
    assert len(table.rows) == 9 and "simulated" in table.title and "need not agree" in table.note
    row = next(r for r in table.rows if r[:2] == ("act_rel", "median"))
    own = cube["rho"].sel(strategy="act_rel").values
    assert row[2] == PRINTED["act_rel"]["median"] == 0.77
    assert row[3] == pytest.approx(np.median(own[np.isfinite(own)]))
    (low, high) = used_stress(cube)["S01"]
    assert low == high <= 300e3  # one value per volunteer


def test_statements_are_judged_by_medians() -> None:
    markers = ["corner_left", "upper_lateral_left", "upper_paramedian_left", "lower_lateral_left",
               "lower_paramedian_left"]  # fmt: skip
    level = np.array([0.9, 0.8, 0.7, 0.5, 0.4])
    shape = (1, len(INSTRUCTIONS), 1, 3, len(markers))
    dims = ("volunteer", "instruction", "repetition", "strategy", "marker")
    lead = np.array([0.0, 0.0, 0.0, 0.0, 0.3, 0.3])[None, :, None, None, None]
    worse = np.array([-0.2, 0.0, 0.0])[None, None, None, :, None]
    cube = xr.Dataset(
        {
            "rho": (dims, np.broadcast_to(level, shape) + lead + worse),
            "amplitude_ratio": (dims, np.full(shape, 1.4)),
            "status": (dims[:4], np.full(shape[:4], "ok")),
        },
        coords={"instruction": list(INSTRUCTIONS), "strategy": ["act_all", "act_3", "act_rel"],
                "marker": markers, "volunteer": ["S01"], "repetition": [1]},
    )  # fmt: skip
    said = {text: verdict for text, verdict, _ in printed_statements(cube)}
    assert said.pop("the model moves less than the volunteer") == "does not hold"
    assert set(said.values()) == {"holds"} and len(said) == 5
    flipped = cube.assign(rho=-cube["rho"])
    assert {v for _, v, _ in printed_statements(flipped)} == {"does not hold"}
    part = cube.sel(instruction=["A"], strategy=["act_rel"])
    verdicts = {text: v for text, v, _ in printed_statements(part)}
    assert verdicts["act_3 has a higher rho than act_all"] == "not tested"


@pytest.mark.parametrize("layout", ["poly5"])
def test_trials_that_lack_a_part_or_have_it_twice_are_named(folder: Path, layout, tmp_path) -> None:
    mapping = tmp_path / "mapping.toml"
    mapping.write_text(f'names = "{pattern(layout)}"\n')
    (folder / "S01_E_1.poly5").unlink()
    joined = join_recordings(folder, tmp_path / "joined", mapping=mapping)
    assert [p.name for p in joined.paths] == ["S01_B_1.nc"]
    assert any("emg not found next to S01_E_1.toml" in text for text in joined.omitted)
    (folder / "again").mkdir()
    (folder / "again" / "S01_B_1.poly5").write_bytes((folder / "S01_B_1.poly5").read_bytes())
    with pytest.raises(DataError, match="no trial in .* has EMG and markers"):
        join_recordings(folder, tmp_path / "none", mapping=mapping)


@pytest.mark.slow
@pytest.mark.parametrize("layout", ["matlab"])
def test_the_command_writes_the_comparison(folder: Path, laboratory, layout, tmp_path) -> None:
    out = tmp_path / "out"
    given = ["study", "published", str(folder), "--out", str(out), "--face",
             str(laboratory / "face.nc"), "--accuracy", "draft", "--no-contact"]  # fmt: skip
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    assert "simulated" in result.output and "0.77" in result.output
    assert (out / "tables" / "printed.csv").is_file()
    assert read_netcdf(out / "cube.nc", "cube").attrs["origin"] == "simulated"
