"""Figures of long names, many volunteers, missing and extreme values: every text can be read."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
import synthetic_emg
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from synthetic_cubes import cube
from synthetic_trajectories import trajectory
from test_status import cube as cube_with_baselines

import analysis.figures as figures
from analysis.align import align
from analysis.axes import combine_cubes
from analysis.errors import AnalysisError
from analysis.sensitivity import sensitivity
from analysis.statistics.simulated import simulated_scores

MANY = 40  #: volunteers
NAMED = ("volunteer", "instruction", "strategy", "marker", "channel")


def aligned() -> tuple[xr.Dataset, xr.Dataset]:
    model = trajectory(noise=1e-4, seed=3)
    return align(trajectory(shift=0.1, noise=1e-4, origin="simulated"), model), model


def varied() -> xr.Dataset:
    made = simulated_scores(3, volunteers=6, instructions=2)
    other = made.assign(rho=0.9 * made["rho"])
    return sensitivity(combine_cubes({(1.0,): made, (2.0,): other}, {"stress": [1.0, 2.0]}))


DRAWN = {
    "box_plots": lambda: (cube(),),
    "baseline_plot": lambda: (cube_with_baselines(np.random.default_rng(2)),),
    "marker_traces": aligned,
    "synchronisation": lambda: aligned()[:1],
    "activation_heat_map": lambda: (synthetic_emg.activation(),),
    "feature_boxes": lambda: ([synthetic_emg.activation(), synthetic_emg.activation("B", 1)],),
    "difference_map": lambda: (
        {"inverse": [(synthetic_emg.activation(), synthetic_emg.activation(seed=1))]},
    ),
    "emg_with_features": synthetic_emg.signals,
    "sensitivity_plot": lambda: (varied(),),
}
FURTHER = {"emg_with_features": {"origin": "simulated"}}


def renamed(data: xr.Dataset) -> xr.Dataset:
    """Long names with characters of formulas, pages and other alphabets."""
    return data.assign_coords(
        {d: [f"{k} $Ж_{k}$ <b>& a long name of it" for k in data[d].values] for d in data.dims
         if d in NAMED and d in data.coords}
    )  # fmt: skip


def repeated(data: xr.Dataset) -> xr.Dataset:
    if "volunteer" not in data.dims:
        return data
    some = data.isel(volunteer=np.arange(MANY) % data.sizes["volunteer"])
    return some.assign_coords(volunteer=[f"volunteer_{k + 1}" for k in range(MANY)])


def values(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[xr.Dataset], xr.Dataset]:
    def changed(data: xr.Dataset) -> xr.Dataset:
        if isinstance(data, xr.DataArray):
            return data.copy(data=change(data.values))
        numbers = {n: v.copy(data=change(v.values)) for n, v in data.items() if v.dtype.kind == "f"}
        return data.assign(numbers)

    return changed


def without_first(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[:1] = np.nan
    return array


EXTREMES = {
    "as it is": lambda data: data,
    "long names": renamed,
    "many volunteers": repeated,
    "missing": values(lambda array: np.full_like(array, np.nan)),
    "partly missing": values(lambda array: without_first(array) if array.ndim else array),
    "zero": values(np.zeros_like),
    "negative": values(lambda array: -np.abs(array)),
}


def everywhere(change: Callable, given: object) -> object:
    if isinstance(given, xr.Dataset | xr.DataArray):
        return change(given)
    if isinstance(given, dict):
        return {name: everywhere(change, one) for name, one in given.items()}
    return type(given)(everywhere(change, one) for one in given)


def test_every_figure_is_drawn() -> None:
    assert set(figures.__all__) - set(DRAWN) <= {"save", "formant_plot", "incisor_plot"}


@pytest.mark.parametrize("extreme", EXTREMES)
@pytest.mark.parametrize("name", DRAWN)
def test_texts_lie_inside_and_apart(name: str, extreme: str) -> None:
    given = everywhere(EXTREMES[extreme], tuple(DRAWN[name]()))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of missing values and glyphs
        try:
            figure = getattr(figures, name)(*given, **FURTHER.get(name, {}))
        except AnalysisError:
            assert extreme in ("missing", "partly missing")
            return
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
    renderer, width = canvas.get_renderer(), figure.bbox.width
    for legend in figure.legends:
        box = legend.get_window_extent(renderer)
        assert box.x0 >= -1 and box.x1 <= width + 1, "the legend is wider than the figure"
    assert "simulated recordings" in " ".join(figure.get_suptitle().split())
    for panel in figure.axes:
        for which in (panel.xaxis, panel.yaxis):
            low, high = sorted(which.get_view_interval())
            ticks = [*which.get_major_ticks(), *which.get_minor_ticks()]
            shown = [t.label1 for t in ticks if low <= t.get_loc() <= high and t.label1.get_text()]
            assert not any("mathdefault" in one.get_text() for one in shown), "a formula"
            if which is panel.yaxis or not panel.get_visible():
                continue
            spans = sorted(
                (one.get_window_extent(renderer).x0, one.get_window_extent(renderer).x1)
                for one in shown if one.get_visible() and not one.get_rotation() % 90
            )  # fmt: skip
            for (_, end), (start, _) in zip(spans, spans[1:], strict=False):
                assert start >= end - 1, f"labels at the {panel.get_xlabel()} overlap"
