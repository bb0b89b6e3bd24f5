"""Arguments of another kind, walked over all public functions and parameters of data or files."""

import inspect
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface as ef
from emgface.cli import app
from emgface.errors import DataError, EmgfaceError, SchemaError
from emgface.face.file import save_face
from emgface.files import existing_file, replace_file
from emgface.schema.in_memory import kind_in_memory, usable
from tests.api.test_given_in_memory import made
from tests.api.test_odd_arguments import recording

TAKES = ("Data", "File", "Given", "Dataset", "Marks", "PathLike")
"""Names in the annotation of a parameter that takes a dataset or the path of a file."""
FOLDERS = {"compare.recordings", "compare.store", "reduce.folder", "report.folder", "study.out"}
LISTS = {"simulate.calibrate", "compare.reduced", "show.baseline"}  #: of paths
PAIRS = {"simulate.waypoints", "simulate.branch"}  #: of a path and a time


def parameters() -> list[tuple[str, str]]:
    """Functions and those of their parameters that take data or files."""
    return [
        (function, name)
        for function in ef.__all__
        for name, parameter in inspect.signature(_callable(function)).parameters.items()
        if any(word in str(parameter.annotation) for word in TAKES)
    ]


def _callable(function: str):
    given = getattr(ef, function)
    return getattr(__import__("emgface.api", fromlist=[function]), function, given)


def motion() -> xr.Dataset:
    return made("trajectory").assign_attrs(sigma_max=1e5)


def usual(function: str, face: xr.Dataset) -> dict[str, object]:
    """Arguments with which a function gets as far as the parameter that is examined."""
    levels = {"accuracy": "draft", "contact": {"method": "none"}}
    return {
        "activate": {"recording": recording(), "strategy": "act_all"},
        "build": {"kind": "face", "resolution": "coarse"},
        "check": {"given": recording()},
        "describe": {"path": "absent.csv"},
        "read": {"path": "absent.csv"},
        "report": {"folder": "absent"},
        "compare": {"before": face, "after": face},
        "fit": {"face": face, "landmarks": {"a": (0.0, 0.0, 0.0)}},
        "invert": {"recording": recording(), "face": face},
        "reduce": {"face": face},
        "score": {"recording": recording(), "trajectory": motion()},
        "show": {"shown": motion()},
        "simulate": {"activation": made("activation"), "face": face} | levels,
        "sound": {"source": None},
        "study": {"out": "unused"},
        "treat": {"face": face, "plan": {"step": []}},
    }.get(function, {})  # fmt: skip


ODD = {
    "a number": 3,
    "bytes": b"face.nc",
    "an empty dataset": xr.Dataset(),
    "a table": pd.DataFrame({"a": [1.0]}),
    "an array": np.zeros(3),
    "a list": [1, 2],
    "nothing": None,
    "a folder": Path(),
}


@pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")
@pytest.mark.parametrize(("function", "name"), parameters())
def test_something_else_is_refused(function, name, coarse, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    place = f"{function}.{name}"
    optional = inspect.signature(_callable(function)).parameters[name].default is None
    left = {"nothing"} if optional else set()
    left |= {"a folder"} if place in FOLDERS else set()
    for what, value in ODD.items():
        if what in left or (what == "nothing" and place in {*LISTS, "show.baseline"}):
            continue
        given = (value, 0.1) if place in PAIRS else [value] if place in LISTS else value
        if what == "a list" and place in {"activate.reference", *LISTS}:
            given = value
        with pytest.raises(EmgfaceError) as raised:
            _callable(function)(**usual(function, coarse) | {name: given})
        said = str(raised.value)
        assert "expected" in said or "did you mean" in said, f"{place} = {what}: {said}"
    assert not list(tmp_path.iterdir())


def datasets(coarse: xr.Dataset) -> dict[str, xr.Dataset]:
    """Datasets by their kind, without the attributes in which a file states it."""
    every = {kind: made(kind) for kind in ("recording", "activation", "trajectory")}
    every |= {"face_model": coarse, "jaw_model": ef.build("jaw")}
    return {kind: data.drop_attrs(deep=False) for kind, data in every.items()}


def test_the_kind_of_a_dataset_is_recognised_by_its_variables(coarse) -> None:
    given = datasets(coarse)
    for kind, data in given.items():
        assert kind_in_memory(data) == kind
        for other in set(given) - {kind}:
            with pytest.raises(SchemaError, match=f"of the kind '{kind}', expected '{other}'"):
                usable(data, other)


def test_a_model_in_memory_is_checked_like_its_file(coarse, tmp_path) -> None:
    save_face(coarse, tmp_path / "face.nc")
    own, read = ef.check(coarse), ef.check(tmp_path / "face.nc")
    assert list(own) == list(read) and len(own) > 1
    for title, table in own.items():
        pd.testing.assert_frame_equal(table, read[title])


def test_what_a_selection_leaves_is_no_fault(coarse) -> None:
    """A scalar coordinate, such as the volunteer, was refused as an unknown variable."""
    quick = {"duration": 0.02, "accuracy": "draft", "contact": {"method": "none"}}
    named = coarse.assign_coords(volunteer="V1")
    own, other = (ef.simulate({"ZYG_L": 0.2}, face, **quick) for face in (coarse, named))
    xr.testing.assert_equal(own, other)
    assert "volunteer" in named.coords and "volunteer" not in other.coords


def test_a_folder_and_a_broken_link_are_named_as_such(tmp_path) -> None:
    with pytest.raises(DataError, match="is a folder; expected a recording"):
        ef.read(tmp_path)
    with pytest.raises(DataError, match="is a folder, expected the name of a file to write"):
        replace_file(tmp_path, lambda part: part.touch())
    (tmp_path / "link.nc").symlink_to(tmp_path / "absent.nc")
    with pytest.raises(DataError, match="is a link to .*absent.nc, which is not there"):
        existing_file(tmp_path / "link.nc", "a recording")


@pytest.mark.parametrize("out", [".", ""])
def test_a_command_that_would_write_to_a_folder_ends_with_one_sentence(out: str) -> None:
    given = ["build", "face", "--resolution", "coarse", "--out", out]
    result = CliRunner().invoke(app, given)
    assert result.exit_code and not isinstance(result.exception, ValueError | TypeError)
