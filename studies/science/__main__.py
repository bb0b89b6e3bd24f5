"""Generate the page docs/science: simulated volunteers, their studies, figures and text.

    python -m studies.science [--out docs/science] [--store FOLDER] [--volunteers 6] [--workers 2]
                              [--instructions ABCDEF] [--accuracy draft] [--finished] [--ends]

Stored results are not computed again. With --finished, the cube of a finished study is used
irrespective of the code that computed it; with --ends, only the first and the last world of the
series are computed.
"""

import argparse
import time
from pathlib import Path

from emgface.files import replace_file
from emgface.study.observer import Silent
from studies.science.setup import (
    REPETITIONS,
    RESOLUTION,
    SEED,
    WORLDS,
    Plan,
    plan,
    run_world,
)

HEAD = """# What a simulated study can and cannot show

    {command}

generates this page: {volunteers} simulated volunteers, instructions {instructions}, {repetitions}
repetitions, seed {seed}, faces of resolution {resolution}, accuracy "{accuracy}", no contact of the
lips. At accuracy "draft" the error of time stepping changes rho by less than 0.001
([accuracy](../accuracy.md)). **All recordings are
simulated.** The scores on this page do not estimate how well the method predicts the motion of people.
"""


class Told(Silent):
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
    parser.add_argument("--ends", action="store_true")
    given = parser.parse_args()
    plan.store, plan.volunteers, plan.workers = given.store, given.volunteers, given.workers
    plan.observer, plan.finished, plan.ends = Told(), given.finished, given.ends
    plan.instructions, plan.accuracy = tuple(given.instructions), given.accuracy
    studies = {world: run_world(world) for world in WORLDS}
    given.out.mkdir(parents=True, exist_ok=True)
    head = HEAD.format(
        command=_command(given),
        volunteers=given.volunteers,
        instructions=" ".join(given.instructions),
        repetitions=REPETITIONS,
        seed=SEED,
        resolution=RESOLUTION,
        accuracy=given.accuracy,
    )
    from studies.science.sections import SECTIONS

    text = "\n".join([head, *(make(studies, given.out) for make in SECTIONS)])
    replace_file(given.out / "README.md", lambda path: path.write_text(text, encoding="utf-8"))
    print(f"wrote {given.out / 'README.md'}")


def _command(given: argparse.Namespace) -> str:
    """Command line with the options that affect the numbers."""
    default = Plan()
    usual = {
        "volunteers": default.volunteers,
        "instructions": "".join(default.instructions),
        "accuracy": default.accuracy,
    }
    told = [
        f"--{key} {getattr(given, key)}" for key, v in usual.items() if getattr(given, key) != v
    ]
    told += ["--ends"] if given.ends else []
    return " ".join(["python -m studies.science", *told])


if __name__ == "__main__":
    main()
