"""Tables agree with the descriptives in every format and state the origin of the data."""

import csv
import io

import numpy as np
import pytest
from synthetic_cubes import cube

from analysis.descriptives import descriptives
from analysis.tables import Column, Table, descriptive_table, report_tables, trial_table


def test_strategy_table_holds_the_descriptives() -> None:
    table, described = descriptive_table(cube()), descriptives(cube())
    assert [row[0] for row in table.rows] == ["act_all", "act_3", "act_rel"]
    for row in table.rows:
        group = described.sel(strategy=row[0])
        assert row[1:4] == tuple(
            float(group[name]) for name in ("median", "mean", "standard_deviation")
        )
    assert table.rows[0][4:] == (14, 1, 3, 0, 0)
    assert table.rows[2][4:] == (21, 0, 0, 0, 1)


def test_groups_of_two_dims_are_in_order() -> None:
    table = descriptive_table(cube(), by=("marker", "strategy"))
    assert len(table.rows) == 9
    assert [row[:2] for row in table.rows[:2]] == [("corner_left", "act_all"),
                                                   ("corner_left", "act_3")]  # fmt: skip
    assert table.rows[0][-3:] == (3, 0, 0)


def test_all_trials_are_listed() -> None:
    table = trial_table(cube())
    assert len(table.rows) == 24
    statuses = [row[4] for row in table.rows]
    assert statuses.count("failed:Inverted") == 3
    assert statuses.count("missing") == 2
    assert "no result was passed" in table.text()


def test_every_table_is_labelled_simulated() -> None:
    tables = report_tables(cube())
    assert set(tables) == {"strategy", "strategy_amplitude_ratio", "strategy_rmse", "instruction",
                           "volunteer", "marker", "trials"}  # fmt: skip
    for table in tables.values():
        assert "simulated recordings" in table.text().splitlines()[0]
        assert "simulated recordings" in table.markdown().splitlines()[0]
        assert all(line.startswith("simulated,") for line in table.csv().splitlines()[1:])


def test_measured_tables_are_not_labelled_simulated() -> None:
    data = cube().assign_attrs(origin="measured")
    assert "measured recordings" in descriptive_table(data).text()
    assert "simulated" not in descriptive_table(data).text()


def test_text_is_aligned_and_in_readable_units() -> None:
    table = Table(
        "distance",
        (Column("name"), Column("rmse", "m", "mm", 1e3, 2), Column("n")),
        (("corner", 0.0012345, 10), ("upper", float("nan"), 2)),
        "measured",
    )
    assert table.text().splitlines() == [
        "distance",
        "",
        "name    rmse [mm]   n",
        "------  ---------  --",
        "corner       1.23  10",
        "upper           -   2",
    ]


def test_csv_is_exact_and_si() -> None:
    table = descriptive_table(cube(), variable="rmse")
    rows = list(csv.DictReader(io.StringIO(table.csv())))
    described = descriptives(cube(), variable="rmse")
    for row in rows:
        assert float(row["median [m]"]) == float(described["median"].sel(strategy=row["strategy"]))
    empty = list(csv.DictReader(io.StringIO(trial_table(cube()).csv())))
    assert {row["median_rho"] for row in empty if row["status"] != "ok"} == {""}


def test_markdown_keeps_its_columns() -> None:
    table = Table("t", (Column("a"), Column("b")), (("x|y", 1),), "measured", "a note")
    lines = table.markdown().splitlines()
    assert lines[2:5] == ["| a | b |", "| --- | ---: |", "| x\\|y | 1 |"]
    assert lines[-1] == "a note"


@pytest.mark.parametrize("by", [(), ("strategy",)])
def test_empty_groups_show_a_dash(by: tuple[str, ...]) -> None:
    data = cube()
    data["status"][:] = "missing"
    data["rho"][:] = np.nan
    text = descriptive_table(data, by=by).text()
    assert "nan" not in text
    assert " - " in text


def test_latex_escapes_and_aligns() -> None:
    table = Table(
        "rmse_of 50 % & more",
        (Column("strategy"), Column("change", "m", "mm", 1e3)),
        (("act_3", -1.5e-3), ("act{rel}", float("nan"))),
        "simulated",
    )
    assert table.latex().splitlines() == [
        r"\begin{table}",
        r"  \centering",
        r"  \caption{rmse\_of 50 \% \& more.}",
        r"  \begin{tabular}{lr}",
        r"    \toprule",
        r"    strategy & change [mm] \\",
        r"    \midrule",
        r"    act\_3 & $-$1.50 \\",
        r"    act\{rel\} & - \\",
        r"    \bottomrule",
        r"  \end{tabular}",
        r"\end{table}",
    ]
    assert r"\textbackslash{}" in Table("a\\b", (), (), "simulated").latex()


def test_a_minimal_cube_has_a_table_of_trials() -> None:
    least = cube().drop_vars(["shift", "steps"])
    names = [column.name for column in trial_table(least).columns]
    assert "shift" not in names and "status" in names


@pytest.mark.parametrize(
    ("value", "shown"),
    [(1e300, "1e+303"), (-1e300, "-1e+303"), (1e-300, "0.00"), (1.5, "1500.00")],
)
def test_an_absurd_number_fits_its_column(value: float, shown: str) -> None:
    """A cell of 300 digits would push all other columns out of the page."""
    assert Column("rmse", "m", "mm", 1e3).cell(value) == shown
