"""Former commands: each is translated to the command that replaced it, with a warning.

Before version 0.3 every organ had its own verbs (``jaw run``, ``head simulate``). They are not
listed by ``--help``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Final

from emgface.deprecation import Former

SINCE, REMOVAL = "0.3", "0.4"
SWITCHES: Final = ("--clip", "--floor", "--force", "--gravity", "--help", "--no-gravity")
"""Options without a value, of the commands whose words are rearranged."""
Words = list[str]


@dataclass(frozen=True)
class Alias:
    """Command that replaced a former one, and how its words are rearranged.

    Attributes
    ----------
    new : words of the command.
    moved : first argument becomes ``--model``; what moves the model becomes the argument.
    settings : options that became settings (``--set NAME=VALUE``), by their names.
    finish : further change of the words after the command.
    """

    new: str
    moved: bool = False
    settings: Mapping[str, str] = field(default_factory=dict[str, str])
    finish: Callable[[Words], Words] = lambda words: words

    def words(self, rest: Words) -> Words:
        """Words of the new command for the words after the former one."""
        if not (self.moved or self.settings):
            return [*self.new.split(), *self.finish(rest)]
        given, options = _parted(rest)
        made, levels, source = Words(), Words(), ""
        level = next((value for name, value in options if name == "--level"), "")
        for name, value in options:
            if self.moved and name in ("--task", "--excitation"):
                source = value or source
            elif self.moved and name == "--muscle":
                levels.append(value if "=" in value or not level else f"{value}={level}")
            elif self.moved and name == "--level":
                continue
            elif name in self.settings:
                text = value or ("false" if name.startswith("--no-") else "true")
                made += ["--set", f"{self.settings[name]}={text}"]
            else:
                made += [name] if name in SWITCHES else [name, value]
        if self.moved and given:
            model, *others = given
            source = ",".join([*([source] if source else []), *levels]) or "rest"
            given = others or [source]
            made += ["--model", model]
        return [*self.new.split(), *self.finish([*given, *made])]


def _parted(words: Words) -> tuple[Words, list[tuple[str, str]]]:
    """Arguments, and options with their values."""
    given, options, k = Words(), list[tuple[str, str]](), 0
    while k < len(words):
        name, sign, value = words[k].partition("=")
        if not name.startswith("--"):
            given.append(words[k])
        elif sign or name in SWITCHES or k + 1 == len(words):
            options.append((name, value))
        else:
            k += 1
            options.append((name, words[k]))
        k += 1
    return given, options


def _jaw(words: Words) -> Words:
    return [*words, "--kind", "jaw"]


def _page(words: Words) -> Words:
    """Write the page next to the file of a motion, as former commands did."""
    if not words or "--out" in words or "--help" in words:
        return words
    return [*words, "--out", str(PurePath(words[0]).with_suffix(".html"))]


def _contacts(words: Words) -> Words:
    """Join settings of the same name, which were repeatable options."""
    contacts = [w.partition("=")[2] for w in words if w.startswith("contacts=")]
    if len(contacts) < 2:
        return words
    rest, k = Words(), 0
    while k < len(words):
        if words[k] == "--set" and words[k + 1].startswith("contacts="):
            k += 2
            continue
        rest.append(words[k])
        k += 1
    return [*rest, "--set", f"contacts={','.join(contacts)}"]


_OF_FACE: Final = {
    "--radius": "radius", "--oop": "oop", "--oom": "oom", "--lao": "lao_fibres",
    "--marker-ring-offset": "marker_ring_offset", "--bones": "bones",
}  # fmt: skip
_OF_JAW: Final = {"--law": "law", "--series": "series", "--morsel": "morsel"}
_GRAVITY: Final = {"--gravity": "gravity", "--no-gravity": "gravity"}
_OF_TONGUE: Final = {"--variant": "variant", **_GRAVITY}
_OF_HEAD: Final = {"--law": "law", **_GRAVITY}

ALIASES: Final[Mapping[str, Alias]] = {
    "face import artisynth": Alias("import face", settings=_OF_FACE),
    "face build": Alias("build face"),
    "face check": Alias("check"),
    "face reduce": Alias("reduce"),
    "jaw import": Alias(
        "import jaw",
        settings={"--variant": "variant", "--condyle": "condyle", "--values": "values"},
    ),
    "jaw build": Alias("build jaw"),
    "jaw show": Alias("show", finish=_page),
    "jaw run": Alias("simulate", moved=True, settings=_OF_JAW),
    "jaw tasks": Alias("tabulate", settings={"--series": "series", "--step": "step"}),
    "jaw record": Alias("record"),
    "jaw activate": Alias("activate", finish=_jaw),
    "jaw score": Alias("score"),
    "tongue import": Alias("import tongue", settings={"--forces": "forces", "--rest": "rest"}),
    "tongue build": Alias("build tongue"),
    "tongue simulate": Alias("simulate", moved=True, settings=_OF_TONGUE),
    "tongue show": Alias("show", finish=_page),
    "tongue muscles": Alias(
        "tabulate", settings={"--variant": "variant", "--level": "level", "--step": "step"}
    ),
    "head build": Alias("build head"),
    "head import": Alias(
        "import head",
        settings={"--parts": "parts", "--contact": "contacts", "--floor": "floor"},
        finish=_contacts,
    ),
    "head run": Alias("simulate", moved=True, settings=_OF_HEAD),
    "head simulate": Alias("simulate", moved=True, settings=_OF_HEAD),
    "head follow": Alias("simulate", moved=True),
    "head sweep": Alias("sweep"),
    "head show": Alias("show", finish=_page),
    "data check": Alias("check"),
    "data map": Alias("map"),
    "data describe": Alias("describe"),
    "data inventory": Alias("inventory"),
    "data features": Alias("features"),
    "data convert": Alias("convert"),
    "data cut": Alias("cut"),
    "data schema": Alias("schema"),
    "inverse run": Alias("invert run"),
    "inverse calibrate": Alias("invert calibrate"),
}
"""Former commands and what replaced them."""

_FORMER: Final = {
    old: Former(f"'emgface {old}'", f"'emgface {alias.new}'", SINCE, REMOVAL)
    for old, alias in ALIASES.items()
}


def translated(words: Words) -> tuple[Words, str]:
    """Words of a command line in the present form, and a sentence if they were in a former one."""
    for length in (3, 2):
        old = " ".join(words[:length])
        if old in ALIASES:
            return ALIASES[old].words(words[length:]), f"{_FORMER[old].text}."
    return words, ""


def table() -> str:
    """Former and present commands as a Markdown table, for the documentation."""
    rows = [f"| `emgface {old}` | `emgface {alias.new}` |" for old, alias in ALIASES.items()]
    return "\n".join(["| former command | command |", "| --- | --- |", *rows]) + "\n"
