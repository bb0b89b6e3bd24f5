"""The report of a study: completeness, independence of other files, and stated limits."""

import base64
import hashlib
import html
import json
import re
import shutil
import zlib
from pathlib import Path
from typing import get_args

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from analysis.cube import build_cube
from analysis.statistics.simulated import simulated_scores
from analysis.tables import origin_of, report_tables
from analysis.trial import Trial
from emgface.choices import configure
from emgface.cli import app
from emgface.errors import DataError
from emgface.face.file import load_face
from emgface.face.simulation_parameters import SimulationParameters
from emgface.pictures.body import merged, skin_of
from emgface.pictures.encoding import ABSENT, QUANTUM, deltas, whole
from emgface.pictures.page import THREE, resource
from emgface.report import contents, write
from emgface.report.first_motion import FirstMotion
from emgface.report.kept import study_folder
from emgface.report.methods import methods
from emgface.report.results import Results, open_results, representative
from emgface.report.simulated import simulated_limits
from emgface.report.write import render_report, write_page
from emgface.run.lines import lines, run_files
from emgface.schema.netcdf import write_netcdf
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study
from tests.study_run.test_run import configured

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")

THREE_DIGEST = "08fd7545d13d2c7fb65ab691530a802dafefd638596501854f267d0fb13c39e7"
"""SHA-256 of build/three.module.min.js in the npm package three 0.170.0."""


def text_of(page: str) -> str:
    """Visible text of a page."""
    bare = re.sub(r"<(script|style|svg)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", bare)).split())


def scores(**options) -> xr.Dataset:
    """Scores with all variables of a cube."""
    cube = simulated_scores(5, **options)
    for name, units in (("run_time", "s"), ("steps", "1"), ("sigma_max", "Pa")):
        cube[name] = xr.ones_like(cube["rho"].isel(marker=0, drop=True)).assign_attrs(units=units)
    cube["reason"] = xr.full_like(cube["status"], "")
    return cube


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
    found = re.search(r'id="motions">(.*?)</script>', text, re.DOTALL)
    assert found
    data = json.loads(found[1])
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
    found = whole(values, np.zeros(3))
    assert found.tolist() == [[[50, 0, -50]], [[ABSENT] * 3]]
    raw = np.frombuffer(zlib.decompress(base64.b64decode(deltas(found))), np.uint8)
    assert len(raw) == 2 * found.size


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


def test_a_planted_difference_is_found_and_no_other_is_claimed() -> None:
    moved = contents.inference(scores(effects=(0.0, 0.9, 0.9), sd_interaction=0.05))
    assert any("rho is higher with the first" in one for one in moved.conclusions)
    still = contents.inference(scores())
    assert not any("is higher" in one or "is lower" in one for one in still.conclusions)
    *contrasts, last = still.conclusions
    assert len(contrasts) == 3 and all("a difference may exist" in one for one in contrasts)
    assert last.startswith("No statement is made about instructions in general: 2 instructions")


def alone(cube: xr.Dataset, folder: Path) -> str:
    """Words of the report of a cube without configuration."""
    write_netcdf(cube, folder / "cube.nc", "cube")
    return text_of(render_report(open_results(folder)))


def test_empty_cube(tmp_path: Path) -> None:
    text = alone(scores().isel(volunteer=[]), tmp_path)
    assert "This study contains no trial; there is nothing to report." in text
    assert "no test is performed" in text and "No simulation was scored" in text


def test_all_trials_failed(tmp_path: Path) -> None:
    trials = [
        Trial("v1", "A", r, s, status="failed:InvertedElement", reason="element 7 is inverted")
        for r in (1, 2)
        for s in ("act_all", "act_3")
    ]
    cube = build_cube(trials, markers=["corner_left"], origin="simulated")
    text = alone(cube, tmp_path)
    assert "No trial could be scored: of 4 trials, 4 failed, 0 were excluded" in text
    assert "failed:InvertedElement 4 v1 A 1 act_all, v1 A 1 act_3" in text
    assert "element 7 is inverted" in text and "Moving face" not in text


def test_one_strategy_and_one_volunteer(tmp_path: Path) -> None:
    cube = scores(volunteers=2).isel(strategy=[0])
    assert "There is one strategy, act_all; there is no comparison." in contents.verdict(cube)
    assert contents.inference(cube).table is None
    two = contents.verdict(scores(volunteers=2))
    assert "There are 2 volunteers; intervals require 5 or more and are not given." in two
    one = scores(volunteers=1)
    assert any("There is one volunteer" in sentence for sentence in contents.verdict(one))
    assert contents.inference(one).conclusions == [
        "There is one volunteer; the tests require several volunteers, and no test is performed."
    ]


def test_simulated_worlds_are_named_with_their_limits(tmp_path: Path, without_figures) -> None:
    matched = scores().assign_attrs(world="matched world")
    matched = matched.assign_coords(strategy=["act_all", "act_3", "act_rel"])
    text = alone(matched, tmp_path)
    assert "simulated recordings, matched world" in text
    assert "the true selection of muscles by construction" in text
    assert "Scores and tests in this report do not apply to people" in text
    other = simulated_limits(matched.assign_attrs(world="world mismatched in delay"))
    assert any("world mismatched in delay" in sentence for sentence in other)
    assert any("an advantage that it may not have in people" in sentence for sentence in other)
    two = matched.isel(strategy=[0, 1])
    assert not any("act_rel" in sentence for sentence in simulated_limits(two))
    unlabelled = simulated_limits(scores())
    assert any("do not state how the volunteers differ" in sentence for sentence in unlabelled)
    assert simulated_limits(matched.assign_attrs(origin="measured")) == []
    titles = [table.title for table in report_tables(matched).values()]
    assert titles and all("simulated recordings, matched world" in title for title in titles)
    assert origin_of(scores()) == "simulated"


def test_rho_identical_everywhere(tmp_path: Path, without_figures) -> None:
    cube = scores()
    cube["rho"][:] = 0.5
    text = alone(cube, tmp_path)
    assert "rho is 0.5 everywhere: all 216 values are identical" in text
    assert "is higher" not in text and "is lower" not in text


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


def test_representative_trial_is_in_the_middle() -> None:
    cube = scores(volunteers=3, instructions=1, repetitions=1)
    for volunteer, value in (("v1", 0.1), ("v2", 0.9), ("v3", 0.5)):
        cube["rho"].loc[{"volunteer": volunteer}] = value
    assert representative(cube) == {"i1": ("v3", "i1", 1)}
    cube["status"].loc[{"volunteer": "v3", "strategy": "act_3"}] = "failed:SignalError"
    assert representative(cube)["i1"][0] in {"v1", "v2"}


def test_an_error_without_estimate_is_reported_as_such() -> None:
    cube = scores(volunteers=2)
    table = contents.cost(Results(Path(), cube))
    assert table is not None and {row[-1] for row in table.rows} == {"not estimated"}
    cube["numerical_error"] = (0.25e-3 * xr.ones_like(cube["run_time"])).assign_attrs(units="m")
    table = contents.cost(Results(Path(), cube))
    assert table is not None and {row[-1] for row in table.rows} == {"0.25"}


def test_exclusions_name_markers_without_rho() -> None:
    cube = scores(volunteers=2, instructions=1, repetitions=1)
    cube["rho"][0, 0, 0, 0, 1] = np.nan
    cube["marker_reason"] = xr.full_like(cube["rho"], 0.0).astype("U40")
    cube["marker_reason"][:] = ""
    cube["marker_reason"][0, 0, 0, 0, 1] = "the measured marker does not move"
    table = contents.exclusions(Results(Path(), cube))
    assert table.rows == (
        (
            "partly scored",
            1,
            "v1 i1 1 act_all",
            "1 of 3 markers have no rho: the measured marker does not move",
        ),
    )


def chosen(**simulation) -> str:
    study = configure(StudyConfiguration, {"simulation": simulation})
    return methods(study, scores().assign_attrs(face="slab", face_origin="generated"))


def test_methods_state_every_choice_of_the_mechanics() -> None:
    fields = SimulationParameters.model_fields
    told: dict[str, set[str]] = {}
    for name in ("solver", "incompressibility", "fibre_law", "muscle_form", "damping_tangent"):
        options = get_args(fields[name].annotation)
        extra: dict[str, object] = {"contact": {"method": "none"}}
        extra |= {"bulk_potential": "quadratic"} if name == "incompressibility" else {}
        told[name] = {chosen(**{name: option}, **extra) for option in options}
        assert len(told[name]) == len(options), name
    controlled = chosen(solver="converged", error_tolerance=1e-4)
    assert "chosen by error control with a tolerance of 0.1 mm" in controlled
    assert "lips and cheeks with the teeth, where the face has them" in chosen(), "the default"
    assert "support of 5 N/m" in chosen(support=5.0)
    held = chosen(contact={"between": ["lips"], "friction": 0.2})
    assert "contact of the lips with each other (node-to-face constraints, friction 0.2)" in held
    assert "contact" not in chosen(contact={"method": "none"})
    assert "the estimated error includes the displacement by the change of the normals" in chosen()
    of_one = chosen(solver="linearly_implicit", error_tolerance=None)
    assert "the estimated error includes 3 % of the displacement" in of_one
    assert "contact was repeated with other time steps" in chosen(check_contact=True)


def test_methods_state_every_choice_of_the_signals() -> None:
    for table, name in (
        ("feature", "kind"),
        ("mapping", "mapping_stage"),
        ("normalisation", "reach"),
    ):
        model = getattr(StudyConfiguration().signals, table)
        options = get_args(type(model).model_fields[name].annotation)
        texts = {
            methods(configure(StudyConfiguration, {"signals": {table: {name: option}}}), scores())
            for option in options
        }
        assert len(texts) == len(options), name


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


def test_the_report_says_how_often_full_order_replaced_a_reduced_face() -> None:
    labels = {"volunteer": ["V1", "V2", "V3"], "instruction": ["A"], "repetition": [1]}
    dims, shape = (*labels, "strategy"), (3, 1, 1, 1)
    status = np.array(["ok", "ok", "failed:InvertedElement"]).reshape(shape)
    used = np.array([1.0, 0.0, 0.0]).reshape(shape)
    data = {"status": (dims, status), "reduced": (dims, used)}
    cube = xr.Dataset(data, coords={**labels, "strategy": ["act_all"]})
    (told,) = contents.reduction(cube)
    assert told.startswith("A reduced face was simulated in 2 scored trials. In 1 of them,")
    assert not contents.reduction(cube.assign(reduced=(dims, np.full(shape, np.nan))))


def test_the_error_of_the_time_steps_is_stated_beside_the_motion() -> None:
    labels = {"volunteer": ["V1", "V2", "V3"], "instruction": ["A"], "repetition": [1]}
    dims = (*labels, "strategy")
    shape = (3, 1, 1, 1)

    def over(*values: object) -> tuple[tuple[str, ...], np.ndarray]:
        return dims, np.array(values).reshape(shape)

    cube = xr.Dataset(
        {
            "status": over("ok", "ok", "failed:InvertedElement"),
            "numerical_error": over(0.1e-3, 2e-3, 9e-3),
            "motion": over(4e-3, 6e-3, 1e-3),
            "inaccurate": over(0.0, 1.0, 1.0),
        },
        coords={**labels, "strategy": ["act_all"]},
    )
    (told,) = contents.accuracy(cube)
    assert "a median of 1.1 mm and a maximum of 2 mm; the median motion is 5 mm" in told
    assert "a tenth of the motion in 1 trial, flagged as inaccurate" in told
    assert (
        "not estimated in any"
        in contents.accuracy(cube.assign(numerical_error=over(*[np.nan] * 3)))[0]
    )
    assert contents.accuracy(cube.drop_vars("motion")) == []


def test_the_first_motion_is_shown_and_found_by_the_study(laboratory: Path, tmp_path: Path) -> None:
    study = configured(laboratory, recordings={"folder": str(laboratory / "recordings"),
                                               "instructions": ["B"]})  # fmt: skip
    told: list[Path | Exception] = []
    first = FirstMotion(study, tmp_path / "study", tmp_path / "first.html", told.append)
    first.of(laboratory / "recordings" / "S01_B_1.nc")
    first.end()
    assert told == [tmp_path / "first.html"]
    text = told[0].read_text(encoding="utf-8")
    assert "S01 B 1 act_rel" in text and "simulated recording" in text
    outcomes = {event.stage: event.outcome for event in run_study(study, tmp_path / "study").events}
    assert outcomes["activation"] == outcomes["motion"] == "reused"
    absent = FirstMotion(study, tmp_path / "study", tmp_path / "b.html", told.append, beside=False)
    absent.of(tmp_path / "absent.nc")
    assert isinstance(told[1], DataError) and not (tmp_path / "b.html").exists()


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


def test_muscles_without_information_are_named_with_a_threshold_to_try() -> None:
    """One channel is far below the threshold of the Willison amplitude, in one trial of two."""
    from types import SimpleNamespace

    from emgface.muscles import CHANNELS
    from emgface.report.figures import mute_muscles

    def recording(k, quiet):
        emg = 1e-4 * np.random.default_rng(k).normal(size=(len(CHANNELS), 4000))
        emg[list(CHANNELS).index("ZYG_L")] *= 1e-3 if quiet else 1.0
        data = xr.Dataset(
            {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
            {"channel": list(CHANNELS), "time_emg": ("time_emg", np.arange(4000) / 2000.0)},
        )
        return SimpleNamespace(error=None, excluded=[], dataset=data, place=("V1", "A", k))

    intake = SimpleNamespace(recordings=[recording(1, quiet=False), recording(2, quiet=True)])
    (sentence,) = mute_muscles(SimpleNamespace(study=StudyConfiguration(), intake=intake))
    assert sentence.startswith(
        "ZYG_L contains no information in trial V1 A 2: its Willison amplitude"
    )
    assert "is zero in every window at a threshold of 1e-05 V: try a threshold near" in sentence
