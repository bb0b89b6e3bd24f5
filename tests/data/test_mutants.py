"""Twenty mutants of every format by `python -m benchmarks mutants`: refused, reported, or valid data."""

import pytest

from benchmarks.mutants import MUTATIONS, formats, mutant, outcomes
from emgface.recordings.dataset import readers

ALLOWED = {"refused", "reported", "same", "silent"}  # a changed sample is a valid one


def test_mutants_follow_from_their_seed() -> None:
    whole = bytes(range(256)) * 4
    assert [mutant(whole, f"x {k}") for k in range(50)] == [
        mutant(whole, f"x {k}") for k in range(50)
    ]
    assert {mutant(whole, f"x {k}")[0] for k in range(300)} == set(MUTATIONS)


def test_every_reader_has_a_format(tmp_path) -> None:
    suffixes: set[str] = set()
    for name, make in formats().items():
        folder = tmp_path / name
        folder.mkdir()
        path, target, _ = make(folder)
        suffixes |= {path.suffix.lower(), target.suffix.lower()}
    for module in set(readers().values()):
        assert suffixes & set(module.SUFFIXES), module.FORMAT


@pytest.mark.slow  # one process for each format
@pytest.mark.parametrize("name", formats())
def test_no_mutant_crashes_or_hangs(name: str) -> None:
    results = outcomes(name, range(5000, 5020))
    assert len(results) == 20
    assert {result for _, _, result in results} <= ALLOWED, results
