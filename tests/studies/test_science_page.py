"""Sentences and tables of the science page, compared with the tables that its command stored."""

from pathlib import Path

import pandas as pd
import pytest

from benchmarks.report import markdown
from emgface.face.simulation_parameters import SimulationParameters
from studies.science import excursions, normalisation, strength, worlds
from studies.science.subset import told

DOCS = Path(__file__).parents[2] / "docs"
FOLDER = DOCS / "science"


def words(text: str) -> str:
    """Text with single blanks, because pages are wrapped."""
    return " ".join(text.split())


@pytest.fixture(scope="module")
def page() -> str:
    return words((FOLDER / "README.md").read_text(encoding="utf-8"))


def contained(page: str, text: str) -> None:
    """Every line of a text is part of the page."""
    lines = [words(line) for line in text.splitlines() if line.strip()]
    assert lines
    assert [line for line in lines if line not in page] == []


def test_sentences_on_worlds_follow_from_their_table(page: str) -> None:
    found = pd.read_csv(FOLDER / "worlds.csv")
    levels = worlds.per_volunteer(found, "median rho")
    shift = worlds.per_volunteer(found, "median shift [s]")["act_3"].median(axis=1)
    contained(page, worlds.reading(levels, shift))
    contained(page, markdown(worlds.effects(levels).reset_index()))


def test_sentences_on_the_normalisation_follow_from_their_tables(page: str) -> None:
    found = pd.read_csv(FOLDER / "normalisation.csv")
    silent = pd.read_csv(FOLDER / "silent_muscles.csv")
    keys = normalisation.KEYS
    rho = found.pivot_table(index=keys, columns="volunteer", values="median rho", sort=False)
    peak = silent.groupby(keys)["peak"].median()
    contained(page, markdown(normalisation._table(rho, peak), ".2f"))
    contained(page, normalisation._reading(rho, peak))


def test_sentences_on_the_stress_follow_from_their_tables(page: str) -> None:
    found = pd.read_csv(FOLDER / "strength.csv")
    moved = pd.read_csv(FOLDER / "excursions.csv")
    contained(page, markdown(strength._table(found), ".2f"))
    contained(page, strength._reading(found, moved))
    contained(page, markdown(excursions.compared(moved)))


def test_other_numbers_than_those_of_the_table_are_found(page: str) -> None:
    """The test can fail: one changed value of one volunteer contradicts the page."""
    found = pd.read_csv(FOLDER / "strength.csv")
    found.loc[0, "amplitude ratio"] += 0.1
    with pytest.raises(AssertionError):
        contained(page, markdown(strength._table(found), ".2f"))


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


def test_told_gives_the_numbers_of_a_table() -> None:
    assert told([1.0, 1.0, 1.0, 1.0, 1.0]) == "1.00 (1.00 to 1.00)"
