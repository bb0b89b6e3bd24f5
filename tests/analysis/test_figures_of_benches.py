"""The price of accuracy and the table of survival, drawn from labelled data."""

import numpy as np
import pytest
import xarray as xr

from analysis.errors import FigureError
from analysis.figures import error_control, limits_table, stability_table, work_precision


def runs() -> xr.Dataset:
    of_setting = {
        "error_max": [1e-3, 5e-4, np.nan, 4e-4, 3e-4],
        "change_rho": [1e-2, 5e-3, np.nan, 4e-3, 3e-3],
        "run_time": [1.0, 2.0, np.nan, 3.0, 6.0],
    }
    units = {"error_max": "m", "change_rho": "1", "run_time": "s/s"}
    dims = ("setting", "instruction")
    data = {
        name: (dims, np.array(values)[:, None] * [1.0, 0.5], {"units": units[name]})
        for name, values in of_setting.items()
    }
    return xr.Dataset(
        {
            **data,
            "pareto": ("setting", [True, False, False, True, True]),
            "difference_max": (
                ("model", "instruction"),
                [[2e-4, 1e-4], [0.0, 0.0]],
                {"units": "m"},
            ),
            "difference_rho": (("model", "instruction"), [[0.02, 0.01], [0.0, 0.0]]),
            "elements": ("model", [100, 800]),
        },
        coords={
            "family": ("setting", ["Euler", "Euler", "Euler", "SDIRK2", "SDIRK2"]),
            "label": ("setting", ["20 ms", "10 ms", "5 ms", "10 ms", "20 ms"]),
            "model_of": ("setting", ["pointwise"] * 4 + ["refined:element"]),
            "model": ["pointwise", "refined:element"],
            "instruction": ["A", "D"],
        },
        attrs={"finest": "refined:element"},
    )


def test_time_errors_and_model_differences_are_told_apart() -> None:
    figure = work_precision(runs(), title="smile")
    panels = {axes.get_title("left")[0]: axes for axes in figure.axes}
    rings = next(line for line in panels["a"].get_lines() if line.get_markersize() == 11)
    np.testing.assert_allclose(rings.get_xdata(), [1.0, 3.0])
    np.testing.assert_allclose(rings.get_ydata(), [1.0, 0.4])  # mm, the worse instruction
    assert [t.get_text() for t in panels["a"].texts] == ["20 ms", "10 ms"]
    assert [t.get_text() for t in panels["c"].texts] == ["20 ms"]
    assert [t.get_text() for t in panels["d"].texts] == ["0.2 mm, rho by 0.02", "finest"]
    np.testing.assert_allclose([bar.get_width() for bar in panels["d"].patches], [0.2, 0.0])
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["Euler (1 failed)", "SDIRK2"]
    assert panels["b"].get_xscale() == panels["b"].get_yscale() == "log"
    assert figure.get_suptitle().startswith("smile (simulated)")


def test_achieved_errors_stand_against_those_requested() -> None:
    requested = ("setting", [np.nan, 1e-4, 5e-4, np.nan, 1e-3], {"units": "m"})
    figure = error_control(runs().assign_coords(requested=requested))
    lines = [line for line in figure.axes[0].get_lines() if line.get_label()[0] in "AD"]
    np.testing.assert_allclose(lines[0].get_xdata(), [0.1, 0.5])  # the first model, sorted
    np.testing.assert_allclose(lines[1].get_ydata(), [0.25, np.nan])
    np.testing.assert_allclose(lines[2].get_ydata(), [0.3])
    with pytest.raises(FigureError, match="no setting has error control"):
        error_control(runs().assign_coords(requested=requested).isel(setting=[0]))


def test_measurements_that_cannot_be_drawn() -> None:
    with pytest.raises(FigureError, match="expected change_rho"):
        work_precision(runs().drop_vars("change_rho"))
    failed = runs()
    failed["error_max"] = failed["error_max"] * np.nan
    with pytest.raises(FigureError, match="no run of the first model succeeded"):
        work_precision(failed)


def test_stability_says_what_failed() -> None:
    status = [["ok", "failed:InvertedElement"], ["", "ok"]]
    found = xr.Dataset(
        {"status": (("case", "method"), status)},
        coords={"case": ["1 MPa, one step", "rest"], "method": ["converged", "linearly_implicit"]},
    )
    figure = stability_table(found)
    words = [text.get_text() for text in figure.axes[0].texts]
    assert words == ["ok", "InvertedElement", "not run", "ok"]
    assert figure.get_suptitle() == "stability (simulated)"
    with pytest.raises(FigureError, match="the status broken is unknown"):
        stability_table(found.assign(status=(("case", "method"), [["ok", "broken"], ["", "ok"]])))
    with pytest.raises(FigureError, match="with dims case and method"):
        stability_table(found.drop_vars("status"))


def test_limits_are_told_in_words_under_the_name_of_their_row() -> None:
    limit = [["all", "1 ... 10 (InvertedElement)"], ["", "none (WRONG: NaN in the result)"]]
    coords = {
        "case": ["step [ms]: 1 ... 100", "gravity"],
        "group": ("case", ["3. steps", "6. loads"]),
        "method": ["SDIRK2", "linearly implicit trapezoidal"],
    }
    figure = limits_table(xr.Dataset({"limit": (("case", "method"), limit)}, coords))
    words = [text.get_text() for text in figure.axes[0].texts]
    assert words[:2] == ["all", "1 ... 10\n(InvertedElement)"]
    assert words[2] == "not run"
    assert words[3].startswith("none\n(WRONG: NaN")
    assert words[4:] == ["3. steps", "6. loads"]
    places = figure.axes[0].get_yticks().tolist()
    assert places == [1, 3]  # below their headings
    assert figure.axes[0].get_xticklabels()[1].get_text().count("\n") == 2
