"""Run the seven experiments on a generated head and write `docs/coupled`.

python -m studies.coupled --part closing    one experiment, continued where it was interrupted
python -m studies.coupled --page            the page only, from the stored tables
"""

from pathlib import Path
from typing import Annotated, Final

import pandas as pd
import typer

from analysis.figures.style import save
from benchmarks.report import markdown, say, shrink
from emgface.anatomy.head.sweep import MESH_ERROR, STEP_ERROR, sweep
from emgface.run.observer import Silent
from studies.coupled.experiments import EXPERIMENTS as PUBLISHED
from studies.coupled.explained import EXPLAINED, EXPLANATIONS
from studies.coupled.figure import outcome_figure
from studies.coupled.findings import FINDINGS, VERDICTS, Results

EXPERIMENTS: Final = {**PUBLISHED, **EXPLAINED}
TESTS: Final = {**FINDINGS, **EXPLANATIONS}
HERE: Final = Path(__file__).resolve().parents[2] / "docs" / "coupled"
TEMPLATE: Final = Path(__file__).with_name("page.md")
"""Text of the page, with a place for each experiment and its results."""


class Said(Silent):
    """Observer that prints every completed run."""

    def finished(self, label: str, status: str) -> None:
        """Print the status of a run."""
        say(f"{label}: {status}")


def run(name: str, folder: Path) -> None:
    """Sweep of an experiment, and its figure."""
    one = EXPERIMENTS[name]
    table = sweep(
        one.runs,
        one.setting,
        table=folder / f"{name}.csv",
        folder=Path("results", "coupled", name),
        measure=one.measure,
        observer=Said(),
    )
    figure = outcome_figure(table[table["end"] == "reached"], one.drawn, one.title)
    shrink(save(figure, folder / f"{name}.png"))


def section(name: str, folder: Path) -> dict[str, str]:
    """Heading, statements with figure and table of an experiment, by their names in the template."""
    one, table = EXPERIMENTS[name], pd.read_csv(folder / f"{name}.csv")
    rows = pd.DataFrame(
        [
            {"published": f.statement, "found": f.computed, "": VERDICTS[f.holds]}
            for f in TESTS[name](Results(table))
        ]
    )
    shown = pd.DataFrame({"run": table["name"]})
    for outcome in one.shown:
        shown[outcome.replace("_", " ")] = [_cell(row, outcome) for _, row in table.iterrows()]
    return {
        f"{{{name}}}": f"## {one.title}",
        f"{{{name} results}}": "\n\n".join(
            [markdown(rows), f"![{one.title}, simulated]({name}.png)", markdown(shown)]
        ),
    }


def _cell(row: pd.Series, outcome: str) -> str:
    """Value with step and mesh error, or the reason of a failure."""
    if row["end"] != "reached":
        return str(row["end"]).partition(":")[0]
    errors = [row.get(outcome + ending) for ending in (STEP_ERROR, MESH_ERROR)]
    known = [f"{float(e):.2f}" for e in errors if e is not None and not pd.isna(e)]
    return f"{row[outcome]:.2f}" + "".join(f" ± {error}" for error in known)


def page(folder: Path = HERE) -> str:
    """Text of the page: the template with the tables that are stored in a folder."""
    text = TEMPLATE.read_text(encoding="utf-8")
    for name in EXPERIMENTS:
        if (folder / f"{name}.csv").exists():
            for place, filled in section(name, folder).items():
                text = text.replace(place, filled)
    return text


def main(
    part: Annotated[str, typer.Option(help=", ".join(EXPERIMENTS))] = "",
    out: Path = HERE,
    page_only: Annotated[bool, typer.Option("--page")] = False,
) -> None:
    """Compute the experiments and write the page."""
    if part and part not in EXPERIMENTS:
        raise SystemExit(f"no experiment {part!r}, expected one of {', '.join(EXPERIMENTS)}")
    out.mkdir(parents=True, exist_ok=True)
    if not page_only:
        for name in [part] if part else EXPERIMENTS:
            run(name, out)
    (out / "README.md").write_text(page(out), encoding="utf-8")


if __name__ == "__main__":
    typer.run(main)
