"""The page of inputs and their checks names files and tests that exist, with inputs for every kind."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
ROWS = [
    [cell.strip() for cell in line.strip("| \n").split(" | ")]
    for line in (ROOT / "docs" / "boundary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| kind")
]


def test_every_row_has_a_place_a_test_and_two_inputs():
    assert len(ROWS) > 15
    for kind, places, tests, inputs in ROWS:
        assert re.findall("`[^`]+`", places), kind
        assert "::" in tests, kind
        assert len(inputs.split("; ")) >= 2, kind


def test_places_and_tests_exist():
    for kind, places, tests, _ in ROWS:
        for place in re.findall("`([^`]+)`", places):
            assert (ROOT / place).exists(), (kind, place)
        for test in re.findall("`([^`]+)`", tests):
            path, name = test.split("::")
            text = (ROOT / path).read_text(encoding="utf-8")
            assert re.search(rf"^def {name}\(", text, re.MULTILINE), (kind, test)
