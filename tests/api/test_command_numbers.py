"""Numbers of commands: every option has limits, and values outside are refused before anything runs."""

import inspect
import typing

import pytest
import typer
from typer.testing import CliRunner

from emgface.cli import app
from emgface.cli.numbers import LIMITS, ONCE, checked
from emgface.errors import ConfigurationError
from emgface.models.kinds import levels_of

WRONG = ["nan", "inf", "-inf", "1e300", "-1e300"]


def commands(group, path=()):
    for command in group.registered_commands:
        name = command.name or command.callback.__name__.strip("_").replace("_", "-")
        yield (*path, name), command.callback
    for inner in group.registered_groups:
        yield from commands(inner.typer_instance, (*path, inner.name))


def numbers():
    for path, callback in commands(app):
        for name, hint in typing.get_type_hints(callback).items():
            kinds = {hint, *typing.get_args(hint)}
            kinds |= {k for kind in kinds for k in typing.get_args(kind)}
            if kinds & {int, float}:
                yield path, callback, name, float in kinds


ALL = list(numbers())
IDS = [f"{' '.join(path)} {name}" for path, _, name, _ in ALL]


def test_numbers_of_every_command_have_limits():
    assert len(ALL) > 50
    assert {name for *_, name, _ in ALL} == set(LIMITS)
    assert all(least < most for least, most in LIMITS.values())


@pytest.mark.parametrize(("path", "callback", "name", "real"), ALL, ids=IDS)
def test_every_number_is_refused_outside_its_limits(path, callback, name, real):
    assert callback.checks_numbers
    least, most = LIMITS[name]
    wrong = [least - 1.0 - 1e-3 * abs(least), 2.0 * most + 1.0]
    parameters = inspect.signature(callback).parameters
    for value in [*wrong, *(map(float, WRONG) if real else ())]:
        given = {p: None for p in parameters}
        for one in (value, (value, value)):
            with pytest.raises(typer.BadParameter, match="expected a number from"):
                callback(**(given | {name: one}))


@pytest.mark.parametrize("value", WRONG)
@pytest.mark.parametrize("option", ["--duration", "--step"])
@pytest.mark.parametrize("group", [("jaw", "run"), ("tongue", "simulate"), ("head", "simulate")])
def test_a_command_line_with_such_numbers_ends_with_a_sentence(group, option, value, tmp_path):
    path = tmp_path / "m.nc"
    path.touch()
    given = [*group, str(path), "--out", str(tmp_path / "o.nc"), option, value]
    done = CliRunner().invoke(app, given)
    assert done.exit_code == 2
    assert "expected a number from" in " ".join(done.output.replace("│", " ").split())
    assert not (tmp_path / "o.nc").exists()


@pytest.mark.parametrize("source", ["bi_GGP=0.1,bi_GGP=0.3", "bi_GGP,bi_GGP", "SL, bi_GGP, SL=0"])
def test_a_muscle_given_twice_is_refused(source):
    with pytest.raises(ConfigurationError, match="is given twice"):
        levels_of(source, 0.3)


def test_names_that_may_occur_once_are_those_of_commands():
    known = {
        name for _, callback in commands(app) for name in inspect.signature(callback).parameters
    }
    assert set(ONCE) <= known


def test_a_command_is_checked_once():
    def run(step: float = 1.0) -> float:
        return step

    once = checked(run)
    assert checked(once) is once
    assert once(step=2.0) == 2.0
    with pytest.raises(typer.BadParameter, match="--step nan"):
        once(float("nan"))
