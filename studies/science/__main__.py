"""Generate the page docs/science: simulated volunteers, their studies, figures and text.

    python -m studies.science [--out docs/science] [--store FOLDER] [--volunteers 6] [--workers 2]
                              [--instructions ABDE] [--accuracy draft] [--finished]
                              [--only SECTION ...]

With --only, the named sections are printed, their tables and figures are written, and they replace
those of the page, if there is one. Stored results are not computed again. With --finished, the cube of
a finished study is used irrespective of the code that computed it.
"""

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from emgface.files import replace_file
from emgface.run.observer import Silent
from emgface.run.runner import kept_processes
from studies.science.sections import NEED_STUDIES, SECTIONS
from studies.science.setup import (
    REPETITIONS,
    RESOLUTION,
    SEED,
    STEP,
    WORLDS,
    Plan,
    plan,
    run_world,
)
from studies.science.spent import cost, measured, timed
from studies.science.subset import subset

HEAD = """# What a simulated study can and cannot show

    {command}

This command generates the page. The studies use {volunteers} simulated volunteers with the
instructions {instructions}, {repetitions} repetitions, seed {seed}, faces with the resolution
"{resolution}", accuracy "{accuracy}" and no contact of the lips; the face of the study is simulated
with steps of at most {step:.0f} ms. **All recordings are simulated.** The scores on this page do not
show how well the method predicts the motion of people.

The design is small, so that all parts together take at most half an hour on two cores. Where a
difference is not shown, the smallest one that is detected with a power of 0.8 is stated.
"""
BASELINES = "rho, template, ceiling, wrong instruction, shuffled EMG and skill, {} world"
FIGURES = (
    ("controls.png", "motions", "skill without EMG, and gain by own EMG that is known"),
    ("worlds.png", "subset", "rho with persons and recordings matched and mismatched"),
    ("baselines_matched.svg", "all", BASELINES.format("matched")),
    ("baselines_mismatched.svg", "all", BASELINES.format("mismatched")),
    ("normalisation.png", "subset", "rho and silent muscles with Eq. 8 per trial and per session"),
    ("strength.png", "subset", "amplitude ratio, rho and lowered trials over sigma_max"),
    ("excursions.png", "faces", "excursions of the lips per instruction, and those of persons"),
    ("inference.svg", "drawn", "size and coverage of claims about instructions in general"),
    ("contrasts.svg", "all", "differences of the strategies, these instructions and in general"),
    ("inverse.png", "inverted", "activations from motion, nulls, and deviations of persons"),
)
"""Figures of the page, the trials on which each is based, and their contents."""


class PrintedProgress(Silent):
    """Print the progress of the run."""

    def __init__(self) -> None:
        self._started, self._done, self._total = time.monotonic(), 0, 0

    def begin(self, total: int) -> None:
        """Set the number of trials."""
        self._done, self._total = 0, total

    def message(self, text: str) -> None:
        """Print a sentence."""
        print(text, flush=True)

    def finished(self, label: str, status: str) -> None:
        """Print the state of the run for every tenth trial and every failure."""
        self._done += 1
        if self._done % 10 == 0 or self._done == self._total or status != "ok":
            spent = time.monotonic() - self._started
            print(f"[{spent:6.0f} s] {self._done}/{self._total} {label}: {status}", flush=True)


def main() -> None:
    """Simulate the volunteers, run their studies and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("docs/science"))
    parser.add_argument("--store", type=Path, default=plan.store)
    parser.add_argument("--volunteers", type=int, default=plan.volunteers)
    parser.add_argument("--instructions", default="".join(plan.instructions))
    parser.add_argument("--accuracy", default=plan.accuracy)
    parser.add_argument("--workers", type=int, default=plan.workers)
    parser.add_argument("--finished", action="store_true")
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), default=())
    given = parser.parse_args()
    plan.store, plan.volunteers, plan.workers = given.store, given.volunteers, given.workers
    plan.observer, plan.finished = PrintedProgress(), given.finished
    plan.instructions, plan.accuracy = tuple(given.instructions), given.accuracy
    given.out.mkdir(parents=True, exist_ok=True)
    studies: dict[str, Path] = {}
    made: list[str] = []
    for world in WORLDS if not given.only or {*given.only} & NEED_STUDIES else ():
        with kept_processes(plan.workers), timed(f"{world} world"):
            studies[world] = run_world(world)
    for name, make in SECTIONS.items():
        if given.only and name not in given.only:
            continue
        with kept_processes(plan.workers), timed(f"section {name}"):
            made.append(make(studies, given.out))
    page = given.out / "README.md"
    if given.only:
        print("\n".join(made))
        if page.is_file():
            text = replaced(page.read_text(encoding="utf-8"), [*made, cost(measured(given.out))])
            replace_file(page, lambda path: path.write_text(text, encoding="utf-8"))
        return
    head = HEAD.format(
        command=_command(given),
        volunteers=given.volunteers,
        instructions=" ".join(given.instructions),
        repetitions=REPETITIONS,
        seed=SEED,
        resolution=RESOLUTION,
        accuracy=given.accuracy,
        step=1e3 * STEP,
    )
    text = "\n".join([head, _figures(), *made, cost(measured(given.out))])
    replace_file(page, lambda path: path.write_text(text, encoding="utf-8"))
    print(f"wrote {page}")


def replaced(page: str, sections: Sequence[str]) -> str:
    """Page with sections in place of those with the same heading, new ones before the last section."""
    head, *blocks = page.split("\n## ")
    titles = [block.partition("\n")[0] for block in blocks]
    for section in sections:
        block = section.removeprefix("## ").rstrip("\n") + "\n"
        title = block.partition("\n")[0]
        if title in titles:
            blocks[titles.index(title)] = block
        else:
            blocks.insert(len(blocks) - 1, block)
            titles.insert(len(titles) - 1, title)
    return "\n## ".join([head, *blocks])


def _figures() -> str:
    """Table of the figures and of the trials on which they are based."""
    every = f"{plan.volunteers} volunteers, {', '.join(plan.instructions)}"
    basis = {
        "all": f"{every}, {REPETITIONS} repetitions",
        "subset": f"{plan.volunteers} volunteers, {', '.join(subset())}, 1 repetition",
        "motions": "motions drawn at random",
        "drawn": "scores drawn at random",
        "faces": "no volunteers: fully activated muscles",
        "inverted": f"{plan.volunteers} volunteers, A, D, 1 repetition",
    }
    rows = [f"| [{name}]({name}) | {basis[trials]} | {shows} |" for name, trials, shows in FIGURES]
    return "\n".join(["| figure | trials (simulated) | shows |", "|---|---|---|", *rows, ""])


def _command(given: argparse.Namespace) -> str:
    """Command line with the options that affect the numbers."""
    default = Plan()
    usual = {
        "volunteers": default.volunteers,
        "instructions": "".join(default.instructions),
        "accuracy": default.accuracy,
    }
    words = [
        f"--{key} {getattr(given, key)}" for key, v in usual.items() if getattr(given, key) != v
    ]
    return " ".join(["python -m studies.science", *words])


if __name__ == "__main__":
    main()
