"""Every command that writes, ended at every change of a file: by a kill, Ctrl-C, a full disk.

The audit events of Python announce each change of a file before it is made; netCDF files are announced
by a subclass. A process that is killed, interrupted or refused at one of them must leave complete
files or none, and the same command must then complete. Parts of killed processes are removed by it.
"""

import errno
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

import emgface.files
from emgface.cli import app
from emgface.cli.written import WRITTEN_OPTIONS
from emgface.face.file import save_face
from emgface.face.waypoints import INDEX
from emgface.files import is_part
from emgface.pictures import movie, stills
from emgface.recordings.dataset import read_recording, write_recording
from emgface.treatment import motions
from tests.api.test_command_files import paths
from tests.study_run.test_cli import STUDY

pytestmark = [
    pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs to fork a process"),
]

QUICK: dict[str, str] = {
    "map": "map {rec} --out {o}/mapping.toml",
    "describe": "describe {o}/in/table.csv --out {o}/in/table.toml",
    "inventory": "inventory {recs} --out {o}/inventory.csv",
    "convert": "convert {rec} --out {o}/bids --to bids --force",
    "cut": "cut {session} --out {o}/trials --events {events} --force",
    "study template": "study template --out {o}/study.toml",
    "schema": "schema --out {o}/schema.md",
}
"""One command line of each command that writes and needs seconds; {o} is the folder of its results."""

SLOW: dict[str, str] = {
    "check": "check {rec} --page {o}/page.svg --exclude {o}/exclude.toml",
    "activate": "activate {rec} --study {study} --out {o}/a.nc --plot {o}/a.png",
    "sound formants": "sound formants --vowel a --nc {o}/a.nc --plot {o}/a.png",
    "convert": "convert {recs} --out {o}/nc",
    "simulate": "simulate {act} --study {study} --surface --out {o}/motion.nc --page {o}/face.html "
    "--movie {o}/face.gif --vtk {o}/vtk",
    "simulate way points": "simulate {act} --study {study} --out {o}/motion.nc --waypoints {o}/way "
    "--waypoint-every 0.2",
    "score": "score {rec} {motion} --study {study} --out {o}/scores.nc",
    "segment": "segment {image} --clicks {clicks} --label head=1 --out {o}/labels.nii.gz "
    "--picture {o}/labels.png",
    "show": "show {motion} --out {o}/motion.html",
    "invert run": "invert run {trial} --study {study} --out {o}/inverse.nc",
    "volunteers": "volunteers --out {o}/made --n 1 --instructions C --study {study} --workers 1 "
    "--emg noise",
    "study run": "study run {study} --out {o}/study --workers 1",
    "study export": "study export {done} --out {o}/copy",
    "report": "report {done} --out {o}/report.html",
    "treat": "treat {plan} {lips} --out {o}/treated.nc",
    "compare": "compare {lips} {weak} {trials} --out {o}/page.html --plain {o}/plain.html "
    "--picture {o}/a.png --table {o}/a.csv --no-contact --workers 1",
    "dose": "dose --plan {plan} --out {o}/doses.csv --persons 1 --draws 0 --movements A --no-contact "
    "--cube {o}/doses.nc --figure {o}/doses.png --workers 1",
}

OTHERS = {
    "build", "demo", "fit", "import", "invert calibrate", "live", "record",
    "reduce", "sound areas", "sound head", "sound muscles", "sound synthesise", "sound trial",
    "study published", "sweep", "tabulate",
}  # fmt: skip
"""Commands whose computation takes minutes, or requires published files; they write by the same
functions, which tests/rules/test_writing.py holds."""


def test_every_command_that_writes_is_listed() -> None:
    writing = {command for command, _, names in paths() if set(names) & set(WRITTEN_OPTIONS)}
    tested = {name.removesuffix(" way points") for name in (*QUICK, *SLOW)} | {"study export"}
    assert writing == tested | OTHERS and not tested & OTHERS


class Watched(netCDF4.Dataset):
    """netCDF file whose opening is announced as that of other files."""

    def __init__(self, filename: Any, mode: str = "r", **options: Any) -> None:  # noqa: D107
        if mode != "r":
            sys.audit("open", str(filename), mode, os.O_CREAT | os.O_WRONLY)
        super().__init__(filename, mode, **options)


WAYS = ("kill", "interrupt", "full")

_watching: list[Callable[[str, str], None]] = []
_CHANGES = {"os.rename": 1, "os.link": 1, "os.remove": 0, "os.mkdir": 0, "os.truncate": 0}
"""Events of changes, and the index of the changed path among their arguments."""


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if not _watching:
        return
    if event == "open":
        path, _, flags = arguments
        if not isinstance(path, str | os.PathLike) or not flags & (os.O_WRONLY | os.O_RDWR):
            return
    elif event in _CHANGES:
        path = arguments[_CHANGES[event]]
    else:
        return
    _watching[-1](event, os.fspath(path))


sys.addaudithook(_hook)


@contextmanager
def watched(folder: Path, act: Callable[[int, str, str], None]) -> Iterator[None]:
    """Call `act` with number, event and path before each change within a folder."""
    count = 0

    def see(event: str, path: str) -> None:
        nonlocal count
        if os.path.abspath(path).startswith(f"{folder}{os.sep}"):
            count += 1
            act(count, event, path)

    before = netCDF4.Dataset
    netCDF4.Dataset = Watched
    _watching.append(see)
    emgface.files._remove_parts_of_killed.cache_clear()
    try:
        yield
    finally:
        _watching.pop()
        netCDF4.Dataset = before


@pytest.fixture(scope="module", autouse=True)
def small_results() -> Iterator[None]:
    """Pictures of few pixels and short gestures, in the same changes of files; made seven times each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(movie, "PANEL", 40)
        patch.setattr(stills, "paint", partial(stills.paint, pixels=20))
        patch.setattr(motions, "GESTURE_RISE", 0.05)
        patch.setattr(motions, "HOLD", 0.05)
        yield


@pytest.fixture(scope="module")
def places(laboratory: Path, shown: Path, coarse: xr.Dataset, tmp_path_factory) -> dict[str, Path]:
    """Inputs of all commands, by their names in the command lines."""
    folder = tmp_path_factory.mktemp("inputs")
    recordings = laboratory / "recordings"
    rec = next(recordings.glob("*_B_*.nc"))
    study = folder / "study.toml"
    study.write_text(STUDY.format(folder=recordings, face=laboratory / "face.nc"))
    rows = np.random.default_rng(1).normal(size=(500, 3)).round(6)
    rows[:, 0] = np.arange(500) / 1000
    csv = folder / "table.csv"
    csv.write_text("time,a,b\n" + "\n".join(",".join(map(str, row)) for row in rows) + "\n")
    session = read_recording(rec)
    session.attrs.pop("repetition")
    write_recording(session, folder / "session.nc")
    (folder / "e_events.tsv").write_text("onset\tduration\ttrial_type\n0.6\t0.5\tD\n1.2\t0.3\tD\n")
    paths = {
        "rec": rec, "recs": recordings, "study": study, "csv": csv, "done": shown,
        "session": folder / "session.nc", "events": folder / "e_events.tsv",
        "act": folder / "act.nc", "motion": folder / "motion.nc", "trials": folder / "trials",
        "plan": folder / "plan.toml", "lips": folder / "lips.nc", "weak": folder / "weak.nc",
    }  # fmt: skip
    if find_spec("SimpleITK"):
        paths |= _phantom(folder)
    paths["plan"].write_text("[[step]]\nkind = 'palsy'\ndegree = 0.5\n")
    save_face(coarse, paths["lips"])
    made = ["treat {plan} {lips} --out {weak}"]
    made += ["cut {session} --events {events} --out {trials}"]
    made += ["activate {rec} --study {study} --out {act}"]
    made += ["simulate {act} --study {study} --surface --out {motion}"]
    for line in made:
        result = CliRunner().invoke(app, line.format(**paths).split())
        assert result.exit_code == 0, result.output
    return paths | {"trial": min(paths["trials"].glob("*.nc"))}  # 0.5 s, which are soon inverted


def _phantom(folder: Path) -> dict[str, Path]:
    """Image of a ball of 12 mm radius, and a click in it."""
    from emgface.fit.readers.volumes import toolkit

    r = np.linalg.norm(np.stack(np.meshgrid(*3 * [np.arange(24) - 11.5], indexing="ij")), axis=0)
    noise = np.random.default_rng(1).standard_normal(r.shape)
    image = toolkit().GetImageFromArray((100.0 / (1.0 + np.exp(4 * (r - 6))) + noise).astype("f4"))
    image.SetSpacing([2.0, 2.0, 2.0])
    toolkit().WriteImage(image, str(folder / "image.nrrd"))
    (folder / "clicks.csv").write_text("name,x_mm,y_mm,z_mm\nhead 1,23,23,23\n")
    return {"image": folder / "image.nrrd", "clicks": folder / "clicks.csv"}


def run(line: str, places: dict[str, Path], out: Path) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return CliRunner().invoke(app, [word.format(**places, o=out) for word in line.split()])


def begun(line: str, places: dict[str, Path], out: Path) -> Path:
    """Folder of the results of a command; a sidecar is written next to its table."""
    out.mkdir()
    if "{o}/in/" in line:
        (out / "in").mkdir()
        shutil.copy(places["csv"], out / "in" / places["csv"].name)
    return out


def kept(path: Path) -> bool:
    """Return True for a file that is appended to: the journal of a run, whose lines have checksums."""
    return path.suffix == ".jsonl"


def in_part(path: Path) -> bool:
    """Return True for a temporary file, and for a file in a temporary folder."""
    return any(is_part(one) for one in (path, *path.parents))


def grows(path: Path) -> bool:
    """Return True for a file from which an interrupted command continues, complete at every instant."""
    return path.name == INDEX or path.name.endswith(".unfinished.npz")


def content(path: Path) -> Any:
    """Return the parts of a file that two runs must have in common.

    They are the arrays of a netCDF file, and the length of a text or picture.
    """
    if path.suffix == ".nc":
        with xr.open_dataset(path, decode_times=False) as opened:
            return {
                name: (v.dims, v.dtype.kind, v.shape) for name, v in opened.load().variables.items()
            }
    if path.name == INDEX:  # which contains digests of files with the time of their writing
        return len(path.read_bytes().splitlines())
    return path.stat().st_size // 512 if path.stat().st_size > 2048 else path.read_bytes()[-8:]


def files(folder: Path) -> dict[str, Path]:
    paths = (p for p in folder.rglob("*") if p.is_file() and not kept(p))
    return {str(p.relative_to(folder)): p for p in paths if "store/" not in str(p)}


def parts(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.rglob(".*.part"))


def in_child(work: Callable[[], object]) -> int:
    """Status of a child process that calls a function."""
    child = os.fork()
    if child == 0:
        code = 99
        try:
            work()
            code = 0
        finally:
            os._exit(code)
    return os.waitpid(child, 0)[1]


def walk(line: str, places: dict[str, Path], tmp_path: Path, most: int, ways: int) -> None:
    """End a command at up to `most` of its changes, in so many ways each, and complete it afterwards."""
    whole = begun(line, places, tmp_path / "whole")
    seen: list[tuple[str, str]] = []
    with watched(whole, lambda _, event, path: seen.append((event, path))):
        result = run(line, places, whole)
    assert result.exit_code == 0, (result.output, result.exception)
    reference = files(whole)
    assert reference and parts(whole) == []
    direct = {p for e, p in seen if e == "open" and not in_part(Path(p)) and not kept(Path(p))}
    assert direct == set(), "written under its name before it is complete"
    named = [k for k, (event, _) in enumerate(seen, start=1) if event in ("open", "os.rename")]
    chosen = sorted({named[int(k)] for k in np.linspace(0, len(named) - 1, most)})
    for k, number in enumerate(chosen):
        for how in (WAYS[(k + one) % len(WAYS)] for one in range(ways)):
            out = begun(line, places, tmp_path / f"{how}{number}")
            _ended(line, places, out, number, how)
            _complete(line, places, out, reference)
            shutil.rmtree(out)


def _ended(line: str, places: dict[str, Path], out: Path, number: int, how: str) -> None:
    def act(k: int, event: str, path: str) -> None:
        if k != number and not (how == "full" and k > number and event == "open"):
            return
        if how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if how == "interrupt":
            raise KeyboardInterrupt
        if event in ("open", "os.rename", "os.link"):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), path)

    def work() -> None:
        with watched(out, act):
            result = run(line, places, out)
        lines = [one for one in result.output.splitlines() if one.strip()]
        code = 130 if how == "interrupt" else 2
        if result.exit_code != code or "Traceback" in result.output:
            raise AssertionError((how, number, result.exit_code, result.exception, lines))

    status = in_child(work)
    if how == "kill":
        assert os.WIFSIGNALED(status) or status == 0, (how, number)
    else:
        assert status == 0, (how, number, "see the messages above")
        assert parts(out) == [], (how, number)


def _complete(line: str, places: dict[str, Path], out: Path, reference: dict[str, Path]) -> None:
    for name, path in files(out).items():
        if not in_part(Path(name)) and not grows(path):
            assert name in reference, name
            _same(path, reference[name])

    def again() -> None:
        result = run(line, places, out)
        refused = "exist" in result.output and result.exit_code == 2
        if not (result.exit_code == 0 or (refused and set(files(out)) >= set(reference))):
            raise AssertionError((result.exit_code, result.exception, result.output))

    assert in_child(again) == 0, line
    assert parts(out) == []
    stored = files(out)
    assert set(stored) == set(reference)
    for name, path in stored.items():
        _same(path, reference[name])


def _same(path: Path, other: Path) -> None:
    own, wanted = content(path), content(other)
    if isinstance(own, int):  # pages state when they were written
        assert abs(own - wanted) <= 1 + wanted // 50, path.name
    else:
        assert own == wanted, path.name


@pytest.mark.parametrize("name", list(QUICK))
def test_quick_commands_end_whole(name: str, places, tmp_path: Path) -> None:
    walk(QUICK[name], places, tmp_path, most=2, ways=3)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SLOW))
def test_slow_commands_end_whole(name: str, places, tmp_path: Path) -> None:
    if name == "segment" and "image" not in places:
        pytest.skip("SimpleITK is not installed")
    walk(SLOW[name], places, tmp_path, most=3, ways=1)
