"""Kinds of models and their commands: one example of every command, former names, the help."""

import inspect
import json
import shlex
from importlib import metadata
from pathlib import Path

import pytest
import typer
import xarray as xr
from packaging.version import Version
from typer.testing import CliRunner, Result

from emgface.choices import configure
from emgface.cli import LISTED_COMMANDS, app
from emgface.cli.aliases import ALIASES, table, translated
from emgface.deprecation import FORMER
from emgface.errors import ConfigurationError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.models.face import parameters_of
from emgface.models.kinds import MODEL_KINDS, Functions, Person, chosen, names_file, parsed

ROOT = Path(__file__).resolve().parents[2]
METHODS = [name for name in vars(Functions) if not name.startswith("_")]


def run(*words: object) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.parametrize("kind", MODEL_KINDS.values(), ids=lambda kind: kind.name)
def test_every_kind_has_every_function_of_the_contract(kind) -> None:
    assert len(METHODS) >= 10
    for name in METHODS:
        declared = list(inspect.signature(getattr(Functions, name)).parameters)[1:]
        given = list(inspect.signature(getattr(kind.functions, name)).parameters)
        assert len(given) == len(declared), (kind.name, name)


MOVED = {
    "face": ("ZYG_L=0.2,ZYG_R=0.2", ("--duration", "0.05", "--no-contact", "--accuracy", "draft")),
    "jaw": ("open", ("--duration", "0.05", "--step", "0.005")),
    "tongue": ("bi_GGP=0.1", ("--duration", "0.02", "--step", "0.01")),
    "head": ("bi_open=0.1", ("--duration", "0.02")),
}
BUILT = {"head": ("--parts", "jaw,hyoid"), "jaw": ()}


@pytest.mark.parametrize("kind", MODEL_KINDS.values(), ids=lambda kind: kind.name)
def test_every_kind_is_built_checked_moved_and_shown_by_the_same_commands(kind, tmp_path) -> None:
    model, motion = tmp_path / "model.nc", tmp_path / "motion.nc"
    size = BUILT.get(kind.name, ("--resolution", "coarse"))
    built = run("build", kind.name, "--out", model, *size)
    assert built.exit_code == 0 and f"Wrote {model}" in built.output.replace("\n", ""), built.output
    checked = run("check", model)
    assert checked.exit_code == 0 and "model.nc: " in checked.output, checked.output
    source, options = MOVED[kind.name]
    page = tmp_path / "page.html"
    moved = run("simulate", source, "--model", model, "--out", motion, "--page", page, *options)
    assert moved.exit_code == 0, moved.output
    assert motion.is_file() and "<html" in page.read_text()
    assert "Estimated error of the time steps: " in " ".join(moved.output.split())
    with xr.open_dataset(motion) as data:
        error = data["numerical_error"].values
        assert error.shape == data["time"].shape
        assert data.attrs["numerical_error"] == error.max() > 0.0
    shown = run("show", motion, "--out", tmp_path / "motion.png")
    assert shown.exit_code == 0, shown.output
    assert (tmp_path / "motion.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", ["jaw", "tongue", "head"])
def test_options_of_other_kinds_are_refused_and_nothing_is_written(kind, tmp_path) -> None:
    model, out = tmp_path / "model.nc", tmp_path / "motion.nc"
    size = BUILT.get(kind, ("--resolution", "coarse"))
    assert run("build", kind, "--out", model, *size).exit_code == 0
    for option in (("--solver", "sdirk2"), ("--no-contact",), ("--set", "color=red")):
        result = run("simulate", "rest", "--model", model, "--out", out, *option)
        assert result.exit_code == 2 and "expected" in result.output, result.output
    assert not out.exists()
    if kind != "head":
        assert run("build", kind, "--out", out, "--parts", "jaw").exit_code == 2
        assert not out.exists()


def leaves(values: dict, before: str = ""):
    """Values of a nested mapping by dotted names."""
    for name, value in values.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{before}{name}.")
        elif value is not None:
            yield before + name, value


DEFAULTS = dict(leaves(SimulationParameters().model_dump(mode="json")))


def test_every_parameter_of_a_simulation_is_a_setting_of_a_face() -> None:
    assert len(DEFAULTS) >= 30
    texts = {name: v if isinstance(v, str) else json.dumps(v) for name, v in DEFAULTS.items()}
    for name, text in texts.items():
        given = dict(leaves(parameters_of(parsed([f"{name}={text}"]), {})))
        assert given == {name: DEFAULTS[name]}
    whole = configure(SimulationParameters, parameters_of(texts, {}))
    assert whole == SimulationParameters()


@pytest.mark.parametrize(
    ("settings", "given", "said"),
    [
        (["outpt=0.1"], {}, "did you mean 'output'"),
        (["surface=true"], {}, "unknown parameter 'surface'"),
        (["contact.method=none"], {"contact": {"method": "none"}}, "another option"),
        (["step=0.01", "step=0.02"], {}, "step is specified twice"),
        (["step"], {}, "NAME=VALUE"),
    ],
)
def test_settings_of_a_face_that_are_refused(settings, given, said) -> None:
    with pytest.raises(ConfigurationError, match=said):
        parameters_of(parsed(settings), given)


def test_a_setting_of_a_face_has_the_effect_of_its_option(tmp_path) -> None:
    face, one, other = (tmp_path / name for name in ("face.nc", "one.nc", "other.nc"))
    assert run("build", "face", "--out", face, "--resolution", "coarse").exit_code == 0
    common = ("simulate", "ZYG_L=0.2", "--face", face, "--duration", "0.05", "--accuracy", "draft")
    assert run(*common, "--no-contact", "--out", one).exit_code == 0
    result = run(*common, "--set", "contact.method=none", "--out", other)
    assert result.exit_code == 0, result.output
    with xr.open_dataset(one) as a, xr.open_dataset(other) as b:
        assert a["position"].identical(b["position"])


@pytest.mark.parametrize("words", ["build nose --out n.nc", "import nose . --out n.nc"])
def test_an_unknown_kind_is_named(words: str) -> None:
    result = run(*words.split())
    assert result.exit_code == 2 and "expected one of face, jaw, tongue, head" in result.output


def test_help_fits_a_screen_and_lists_every_command_once() -> None:
    text = run("--help").output
    assert len(text.splitlines()) <= 24 and max(map(len, text.splitlines())) <= 80
    named = [verb for verbs in LISTED_COMMANDS.values() for verb, *_ in verbs]
    whole = typer.main.get_command(app)
    assert sorted(named) == sorted(whole.commands)  # pyright: ignore[reportAttributeAccessIssue]
    assert len(set(named)) == len(named) <= 30
    for name in named:
        assert f" {name} " in text


def accepted(words: list[str]) -> str:
    """First problem of a command line that parsing finds, without running the command."""
    command, rest = typer.main.get_command(app), words
    while hasattr(command, "commands"):
        if rest[0] not in command.commands:
            return f"no command {rest[0]}"
        command, rest = command.commands[rest[0]], rest[1:]
    try:
        command.make_context("x", list(rest))
    except Exception as error:  # of the parser
        return str(error)
    return ""


@pytest.mark.parametrize("old", ALIASES)
def test_every_former_command_is_one_of_today(old: str) -> None:
    group = typer.main.get_command(app)
    for word in ALIASES[old].new.split():
        if hasattr(group, "commands"):
            group = group.commands[word]
    assert f"`emgface {old}` | `emgface {ALIASES[old].new}`" in table()


FORMER_LINES = {
    "face import artisynth F --lao lateral --out o": "import face F --set lao_fibres=lateral --out o",
    "jaw run j.nc --task open --law hill --out o": "simulate open --set law=hill --out o --model j.nc",
    "jaw run j.nc --excitation e.csv --out=o": "simulate e.csv --out o --model j.nc",
    "jaw run j.nc --out o": "simulate rest --out o --model j.nc",
    "tongue simulate t.nc --muscle SL --muscle GGP --level 0.2 --no-gravity --out o":
        "simulate SL=0.2,GGP=0.2 --set gravity=false --out o --model t.nc",
    "head follow h.nc r.c3d --strategy act_3 --out o":
        "simulate r.c3d --strategy act_3 --out o --model h.nc",
    "head import F --contact lip-lip --contact lips-teeth --floor --out o":
        "import head F --set floor=true --out o --set contacts=lip-lip,lips-teeth",
    "jaw show m.nc": "show m.nc --out m.html",
    "jaw show m.nc --out m.png": "show m.nc --out m.png",
    "jaw activate r.nc --out u.nc": "activate r.nc --out u.nc --kind jaw",
    "data check a.nc b.nc": "check a.nc b.nc",
    "inverse calibrate a b --out c": "invert calibrate a b --out c",
    "simulate a.nc --out m.nc": "simulate a.nc --out m.nc",
}  # fmt: skip


@pytest.mark.parametrize("line", FORMER_LINES)
def test_words_of_former_commands_are_rearranged(line: str, tmp_path, monkeypatch) -> None:
    words, message = translated(shlex.split(line))
    assert " ".join(words) == FORMER_LINES[line]
    assert bool(message) == (not line.startswith("simulate"))
    monkeypatch.chdir(tmp_path)
    assert accepted(words) == ""


def test_former_names_are_removed_in_time() -> None:
    """Fails in the version that removes them."""
    assert len(FORMER) > 30
    for one in FORMER:
        assert Version(one.since) < Version(one.removal)
        assert Version(one.removal) > Version(metadata.version("emgface")), one.text


def test_settings_have_the_types_of_their_defaults() -> None:
    def function(a: int = 1, b: float = 2.0, c: bool = False, d: str | None = None) -> None: ...

    given = parsed(["a=3", "b=0.5", "c=true", "d=x=y"])
    assert chosen(function, given, *"abcd") == {"a": 3, "b": 0.5, "c": True, "d": "x=y"}
    for wrong in ({"a": "x"}, {"b": "nan"}, {"c": "yes"}, {"e": "1"}):
        with pytest.raises(ConfigurationError):
            chosen(function, wrong, *"abcd")
    for text in ("a", "=1", "a="):
        with pytest.raises(ConfigurationError):
            parsed([text])


def test_files_are_distinguished_from_exciters(tmp_path: Path) -> None:
    assert names_file("e.csv") and names_file(str(tmp_path))
    assert not any(map(names_file, ("open", "bi_open=0.1", "a=0.1,b", "rest")))


def test_a_person_has_only_the_options_of_its_kind() -> None:
    with pytest.raises(ConfigurationError, match="a jaw has no"):
        MODEL_KINDS["jaw"].build(Person(resolution="fine"))


def examples() -> list[str]:
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    blocks = page.split("```sh\n")[1:]
    return [
        line.partition(" #")[0].strip() for b in blocks for line in b.split("```")[0].splitlines()
    ]


def test_every_command_has_an_example() -> None:
    named = {verb for verbs in LISTED_COMMANDS.values() for verb, *_ in verbs}
    assert {shlex.split(line)[1] for line in examples()} == named
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    assert table() in page


@pytest.mark.parametrize("line", examples())
def test_examples_are_accepted(line: str) -> None:
    assert accepted(shlex.split(line)[1:]) == ""
