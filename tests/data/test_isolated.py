"""Parsers in a child process: crashes, hangs and interruptions become errors."""

import ctypes
import os
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from emgface.errors import DataError
from emgface.recordings.readers import _isolated
from emgface.recordings.readers._arrays import read_array
from emgface.recordings.readers._isolated import isolated, parsed


def crash() -> None:
    ctypes.string_at(0)


def leave() -> None:
    os._exit(7)


def fill(count: int) -> int:
    return np.ones(count).size


def doubt() -> int:
    warnings.warn("returned data may be corrupt", stacklevel=1)
    return 1


def echo(value: object) -> object:
    print("parsers print", flush=True)
    os.write(1, b"into any descriptor")
    return value


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "a.bin"
    path.write_bytes(b"123")
    return path


def test_the_result_is_returned_whatever_the_parser_prints(file: Path) -> None:
    value = {"a": np.arange(3), "b": "text"}
    returned = isolated(file, echo, value)
    assert isinstance(returned, dict) and returned["b"] == "text"
    np.testing.assert_array_equal(returned["a"], value["a"])


def test_an_error_of_the_parser_is_raised_again(file: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        isolated(file, divmod, 1, 0)


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_a_crash_becomes_an_error_and_the_next_call_works(file: Path) -> None:
    with pytest.raises(DataError, match=r"a\.bin cannot be read: its parser crashed \(SIG"):
        isolated(file, crash)
    with pytest.raises(DataError, match="ended with the exit code 7"):
        isolated(file, leave)
    assert isolated(file, echo, 5) == 5


def test_a_parser_that_hangs_is_ended(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    isolated(file, echo, 1)
    monkeypatch.setattr(_isolated, "_SECONDS", 0.5)
    with pytest.raises(DataError, match="took longer than"):
        isolated(file, time.sleep, 60)
    monkeypatch.undo()
    assert isolated(file, echo, 2) == 2


@pytest.mark.skipif(sys.platform != "linux", reason="memory is limited where /proc tells its use")
def test_a_parser_that_requests_all_memory_is_stopped(file: Path) -> None:
    with pytest.raises(MemoryError):
        isolated(file, fill, 1 << 32)
    assert isolated(file, fill, 1000) == 1000


def test_data_that_the_parser_doubts_are_refused(file: Path) -> None:
    with pytest.raises(DataError, match=r"a\.bin cannot be read .*may be corrupt"):
        parsed(file, doubt)


def test_matlab_4_in_an_unknown_byte_order_is_refused(tmp_path: Path) -> None:
    """The first number states the order; scipy warns of that of VAX, and returns other data."""
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"emg": np.random.default_rng(1).normal(size=(6, 3))}, format="4")
    whole = path.read_bytes()
    assert read_array(path, "emg").shape == (6, 3)
    path.write_bytes((2000).to_bytes(4, "little") + whole[4:])
    with pytest.raises(DataError, match=r"a\.mat cannot be read"):
        read_array(path, "emg")


def test_a_damaged_nested_tag_of_matlab_becomes_an_error(tmp_path: Path) -> None:
    """With an invalid type of an element in a structure, scipy's parser reads outside the data."""
    rng = np.random.default_rng(1)
    content = {
        "rec": {
            "emg": rng.normal(size=(6, 3)),
            "labels": np.array(["a", "b", "c"], dtype=object),
            "in": {"x": np.arange(3.0)},
        }
    }
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, content)
    whole = path.read_bytes()
    reasons: list[str] = []
    # Tags of the dims, the names of fields, the first field and its parts.
    for at in (232, 233, 264, 265, 432, 480, 490, 492):
        for bit in (0, 1, 3):
            data = bytearray(whole)
            data[at] ^= 1 << bit
            path.write_bytes(bytes(data))
            try:
                read_array(path, "rec.emg")
            except DataError as error:
                reasons.append(str(error))
    assert reasons and all(reason.count("\n") == 0 and "a.mat" in reason for reason in reasons)
    path.write_bytes(whole)
    np.testing.assert_array_equal(read_array(path, "rec.emg"), content["rec"]["emg"])
