"""The report of a study: completeness, independence of other files, and stated limits."""

import base64
import hashlib
import html
import json
import re
import shutil
import zlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.errors import DataError
from emgface.face.file import load_face
from emgface.pictures.body import merged, skin_of
from emgface.pictures.encoding import ABSENT_MARKER, QUANTUM, deltas, whole
from emgface.pictures.page import THREE, resource
from emgface.report import write
from emgface.report.first_motion import FirstMotion
from emgface.report.kept import study_folder
from emgface.report.results import Results, open_results
from emgface.report.write import write_page
from emgface.run.lines import lines, run_files
from emgface.schema.netcdf import write_netcdf
from emgface.study.run import run_study
from tests.study_run.test_run import configured

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

THREE_DIGEST = "08fd7545d13d2c7fb65ab691530a802dafefd638596501854f267d0fb13c39e7"
"""SHA-256 of build/three.module.min.js in the npm package three 0.170.0."""


def text_of(page: str) -> str:
    """Visible text of a page."""
    bare = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


def test_page_has_every_part(page: Path) -> None:
    text = text_of(page.read_text(encoding="utf-8"))
    for part in ("Summary", "Moving face", "Scores", "Comparison of strategies", "Exclusions",
                 "From signal to score", "Numerical error and run time", "Methods", "Provenance",
                 "Citation"):  # fmt: skip
        assert part in text, part
    assert "slab <of> tissue" in text and "simulated recordings" in text
    assert "There is one volunteer" in text and "largest numerical error [mm]" in text
    assert "signals.filter.low" in text and "Eskes et al. 2017, Methods" in text
    assert "Butterworth, design order 4, forward and backward" in text
    digest = hashlib.sha256((page.parent / "study" / "cube.nc").read_bytes()).hexdigest()
    assert digest in text
    assert str(page.parent) not in page.read_text(encoding="utf-8")


def test_the_page_requests_no_other_file(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert page.stat().st_size < 15e6
    inside = re.findall(
        r"""\b(?:src|href|action|data)=["']([^"']+)""", text.split("<script type")[0]
    )
    assert inside and all(link.startswith(("#", "data:")) for link in inside)
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', text)
    assert policy and html.unescape(policy[1]).startswith("default-src 'none'; script-src 'sha256-")
    script = re.findall(r'<script type="module">(.*?)</script>', text, re.DOTALL)
    digest = base64.b64encode(hashlib.sha256(script[0].encode()).digest()).decode()
    assert len(script) == 1 and f"'sha256-{digest}'" in html.unescape(policy[1])
    ids = re.findall(r'\sid="([^"]+)"', text.split('<script type="module">')[0])
    assert len(ids) == len(set(ids))


def test_figures_have_captions(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    pictures = re.findall(r"<svg[^>]*>", text)
    assert len(pictures) == 9
    assert all('role="img"' in one and "simulated recordings" in one for one in pictures)


def test_motion_in_the_page_is_that_of_the_study(page: Path) -> None:
    """Markers decoded from the page, against those stored by the study, to the rounding.

    The measured ones start around the simulated ones.
    """
    text = page.read_text(encoding="utf-8")
    mutants = re.search(r'id="motions">(.*?)</script>', text, re.DOTALL)
    assert mutants
    data = json.loads(mutants[1])
    trial = next(t for t in data["trials"] if t["strategy"] == "act_rel")

    def decoded(name: str, points: int) -> np.ndarray:
        raw = np.frombuffer(zlib.decompress(base64.b64decode(trial[name])), np.uint8)
        planes = raw.reshape(2, -1).astype(np.uint16)
        change = (planes[0] | planes[1] << 8).astype(np.int16)
        change = change.reshape(len(trial["time"]), points, 3)
        return np.cumsum(change, axis=0, dtype=np.int16)

    results = open_results(page.parent / "study")
    assert results.laboratory is not None
    stored = results.trial(("S01", "B", 1), "act_rel").motion
    wanted = (
        stored["position"]
        .transpose("time", "marker", "axis")
        .sel(time=trial["time"], method="nearest")
    )
    rest = results.laboratory.face["position"].values[skin_of(results.laboratory.face).node]
    centre = (rest.min(axis=0) + rest.max(axis=0)) / 2
    simulated = decoded("simulated", 10) * QUANTUM + centre
    assert abs(simulated - wanted.values).max() <= QUANTUM / 2 * (1 + 1e-6)
    measured = decoded("measured", 10)[0] * QUANTUM + centre
    assert abs((measured - simulated[0]).mean(axis=0)).max() <= QUANTUM  # shifted together
    skin = decoded("skin", data["nodes"])
    assert skin.shape[1] == len(rest) and abs(np.ptp(skin, axis=0)).max() * QUANTUM > 1e-4


def test_the_skin_is_kept_when_trials_run_and_not_simulated_again(page: Path) -> None:
    results = open_results(page.parent / "study")
    assert results.laboratory is not None
    trial = results.trial(("S01", "B", 1), "act_rel")
    runs = [line for path in run_files(page.parent / "study") for _, line in lines(path)]
    stages = [stage["stage"] for line in runs for stage in line.get("stages", ())]
    assert stages.count("skin") == stages.count("motion") > 0  # by the study, not by the report
    before = len(results.laboratory.store.events)
    sigma_max = float(trial.motion.attrs["sigma_max"])
    moved = results.laboratory.skin_motion(trial.activation["activation"], sigma_max, "again")
    assert [e.outcome for e in results.laboratory.store.events[before:]] == ["reused"]
    assert moved.dataset["surface_position"].dtype == np.float32
    assert "surface_position" not in trial.motion


def test_integers_keep_missing_values() -> None:
    values = np.array([[[0.001, 0.0, -0.001]], [[np.nan] * 3]])
    integers = whole(values, np.zeros(3))
    assert integers.tolist() == [[[50, 0, -50]], [[ABSENT_MARKER] * 3]]
    raw = np.frombuffer(zlib.decompress(base64.b64decode(deltas(integers))), np.uint8)
    assert len(raw) == 2 * integers.size


def test_the_library_has_the_pinned_digest() -> None:
    assert hashlib.sha256(resource(THREE).encode()).hexdigest() == THREE_DIGEST
    assert "MIT License" in resource("three/LICENSE")


def test_thinned_skin_keeps_shape_and_lips(laboratory: Path) -> None:
    face = load_face(laboratory / "face.nc")
    full, thin = skin_of(face), skin_of(face, most=60)
    assert len(thin.node) <= 60 < len(full.node)
    assert set(thin.node.tolist()) <= set(full.node.tolist())
    box = [np.ptp(face["position"].values[s.node], axis=0) for s in (full, thin)]
    np.testing.assert_allclose(box[1], box[0], atol=7e-3)
    # Two sheets that lie on each other share no edge and must not be merged.
    square = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    position = np.concatenate([square, square + 1e-9])
    corners = np.array([[0, 1, 2], [3, 4, 5]])
    assert merged(position, corners, 6).tolist() == [*range(6)]
    kept = merged(position, corners, 5)
    assert len(set(kept.tolist())) == 5 and ((kept >= 3) == (np.arange(6) >= 3)).all()


def test_unreadable_recordings_are_reported(page: Path, tmp_path: Path) -> None:
    cube = xr.load_dataset(page.parent / "study" / "cube.nc")
    configuration = json.loads(cube.attrs["configuration"])
    configuration["recordings"]["folder"] = str(tmp_path / "gone")
    cube.attrs["configuration"] = json.dumps(configuration)
    write_netcdf(cube, tmp_path / "cube.nc", "cube")
    results = open_results(tmp_path)
    assert (
        results.laboratory is None
        and "recordings or the face can no longer be read" in results.notes[0]
    )
    cube.attrs["configuration"] = '{"speed": 3}'
    write_netcdf(cube, tmp_path / "cube.nc", "cube")
    assert "by another version of this package" in open_results(tmp_path).notes[0]
    with pytest.raises(DataError, match="contains no cube.nc"):
        open_results(tmp_path / "gone")


def test_command_writes_page_and_tables(page: Path, tmp_path: Path, without_figures) -> None:
    folder = tmp_path / "study"
    shutil.copytree(page.parent / "study", folder)
    arguments = ["report", str(folder), "--no-faces", "--out", str(tmp_path / "report.html")]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "script-src 'none'" in html.unescape(text) and "Moving face" not in text_of(text)
    written = {path.name for path in (folder / "tables").iterdir()}
    assert {"strategy.csv", "strategy.md", "strategy.tex", "trials.csv"} <= written
    (folder / "tables" / "strategy.csv").unlink()
    called = ef.report(folder, tmp_path / "called.html", faces=False)
    assert text_of(called.read_text(encoding="utf-8")) == text_of(text)
    table = pd.read_csv(folder / "tables" / "strategy.csv").set_index("strategy")["median"]
    rho = ef.read(folder / "cube.nc")["rho"]
    for strategy in ("act_all", "act_rel"):
        assert table[strategy] == pytest.approx(float(rho.sel(strategy=strategy).median()))


def test_the_first_motion_is_shown_and_found_by_the_study(laboratory: Path, tmp_path: Path) -> None:
    study = configured(laboratory, recordings={"folder": str(laboratory / "recordings"),
                                               "instructions": ["B"]})  # fmt: skip
    messages: list[Path | Exception] = []
    first = FirstMotion(study, tmp_path / "study", tmp_path / "first.html", messages.append)
    first.begin(laboratory / "recordings" / "S01_B_1.nc")
    first.end()
    assert messages == [tmp_path / "first.html"]
    text = messages[0].read_text(encoding="utf-8")
    assert "S01 B 1 act_rel" in text and "simulated recording" in text
    outcomes = {event.stage: event.outcome for event in run_study(study, tmp_path / "study").events}
    assert outcomes["activation"] == outcomes["motion"] == "reused"
    absent = FirstMotion(
        study, tmp_path / "study", tmp_path / "b.html", messages.append, threaded=False
    )
    absent.begin(tmp_path / "absent.nc")
    assert isinstance(messages[1], DataError) and not (tmp_path / "b.html").exists()


def test_a_study_inside_a_folder_is_found(page: Path, tmp_path: Path) -> None:
    assert study_folder(page.parent) == page.parent / "study"
    assert study_folder(page.parent / "study") == page.parent / "study"
    assert study_folder(tmp_path) == tmp_path


def test_a_page_is_rendered_again_only_after_a_change(
    page: Path, tmp_path: Path, monkeypatch
) -> None:
    drawn: list[bool] = []

    def counted(results: Results, *, faces: bool, **rest: object) -> str:
        drawn.append(faces)
        return '<div id="motions">' if faces else "<div>"

    monkeypatch.setattr(write, "render_report", counted)
    copy = tmp_path / "copy.html"
    assert write_page(page.parent, copy).size == page.stat().st_size
    assert copy.read_bytes() == page.read_bytes()
    before = copy.stat().st_mtime_ns
    write_page(page.parent, copy)
    assert copy.stat().st_mtime_ns == before and drawn == []
    write_page(page.parent, copy, faces=False)
    assert 'id="motions"' not in copy.read_text(encoding="utf-8") and drawn == [False]
    (page.parent / "study" / "store" / "page.html").write_bytes(page.read_bytes())
