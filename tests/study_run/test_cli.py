"""Command line: successful commands, and errors in one sentence without traceback."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from rich.text import Text
from typer.main import get_command
from typer.testing import CliRunner

from emgface import __version__
from emgface.cli import app
from emgface.face.file import load_face
from emgface.face.template import random_measures
from emgface.recordings.dataset import read_recording
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.file import SHORT_PARAMETERS, load_study, study_template

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
STUDY = """
strategies = ["act_rel"]
[recordings]
folder = "{folder}"
instructions = ["B"]
[face]
path = "{face}"
[signals.normalisation]
silent = "zero"
[simulation]
solver = "linearly_implicit"
step = 0.02
output = 0.02
sigma_max = 100e3
contact = {{ method = "none" }}
"""


def run(*arguments: object):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def one_sentence(result, *said: str) -> None:
    """Exit code 2 and one line on stderr that contains all of `said`."""
    lines = [line for line in result.stderr.splitlines() if line.strip()]
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    assert len(lines) == 1, lines
    for text in said:
        assert re.search(text, lines[0]), lines[0]


@pytest.fixture
def recording(laboratory: Path) -> xr.Dataset:
    return read_recording(next((laboratory / "recordings").glob("*_B_*.nc")))


def stored(dataset: xr.Dataset, folder: Path, name: str = "trial.nc") -> Path:
    """Write without the checks of the package."""
    path = folder / name
    dataset.drop_encoding().to_netcdf(path)
    return path


def study_file(laboratory: Path, folder: Path, recordings: Path | None = None) -> Path:
    path = folder / "study.toml"
    where = recordings or laboratory / "recordings"
    path.write_text(STUDY.format(folder=where, face=laboratory / "face.nc"))
    return path


def counted(output: str) -> tuple[int, int]:
    """Numbers of results that a study computed and took from its store."""
    results = re.search(r"(\d+) results were computed, (\d+) were already stored", output)
    assert results is not None, output
    return int(results[1]), int(results[2])


# what works


def test_no_help_loses_text_to_the_markup_of_the_terminal() -> None:
    """A unit such as [s] is a style of the terminal's markup, which prints nothing in its place."""

    def commands(command: Any, name: str) -> Iterator[tuple[str, Any]]:
        yield name, command
        for word, below in getattr(command, "commands", {}).items():
            yield from commands(below, f"{name} {word}")

    texts = [
        (f"{name} {part.name}", part.help)
        for name, command in commands(get_command(app), "emgface")
        for part in (command, *command.params)
        if getattr(part, "help", None)
    ]
    assert len(texts) > 300
    assert [name for name, text in texts if Text.from_markup(text).plain != text] == []


def test_help_names_every_command() -> None:
    result = run("--help")
    assert result.exit_code == 0
    for command in ("demo", "study", "build", "check", "activate", "simulate", "score", "report",
                    "show", "volunteers"):  # fmt: skip
        assert command in result.stdout


def test_version() -> None:
    assert run("--version").stdout.strip() == f"emgface {__version__}"


def test_the_template_is_printed_or_written(tmp_path: Path) -> None:
    assert run("study", "template", "--all").stdout == study_template()
    assert run("study", "template", "--out", tmp_path / "s.toml").exit_code == 0
    short = (tmp_path / "s.toml").read_text()
    assert short == study_template(only=SHORT_PARAMETERS) and len(short.splitlines()) < 200
    for name in SHORT_PARAMETERS:
        assert re.search(rf"^(# )?{name.rpartition('.')[2]} =", short, re.MULTILINE), name
    assert load_study(tmp_path / "s.toml") == StudyConfiguration(
        recordings={"folder": tmp_path / "recordings"}
    )


def test_a_face_is_generated_checked_and_drawn(tmp_path: Path) -> None:
    face = tmp_path / "face.nc"
    assert run("build", "face", "--resolution", "coarse", "--out", face).exit_code == 0
    checked = run("check", face)
    assert checked.exit_code == 0 and "nodes" in checked.stdout and "ZYG_L" in checked.stdout
    assert run("show", face, "--out", tmp_path / "face.html").exit_code == 0
    assert "generated face" in (tmp_path / "face.html").read_text(encoding="utf-8")


def test_one_command_from_a_recording_to_a_moving_face(laboratory, tmp_path, monkeypatch) -> None:
    """One command from a recording to trajectory, page, movie and files for ParaView."""
    monkeypatch.setattr("emgface.pictures.movie.PANEL", 40)
    study = study_file(laboratory, tmp_path)
    recording = next((laboratory / "recordings").glob("*_B_*.nc"))
    files = [tmp_path / name for name in ("motion.nc", "face.html", "face.gif", "vtk")]
    options = ("--out", "--page", "--movie", "--vtk")
    written = [text for pair in zip(options, files, strict=True) for text in pair]
    nothing = run("simulate", recording, "--study", study)
    one_sentence(nothing, "no output is specified, expected --out, --page, --movie or --vtk")
    result = run("simulate", recording, "--strategy", "act_rel", "--study", study, "--surface",
                 *written)  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "simulated motion" in " ".join(result.stderr.split())
    page = files[1].read_text(encoding="utf-8")
    assert "simulated motion, simulated recording" in page and "S01 B 1 act_rel" in page
    motion = xr.load_dataset(files[0])
    assert len(list(files[3].glob("simulated_*.vtu"))) == motion.sizes["frame"] > 3
    shown = run("show", files[0], "--out", tmp_path / "motion.html")
    assert shown.exit_code == 0, shown.output
    one_sentence(run("show", tmp_path, "--out", tmp_path / "x.png"), "expected")


def test_a_trial_stage_by_stage_gives_the_scores_of_the_study(
    laboratory, tmp_path, monkeypatch
) -> None:
    study = study_file(laboratory, tmp_path)
    recording = next((laboratory / "recordings").glob("*_B_*.nc"))
    files = {name: tmp_path / f"{name}.nc" for name in ("activation", "motion", "scores")}
    picture = tmp_path / "activation.png"
    steps = [
        ("activate", recording, "--out", files["activation"], "--strategy", "act_rel",
         "--study", study, "--plot", picture),
        ("simulate", files["activation"], "--out", files["motion"], "--study", study),
        ("score", recording, files["motion"], "--out", files["scores"], "--study", study),
    ]  # fmt: skip
    for step in steps:
        result = run(*step)
        assert result.exit_code == 0, result.output
    assert "simulated" in result.stdout and picture.exists()
    whole, again = (
        run("study", "run", study, "--out", tmp_path / "study", "--workers", 1) for _ in range(2)
    )
    computed, reused = counted(whole.output)
    assert computed > 0 and counted(again.output) == (0, computed + reused)
    assert whole.exit_code == 0, whole.output
    assert "act_rel" in whole.stdout and "simulated recordings" in whole.stdout
    cube = xr.load_dataset(tmp_path / "study" / "cube.nc")
    scores = xr.load_dataset(files["scores"])
    np.testing.assert_allclose(cube["rho"].values.ravel(), scores["rho"].values, atol=1e-6)
    flagged = scores.copy(deep=True)
    flagged["weak_match"][...] = 1
    monkeypatch.setattr("emgface.score", lambda *args, **options: flagged, raising=False)
    assert "Flag weak_match: the aligned components share less" in run(*steps[-1]).output
    report = run("report", tmp_path / "study")
    assert report.exit_code == 0 and "S01" in report.stdout
    assert report.stdout.startswith(
        "rho per strategy, simulated recordings, mismatched world except"
    )
    assert report.stdout.isascii() and "\x1b" not in report.stdout  # plain, for a pipe or a paper
    assert (tmp_path / "study" / "tables" / "trials.csv").read_text().startswith("origin,")
    # Unchanged, the tables are those that were kept, and require no statistics.
    with monkeypatch.context() as patched:
        patched.setattr(
            "emgface.report.study_tables.write_tables", lambda *_: pytest.fail("computed")
        )
        again = run("report", tmp_path / "study")
        assert again.exit_code == 0 and again.stdout == report.stdout
    cube.close()
    other = read_netcdf(tmp_path / "study" / "cube.nc", "cube").assign_attrs(title="another title")
    write_netcdf(other, tmp_path / "study" / "cube.nc", "cube")
    written = (tmp_path / "study" / "store" / "report.txt").read_bytes()
    assert run("report", tmp_path / "study").stdout == report.stdout
    assert (tmp_path / "study" / "store" / "report.txt").read_bytes() != written


def test_usable_recordings_pass_the_check(laboratory: Path) -> None:
    result = run("check", laboratory / "recordings", "--study")
    assert result.exit_code == 0, result.output
    assert "2 of 2 recordings can be used" in result.stderr
    assert "simulated, mismatched world" in result.stdout
    assert "2 pass every later step" in result.stderr


def test_volunteers_are_written(laboratory: Path, tmp_path: Path) -> None:
    study = study_file(laboratory, tmp_path)
    result = run("volunteers", "--n", 1, "--instructions", "C", "--out", tmp_path, "--study", study,
                 "--workers", 1, "--world", "delay+recruitment")  # fmt: skip
    assert result.exit_code == 0, result.output
    assert "world mismatched in delay, recruitment" in result.output
    made = read_recording(tmp_path / "recordings" / "S01_C_1.nc")
    assert made.attrs["world"] == "world mismatched in delay, recruitment"


def test_a_face_is_built_of_measures(tmp_path: Path) -> None:
    path = tmp_path / "face.nc"
    result = run("build", "face", "--out", path, "--resolution", "coarse", "--preset", "man",
                 "--set", "mouth_width=52mm", "--set", "droop=2 mm", "--seed", 5)  # fmt: skip
    assert result.exit_code == 0, result.output
    face = load_face(path)
    assert f"{face.sizes['element']} elements" in result.stderr and "generated" in result.stderr
    assert face.attrs["measure_mouth_width"] == 52e-3 and face.attrs["measure_droop"] == 2e-3
    drawn = random_measures(5, preset="man")
    assert face.attrs["measure_nose_width"] == drawn.nose_width
    assert run("check", path).exit_code == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--resolution", "huge"), ("'huge'", "coarse")),
        (("--resolution", 12), ("12 elements", "400")),
        (("--preset", "elf"), ("'elf'", "older_woman")),
        (("--set", "mouth_width=52"), ("mouth_width", "unit", "mm")),
        (("--set", "mouth_width=500mm"), ("mouth_width is 500 mm",)),
    ],
)
def test_a_face_that_cannot_be_built(tmp_path: Path, options, said) -> None:
    one_sentence(run("build", "face", "--out", tmp_path / "f.nc", *options), "FaceError", *said)
    assert list(tmp_path.iterdir()) == []


# what is wrong with a recording


def slow(recording: xr.Dataset) -> xr.Dataset:
    return recording.isel(time_emg=slice(None, None, 40))


def in_millivolts(recording: xr.Dataset) -> xr.Dataset:
    recording["emg"].attrs["units"] = "mV"
    return recording


def with_a_gap(recording: xr.Dataset) -> xr.Dataset:
    recording["emg"][3, 1000:1200] = np.nan
    return recording


def with_a_constant_channel(recording: xr.Dataset) -> xr.Dataset:
    recording["emg"][5] = 1e-6
    return recording


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda r: r.drop_sel(channel="ZYG_L"), ("SchemaError|SignalError", "ZYG_L")),
        (in_millivolts, ("UnitsError", "emg", "'mV'", "'V'")),
        (slow, ("SignalError", "51.2 Hz", "octave", "500 Hz")),
        (with_a_gap, ("SignalError", "ZYG_L", "gap")),
        (with_a_constant_channel, ("SignalError", "DAO_L", "0/0")),
        (lambda r: r.isel(time_emg=slice(0, 300)), ("SignalError", "300 samples", "shorter")),
        (lambda r: r.drop_vars("emg").drop_dims("time_emg"), ("SchemaError", "emg")),
    ],
    ids=["channel", "unit", "rate", "gap", "constant", "short", "no emg"],
)
def test_a_recording_that_gives_no_activation(recording, tmp_path, change, said) -> None:
    path = stored(change(recording), tmp_path)
    one_sentence(run("activate", path, "--out", tmp_path / "a.nc"), *said)
    assert not (tmp_path / "a.nc").exists()


def test_a_recording_shorter_than_the_window(recording, tmp_path) -> None:
    study = tmp_path / "study.toml"
    study.write_text("[signals.feature]\nwindow = 5.0\n")
    path = stored(recording, tmp_path)
    result = run("activate", path, "--out", tmp_path / "a.nc", "--study", study)
    one_sentence(result, "SignalError", "window")


@pytest.mark.parametrize("damage", [lambda b: b[: len(b) // 2], lambda b: b[:20], lambda b: b""])
def test_a_truncated_file(recording, tmp_path, damage) -> None:
    path = stored(recording, tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    one_sentence(run("check", path), "DataError", "trial.nc")
    one_sentence(run("activate", path, "--out", tmp_path / "a.nc"), "DataError", "trial.nc")


def test_markers_missing(laboratory, recording, tmp_path) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    stored(recording.drop_sel(marker=["nasion", "corner_left"]), folder)
    study = study_file(laboratory, tmp_path, folder)
    result = run("study", "run", study, "--out", tmp_path / "out", "--workers", 1)
    assert result.exit_code == 2 and "Traceback" not in result.output
    sentences = [line for line in result.stderr.splitlines() if "failed:SchemaError: " in line]
    assert len(sentences) == 1
    assert "nasion" in sentences[0] and "corner_left" in sentences[0]


def test_an_absent_file(tmp_path) -> None:
    one_sentence(run("check", tmp_path / "no.nc"), "DataError", r"no\.nc")
    out = tmp_path / "out.nc"
    one_sentence(run("reduce", tmp_path / "no.nc", "--out", out), "FaceError", r"no\.nc")
    for folder in (tmp_path, tmp_path / "absent"):
        one_sentence(run("report", folder), "DataError", r"contains no cube\.nc", "study run --out")
    one_sentence(
        run("study", "run", tmp_path / "no.toml", "--out", tmp_path / "o"), "ConfigurationError"
    )


# what is wrong with a face, an activation, a study file


def test_a_face_with_an_inverted_element(slab, tmp_path) -> None:
    bad = slab.copy(deep=True)
    bad["connectivity"][7] = bad["connectivity"][7].values[[4, 5, 6, 7, 0, 1, 2, 3]]
    one_sentence(run("check", stored(bad, tmp_path)), "FaceError", "element 8", "inverted")


def test_a_muscle_without_an_element(slab, tmp_path) -> None:
    keep = np.flatnonzero(slab["bundle_muscle"].values != 3)
    bad = stored(slab.isel(bundle_element=keep), tmp_path)
    one_sentence(run("check", bad), "FaceError", "LAO_L", "no element")


def test_an_activation_outside_0_and_1(laboratory, recording, tmp_path) -> None:
    truth = recording["true_activation"].rename(time_true="time").rename("activation")
    truth[4, 10] = 1.2
    path = stored(truth.to_dataset().assign_attrs(origin="simulated"), tmp_path)
    result = run("simulate", path, "--out", tmp_path / "m.nc", "--face", laboratory / "face.nc")
    one_sentence(result, "activation", r"1\.2", "0.*1")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[simulation]\nsigma_mx = 1e5\n", ("simulation.sigma_mx", "did you mean 'sigma_max'")),
        ("[signals.filter]\nlow = 600.0\n", ("low", "600", "below high")),
        ("strategies = ['act_9']\n", ("act_9", "act_rel")),
    ],
)
def test_a_study_file_with_a_mistake(tmp_path, text, said) -> None:
    path = tmp_path / "study.toml"
    path.write_text(text)
    one_sentence(run("study", "run", path, "--out", tmp_path / "o"), "ConfigurationError", *said)


def test_a_study_whose_folder_holds_no_recording(laboratory, tmp_path) -> None:
    (tmp_path / "empty").mkdir()
    study = study_file(laboratory, tmp_path, tmp_path / "empty")
    result = run("study", "run", study, "--out", tmp_path / "o")
    one_sentence(result, "DataError", "empty")


def test_a_folder_that_cannot_be_written(laboratory, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    study = study_file(laboratory, tmp_path)
    result = run("study", "run", study, "--out", tmp_path / "file" / "out", "--workers", 1)
    one_sentence(result, "StoreError", "file")


def test_unknown_instruction_and_solver_are_named(laboratory, recording, tmp_path) -> None:
    path = stored(recording, tmp_path)
    one_sentence(
        run("volunteers", "--instructions", "Q", "--out", tmp_path), "ConfigurationError", "'Q'"
    )
    result = run("volunteers", "--world", "delai", "--out", tmp_path)
    one_sentence(result, "ConfigurationError", "'delai'", "mismatched")
    result = run("activate", path, "--out", tmp_path / "a.nc", "--strategy", "act_reel")
    one_sentence(result, "ConfigurationError", "act_reel", "act_rel")


def test_a_partial_study_exits_1_and_names_each_failure_once(
    laboratory, recording, tmp_path
) -> None:
    folder = tmp_path / "recordings"
    folder.mkdir()
    stored(recording, folder, "good.nc")
    stored(with_a_gap(recording).assign_attrs(repetition=2), folder, "bad.nc")
    study = study_file(laboratory, tmp_path, folder)
    result = run("study", "run", study, "--out", tmp_path / "out", "--workers", 1)
    assert result.exit_code == 1, result.output
    assert sum("failed:SignalError: " in line for line in result.stderr.splitlines()) == 1


def test_an_interruption_is_reported_and_exits_130(laboratory, tmp_path, monkeypatch) -> None:
    from emgface.study import outcomes as workers

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(workers, "run_trial", interrupted)
    study = study_file(laboratory, tmp_path)
    result = run("study", "run", study, "--out", tmp_path / "out", "--workers", 1)
    assert result.exit_code == 130
    assert "run the same command again" in result.stderr


@pytest.mark.parametrize(
    ("signal", "code"), [(KeyboardInterrupt(), 130), (SystemExit(143), 143), (SystemExit(2), None)]
)
def test_a_library_that_an_interruption_breaks_does_not_hide_it(monkeypatch, signal, code) -> None:
    """The clean-up of a file library may fail in its turn, for example with KeyError."""
    from emgface.face import file

    def interrupted(*_: object, **__: object) -> None:
        try:
            raise signal
        finally:
            raise KeyError("closed")

    monkeypatch.setattr(file, "load_face", interrupted)
    result = run("reduce", "face.nc", "--out", "reduced.nc")
    assert result.exit_code == (1 if code is None else code)
    assert ("run the same command again" in result.stderr) == (code is not None)


def test_debug_shows_the_traceback(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("EMGFACE_DEBUG", "")  # restored afterwards, whatever the command sets
    result = run("--debug", "reduce", tmp_path / "no.nc", "--out", tmp_path / "out.nc")
    assert result.exit_code == 1 and type(result.exception).__name__ == "FaceError"
