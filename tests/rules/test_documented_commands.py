"""Commands in pages and docstrings: their names and options exist. Nothing is executed."""

import ast
import re
import shlex
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from benchmarks.__main__ import ARCHIVES, archived, measurements
from emgface.cli import app

ROOT = Path(__file__).resolve().parents[2]
COMMAND = re.compile(r"(?:\bemgface|python -m (?:benchmarks|studies\.\w+)) .*")
ENDS = re.compile(r"&&|;|\||>| # ")
"""Characters and words of the shell that end a command before the end of its line."""
FENCED = re.compile(r"^ *```(\w*)[^\n]*\n(.*?)^ *```", re.DOTALL | re.MULTILINE)
FORMER = ("CHANGELOG.md", "commands.md")
"""Pages that also name commands of former versions."""


def lines() -> Iterator[tuple[str, str]]:
    """Lines of code of the pages, and of the docstrings of measurements and studies."""
    for path in sorted(
        {*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("studies/**/*.md")}
    ):
        if {"generated", "changes"} & {
            *path.parts
        }:  # by the building of the documentation, or news
            continue
        text = path.read_text(encoding="utf-8")
        code = [block for kind, block in FENCED.findall(text) if kind in ("", "sh")]
        rest = FENCED.sub("", text)
        code += [" ".join(one.split()) for one in re.findall(r"`([^`]+)`", rest)]
        code += re.findall(r"^ {4}(\S.*)$", rest, re.MULTILINE)
        if path.name not in FORMER:
            yield from ((path.name, line) for block in code for line in joined(block))
    for path in (*ROOT.glob("benchmarks/**/*.py"), *ROOT.glob("studies/**/*.py")):
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        yield from ((str(path.relative_to(ROOT)), line) for line in joined(text))


def joined(code: str) -> list[str]:
    """Lines of code, continued ones in one."""
    return code.replace("\\\n", " ").splitlines()


def commands() -> list[tuple[str, list[str]]]:
    """Page and words of every command."""
    cited: list[tuple[str, list[str]]] = []
    for page, line in lines():
        for one in COMMAND.findall(line):
            text = ENDS.split(re.sub(r"[\[\]`]", " ", one))[0]
            try:
                cited.append((page, shlex.split(text)))
            except ValueError:  # a quotation that continues in prose
                cited.append((page, text.split()))
    return [(page, words) for page, words in cited if words[1:] and words[1] != "as"]


def wrong(words: list[str]) -> str:
    """Message about the first name that the parsers do not know, or the commit of an archive."""
    if words[0] == "emgface":
        command: Any = whole()
        rest = words[1:]
        while rest and hasattr(command, "commands") and not rest[0].startswith("-"):
            name = rest[0].rstrip(".,:;)")
            if not re.fullmatch("[a-z]+", name):
                return ""  # a placeholder
            if name not in command.commands:
                return f"no command {name}"
            command, rest = command.commands[name], rest[1:]
        known = {"--help", "--version", "--debug"}
        known |= {text for part in command.params for text in (*part.opts, *part.secondary_opts)}
    else:
        module, rest = words[2], words[3:]
        if module == "benchmarks":
            if not rest or rest[0].startswith("-") or rest[0].isupper():
                return ""
            if commit := archived([word.rstrip(".,:;)") for word in rest]):
                return commit
            name, rest = rest[0].replace("-", "_"), rest[1:]
            if name not in known_measurements():
                return f"no measurement {name}"
            module = f"benchmarks/{name}"
        known = options(module.replace(".", "/"))
    given = [word.split("=")[0].rstrip(".,:;)") for word in rest if re.match("--[a-z]", word)]
    return ", ".join(f"no option {name}" for name in given if name not in known)


whole = cache(lambda: get_command(app))
known_measurements = cache(measurements)


@cache
def options(module: str) -> set[str]:
    """Options of the function `main` of a measurement or study."""
    places = (f"{module}.py", f"{module}/__main__.py", f"{module}/__init__.py")
    path = next(ROOT / place for place in places if (ROOT / place).is_file())
    tree = ast.parse(path.read_text(encoding="utf-8"))
    main = next(n for n in tree.body if isinstance(n, ast.FunctionDef) and n.name == "main")
    names = [one.arg.replace("_", "-") for one in (*main.args.args, *main.args.kwonlyargs)]
    stated = [n.value for n in ast.walk(main) if isinstance(n, ast.Constant)]
    return (
        {f"--{name}" for name in names} | {f"--no-{name}" for name in names} | {*map(str, stated)}
    )


def test_every_documented_command_exists() -> None:
    every = commands()
    assert len(every) > 300
    pages = [*ROOT.glob("docs/**/*.md"), *ROOT.glob("studies/**/*.md")]
    text = {path: path.read_text(encoding="utf-8") for path in pages}
    wrong_commands = {
        f"{page}: {' '.join(words)}: {why}"
        for page, words in every
        if (why := wrong(words)) and not any(why in text[p] for p in pages if p.name == page)
    }
    assert not wrong_commands, "\n".join(sorted(wrong_commands))


@pytest.mark.parametrize(
    ("command", "why"),
    [
        ("emgface build face --out face.nc --no-such", "no option --no-such"),
        ("emgface study nothing out", "no command nothing"),
        ("emgface build face --out face.nc", ""),
        ("python -m benchmarks nothing", "no measurement nothing"),
        ("python -m benchmarks jaw --part posterior --samples 9", "b11a4377"),
        ("python -m benchmarks jaw --part pull", "9c2599bc"),
        ("python -m benchmarks locking --body cook --points 3", "no option --points"),
        ("python -m studies.coupled --part closing", ""),
    ],
)
def test_commands_that_do_not_exist_are_found(command: str, why: str) -> None:
    assert wrong(command.split()) == why


@pytest.mark.parametrize("commit", ARCHIVES)
def test_archived_measurements_are_in_the_history(commit: str) -> None:
    """Pages named tags that no clone contained, so that 'git checkout' failed."""
    git = ["git", "-C", str(ROOT), "-c", "safe.directory=*"]
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone of the repository")
    past = [*git, "merge-base", "--is-ancestor", commit, "HEAD"]
    assert subprocess.run(past, capture_output=True).returncode == 0
    listed = [*git, "ls-tree", "--name-only", commit, "benchmarks/"]
    names = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split()
    there = {name.removeprefix("benchmarks/").removesuffix(".py") for name in names}
    assert set(ARCHIVES[commit]) <= there


def test_every_command_in_a_message_exists() -> None:
    """In all texts of the package, where a quotation mark or bracket precedes the command."""
    cited: list[tuple[str, str, str]] = []
    for path in sorted((ROOT / "emgface").rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_bytes())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                text = " ".join(node.value.split())
                for one in re.findall(r"['(`\[](emgface [a-z][^'`)\]]*)", text):
                    words = re.split(r"[,;:]| (?:for|of|with|if|to|or|and)\b", one)[0].split()
                    cited.append((path.name, one, wrong(words)))
    assert len(cited) > 60
    assert not [one for one in cited if one[2]]


def every_option() -> set[str]:
    """Options of all commands, measurements, studies and makers of pages."""
    options_known, left = {"--help", "--version", "--debug"}, [whole()]
    while left:
        one: Any = left.pop()
        options_known |= {
            text for part in one.params for text in (*part.opts, *part.secondary_opts)
        }
        left += getattr(one, "commands", {}).values()
    modules = [f"benchmarks/{name}" for name in known_measurements()]
    modules += [str(path.parent.relative_to(ROOT)) for path in ROOT.glob("studies/*/__main__.py")]
    return options_known.union(*(options(module) for module in modules))


def test_an_option_that_stands_alone_on_a_page_exists() -> None:
    known = every_option()
    alone = {(page, line.split()[0].split("=")[0]) for page, line in lines() if line[:2] == "--"}
    assert len(alone) > 20
    assert not {(page, name) for page, name in alone if name.rstrip(",.") not in known}
