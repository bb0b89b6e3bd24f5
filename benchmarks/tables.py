"""Tables of the documentation, made by the commands that they name.

    python benchmarks/tables.py --check    # fails where a figure differs from what its command prints
    python benchmarks/tables.py --write    # makes the tables again

A table stands between two comments, the first with its command, which prints it in Markdown:

    <!-- table: python benchmarks/locking.py --body cook -->
    | ... |
    <!-- end of table -->

`long table:` tells that the command takes minutes and runs with `--all`, `shared table:` that it reads
the third-party models besides, and is left out where these are absent.
"""

import argparse
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


def main() -> None:
    """Check or make the tables of pages."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    task = parser.add_mutually_exclusive_group(required=True)
    task.add_argument("--check", action="store_true")
    task.add_argument("--write", action="store_true")
    parser.add_argument("--all", action="store_true", help="Also what takes minutes.")
    parser.add_argument("--only", default="", help="A part of the commands that are run.")
    parser.add_argument("pages", nargs="*", type=Path, default=sorted(ROOT.glob("docs/*.md")))
    options = parser.parse_args()
    wrong = 0
    for page in options.pages:
        text = page.read_text(encoding="utf-8")
        for found in list(MARKED.finditer(text)):
            kind, command = found["kind"], found["command"]
            left_out = (kind and not options.all) or options.only not in command
            if left_out or (kind == "shared " and shared_folder() is None):
                print(f"{page.name}: left out {command}")
                continue
            table = made_by(command)
            odd = differences(found["table"], table)
            wrong += bool(odd)
            print(f"{page.name}: {'differs' if odd else 'agrees'}: {command}")
            print("".join(f"    {line}\n" for line in odd), end="", flush=True)
            if options.write:
                text = text.replace(found[0], found[0].replace(found["table"], table))
        if options.write:
            page.write_text(text, encoding="utf-8")
    if wrong and options.check:
        raise SystemExit(
            f"{wrong} tables differ from their commands: run with --write and explain why"
        )


if __name__ == "__main__":
    main()
