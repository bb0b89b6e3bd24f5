"""Studies and recordings from somebody else: what their files name does not lead out of the folder."""

import json
import multiprocessing
import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

import emgface
from emgface.cli import app
from emgface.errors import JournalWarning, StoreError
from emgface.recordings.dataset import read_recording, write_recording
from emgface.report.results import open_results, study_cube
from emgface.run.lines import damaged_lines, lines, run_files, written
from emgface.run.retention import export, unused_files
from emgface.run.runner import LocalProcesses, run_jobs
from emgface.run.store import OWNERS, add_owner, owners
from emgface.study.configuration import StudyConfiguration
from emgface.study.run import run_study

pytestmark = pytest.mark.filterwarnings("ignore::emgface.errors.FeatureWarning")


@pytest.fixture
def folder(shown: Path, tmp_path: Path) -> Path:
    export(shown, tmp_path / "study")
    return tmp_path / "study"


def everything(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def rewrite(folder: Path, change) -> None:
    """Change every line of a journal and give it its checksum."""
    for path in run_files(folder):
        made = [
            written({k: v for k, v in line.items() if k != "check"})
            for line in (change(dict(line)) for _, line in lines(path))
        ]
        path.write_bytes(b"".join(made))


@pytest.mark.parametrize("stage", ["../../victim", "..", "/etc", "."])
def test_a_stage_in_a_journal_does_not_lead_out_of_the_store(folder: Path, stage: str) -> None:
    victim = folder.parent / "victim"
    victim.mkdir()
    (victim / "own.nc").write_bytes(b"own")
    before = everything(victim)

    def change(line):
        for one in line.get("stages", ()):
            one["stage"] = stage
        return line

    rewrite(folder, change)
    for action in (lambda: unused_files([folder]), lambda: export(folder, folder.parent / "out")):
        with pytest.raises(StoreError, match="expected a name and hexadecimal digits"):
            action()
    result = CliRunner().invoke(app, ["study", "gc", str(folder), "--delete"])
    assert result.exit_code == 2 and everything(victim) == before


def test_a_journal_that_names_the_store_of_another_study_deletes_nothing(
    shown: Path, folder: Path
) -> None:
    export(shown, folder.parent / "mine")
    before = everything(folder.parent / "mine")

    def change(line):
        if "store" in line:
            line["store"] = str(folder.parent / "mine" / "store")
        return line

    rewrite(folder, change)
    with pytest.raises(StoreError, match="is not in the list of"):
        unused_files([folder])
    result = CliRunner().invoke(app, ["study", "gc", str(folder), "--delete"])
    assert result.exit_code == 2 and everything(folder.parent / "mine") == before


def test_links_of_a_store_are_not_followed(folder: Path) -> None:
    outside = folder.parent / "outside"
    shutil.move(folder / "store" / "skin", outside)
    (folder / "store" / "skin").symlink_to(outside)
    (outside / "0123.nc").write_bytes(b"own")
    secret = folder.parent / "secret.txt"
    secret.write_text("secret")
    (folder / "tables").mkdir(exist_ok=True)
    (folder / "tables" / "a.csv").symlink_to(secret)
    (folder / "runs" / "b.txt").symlink_to(secret)
    before = everything(outside)
    assert unused_files([folder]).files == []
    export(folder, folder.parent / "copy")
    copied = everything(folder.parent / "copy")
    assert b"secret" not in copied.values() and everything(outside) == before
    assert not [path for path in (folder.parent / "copy").rglob("*") if path.is_symlink()]
    assert not (folder.parent / "copy" / "store" / "skin").exists()


def test_one_flipped_bit_of_a_journal_stops_deletion(folder: Path) -> None:
    (path,) = run_files(folder)
    whole = path.read_bytes()
    starts = [0, *(k + 1 for k, byte in enumerate(whole) if byte == 10)]
    before = everything(folder / "store")
    for number, start in enumerate(starts[:-1], 1):
        data = bytearray(whole)
        data[start + 30] ^= 4
        path.write_bytes(bytes(data))
        assert damaged_lines(path)[0] == (number if number > 1 else 1)
        result = CliRunner().invoke(app, ["study", "gc", str(folder), "--delete"])
        assert result.exit_code == 2, (number, result.output)
        assert everything(folder / "store") == before
    path.write_bytes(whole)
    assert unused_files([folder]).files == []


def damaged(folder: Path) -> Path:
    """Flip a bit in the second line of the journal of a study."""
    (path,) = run_files(folder)
    whole = bytearray(path.read_bytes())
    whole[whole.index(b"\n") + 31] ^= 4
    path.write_bytes(whole)
    return path


def run_again(folder: Path) -> None:
    text = str(study_cube(folder).attrs["configuration"])
    run_study(StudyConfiguration.model_validate_json(text), folder)


def asked(*words: str) -> str:
    return CliRunner().invoke(app, ["study", *words]).output


def warned(action: Callable[[], object]) -> str:
    with pytest.warns(JournalWarning) as caught:
        action()
    return " ".join(str(one.message) for one in caught)


READING = {
    "status": lambda folder: asked("status", str(folder)),
    "status --json": lambda folder: asked("status", str(folder), "--json"),
    "explain": lambda folder: asked("explain", str(folder)),
    "gc": lambda folder: asked("gc", str(folder)),
    "export": lambda folder: asked("export", str(folder), "--out", str(folder.parent / "copy")),
    "reproduce": lambda folder: asked("reproduce", str(folder)),
    "report": lambda folder: warned(lambda: open_results(folder)),
    "run": lambda folder: warned(lambda: run_again(folder)),
}


@pytest.mark.parametrize("command", READING)
def test_every_command_that_reads_a_journal_states_its_damaged_lines(
    folder: Path, command: str
) -> None:
    path = damaged(folder)
    output = READING[command](folder)
    assert f"line 2 of {path} is damaged" in output


def test_status_lists_damaged_lines_in_json(folder: Path) -> None:
    ask = ["study", "status", str(folder), "--json"]
    assert json.loads(CliRunner().invoke(app, ask).stdout)["damage"] == []
    path = damaged(folder)
    (message,) = json.loads(CliRunner().invoke(app, ask).stdout)["damage"]
    assert str(path) in message and "line 2" in message


def test_nothing_reads_a_journal_without_stating_its_damage() -> None:
    """Only `gc`, which refuses damage, obtains the files of runs without the warning."""
    package = Path(emgface.__file__).parent
    users = [path for path in package.rglob("*.py") if "run_files" in path.read_text("utf-8")]
    assert sorted(path.name for path in users) == ["lines.py", "retention.py"]


def test_a_store_without_a_list_and_with_other_studies_is_refused(
    shown: Path, folder: Path
) -> None:
    store = folder / "store"
    (place,) = owners(store)
    assert place == folder.resolve()
    gone = folder.parent / "gone"
    add_owner(store, gone)
    with pytest.raises(StoreError, match="is also used by .*gone"):
        unused_files([folder])
    assert unused_files([folder], forget=[gone]).files == []
    shutil.rmtree(store / OWNERS)
    with pytest.raises(StoreError, match="has no list of the studies"):
        unused_files([folder])


def test_gc_lists_before_it_deletes(folder: Path) -> None:
    path = folder / "store" / "motion" / f"{'0' * 32}.nc"
    path.write_bytes(b"12345")
    for words, exists in ((), True), (("--delete",), False):
        result = CliRunner().invoke(app, ["study", "gc", str(folder), *words])
        assert str(path) in result.stdout.replace("\n", "") and path.exists() == exists


def test_cut_writes_into_its_folder_only_and_replaces_nothing(
    laboratory: Path, tmp_path: Path
) -> None:
    trial = read_recording(next((laboratory / "recordings").glob("*.nc")))
    source, out = tmp_path / "in" / "long.nc", tmp_path / "a" / "b" / "out"
    write_recording(trial.assign_attrs(volunteer="../../escaped/V1"), source)
    table = tmp_path / "events.tsv"
    table.write_text("onset\tduration\ttrial_type\n0.1\t0.2\t../../B\n0.3\t0.2\tB\n")
    words = ["cut", str(source), "--events", str(table), "--out", str(out)]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    made = everything(tmp_path / "a")
    assert len(made) == 2 and all(path.parent == out for path in made)
    assert not (tmp_path / "escaped").exists() and not (tmp_path / "a" / "escaped").exists()
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 2 and "--force" in again.output and everything(tmp_path / "a") == made
    assert CliRunner().invoke(app, [*words, "--force"]).exit_code == 0
    table.write_text("onset\tduration\ttrial_type\n0.1\t0.2\ta/b\n0.3\t0.2\ta-b\n")
    result = CliRunner().invoke(app, [*words[:-1], str(tmp_path / "other")])
    assert result.exit_code == 2 and "would both be written as" in result.output
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize("kind", ["netcdf", "bids"])
def test_convert_replaces_nothing(laboratory: Path, tmp_path: Path, kind: str) -> None:
    source = next((laboratory / "recordings").glob("*.nc"))
    words = ["convert", str(source), "--out", str(tmp_path / "out"), "--to", kind]
    assert CliRunner().invoke(app, words).exit_code == 0
    made = everything(tmp_path)
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 2 and "--force" in again.output and everything(tmp_path) == made
    assert CliRunner().invoke(app, [*words, "--force"]).exit_code == 0


def _wait(seconds: float) -> None:
    time.sleep(seconds)


def _nothing() -> None:
    pass


def test_stopping_the_workers_leaves_other_children_alone() -> None:
    workers = LocalProcesses(2, ["emgface.run.runner"])
    jobs = run_jobs(_wait, [0.0, 60.0], workers, begin=_nothing, arguments=())
    next(jobs)
    own = multiprocessing.get_context("spawn").Process(target=_wait, args=(60.0,))
    own.start()
    try:
        with pytest.raises(KeyboardInterrupt):
            jobs.throw(KeyboardInterrupt)
        own.join(1.0)
        assert own.is_alive()
    finally:
        own.kill()
        own.join()
        workers.end()
