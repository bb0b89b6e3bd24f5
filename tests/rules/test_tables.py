"""Tables of the documentation and their commands, compared digit by digit."""

import pytest

from benchmarks.__main__ import measurements
from benchmarks.tables import MARKED, ROOT, differences, main
from studies.mechanics.__main__ import page

HEAD = "| case | error |\n|---|---|\n"


@pytest.mark.parametrize(
    "printed, made, agrees",
    [
        ("2.6e-6", "2.6e-6", True),
        ("2.6e-6", "2.7e-6", True),  # one unit of the last digit
        ("2.6e-6", "2.8e-6", False),
        ("1.5e-10", "2.6e-6", False),
        ("9.10", "9.11", True),
        ("9.10", "9.12", False),
        ("< 1e-09", "< 1e-09", True),
        ("< 1e-09", "2.0e-06", False),
    ],
)
def test_numbers_differ_beyond_one_unit_of_their_last_digit(printed, made, agrees):
    messages = differences(HEAD + f"| a | {printed} |\n", HEAD + f"| a | {made} |\n")
    assert (messages == []) is agrees


def test_a_missing_line_or_column_is_a_difference():
    assert differences(HEAD + "| a | 1 |\n", HEAD)
    assert differences(HEAD + "| a | 1 |\n", HEAD + "| a | 1 | 2 |\n")


def test_commands_of_marked_tables_exist():
    marked = [
        m for page in ROOT.glob("docs/**/*.md") for m in MARKED.finditer(page.read_text("utf-8"))
    ]
    assert marked
    for match in marked:
        *module, name = match["command"].split()[:4]
        assert module == ["python", "-m", "benchmarks"] and name in measurements(), name


@pytest.mark.slow
def test_tables_of_cheap_commands_are_what_the_commands_print(capsys):
    main()
    assert "agrees: python -m benchmarks locking --body cook" in capsys.readouterr().out


def test_the_page_of_mechanics_is_that_of_its_tables(root):
    assert page() == (root / "docs" / "mechanics" / "README.md").read_text("utf-8")
