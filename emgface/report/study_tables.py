"""Output of the tables of a study."""

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from analysis.alignment_tables import alignment_tables
from analysis.axes import further_axes, reference_cube
from analysis.baseline_tables import comparison
from analysis.errors import AnalysisError
from analysis.listing import trials
from analysis.robustness import levels_of, robustness, robustness_sentences, robustness_table
from analysis.sensitivity import choices_table, sensitivity
from analysis.statistics.summary import statistics_table, study_statistics
from analysis.tables import Table, report_tables
from emgface.characters import visible
from emgface.report.provenance import repeated
from emgface.run.store import store_text
from emgface.signals.montage import COMPLETE


@dataclass(frozen=True)
class Report:
    """Tables of a cube and their folder."""

    #: result of `analysis.tables.report_tables`, with further tables of the study
    tables: dict[str, Table]
    summary: str  #: table of rho per strategy
    #: muscles that were not recorded, and the interpretation of rho by the baselines; may be empty
    meaning: list[str]
    #: one sentence per reason for a missing score, or one that depends on rounding
    failures: list[str]
    folder: Path  #: folder of the CSV, Markdown and LaTeX files
    compared: tuple[list[str], dict[str, Table]]  #: result of `analysis.baseline_tables.comparison`
    #: result of `study_statistics`, if the study allows tests
    statistics: dict[str, xr.Dataset] | None
    #: conclusions under other choices, sentences and table, if anything varies
    other_choices: tuple[list[str], Table] | None


def write_tables(cube: xr.Dataset, out: Path) -> Report:
    """Write the tables of a cube as CSV, Markdown and LaTeX to the folder ``out/tables``.

    If choices were varied, the tables show their reference, and additional tables list the effect of
    each choice, and the conclusions under each choice and without flagged alignments. Raises
    StoreError if the folder cannot be written.
    """
    base, folder = reference_cube(cube), out / "tables"
    compared, statistics, other_choices = comparison(base), None, None
    meaning = [*repeated(base), *compared[0]]
    tables = report_tables(base) | alignment_tables(base) | compared[1]
    if base.sizes["volunteer"] > 1 and base.sizes["strategy"] > 1:
        with suppress(AnalysisError):  # too few scores for any test
            statistics = study_statistics(base)
            tables["tests"] = statistics_table(statistics)
    if further_axes(cube):
        with suppress(AnalysisError):
            tables["choices"] = choices_table(sensitivity(cube))
    if np.isfinite(base["rho"].values).any() and len(levels_of(cube)) > 1:
        with suppress(AnalysisError):
            result = robustness(cube)
            other_choices = robustness_sentences(result), robustness_table(result)
            tables["conclusions"] = other_choices[1]
    for name, table in tables.items():
        store_text(folder / f"{name}.csv", table.csv())
        store_text(folder / f"{name}.md", visible(table.markdown()))
        store_text(folder / f"{name}.tex", visible(table.latex()))
    montage = str(base.attrs.get("montage", COMPLETE.sentence))
    if montage != COMPLETE.sentence:
        meaning = [f"The montage is incomplete: {montage}.", *meaning]
    return Report(
        tables,
        tables["strategy"].text(),
        meaning,
        _failures(base),
        folder,
        compared,
        statistics,
        other_choices,
    )


def _failures(cube: xr.Dataset) -> list[str]:
    listed = trials(cube)
    bad = listed[(listed["status"] != "ok") | (listed["reason"] != "")]
    sentences: list[str] = []
    for (status, reason), group in bad.groupby(["status", "reason"], sort=False):
        first = group.iloc[0]
        label = " ".join(str(first[d]) for d in ("volunteer", "instruction", "repetition"))
        count = "1 trial" if len(group) == 1 else f"{len(group)} trials"
        sentences.append(
            f"{count} ({label}, ...) {status}: {reason}"
            if len(group) > 1
            else f"{count} ({label} {first['strategy']}) {status}: {reason}"
        )
    return sentences
