"""Sentences and tables of the science page, compared with the tables that its command stored."""

from pathlib import Path

import pandas as pd
import pytest

from analysis.tables import Column, Table
from benchmarks.report import markdown
from emgface.face.simulation_parameters import SimulationParameters
from studies.science import (
    controls,
    excursions,
    inference,
    inverse,
    normalisation,
    strength,
    worlds,
)
from studies.science.spent import cost
from studies.science.subset import mean_text
from tests.sentences import choices_of, conclusions_of, meanings, words

DOCS = Path(__file__).parents[2] / "docs"
FOLDER = DOCS / "science"


@pytest.fixture(scope="module")
def page() -> str:
    return words((FOLDER / "README.md").read_text(encoding="utf-8"))


def contained(page: str, text: str) -> None:
    """Every line of a text is part of the page."""
    lines = [words(line) for line in text.splitlines() if line.strip()]
    assert lines
    assert [line for line in lines if line not in page] == []


def test_sentences_on_the_controls_follow_from_their_tables(page: str) -> None:
    skill, gain = (pd.read_csv(FOLDER / f"controls_{name}.csv") for name in ("skill", "gain"))
    contained(page, controls.text(skill, gain))
    free = skill[skill["prediction"] == controls.NOTHING].set_index("volunteers")["contains 0"]
    assert free.index.tolist() == [5, 6, 12] and (free >= 0.925).all()
    said = words((DOCS / "statistics.md").read_text(encoding="utf-8"))
    low, high = (f"{100 * share:.0f}" for share in (free.min(), free.max()))
    assert f"contains 0 in {low} to {high} % of the studies" in said
    five, six, twelve = skill[skill["prediction"] == controls.FINITE]["mean"]
    assert f"skill of {five:.2f} with five, {six:.2f} with six and {twelve:.2f} with twelve" in said


def test_sentences_on_worlds_follow_from_their_table(page: str) -> None:
    table = pd.read_csv(FOLDER / "worlds.csv")
    levels = worlds.per_volunteer(table, "median rho")
    shift = worlds.per_volunteer(table, "median shift [s]")["act_3"].median(axis=1)
    contained(page, worlds.reading(levels, shift))
    contained(page, markdown(worlds.effects(levels).reset_index()))


def test_sentences_on_the_normalisation_follow_from_their_tables(page: str) -> None:
    table = pd.read_csv(FOLDER / "normalisation.csv")
    silent = pd.read_csv(FOLDER / "silent_muscles.csv")
    keys = normalisation.KEYS
    rho = table.pivot_table(index=keys, columns="volunteer", values="median rho", sort=False)
    peak = silent.groupby(keys)["peak"].median()
    contained(page, markdown(normalisation._table(rho, peak), ".2f"))
    contained(page, normalisation._reading(rho, peak))


def test_sentences_on_the_stress_follow_from_their_tables(page: str) -> None:
    table = pd.read_csv(FOLDER / "strength.csv")
    moved = pd.read_csv(FOLDER / "excursions.csv")
    contained(page, markdown(strength._table(table), ".2f"))
    contained(page, strength._reading(table, moved))
    contained(page, markdown(excursions.compared(moved)))


def test_sentences_on_the_inverse_follow_from_their_tables(page: str) -> None:
    table, power, differences, gains, fits = (
        pd.read_csv(FOLDER / f"inverse{part}.csv")
        for part in ("", "_controls", "_differences", "_gains", "_fits")
    )
    contained(page, inverse.text(table, (power, differences), gains, fits))
    verdict = words(inverse.verdict(table))
    assert verdict in words((DOCS / "inverse" / "README.md").read_text(encoding="utf-8"))


@pytest.mark.parametrize("world", ["matched", "mismatched"])
def test_sentences_on_the_baselines_follow_from_their_table(page: str, world: str) -> None:
    section = page.partition(f"### {world.capitalize()} world")[2]
    contained(section, "\n".join(meanings(FOLDER / f"baselines_{world}.csv")))


@pytest.mark.parametrize("world", ["matched", "mismatched"])
def test_conclusions_follow_from_the_table_of_tests(page: str, world: str) -> None:
    section = page.partition(f"Conclusions for the {world} world")[2]
    contained(section, "\n".join(conclusions_of(FOLDER / f"tests_{world}.csv")))


def test_sentences_on_claims_follow_from_their_table(page: str) -> None:
    table = pd.read_csv(FOLDER / "inference.csv").drop(columns="origin")
    rows = tuple(tuple(row) for row in table.itertuples(index=False))
    contained(
        page, inference.claims_sentences(Table("", tuple(map(Column, table)), rows, "simulated"))
    )


def test_sentences_on_the_choices_follow_from_their_table(page: str) -> None:
    said = "\n".join(choices_of(DOCS / "choices" / "conclusions.csv"))
    contained(page, said)
    contained(words((DOCS / "choices" / "sentences.md").read_text(encoding="utf-8")), said)


def test_a_conclusion_that_contradicts_its_table_is_found(page: str, tmp_path: Path) -> None:
    """The tests of sentences can fail: every table with one changed number contradicts the page."""
    changes = ((DOCS / "choices" / "conclusions.csv", "median rho", choices_of),)
    for path, column, rebuilt in changes:
        table = pd.read_csv(path)
        table[column] = 1.0 - table[column]
        table.to_csv(tmp_path / path.name, index=False)
        with pytest.raises(AssertionError):
            contained(page, "\n".join(rebuilt(tmp_path / path.name)))


def test_the_run_time_follows_from_its_table(page: str) -> None:
    contained(page, cost(pd.read_csv(FOLDER / "cost.csv", index_col="part")))


def test_a_run_time_above_the_limit_is_reported_as_such() -> None:
    spent = pd.DataFrame(
        {"wall": [1200.0, 900.0], "own": [60.0, 0.0], "workers": [1680.0, 1200.0]}, ["a", "b"]
    )
    assert "takes 25 minutes" in cost(spent) and "30 minutes is met" in cost(spent)
    assert "30 minutes is not met" in cost(spent * 1.5)


def test_other_numbers_than_those_of_the_table_are_found(page: str) -> None:
    """The test can fail: one changed value of one volunteer contradicts the page."""
    table = pd.read_csv(FOLDER / "strength.csv")
    table.loc[0, "amplitude ratio"] += 0.1
    with pytest.raises(AssertionError):
        contained(page, markdown(strength._table(table), ".2f"))


def test_pages_state_the_default_stress() -> None:
    default = f"{SimulationParameters().sigma_max / 1e3:.0f} kPa"
    for name, sentence in {
        "own_data.md": f'`"published"`, the default, is {default}',
        "real_recording.md": f"`sigma_max` is {default}, the start of the published study and the "
        "default",
        "inverse/README.md": f"relative to `simulation.sigma_max` ({default} by default)",
        "science/README.md": f"**The default remains the published start of {default}.**",
    }.items():
        assert sentence in words((DOCS / name).read_text(encoding="utf-8")), name


def test_mean_text_gives_the_numbers_of_a_table() -> None:
    assert mean_text([1.0, 1.0, 1.0, 1.0, 1.0]) == "1.00 (1.00 to 1.00)"
