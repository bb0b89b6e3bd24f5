"""Tables of a cube as plain text, Markdown, LaTeX and CSV.

Every table states the origin of its recordings (measured or simulated): in the title, and in a
column of the CSV, which has no title.
"""

import csv
import io
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import xarray as xr

from analysis.cube import TRIAL_DIMS
from analysis.descriptives import descriptives
from analysis.listing import trials

ABSENT_CELL: Final = "-"
PLAIN: Final = 1e9  #: size from which a number is written with a power of ten
_FORMULA: Final = re.compile(r"[=+\-@\t].")


def no_formula(value: Any) -> Any:
    """Return a cell of a table for spreadsheets, which would compute a text that begins with ``=``.

    Such a text from a file of somebody else is preceded by an apostrophe, and line ends in it become
    blanks; numbers are unchanged.

    Examples
    --------
    >>> no_formula("=1+2"), no_formula(-1.5), no_formula("-1.5"), no_formula("-")
    ("'=1+2", -1.5, '-1.5', '-')
    """
    if not isinstance(value, str):
        return value
    if "\n" in value or "\r" in value:
        value = " ".join(value.splitlines())
    if not _FORMULA.match(value):
        return value
    try:
        float(value)
    except ValueError:
        return f"'{value}"
    return value


@dataclass(frozen=True)
class Column:
    """Head and number format of a column."""

    name: str  #: the same in every format
    #: SI unit of the values, empty for labels and counts; heads the column of a CSV
    units: str = ""
    shown: str = ""  #: unit in text and Markdown
    factor: float = 1.0  #: from `units` to `shown`
    digits: int = 2  #: decimals in text and Markdown

    def head(self, *, si: bool = False) -> str:
        """Return the name with its unit in brackets."""
        units = self.units if si else self.shown
        return f"{self.name} [{units}]" if units not in ("", "1") else self.name

    def cell(self, value: Any) -> str:
        """Format a value; a dash if there is none."""
        if isinstance(value, float):
            if not math.isfinite(value):
                return ABSENT_CELL
            shown = value * self.factor
            return f"{shown:.{self.digits}f}" if abs(shown) < PLAIN else f"{shown:.4g}"
        return " ".join(str(value).split()) or ABSENT_CELL


@dataclass(frozen=True)
class Table:
    """A titled table.

    Attributes
    ----------
    title : str
        Title: the contents of the table and the origin of its recordings.
    columns : tuple of Column
        Heads.
    rows : tuple of tuple
        Values in SI units: text, whole numbers, or floats (NaN where undefined).
    origin : str
        "measured", or "simulated" with the world, as `origin_of` gives it.
    note : str
        Explanation for the reader.
    """

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    origin: str
    note: str = ""

    def text(self) -> str:
        """Return the table in columns of fixed width, numbers right-aligned."""
        heads = [column.head() for column in self.columns]
        cells = self._cells()
        widths = [max(map(len, column)) for column in zip(heads, *cells, strict=True)]
        right = [self._numeric(index) for index in range(len(heads))]

        def line(row: Sequence[str]) -> str:
            parts = [
                cell.rjust(width) if flush else cell.ljust(width)
                for cell, width, flush in zip(row, widths, right, strict=True)
            ]
            return "  ".join(parts).rstrip()

        rule = "  ".join("-" * width for width in widths)
        body = [self.title, "", line(heads), rule, *(line(row) for row in cells)]
        return "\n".join([*body, *(["", self.note] if self.note else [])]) + "\n"

    def markdown(self) -> str:
        """Return the table in Markdown with its title in bold."""

        def line(row: Sequence[str]) -> str:
            return "| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"

        rule = ["---:" if self._numeric(index) else "---" for index in range(len(self.columns))]
        heads = [column.head() for column in self.columns]
        body = [f"**{self.title}**", "", line(heads), line(rule), *map(line, self._cells())]
        return "\n".join([*body, *(["", self.note] if self.note else [])]) + "\n"

    def latex(self) -> str:
        """Return the table in LaTeX, for a document that uses the package booktabs."""
        right = [self._numeric(index) for index in range(len(self.columns))]

        def line(row: Sequence[str]) -> str:
            return "    " + " & ".join(map(escaped, row)) + r" \\"

        form = "".join("r" if flush else "l" for flush in right)
        body = [
            r"\begin{table}",
            r"  \centering",
            rf"  \caption{{{escaped(' '.join([self.title + '.', self.note]).strip())}}}",
            rf"  \begin{{tabular}}{{{form}}}",
            r"    \toprule",
            line([column.head() for column in self.columns]),
            r"    \midrule",
            *map(line, self._cells()),
            r"    \bottomrule",
            r"  \end{tabular}",
            r"\end{table}",
        ]
        return "\n".join(body) + "\n"

    def csv(self) -> str:
        """Return the table as CSV in SI units and full precision, undefined values empty."""
        buffer = io.StringIO()
        writer = csv.writer(buffer, lineterminator="\n")
        writer.writerow(["origin", *(column.head(si=True) for column in self.columns)])
        for row in self.rows:
            empty = [isinstance(value, float) and not math.isfinite(value) for value in row]
            cells = [
                "" if gone else no_formula(value) for gone, value in zip(empty, row, strict=True)
            ]
            writer.writerow([self.origin, *cells])
        return buffer.getvalue()

    def _cells(self) -> list[list[str]]:
        return [
            [column.cell(value) for column, value in zip(self.columns, row, strict=True)]
            for row in self.rows
        ]

    def _numeric(self, index: int) -> bool:
        return any(isinstance(row[index], int | float) for row in self.rows)


def escaped(text: str) -> str:
    """Convert plain text to LaTeX; a hyphen before a digit becomes a minus sign."""
    special = {
        "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
        "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "µ": r"\textmu{}",
        **{character: "\\" + character for character in "&%$#_{}"},
    }  # fmt: skip
    text = "".join(special.get(character, character) for character in text)
    return re.sub(r"(?<![\w.])-(?=\d)", "$-$", text)


TABLE_UNITS: Final = {
    "rho": ("1", "1", 1.0, 2),
    "amplitude_ratio": ("1", "1", 1.0, 2),
    "rmse": ("m", "mm", 1e3, 2),
    "shift": ("s", "ms", 1e3, 1),
    "scale": ("1", "1", 1.0, 3),
    "sigma_max": ("Pa", "kPa", 1e-3, 0),
    "run_time": ("s", "s", 1.0, 1),
    "numerical_error": ("m", "mm", 1e3, 3),
}
"""SI unit, unit shown, factor and decimals of the variables that tables list."""


def origin_of(data: xr.Dataset | xr.DataArray) -> str:
    """Origin for titles: "measured", or "simulated" with the world ("simulated, mismatched world")."""
    origin = str(data.attrs.get("origin", "unlabelled"))
    world = str(data.attrs.get("world", ""))
    return f"{origin}, {world}" if world else origin


def recordings(origin: str) -> str:
    """Describe the recordings of a table or figure by the result of `origin_of`."""
    kind, separator, world = origin.partition(", ")
    return f"{kind} recordings{separator}{world}"


def descriptive_table(
    cube: xr.Dataset, *, by: Sequence[str] = ("strategy",), variable: str = "rho"
) -> Table:
    """Tabulate median, mean, standard deviation and counts of a variable in groups.

    Parameters
    ----------
    cube : xarray.Dataset
        Result of `build_cube`.
    by : sequence of str
        Dims to group by, the first varying slowest.
    variable : str
        ``"rho"``, ``"amplitude_ratio"``, ``"rmse"`` or another of `TABLE_UNITS`.

    Returns
    -------
    Table
        One row per group.

    Raises
    ------
    CubeError
        Unknown dim or variable.
    """
    groups = descriptives(cube, by=by, variable=variable)
    units, shown, factor, digits = TABLE_UNITS.get(
        variable, (str(cube[variable].attrs.get("units", "1")),) * 2 + (1.0, 3)
    )
    # Trials without scores are counted once per marker; the table lists numbers of trials.
    per_trial = 1
    if "marker" in cube[variable].dims and "marker" not in by:
        per_trial = cube.sizes["marker"]
    statistics = {"median": "median", "mean": "mean", "standard deviation": "standard_deviation"}
    columns = (
        *(Column(dim) for dim in by),
        *(Column(name, units, shown, factor, digits) for name in statistics),
        *(Column(name) for name in ("n", "undefined", "failed", "excluded", "missing")),
    )
    rows: list[tuple[Any, ...]] = []
    flat = groups.stack(group=list(by)) if by else groups.expand_dims("group")
    for index in range(flat.sizes["group"]):
        group = flat.isel(group=index)
        labels = [group[dim].values.item() for dim in by]
        values = [float(group[name]) for name in statistics.values()]
        trials_left = ("n_failed", "n_excluded", "n_missing")
        left = [int(group[name]) // per_trial for name in trials_left]
        rows.append((*labels, *values, int(group["n"]), int(group["n_undefined"]), *left))
    what = f"{variable} per {' and '.join(by)}" if by else f"{variable} of all trials"
    note = (
        "n and undefined are numbers of markers in scored trials; failed, excluded and "
        "missing are numbers of trials."
    )
    if "marker" not in cube[variable].dims:
        note = "All counts are numbers of trials."
    origin = origin_of(cube)
    return Table(f"{what}, {recordings(origin)}", columns, tuple(rows), origin, note)


def trial_table(cube: xr.Dataset) -> Table:
    """List all trials of a cube with status, scores, alignment, costs and flags."""
    listed = trials(cube)
    names = ["status", "median_rho", "n_undefined", "shift", "scale", "sigma_max", "steps",
             "run_time", "numerical_error", "flags", "reason"]  # fmt: skip
    columns = tuple(
        Column(name, *TABLE_UNITS.get("rho" if name == "median_rho" else name, ("", "", 1.0, 0)))
        for name in (*TRIAL_DIMS, *names)
        if name in listed  # a cube need not hold all of them
    )
    records: list[dict[Any, Any]] = listed.to_dict("records")
    rows = tuple(tuple(record[column.name] for column in columns) for record in records)
    origin = origin_of(cube)
    return Table(f"all {len(rows)} trials, {recordings(origin)}", columns, rows, origin)


def report_tables(cube: xr.Dataset) -> dict[str, Table]:
    """Compute the tables of a report from a cube.

    Returns
    -------
    dict of str to Table
        ``strategy``, ``strategy_amplitude_ratio``, ``strategy_rmse``, ``instruction``,
        ``volunteer``, ``marker`` (each by strategy) and ``trials``.
    """
    tables = {"strategy": descriptive_table(cube)}
    for variable in ("amplitude_ratio", "rmse"):
        tables[f"strategy_{variable}"] = descriptive_table(cube, variable=variable)
    for dim in ("instruction", "volunteer", "marker"):
        tables[dim] = descriptive_table(cube, by=(dim, "strategy"))
    return tables | {"trials": trial_table(cube)}
