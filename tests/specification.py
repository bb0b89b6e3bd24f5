"""Required and measured values of a specification: tests that can also print their table.

A test takes the fixture ``specified`` and passes it the lines of a check. It fails if a line is not
met, unless the line is among the known misses, which the documentation explains. With

    pytest -m "slow or not slow" --table tests/kinematics/test_specification.py

all lines are printed in Markdown at the end, as the documentation shows them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import pytest

LINES = pytest.StashKey[list["Result"]]()


@dataclass(frozen=True)
class Result:
    """One line of a table; `passed` is None for a line without a requirement."""

    check: str
    wanted: str
    measured: str
    passed: bool | None


def limited(check: str, value: float, limit: float, unit: str = "") -> Result:
    """Line of a value that must not exceed a limit."""
    return Result(check, f"at most {limit:g}{unit}", f"{value:.2g}{unit}", bool(value <= limit))


def refused(check: str, error: type[Exception], attempt: Callable[[], object]) -> Result:
    """Line of an attempt that must raise an error."""
    try:
        attempt()
    except error:
        return Result(check, "refused", "refused", True)
    return Result(check, "refused", "accepted", False)


def markdown(lines: Iterable[Result]) -> str:
    """Lines as a table."""
    words = {True: "yes", False: "**no**", None: ""}
    rows = [("check", "required", "measured", "met"), ("---",) * 4]
    rows += [(one.check, one.wanted, one.measured, words[one.passed]) for one in lines]
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Declare --table."""
    parser.addoption("--table", action="store_true", help="print required and measured values")


@pytest.fixture
def specified(request: pytest.FixtureRequest) -> Callable[..., None]:
    """Function that notes the lines of a check and fails if one of them is not met."""

    def note(lines: Iterable[Result], known: Sequence[str] = ()) -> None:
        made = list(lines)
        assert made
        request.config.stash.setdefault(LINES, []).extend(made)
        missed = [one for one in made if one.passed is False]
        new = [one for one in missed if not any(fnmatch(one.check, name) for name in known)]
        assert not new, "\n" + markdown(new)

    return note


def pytest_terminal_summary(terminalreporter, config: pytest.Config) -> None:
    """Print the table, if it was asked for."""
    lines = config.stash.get(LINES, [])
    if config.getoption("--table") and lines:
        terminalreporter.write_line(markdown(lines))
