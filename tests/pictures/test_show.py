"""Drawing of whatever a dataset or file is."""

import webbrowser
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import image

from analysis.figures.style import title_of
from analysis.statistics.simulated import simulated_scores
from emgface.anatomy.head.build import build_head
from emgface.anatomy.head.model import write_head
from emgface.anatomy.jaw.template import template_jaw
from emgface.anatomy.tongue.template import template_tongue
from emgface.api.views import show
from emgface.errors import DataError
from emgface.face.file import save_face
from emgface.muscles import MUSCLES
from emgface.pictures import show as module
from emgface.pictures.page import driven_by, motion_page
from emgface.pictures.show import draw, figure, kind, page
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.signals.parameters import SignalChain
from tests.tongue.small import small_tongue_motion


def activation() -> xr.Dataset:
    time = np.linspace(1.0, 1.2, 21)
    values = np.tile(np.linspace(0.0, 1.0, 21), (len(MUSCLES), 1))
    return xr.Dataset(
        {"activation": (("muscle", "time"), values, {"units": "1"})},
        coords={"muscle": list(MUSCLES), "time": ("time", time, {"units": "s"})},
        attrs={"origin": "simulated"},
    )


def test_every_kind_has_its_figure(face: xr.Dataset, motion: xr.Dataset) -> None:
    markers = motion.drop_dims(["frame", "surface_facet"])
    time = np.arange(0.0, 1.0, 1e-3)
    emg = 1e-5 * np.random.default_rng(0).standard_normal((2, len(time)))
    recording = xr.Dataset(
        {"emg": (("channel", "time_emg"), emg, {"units": "V"})},
        coords={"channel": ["OOS_L", "OOS_R"], "time_emg": ("time_emg", time, {"units": "s"})},
        attrs={"origin": "simulated", "source": "a test"},
    )
    scores = simulated_scores(3)
    one = scores.isel(volunteer=0, instruction=0, repetition=0, strategy=0, drop=True)
    given = {
        "recording": (recording, "SIMULATED"),
        "activation": (activation(), "simulated"),
        "trajectory": (markers, "simulated"),
        "scores": (one.drop_vars("status"), "simulated"),
        "cube": (scores, "simulated"),
    }
    for name, (data, said) in given.items():
        assert kind(data) == name
        title = title_of(figure(data))
        assert said in title, name
        if name == "cube":
            assert f"<title>{title[:20]}" in page(data), "a page with the figure"
    assert "<title>a test" in page(recording), "a page with all channels"
    assert kind(face) == "face_model" and kind(markers[["position"]].drop_attrs()) == "recording"
    with pytest.raises(
        DataError, match="the dataset contains height, expected a recording, activation"
    ):
        kind(xr.Dataset({"height": 1.0}))


def test_faces_and_motions_have_turning_pages(face: xr.Dataset, motion: xr.Dataset) -> None:
    still, moving = page(face), page(motion)
    assert "generated face" in still and 'id="stage"' in still
    assert "simulated motion" in moving and "S01 D (voluntary smile)" in moving
    assert "default-src 'none'" in moving.replace("&#39;", "'")
    assert "sigma_max 100 kPa" in moving


@pytest.mark.parametrize(
    ("attrs", "badge", "words"),
    [
        ("measured act_rel all", "measured", "from the sEMG of a measured recording"),
        ("simulated true", "simulated", "from the true activation of a simulated recording"),
        ("simulated levels", "", "from specified muscle activations"),
        ("", "", "from specified muscle activations"),
    ],
)  # fmt: skip
def test_page_names_a_recording_only_if_there_was_one(attrs: str, badge: str, words: str) -> None:
    named = zip(("origin", "strategy", "montage"), attrs.split(), strict=False)
    origin, driven = driven_by(xr.Dataset(attrs=dict(named)))
    assert (origin, driven.strip()) == (badge, words)


@pytest.mark.parametrize(("reach", "own"), [("trial", True), ("session", False)])
def test_page_states_the_range_of_the_activation(motion: xr.Dataset, reach: str, own: bool) -> None:
    chain = SignalChain.model_validate({"normalisation": {"reach": reach}})
    drive = activation().assign_attrs(parameters=chain.model_dump_json())
    assert ("scaled to its own range in the trial" in motion_page(motion, drive)) == own


def test_files_are_drawn_by_their_contents(
    face: xr.Dataset, motion: xr.Dataset, tmp_path: Path
) -> None:
    save_face(face, tmp_path / "face.nc")
    write_netcdf(motion, tmp_path / "motion.nc", "trajectory")
    write_netcdf(activation(), tmp_path / "drive.nc", "activation")
    page_file, picture = tmp_path / "face.html", tmp_path / "motion.png"
    show(tmp_path / "face.nc", page_file)
    assert page_file.read_text().startswith("<!DOCTYPE")
    show(tmp_path / "motion.nc", picture)
    assert np.mean(np.ptp(image.imread(picture)[..., :3], axis=2) > 0.08) > 0.1
    drive = show(tmp_path / "drive.nc")
    assert drive.save(tmp_path / "new" / "drive.svg").exists()
    with pytest.raises(DataError, match="no known picture format"):
        drive.save(tmp_path / "drive.doc")
    with pytest.raises(DataError, match="--surface"):
        draw(motion.drop_vars("surface_position"), tmp_path / "motion.gif")


def test_motions_of_tongues_are_drawn(tmp_path: Path) -> None:
    write_netcdf(small_tongue_motion(), tmp_path / "tongue.nc", "tongue_motion")
    for name in ("tongue.html", "tongue.png"):
        show(tmp_path / "tongue.nc", tmp_path / name)
        assert (tmp_path / name).stat().st_size > 5000


def test_models_of_jaw_tongue_and_head_are_drawn_at_rest(tmp_path: Path) -> None:
    jaw, tongue = template_jaw(), template_tongue(resolution="coarse")
    write_netcdf(jaw, tmp_path / "jaw.nc", "jaw_model")
    write_netcdf(tongue, tmp_path / "tongue.nc", "tongue_model")
    write_head(build_head(("jaw", "tongue", "hyoid")), tmp_path / "head.nc")
    for name in ("jaw", "tongue", "head"):
        view = show(tmp_path / f"{name}.nc")
        assert "at rest" in title_of(view.figure)
        for panel in view.figure.axes:
            seen = panel.get_images()[0].get_array()
            assert seen is not None and np.mean(seen[..., 3] > 0) > 0.05, "nothing is drawn"
    # Without its bones a jaw still has muscles.
    bare = jaw.drop_vars(["surface_position", "surface_triangle", "surface_body"])
    assert len(figure(bare.assign_attrs(schema="jaw_model")).axes) == 3
    lists = read_netcdf(tmp_path / "head.nc", "head_model")
    with pytest.raises(DataError, match="without its parts"):
        figure(lists)


def test_a_kind_without_picture_is_named(tmp_path: Path) -> None:
    motion = small_tongue_motion().assign_attrs(schema="reduced_face")
    motion.to_netcdf(tmp_path / "reduced.nc")
    with pytest.raises(DataError, match="of the kind 'reduced_face', which has no picture"):
        show(tmp_path / "reduced.nc")


def test_window(monkeypatch: pytest.MonkeyPatch) -> None:
    messages: list[str] = []
    monkeypatch.setattr(module.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(DataError, match="there is no display for a window.*--out"):
        show(activation()).open()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(webbrowser, "open", lambda uri: messages.append(uri) or True)
    path = show(activation()).open()
    assert messages == [path.as_uri()] and "<svg" in path.read_text()
    monkeypatch.setattr(webbrowser, "open", lambda uri: False)
    with pytest.raises(DataError, match="no browser could be opened"):
        show(activation()).open()
