"""Commands that examine recordings: proposed labels, pages, and protection of existing files."""

import io
import json
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from rich.console import Console

from emgface.cli import console
from emgface.cli.data import FORMATS
from emgface.muscles import CHANNELS
from emgface.recordings.bids.rules import bids_problems
from emgface.recordings.dataset import read_recording, readers, write_recording
from emgface.recordings.quality import remove_hum
from tests.data.conftest import recording
from tests.study_run.test_cli import one_sentence, run, stored

WORDS = {"ZYG_L": "Left zygomaticus", "RIS_R": "EMG 7", "MEN_L": "Trigger"}
"""Labels as a laboratory might have typed them; the last two name no muscle."""


@pytest.fixture
def foreign(laboratory: Path, tmp_path: Path) -> Path:
    """Return the file of a recording with other labels."""
    recording = read_recording(next((laboratory / "recordings").glob("*_B_*.nc")))
    labels = [WORDS.get(str(name), str(name)) for name in recording["channel"].values]
    return stored(recording.assign_coords(channel=labels), tmp_path)


def test_labels_are_proposed_listed_and_written(foreign: Path, tmp_path: Path) -> None:
    out = tmp_path / "mapping.toml"
    result = run("map", foreign, "--out", out)
    assert result.exit_code == 0, result.output
    assert "Left zygomaticus" in result.stdout and "corner_left" in result.stdout
    assert "EMG 7" in result.stdout and "Unresolved: 2 of 14 channels" in result.stderr
    assert "No label found for: RIS_R, MEN_L." in result.stderr.replace(
        "MEN_L, RIS_R", "RIS_R, MEN_L"
    )
    tables = tomllib.loads(out.read_text(encoding="utf-8"))
    assert tables["channels"]["Left zygomaticus"] == "ZYG_L"
    assert set(tables["channels"].values()) == set(CHANNELS) - {"RIS_R", "MEN_L"}
    assert len(tables["markers"]) == 16
    completed = out.read_text(encoding="utf-8")
    for label, name in (("EMG 7", "RIS_R"), ("Trigger", "MEN_L")):
        completed = completed.replace(f'# "{label}" = ""', f'"{label}" = "{name}"')
    out.write_text(completed, encoding="utf-8")
    assert set(read_recording(foreign, mapping=out, study=True)["channel"].values) == set(CHANNELS)


def test_a_mapping_file_is_not_overwritten(foreign: Path, tmp_path: Path) -> None:
    out = tmp_path / "mapping.toml"
    out.write_text("mine")
    one_sentence(run("map", foreign, "--out", out), "DataError", r"mapping\.toml exists")
    assert out.read_text() == "mine"
    before = set(tmp_path.iterdir())
    assert "--out" in run("map", foreign).stderr and set(tmp_path.iterdir()) == before


def test_an_overview_page_is_drawn(foreign: Path, tmp_path: Path) -> None:
    page = tmp_path / "pages" / "overview.png"
    result = run("check", foreign, "--page", page)
    assert f"Wrote {page}" in result.stderr
    assert page.read_bytes().startswith(b"\x89PNG\r\n\x1a\n")


def test_several_recordings_are_pages_of_one_pdf(laboratory: Path, tmp_path: Path) -> None:
    page = tmp_path / "overview.pdf"
    result = run("check", laboratory / "recordings", "--page", page)
    assert result.exit_code == 0, result.output
    content = page.read_bytes()
    assert content.startswith(b"%PDF") and b"/Count 2 " in content


@pytest.mark.parametrize(("name", "said"), [("a.png", "2 recordings"), ("a.xyz", r"'\.xyz'")])
def test_a_page_that_cannot_be_drawn_is_refused_at_once(
    laboratory: Path, tmp_path: Path, name: str, said: str
) -> None:
    result = run("check", laboratory / "recordings", "--page", tmp_path / name)
    one_sentence(result, "DataError", said, r"\.pdf")
    assert result.stdout == "" and list(tmp_path.iterdir()) == []


def test_no_page_is_left_where_the_recording_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "bad.nc").write_bytes(b"")
    result = run("check", tmp_path / "bad.nc", "--page", tmp_path / "overview.png")
    one_sentence(result, "DataError", r"bad\.nc")
    assert [path.name for path in tmp_path.iterdir()] == ["bad.nc"]


def test_a_recording_of_emg_alone_is_mapped(foreign: Path, tmp_path: Path) -> None:
    recording = xr.load_dataset(foreign)[["emg"]].drop_dims(
        ["marker", "time_marker"], errors="ignore"
    )
    path = stored(recording, tmp_path, "emg.nc")
    result = run("map", path, "--out", tmp_path / "m.toml")
    assert result.exit_code == 0, result.output
    assert list(tomllib.loads((tmp_path / "m.toml").read_text())) == ["channels"]


def test_a_wrong_unit_of_a_file_is_replaced_and_written(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,Left Zygo\n" + "".join(f"{i},{i % 7}\n" for i in range(99)))
    sidecar = tmp_path / "a.toml"
    sidecar.write_text(
        'schema = "recording"\norigin = "measured"\n[emg]\nfile = "a.csv"\ntime = "t"\n'
        'time_unit = "ms"\nunit = "mV"\n'
    )
    assert float(read_recording(sidecar)["emg"].max()) == pytest.approx(6e-3)
    out = tmp_path / "m.toml"
    result = run("map", sidecar, "--unit", "emg=uV", "--out", out)
    assert result.exit_code == 0, result.output
    assert tomllib.loads(out.read_text()) == {
        "channels": {"Left Zygo": "ZYG_L"},
        "units": {"emg": "uV"},
    }
    assert float(read_recording(sidecar, mapping=out)["emg"].max()) == pytest.approx(6e-6)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("emg=mm", "'mm'.*uV"),
        ("force=N", "force is 'N', expected one of V"),  # a channel of that label
        ("emg", "'emg' refers to neither emg, position nor a channel"),
    ],
)
def test_an_unknown_unit_is_named(foreign: Path, setting: str, said: str) -> None:
    one_sentence(run("map", foreign, "--unit", setting), "UnitsError", said)


def test_the_help_lists_every_format_that_is_read() -> None:
    for suffix, reader in readers().items():
        assert suffix in FORMATS, reader.FORMAT
    for command in ("check", "map"):
        assert ".poly5" in run(command, "--help").stdout


def test_a_folder_is_not_a_recording(tmp_path: Path) -> None:
    one_sentence(run("map", tmp_path), "DataError", "is a folder")


def test_features_of_a_real_recording(shared: Path) -> None:
    """Eleven channels of the C3D contain signals, five electrodes of the array were not connected."""
    path = shared / "recordings" / "pyomeca" / "markers_analogs.c3d"
    result = run("features", path, "--channels", ".EMG")
    assert result.exit_code == 0, result.output
    assert "11 of 16 channels contain a signal." in result.stderr
    assert "measured" in result.stdout and "15-500 Hz" in result.stdout
    assert result.stdout.count("constant") == 5


def test_features_of_no_channel(laboratory: Path) -> None:
    path = next((laboratory / "recordings").glob("*_B_*.nc"))
    result = run("features", path, "--channels", "Biceps")
    one_sentence(result, f"no channel of {path.name} contains 'Biceps'", "OOS_L")


# conversion and inventory


def test_recordings_are_converted_to_bids_and_back_with_a_notch(
    laboratory: Path, tmp_path: Path
) -> None:
    source, out = laboratory / "recordings", tmp_path / "bids"
    result = run("convert", source, "--to", "bids", "--out", out, "--notch", 50)
    assert result.exit_code == 0, result.output
    assert "2 of 2 recordings were converted" in result.stderr
    assert bids_problems(out) == []
    sidecar = json.loads(next(out.rglob("*_emg.json")).read_text())
    assert "Notch" in next(iter(sidecar["SoftwareFilters"]))
    back = run("convert", out, "--out", tmp_path / "netcdf")
    assert back.exit_code == 0, back.output
    for path in sorted(source.glob("*.nc")):
        given = read_recording(path)
        place = [given.attrs[k] for k in ("volunteer", "instruction", "repetition")]
        converted = next(
            r
            for r in map(read_recording, (tmp_path / "netcdf").glob("*.nc"))
            if [r.attrs[k] for k in ("volunteer", "instruction", "repetition")] == place
        )
        np.testing.assert_array_equal(converted["position"], given["position"])
        notched = remove_hum(given["emg"], 50.0)
        largest = float(abs(notched).max())
        np.testing.assert_allclose(converted["emg"], notched, rtol=0, atol=2.4e-7 * largest)


def test_subject_task_and_run_are_given_where_a_file_names_none(foreign, tmp_path) -> None:
    bare = read_recording(foreign)
    bare.attrs = {k: v for k, v in bare.attrs.items() if k not in ("volunteer", "instruction")}
    other = stored(bare, tmp_path, "other.nc")
    convert = ("convert", "--to", "bids", "--out", tmp_path / "bids")
    one_of = run(*convert, other)
    assert one_of.exit_code == 2 and "specify --subject, --task and --run" in one_of.stderr
    named = ("--subject", "P07", "--task", "smile", "--run", 3)
    given = run(*convert, other, *named)
    assert given.exit_code == 0, given.output
    path = tmp_path / "bids/sub-P07/emg/sub-P07_task-smile_run-03_emg.bdf"
    assert read_recording(path).attrs["repetition"] == 3
    both = run(*convert, other, foreign, *named)
    assert both.exit_code == 2 and "would both be written as P07_smile_03" in both.stderr


def test_a_check_into_a_pipe_is_one_csv_table(foreign: Path, laboratory: Path) -> None:
    result = run("check", foreign, laboratory / "recordings", "--channels", "Left zyg")
    assert result.exit_code == 2 and "no channel of S01_B_1.nc contains 'Left zyg'" in result.stderr
    table = pd.read_csv(io.StringIO(result.stdout))
    assert table[["file", "name", "signal"]].values.tolist() == [
        [foreign.name, "Left zygomaticus", "EMG"]
    ]
    whole = pd.read_csv(io.StringIO(run("check", laboratory / "recordings").stdout))
    assert whole.groupby("file")["kind"].value_counts().tolist() == [16, 14, 16, 14]


def test_a_check_states_which_later_step_would_refuse(foreign: Path, tmp_path: Path) -> None:
    result = run("check", foreign)
    assert (
        "'emgface activate' would refuse it: missing channels ZYG_L, MEN_L, RIS_R" in result.stderr
    )
    assert "'emgface study run' would refuse it: see activate" in result.stderr
    assert (
        "'emgface score'" not in result.stderr and "convert" not in result.stderr.split("1 of")[0]
    )
    assert "0 pass every later step" in result.stderr
    second = shutil.copy(foreign, tmp_path / "second.nc")  # one sentence for both
    both = run("check", foreign, second).stderr
    assert both.count("'emgface activate' would refuse each: missing") == 1
    assert f"{foreign.name}, second.nc: 'emgface activate'" in both
    treated = run("check", foreign, "--missing-side", "mirror")
    assert "1 pass every later step" in treated.stderr
    alone = read_recording(foreign).drop_dims(["time_marker", "marker"])
    blind = run("check", stored(alone, tmp_path, "alone.nc"), "--missing-side", "zero")
    assert "'emgface score' would refuse it: it contains no marker positions" in blind.stderr


def test_a_study_file_is_checked_by_its_recordings(foreign: Path, tmp_path: Path) -> None:
    """With the mapping and the montage of the study, as its run would read them."""
    named = [f"{json.dumps(WORDS.get(n, n))} = {json.dumps(n)}" for n in CHANNELS if n != "MEN_L"]
    (tmp_path / "map.toml").write_text("\n".join(["[channels]", *named]))
    study = tmp_path / "study.toml"
    place = json.dumps(str(foreign.parent))
    text = f'schema_version = 1\n[recordings]\nfolder = {place}\nmapping = "map.toml"\n'
    study.write_text(text)
    result = run("check", study)
    assert "refuse it: missing channel MEN_L (" in result.stderr
    study.write_text(text + '[signals.montage]\nmissing_side = "mirror"\n')
    assert "1 pass every later step" in run("check", study).stderr
    study.write_text(text.replace("mapping", "maping"))
    one_sentence(run("check", study), "ConfigurationError", "maping")


def test_a_table_is_folded_to_the_terminal(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    shown = io.StringIO()
    terminal = Console(file=shown, width=60, force_terminal=True, color_system=None)
    monkeypatch.setattr(console, "out", terminal)
    rows = [("a", *("123456789",) * 6, "r" * 70), ("b", *("1",) * 6, "")]
    console.show_table(console.Rows(tuple("nuvwxyzt"), tuple(rows)), "title")
    lines = [line.rstrip() for line in shown.getvalue().splitlines()]
    assert max(map(len, lines)) <= 60 and "".join(lines).count("123456789") == 6
    assert "".join(line.replace("a", "").strip() for line in lines).count("r") == 70
    assert sum(line.split()[:1] == ["n"] for line in lines) == 2  # blocks repeat the first column
    console.show_table(console.Rows(("n", "t"), (("a", "short"),)), "title")
    assert "short" in capsys.readouterr().out


def test_a_table_shows_the_units_of_its_columns(capsys) -> None:
    """Brackets with lower case letters are markup to the terminal, and vanished from the heads."""
    heads = ("time [s]", "rmse [mm]", "shift [ms]", "frequency [Hz]")
    console.show_table(console.Rows(heads, (("1", "2", "3", "4"),)), "scores [1]")
    shown = capsys.readouterr().out
    for text in (*heads, "scores [1]"):
        assert text in shown


def test_a_sidecar_is_drafted_confirmed_and_read(tmp_path: Path) -> None:
    emg = 1e-2 * np.random.default_rng(0).standard_normal((3000, 2))
    np.savetxt(tmp_path / "a.txt", emg, delimiter="\t")
    out = tmp_path / "a.toml"
    draft = run("describe", tmp_path / "a.txt", "--out", out, "--columns", "zyg li,zyg re")
    assert draft.exit_code == 0 and "Unconfirmed: emg.rate, emg.unit" in draft.stderr
    one_sentence(run("map", out), "a.toml lists emg.rate, emg.unit as unconfirmed")
    one_sentence(run("describe", tmp_path / "a.txt", "--out", out), "exists")
    out.unlink()
    known = ("--rate", 1000, "--unit", "millivolts", "--columns", "zyg li,zyg re")
    assert "Unconfirmed" not in run("describe", tmp_path / "a.txt", "--out", out, *known).stderr
    mapped = run("map", out, "--out", tmp_path / "m.toml")
    assert mapped.exit_code == 0, mapped.output
    read = read_recording(out, mapping=tmp_path / "m.toml")
    assert list(read["channel"].values) == ["ZYG_L", "ZYG_R"]
    np.testing.assert_allclose(read["emg"].values, 1e-3 * emg.T, rtol=1e-12)
    one_sentence(run("describe", tmp_path / "a.txt", "--unit", "N"), "unit of EMG is 'N'")


def test_a_file_that_cannot_be_converted_does_not_stop_the_others(laboratory, tmp_path) -> None:
    folder = tmp_path / "in"
    shutil.copytree(laboratory / "recordings", folder)
    (folder / "S00_broken.nc").write_bytes(b"nothing")
    result = run("convert", folder, "--out", tmp_path / "out")
    assert result.exit_code == 2 and "2 of 3 recordings were converted" in result.stderr
    assert "S00_broken.nc is not a netCDF file" in result.stderr
    assert len(list((tmp_path / "out").glob("*.nc"))) == 2
    wrong = run("convert", folder / "S01_B_1.nc", "--out", tmp_path / "o", "--notch", 5000)
    assert wrong.exit_code == 2 and "SignalError: a notch of 2 Hz at 5000 Hz" in wrong.stderr


def test_an_inventory_names_every_file_and_why_it_was_refused(laboratory, tmp_path) -> None:
    folder = tmp_path / "in"
    shutil.copytree(laboratory / "recordings", folder)
    (folder / "README.md").write_text("about it")
    (folder / "broken.c3d").write_bytes(b"nothing")
    (folder / "emg.csv").write_text("a,b\n" + "1,2\n2,1\n" * 200)
    (folder / "other.csv").write_text("x")
    sidecars = tmp_path / "sidecars"
    sidecars.mkdir()
    (sidecars / "emg.toml").write_text(
        'schema = "recording"\n[emg]\nfile = "emg.csv"\nrate = 1000.0\nunit = "uV"\n'
    )
    out = tmp_path / "table.md"
    result = run("inventory", folder, "--sidecars", sidecars, "--out", out)
    assert result.exit_code == 0, result.output
    assert "3 of 5 files were read" in result.stderr
    lines = {line.split(" | ")[0].removeprefix("| "): line for line in out.read_text().splitlines()}
    assert {"S01_B_1.nc", "S01_E_1.nc", "broken.c3d", "emg.csv", "other.csv"} < set(lines)
    assert "README.md" not in lines
    assert "2 EMG | 1000 | emg uV | 0.4" in lines["emg.csv"]
    assert "14 EMG, 16 markers | 2048, 100" in lines["S01_B_1.nc"]
    assert "*refused: broken.c3d" in lines["broken.c3d"]
    assert "TOML sidecar" in lines["other.csv"] and str(tmp_path) not in out.read_text()
    one_sentence(run("inventory", tmp_path / "absent"), "DataError", "No folder")


def test_a_session_is_cut_by_events_and_by_its_activity(tmp_path: Path) -> None:
    """A session of two bursts with a marker clock that is half a second behind."""
    trial = recording()
    rng = np.random.default_rng(4)
    time = np.arange(round(8.0 * 2048)) / 2048
    on = ((time > 1.5) & (time < 2.7)) | ((time > 5.0) & (time < 6.2))
    emg = (100e-6 * on + 1e-6) * rng.normal(size=(14, time.size))
    frames = np.arange(800) / 100 - 0.5
    still = trial["position"].isel(time_marker=[0]).values.repeat(800, axis=2)
    session = trial[["channel", "marker", "axis"]].assign(
        emg=(("channel", "time_emg"), emg, {"units": "V"}),
        position=(("marker", "axis", "time_marker"), still, {"units": "m"}),
        time_emg=("time_emg", time, {"units": "s"}),
        time_marker=("time_marker", frames, {"units": "s"}),
    )
    session.attrs.pop("repetition", None)
    path = write_recording(session, tmp_path / "session.nc")
    result = run("cut", path, "--out", tmp_path / "found", "--offset", 0.5)
    assert result.exit_code == 0, result.output
    names = sorted(p.name for p in (tmp_path / "found").glob("*.nc"))
    assert names == ["V01_A_1.nc", "V01_A_2.nc"]
    first = read_recording(tmp_path / "found" / names[0])
    assert abs(float(first["time_emg"][-1]) - 1.2) < 0.3
    assert abs(float(first["time_marker"][0])) < 0.011  # on the clock of the EMG
    events = tmp_path / "a_events.tsv"
    events.write_text("onset\tduration\ttrial_type\n1.5\t1.2\tD\n5.0\t1.2\tD\n")
    output = run(
        "cut", path, "--out", tmp_path / "from_events", "--events", events, "--before", 0.2
    )
    assert output.exit_code == 0, output.output
    second = read_recording(tmp_path / "from_events" / "V01_D_2.nc")
    assert second.attrs["cut_from"] == [4.8, 6.2]
    assert second.sizes["time_emg"] == pytest.approx(1.4 * 2048, abs=2)
    far = run("cut", path, "--out", tmp_path / "far", "--events", events, "--after", 9)
    one_sentence(far, "SignalError", "expected every interval inside")
