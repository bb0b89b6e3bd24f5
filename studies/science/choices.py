"""Conclusions of a study, and changes of rho and amplitude, under the open choices.

    python -m studies.science --only choices --out docs/science

Simulated volunteers are scored with all strategies and one choice at a time off its default: sigma_max,
threshold of the feature, and range of the normalisation. Trials with flagged alignments are left out at
the defaults. Tables and figures are written to the folder `choices` next to the page.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from analysis.figures import save, sensitivity_plot
from analysis.robustness import robustness, robustness_sentences, robustness_table
from analysis.sensitivity import choices_table, sensitivity
from analysis.tables import Table
from studies.science.setup import SIGMA_MAX, finished_study, opened, plan
from studies.science.subset import mismatched_people, subset_study

INSTRUCTIONS: Final = ("A", "D")
"""Instructions of the section; with a third one, it would take half as long again."""
AXES: Final[tuple[dict[str, Any], ...]] = (
    {"parameters": ["simulation.sigma_max"], "levels": [300e3, 100e3]},
    {
        "name": "wamp_threshold",
        "parameters": ["signals.feature.threshold"],
        "levels": [10e-6, 20e-6],
    },
    {
        "name": "normalisation_reach",
        "parameters": ["signals.normalisation.reach"],
        "levels": ["trial", "session"],
    },
)
VARIABLES: Final = ("rho", "amplitude_ratio")


def make(studies: Mapping[str, Path], out: Path) -> str:
    """Run the study of all choices, write its tables and figures, and describe them."""
    study = subset_study(
        mismatched_people(plan.store / "choices"),
        "choices",
        recordings={"instructions": INSTRUCTIONS},
        axis=list(AXES),
        simulation={"sigma_max_policy": {"scope": "trial"}},
    )
    cube = opened(finished_study(study, plan.store / "choices"))
    folder = out.parent / "choices"
    folder.mkdir(parents=True, exist_ok=True)
    for variable in VARIABLES:
        effects = sensitivity(cube, variable=variable)
        _write(choices_table(effects), folder / variable)
        save(sensitivity_plot(effects), folder / f"{variable}.svg")
    conclusions = robustness(cube)
    _write(robustness_table(conclusions), folder / "conclusions")
    sentences = "\n".join(f"* {one}" for one in robustness_sentences(conclusions)) + "\n"
    (folder / "sentences.md").write_text(sentences, encoding="utf-8")
    return "\n".join(
        [
            "## Conclusions under the open choices",
            "",
            f"Volunteers of the mismatched world ({cube.sizes['volunteer']}, instructions "
            f"{', '.join(cube['instruction'].values.tolist())}, first repetition), with one choice at a "
            "time off its default (simulated; [tables](../choices/conclusions.csv)).",
            "",
            sentences,
            "![Change of rho with every choice (simulated)](../choices/rho.svg)",
            "",
            "Only one choice at a time differs from its default; effects of two together, and of "
            "levels that are not in the table, are not examined. Volunteers that were drawn with "
            f"about {SIGMA_MAX / 1e3:.0f} kPa cannot show which stress is that of persons.",
            "",
        ]
    )


def _write(table: Table, path: Path) -> None:
    path.with_suffix(".csv").write_text(table.csv(), encoding="utf-8")
    path.with_suffix(".md").write_text(table.markdown(), encoding="utf-8")
