"""Sentences of a report that state a result, rebuilt from the tables that its command wrote."""

import re
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from analysis.axes import combine_cubes
from analysis.baselines import BASELINE_VARIABLES, with_baselines
from analysis.statistics.simulated import simulated_scores
from emgface.cli import app
from emgface.schema.netcdf import write_netcdf
from tests.sentences import choices_of, conclusions_of, meanings, words
from tests.study_run.test_report import text_of
from tests.study_run.test_report_contents import scores


def studied(seed: int, effect: float) -> xr.Dataset:
    """Scores of six volunteers in six instructions with baselines, drawn at random."""
    cube = scores_with(seed, effect)
    rng = np.random.default_rng(seed)
    levels = {
        "template_rho": 0.4, "repeat_rho": 0.9, "ceiling": 0.95, "others_rho": 0.3,
        "shuffled_rho": 0.5, "wrong_rho": 0.1, "wrong_rho_max": 0.3, "within_rho": 0.2,
    }  # fmt: skip
    made: dict[str, xr.DataArray] = {}
    for name, level in (levels | {"template_volunteers": 5.0}).items():
        dims = BASELINE_VARIABLES[name][0]
        size = [cube.sizes[dim] for dim in dims]
        drawn = np.full(size, level) + (name.endswith("rho") * 0.05) * rng.uniform(-1.0, 1.0, size)
        made[name] = xr.DataArray(drawn, dims=dims, coords={dim: cube[dim] for dim in dims})
    return with_baselines(cube, made)


def scores_with(seed: int, effect: float) -> xr.Dataset:
    drawn = simulated_scores(seed, instructions=6, effects=(0.0, 0.0, effect))
    return scores(instructions=6).assign(rho=drawn["rho"])


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a report on strategies under two levels of one choice."""
    folder = tmp_path_factory.mktemp("sentences")
    cube = combine_cubes(
        {(100e3,): studied(3, 0.5), (300e3,): studied(4, -0.5)}, {"stress": [100e3, 300e3]}
    )
    cube["stress"].attrs["units"] = "Pa"
    write_netcdf(cube, folder / "cube.nc", "cube")
    said = CliRunner().invoke(app, ["report", str(folder), "--out", str(folder / "report.html")])
    assert said.exit_code == 0, said.output
    (folder / "printed.txt").write_text(said.output, encoding="utf-8")
    return folder


REBUILT = {
    "tests": partial(conclusions_of, together=True),
    "baselines": meanings,
    "conclusions": choices_of,
}


def lacking(page: str, sentences: list[str]) -> list[str]:
    """Sentences that a page does not contain."""
    return [one for one in sentences if words(one) not in page]


@pytest.mark.parametrize("name", REBUILT)
def test_sentences_of_the_report_follow_from_its_tables(report: Path, name: str) -> None:
    page = text_of((report / "report.html").read_text(encoding="utf-8"))
    sentences = REBUILT[name](report / "tables" / f"{name}.csv")
    assert len(sentences) >= 3 and any(re.search(r"\d", one) for one in sentences)
    assert lacking(page, sentences) == []


@pytest.mark.parametrize(
    ("name", "column"),
    [("tests", "p joint"), ("baselines", "skill"), ("conclusions", "median rho")],
)
def test_a_report_that_contradicts_its_table_is_found(
    report: Path, tmp_path: Path, name: str, column: str
) -> None:
    page = text_of((report / "report.html").read_text(encoding="utf-8"))
    table = pd.read_csv(report / "tables" / f"{name}.csv")
    table[column] = 1.0 - table[column]
    table.to_csv(tmp_path / "changed.csv", index=False)
    assert lacking(page, REBUILT[name](tmp_path / "changed.csv"))


def test_medians_of_the_summary_are_those_of_the_table(report: Path) -> None:
    page = text_of((report / "report.html").read_text(encoding="utf-8"))
    table = pd.read_csv(report / "tables" / "strategy.csv").set_index("strategy")
    shown = dict(re.findall(r"median rho, (\w+) (-?\d\.\d\d) n = \d+ correlations", page))
    assert shown == {name: f"{value:.2f}" for name, value in table["median"].items()}
