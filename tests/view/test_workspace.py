"""Workspace of the live face: moved, bound to its data, and what is refused."""

import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emgface.errors import ConfigurationError, DataError
from emgface.muscles import MUSCLES
from emgface.view.workspace import CURVES_FILE, LONGEST_NOTES, NOTES, RECIPE, Workspace

SAID = {
    "curves": {
        "knots": {"ZYG_L": [[0.0, 0.0], [0.4, 1 / 3]]},
        "duration": 0.8,
        "interpolation": "cubic",
    },
    "view": {"yaw": -35.5, "pitch": 5, "zoom": 1.25},
    "notes": "The left corner is late.\n<script>alert(1)</script>",
}  # fmt: skip


@pytest.fixture
def files(tmp_path):
    for name in ("face", "reduced"):
        (tmp_path / f"{name}.nc").write_bytes(name.encode())
    return {"face": tmp_path / "face.nc", "reduced": tmp_path / "reduced.nc", "recording": None}


@pytest.fixture
def saved(files, tmp_path):
    made = Workspace.open(tmp_path / "work", files, MUSCLES)
    assert json.loads(made.save(json.dumps(SAID).encode()).body) == {"wrote": "work"}
    return tmp_path / "work"


def test_a_workspace_opens_elsewhere_with_the_same_content(files, saved, tmp_path):
    other, moved = tmp_path / "other", tmp_path / "other" / "folder"
    other.mkdir()
    shutil.copytree(saved, moved)
    shutil.copy(files["face"], other / "same face.nc")
    workspace = Workspace.open(moved, files | {"face": other / "same face.nc"}, MUSCLES)
    assert workspace.view == SAID["view"] and workspace.notes == SAID["notes"]
    assert workspace.curves.duration == 0.8 and workspace.curves.interpolation == "cubic"
    np.testing.assert_array_equal(workspace.curves.knots["ZYG_L"], SAID["curves"]["knots"]["ZYG_L"])
    assert str(tmp_path) not in (saved / RECIPE).read_text()  # no path
    assert {p.name for p in saved.iterdir()} == {RECIPE, CURVES_FILE, NOTES}


def test_other_data_are_refused_by_digest(files, saved, tmp_path):
    files["face"].write_bytes(b"another face")
    with pytest.raises(DataError, match="'face'.*another one was given"):
        Workspace.open(saved, files, MUSCLES)
    files["face"].write_bytes(b"face")
    with pytest.raises(DataError, match="'reduced'.*none was given"):
        Workspace.open(saved, files | {"reduced": None}, MUSCLES)
    with pytest.raises(DataError, match="without a file for 'recording'"):
        Workspace.open(saved, files | {"recording": files["face"]}, MUSCLES)
    with pytest.raises(DataError, match="cannot be read"):
        Workspace.open(saved, files | {"face": tmp_path / "absent.nc"}, MUSCLES)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"curves": {"knots": {"ZYG_L": [[0.0, float("nan")]]}, "duration": 1.0}}, "not a number"),
        ({"curves": {"knots": {"../up": [[0.0, 0.0]]}, "duration": 1.0}}, "no muscle ../up"),
        (
            {"curves": {"knots": {"ZYG_L": [[k, 0] for k in range(20001)]}, "duration": 1.0}},
            "at most",
        ),
        ({"curves": 3}, ""),
        ({"view": {"yaw": float("inf")}}, "yaw of the message"),
        ({"view": {"yaw": "0"}}, "yaw of the message"),
        ({"view": {"path": 1.0}}, "no view"),
        ({"view": None}, "no view"),
        ({"notes": "x" * (LONGEST_NOTES + 1)}, "no text"),
        ({"notes": ["x"]}, "no text"),
        ({"notes": "\ud800"}, "no valid character"),
    ],
)
def test_messages_that_a_page_must_not_send_change_nothing(files, saved, change, expected):
    before = {p.name: p.read_bytes() for p in saved.iterdir()}
    made = Workspace.open(saved, files, MUSCLES)
    answer = json.loads(made.save(json.dumps(SAID | change).encode()).body)
    assert expected in answer["why"] and "wrote" not in answer
    assert {p.name: p.read_bytes() for p in saved.iterdir()} == before
    for body in (b"\xff", b"[1]", b"no JSON", b"[" * 100_000):
        assert "why" in json.loads(made.save(body).body)


@pytest.mark.parametrize(
    ("name", "content", "expected"),
    [
        (RECIPE, "version = 2\n", "version 2, expected 1"),
        (RECIPE, "version = 1\ncode = 'x'\n", "contains 'code'"),
        (RECIPE, "version = 1\ndata = 3\n", "without a file for 'face'"),
        (RECIPE, "a = [", "TOML"),
        (CURVES_FILE, "muscle,time,value\n<b>,0,0\n<b>,1,0\n", "no muscle <b>"),
        (NOTES, "x" * (LONGEST_NOTES + 1), "no text"),
        (NOTES, bytes(range(256)), "contains no text"),
        (NOTES, None, "contains no text"),
    ],
)
def test_folders_with_other_content_are_refused(files, saved, name, content, expected):
    (saved / name).unlink()
    if content is None:
        (saved / name).mkdir()
    else:
        (saved / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises((DataError, ConfigurationError), match=expected):
        Workspace.open(saved, files, MUSCLES)


def test_a_folder_with_other_files_is_left_alone(files, tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("text")
    with pytest.raises(DataError, match=f"contains no {RECIPE}"):
        Workspace.open(tmp_path / "mine", files, MUSCLES)
    assert [p.name for p in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("name", [RECIPE, CURVES_FILE, NOTES])
def test_links_in_a_folder_from_somebody_else_are_not_followed(files, saved, tmp_path, name):
    secret = tmp_path / "secret"
    (saved / name).rename(secret)
    (saved / name).symlink_to(secret)
    with pytest.raises(DataError, match=f"{name} is a link, expected a file"):
        Workspace.open(saved, files, MUSCLES)


def test_the_example_of_the_documentation_reads_the_curves(saved, monkeypatch):
    page = (Path(__file__).parents[2] / "docs" / "live.md").read_text(encoding="utf-8")
    example = re.search(r"```python\n(.*?)```", page, re.DOTALL)
    assert example and "FOLDER" in example[1]
    saved.rename(saved.with_name("FOLDER"))
    monkeypatch.chdir(saved.parent)
    names: dict[str, Any] = {}
    exec(example[1], names)  # noqa: S102
    assert names["time"][-1] == pytest.approx(0.8)
    left, right = names["level"].T
    assert left.max() == pytest.approx(1 / 3) and not right.any()
