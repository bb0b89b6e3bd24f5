"""Contents of figures of single trials and of choices, and their errors."""

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from synthetic_emg import CHANNELS, activation, signals
from synthetic_trajectories import MARKERS, trajectory
from test_sensitivity import factorial

from analysis.align import align
from analysis.errors import CubeError, FigureError
from analysis.figures import (
    activation_heat_map,
    difference_map,
    emg_with_features,
    feature_boxes,
    marker_traces,
    save,
    sensitivity_plot,
)
from analysis.figures.style import blank, grid, heading, title_of
from analysis.scores import score
from analysis.sensitivity import sensitivity


def test_heat_map_holds_every_activation() -> None:
    data = activation(strategy="act_rel", repetition=3)
    figure = activation_heat_map(data)
    panel = figure.axes[0]
    np.testing.assert_allclose(panel.collections[0].get_array(), data["activation"])
    assert panel.collections[0].get_clim() == (0.0, 1.0)
    labels = panel.get_yticklabels()
    assert [label.get_text() for label in labels] == list(data["muscle"].values)
    assert [label.get_text() for label in labels if label.get_color() == "0.6"] == [
        "MEN_L",
        "MEN_R",
    ]
    assert title_of(figure) == "muscle activation v0 A 3 act_rel (simulated recordings)"


def test_feature_boxes_show_the_medians() -> None:
    trials = [activation(instruction, seed) for instruction in "BA" for seed in range(3)]
    figure = feature_boxes(trials)
    panels = figure.axes
    assert [panel.get_title() for panel in panels] == [
        "A (3 trials, 3 volunteers)",
        "B (3 trials, 3 volunteers)",
    ]
    drawn = sorted(
        (float(np.mean(line.get_xdata())), float(line.get_ydata()[0]))
        for line in panels[0].get_lines()
        if line.get_linewidth() == 1.6
    )
    pooled = np.concatenate([trial["activation"].values for trial in trials[3:]], axis=1)
    # Left next to right: muscle k on the left, k + 10 on the right.
    expected = [float(np.median(pooled[k + side])) for k in range(10) for side in (0, 10)]
    np.testing.assert_allclose([y for _, y in drawn], expected)
    assert "simulated recordings" in title_of(figure)


def test_differences_of_two_strategies_are_means_over_trials() -> None:
    one = activation(strategy="act_all")
    other = one.copy(deep=True).assign_attrs(strategy="inverse")
    other["activation"] = (0.5 * one["activation"]).assign_attrs(one["activation"].attrs)
    figure = difference_map({"inverse": 2 * [(other, one), (one, one)]})
    size, course = (panel.collections[0].get_array() for panel in figure.axes[:2])
    expected = -0.25 * one["activation"].mean("time").values[:, None]
    np.testing.assert_allclose(size, expected, atol=1e-12)
    changes = one["activation"].std("time").values > 0.0
    np.testing.assert_allclose(course[changes], 1.0)
    assert np.isnan(np.ma.filled(course[~changes], np.nan)).all()
    assert "compared with act_all (simulated" in title_of(figure)
    with pytest.raises(FigureError, match="no trials"):
        difference_map({"inverse": []})


def test_signals_and_features() -> None:
    raw, filtered, feature = signals()
    figure = emg_with_features(raw, filtered, feature, origin="simulated", label="v1 A 1")
    assert len(figure.axes) == 14
    left, right = figure.axes[4], figure.axes[5]
    assert left.get_ylabel() == "RIS L"
    expected = 1e6 * (filtered[2] - filtered[2].mean())
    np.testing.assert_allclose(left.get_lines()[1].get_ydata(), expected)
    np.testing.assert_allclose(right.get_lines()[0].get_ydata(), feature[2])
    assert title_of(figure) == "electromyogram v1 A 1 (simulated recordings)"
    one = emg_with_features(raw, filtered, feature[:2], channels=["MEN_L"], origin="measured")
    assert one.axes[1].texts[0].get_text() == "no feature"
    assert "measured recordings" in title_of(one)


def test_marker_traces() -> None:
    measured = trajectory(shift=0.2, origin="simulated", volunteer="v1", noise=2e-4)
    model = trajectory(amplitude=3e-3)
    aligned = align(measured, model)
    scores = score(aligned, model)
    figure = marker_traces(aligned, model, scores)
    panel, row = figure.axes[1], figure.axes[0].get_yticks()[4]
    inside = np.isfinite(aligned["position"].values).all(axis=(0, 1))
    shown = [panel.get_lines()[4], panel.get_lines()[len(MARKERS) + 4]]
    for line, data in zip(shown, (model, aligned), strict=True):
        one = data["position"].sel(marker=MARKERS[4], axis="y").values
        expected = row + 1e3 * (one - one[inside].mean())
        np.testing.assert_allclose(line.get_ydata(), expected, atol=1e-9)
    rows = figure.axes[0].get_yticks()
    assert f"{rows[0] - rows[1]:g} mm apart" in figure.axes[0].get_ylabel()
    label = figure.axes[0].get_yticklabels()[4].get_text()
    assert f"rho = {float(scores['rho'].sel(marker=MARKERS[4])):.2f}" in label
    assert "v1 (simulated recordings)" in title_of(figure)
    with pytest.raises(CubeError, match="lacks b_aligned"):
        marker_traces(model, model)


LEVELS = ["mapping stage = feature", "mapping stage = activation", "phase = causal"]


def test_sensitivity_puts_the_farthest_axis_on_top() -> None:
    cube = factorial().transpose("phase", "mapping_stage", ...)
    effects = sensitivity(cube)
    figure = sensitivity_plot(effects)
    panel = figure.axes[0]
    assert [label.get_text() for label in panel.get_yticklabels()] == LEVELS
    marks = [line for line in panel.get_lines() if line.get_marker() in ("s", "^", "D")]
    np.testing.assert_allclose([line.get_xdata()[0] for line in marks], effects["estimate"])
    shown = [line.get_markerfacecolor() != "white" for line in marks]
    assert shown == (effects["p_holm"].values <= 0.05).tolist()
    assert any(shown) and not all(shown)
    # A strategy's mark lies within half a row of the label of its level.
    heights = {label: place for place, label in zip(panel.get_yticks(), LEVELS, strict=True)}
    for line, axis, level in zip(
        marks, effects["axis"].values, effects["level"].values, strict=True
    ):
        label = f"{axis} = {level}".replace("_", " ")
        assert abs(line.get_ydata()[0] - heights[label]) < 0.5
    assert title_of(figure) == "effect of the choices on rho (simulated recordings)"


@pytest.mark.parametrize("suffix", ["svg", "pdf"])
def test_vectors_keep_their_text_and_are_the_same_twice(tmp_path, suffix: str) -> None:
    paths = [
        save(feature_boxes([activation()]), tmp_path / f"{name}.{suffix}") for name in ("a", "b")
    ]
    content = paths[0].read_bytes()
    assert content == paths[1].read_bytes()
    if suffix == "svg":
        assert b"(simulated recordings)</text>" in content
    else:
        assert b"/FontFile2" in content


def test_settings_of_the_user_do_not_matter() -> None:
    import matplotlib

    plain = activation_heat_map(activation()).axes[0].xaxis.label.get_fontsize()
    with matplotlib.rc_context({"font.size": 30.0, "axes.labelsize": 30.0}):
        inside = activation_heat_map(activation()).axes[0].xaxis.label.get_fontsize()
        assert matplotlib.rcParams["font.size"] == 30.0
    assert plain == inside == 9.0


def test_impossible_figures_are_refused() -> None:
    raw, filtered, feature = signals()
    with pytest.raises(FigureError, match="variable 'activation'"):
        activation_heat_map(xr.Dataset({"rho": ("marker", [1.0])}))
    with pytest.raises(FigureError, match="no trials"):
        feature_boxes([])
    with pytest.raises(FigureError, match="no attribute 'instruction'"):
        feature_boxes([activation().drop_attrs()])
    with pytest.raises(FigureError, match="measured and simulated"):
        feature_boxes([activation(), activation(origin="measured")])
    with pytest.raises(FigureError, match="different muscles"):
        feature_boxes([activation(), activation().isel(muscle=[0, 1])])
    with pytest.raises(FigureError, match="cannot draw OOS_X, expected 1 to 14 of OOS_L"):
        emg_with_features(raw, filtered, feature, channels=["OOS_X"], origin="measured")
    with pytest.raises(FigureError, match="in 'V'"):
        emg_with_features(raw.drop_attrs(), filtered, feature, origin="measured")
    with pytest.raises(FigureError, match="the feature has dims"):
        emg_with_features(raw, filtered, filtered, channels=CHANNELS[:1], origin="measured")
    with pytest.raises(FigureError, match="at least one choice"):
        sensitivity_plot(raw.to_dataset(name="emg"))


@pytest.mark.parametrize("width", [3.0, 5.0, 8.0])
def test_titles_are_not_wider_than_their_figure(width):
    figure = blank(width, 3.0)
    grid(figure)
    heading(
        figure, "normalised features per muscle and instruction of every volunteer", "simulated"
    )
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    box = figure._suptitle.get_window_extent(canvas.get_renderer())
    assert box.x0 >= 0.0 and box.x1 <= figure.bbox.width
    assert "\n" not in title_of(figure) and "instruction of every" in title_of(figure)
