"""Names and values that a program downstream would interpret: formulas, mathematics, faults."""

import csv
import io
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from matplotlib.text import Text
from typer.testing import CliRunner

from analysis.figures.style import blank, grid, literal, save, styled
from analysis.tables import Column, Table, no_formula
from emgface.cli import app
from emgface.errors import SignalError
from emgface.recordings.dataset import write_recording
from emgface.recordings.quality.figure import overview_figure
from emgface.reduced.live import CausalFeature
from emgface.reduced.stream import frames_of
from tests.data.conftest import recording

HOSTILE = ("cost $5 and $\\alpha", "$\\frac{", "a_$b^$", "$$", "100 %$\\unknown$")


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("style", [styled, literal])
def test_a_dollar_sign_is_a_character(style: Callable, name: str, tmp_path: Path) -> None:
    @style
    def draw():
        figure = blank(3.0, 2.0)
        panel = grid(figure, 1, 1)[0][0]
        panel.plot([1.0, 2.0], label=name)
        panel.set_title(name)
        panel.set_xticks([0.0], [name])
        panel.legend()
        figure.suptitle(name)
        return figure

    figure = draw()
    save(figure, tmp_path / "a.svg")  # draws every text
    assert all(
        not text.get_parse_math() for text in figure.findobj(Text) if name in text.get_text()
    )


@pytest.mark.parametrize("name", HOSTILE)
def test_the_overview_of_a_recording_has_names_with_dollar_signs(name: str, tmp_path: Path) -> None:
    trial = recording()
    labels = [name, *(str(c) for c in trial["channel"].values[1:])]
    trial = trial.assign_coords(channel=labels).assign_attrs(source=name)
    save(overview_figure(trial), tmp_path / "a.png", dpi=40)
    assert (tmp_path / "a.png").stat().st_size > 1000


FORMULAS = ("=1+2", '=HYPERLINK("x")', "+cmd", "-2+3", "@SUM(A1)", "\tx")


@pytest.mark.parametrize("text", FORMULAS)
def test_a_text_is_no_formula_of_a_spreadsheet(text: str, tmp_path: Path) -> None:
    assert no_formula(text) == f"'{text}"
    columns = (Column("name"), Column("value"))
    table = Table(title="t", columns=columns, rows=((text, -1.5),), origin="measured")
    rows = list(csv.reader(io.StringIO(table.csv())))
    assert rows[1][1:] == [f"'{text}", "-1.5"]
    trial = recording()
    labels = [text, *(str(c) for c in trial["channel"].values[1:])]
    write_recording(trial.assign_coords(channel=labels), tmp_path / "a.nc")
    said = CliRunner().invoke(app, ["check", str(tmp_path / "a.nc")]).output
    cells = {cell for row in csv.reader(io.StringIO(said)) for cell in row}
    assert f"'{text}" in cells and text not in cells


def test_a_line_end_does_not_break_a_table() -> None:
    assert no_formula("a\r=1\n+2") == "a =1 +2"


@pytest.mark.parametrize("value", [-1.5, 2, "-", "ZYG_L", "", "-1e-3", None, "a=b"])
def test_other_cells_are_unchanged(value) -> None:
    assert no_formula(value) is value


@pytest.mark.parametrize("fault", [np.nan, np.inf, -np.inf, 1e300, -1e12])
def test_a_faulty_sample_does_not_stay_in_the_live_feature(fault: float) -> None:
    """The filter is recursive: it would keep a value that is not finite for ever."""
    rate, rng = 2000.0, np.random.default_rng(1)
    weights = np.eye(2)
    whole = 5e-5 * rng.standard_normal((2, 4000))
    clean, hurt = CausalFeature(rate, weights), CausalFeature(rate, weights)
    damaged = whole.copy()
    damaged[0, 1000] = fault
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for k in range(0, 4000, 20):
            wanted, feature = clean(whole[:, k : k + 20]), hurt(damaged[:, k : k + 20])
            assert np.isfinite(feature).all()
            np.testing.assert_array_equal(feature[1], wanted[1])
    np.testing.assert_allclose(feature, wanted, rtol=1e-9)


def test_channels_of_one_place_are_refused() -> None:
    time = np.arange(4000) / 2000.0
    emg = xr.DataArray(
        1e-5 * np.random.default_rng(2).standard_normal((2, 4000)),
        {"channel": ["ZYG_L", "ZYG_L"], "time_emg": time},
        attrs={"units": "V"},
        name="emg",
    )
    with pytest.raises(SignalError, match="2 channels ZYG_L"):
        frames_of(emg.to_dataset(), 0.01)


def test_tables_of_the_inventory_contain_no_formulas(tmp_path: Path) -> None:
    write_recording(recording(), tmp_path / "=cmd.nc")
    out = tmp_path.parent / f"{tmp_path.name}.csv"
    CliRunner().invoke(app, ["inventory", str(tmp_path), "--out", str(out)])
    assert pd.read_csv(out)["file"].tolist() == ["'=cmd.nc"]
