"""Tables of the page on choices, compared with the full precision that its command stored."""

from pathlib import Path

import pandas as pd
import pytest

FOLDER = Path(__file__).parents[2] / "docs" / "choices"


def cells(line: str) -> list[str]:
    return [cell.strip() for cell in line.strip().strip("|").split("|")]


def disagreements(shown: str, stored: pd.DataFrame) -> list[str]:
    """Cells of a Markdown table that are not the stored value, rounded to the digits shown."""
    lines = [cells(line) for line in shown.splitlines() if line.startswith("|")]
    rows = lines[2:]
    table = stored.drop(columns="origin")
    if len(rows) != len(table) or {len(row) for row in rows} != {table.shape[1]}:
        return [f"{len(rows)} rows, expected {len(table)}"]
    wrong: list[str] = []
    for row, (_, values) in zip(rows, table.iterrows(), strict=True):
        for cell, value in zip(row, values, strict=True):
            try:
                number = float(cell)
            except ValueError:
                same = cell == str(value) or (cell in ("-", "") and str(value) in ("nan", "-"))
            else:
                digits = len(cell.partition(".")[2])
                same = abs(number - float(value)) <= 0.5 * 10.0**-digits * (1 + 1e-6)
            if not same:
                wrong.append(f"{cell} is shown for {value}")
    return wrong


@pytest.mark.parametrize("name", ["conclusions", "rho", "amplitude_ratio"])
def test_tables_show_the_stored_values(name: str) -> None:
    shown = (FOLDER / f"{name}.md").read_text(encoding="utf-8")
    stored = pd.read_csv(FOLDER / f"{name}.csv", dtype={"level": str})
    assert disagreements(shown, stored) == []
    stored.iloc[0, -2] = float(stored.iloc[0, -2]) + 1.0
    assert disagreements(shown, stored)
