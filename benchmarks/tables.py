"""Tables of the documentation, made by the commands that they name.

    python -m benchmarks tables            # fails where a figure differs from what its command prints
    python -m benchmarks tables --write    # makes the tables again

A table stands between two comments, the first with its command, which prints it in Markdown:

    <!-- table: python -m benchmarks locking --body cook -->
    | ... |
    <!-- end of table -->

`long table:` marks a command that takes minutes and runs with `--everything` only, `shared table:` one
that reads the third-party models besides, and is left out where these are absent.
"""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MARKED = re.compile(
    r"<!-- (?P<kind>|long |shared )table: (?P<command>[^\n]*?) -->\n(?P<table>.*?)<!-- end of table -->",
    re.DOTALL,
)


def unit(cell: str) -> float:
    """One unit of the last printed digit of a number."""
    mantissa, _, exponent = cell.lower().partition("e")
    decimals = len(mantissa.partition(".")[2])
    return 10.0 ** (int(exponent or 0) - decimals)


def differences(old: str, new: str) -> list[str]:
    """Say where two tables differ by more than one unit of the last digit that the old one prints."""
    before, after = (
        [
            [cell.strip() for cell in line.strip().strip("|").split("|")]
            for line in part.splitlines()
        ]
        for part in (old, new)
    )
    if [len(row) for row in before] != [len(row) for row in after]:
        return [f"{len(before)} lines in the page, {len(after)} by the command, or other columns"]
    found: list[str] = []
    for one, two in zip(before, after, strict=True):
        for a, b in zip(one, two, strict=True):
            if a == b:
                continue
            try:
                alike = abs(float(a) - float(b)) <= 1.01 * unit(a)
            except ValueError:
                alike = False
            if not alike:
                found.append(f"{a!r} in the page, {b!r} by the command, in the line of {one[0]!r}")
    return found


def shared_folder() -> Path | None:
    """Folder of third-party models, if there is one."""
    named = os.environ.get("EMGFACE_SHARED")
    folder = Path(named) if named else ROOT.parent / "shared"
    return folder if (folder / "artisynth_reference").is_dir() else None


def made_by(command: str) -> str:
    """Markdown lines that a command prints."""
    words = [sys.executable if w == "python" else w for w in shlex.split(command)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        words, cwd=ROOT, env=environment, check=True, text=True, stdout=subprocess.PIPE
    )
    return "".join(f"{line}\n" for line in done.stdout.splitlines() if line.startswith("|"))


def main(
    pages: list[Path] | None = None, write: bool = False, everything: bool = False, only: str = ""
) -> None:
    """Check the tables of pages, or make them again; `only` is a part of the commands that are run."""
    wrong = 0
    for page in pages or sorted(ROOT.glob("docs/**/*.md")):
        text = page.read_text(encoding="utf-8")
        for found in list(MARKED.finditer(text)):
            kind, command = found["kind"], found["command"]
            left_out = (kind and not everything) or only not in command
            if left_out or (kind == "shared " and shared_folder() is None):
                print(f"{page.name}: left out {command}")
                continue
            table = made_by(command)
            odd = differences(found["table"], table)
            wrong += bool(odd)
            print(f"{page.name}: {'differs' if odd else 'agrees'}: {command}")
            print("".join(f"    {line}\n" for line in odd), end="", flush=True)
            if write:
                text = text.replace(found[0], found[0].replace(found["table"], table))
        if write:
            page.write_text(text, encoding="utf-8")
    if wrong and not write:
        raise SystemExit(
            f"{wrong} tables differ from their commands: run with --write and explain why"
        )
