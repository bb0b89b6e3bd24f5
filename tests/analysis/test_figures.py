"""Contents of figures of a cube, and their origin."""

import numpy as np
import pytest
from PIL import Image
from synthetic_cubes import cube
from synthetic_trajectories import trajectory

from analysis.align import align
from analysis.errors import CubeError
from analysis.figures import box_plots, save, synchronisation
from analysis.figures.style import title_of


def test_box_plots_show_the_medians() -> None:
    data = cube()
    figure = box_plots(data)
    panel = figure.axes[1]
    drawn = sorted(
        (float(np.mean(line.get_xdata())), float(line.get_ydata()[0]))
        for line in panel.get_lines()
        if line.get_linewidth() == 1.6
    )
    expected = [
        float(np.nanmedian(data["rho"].sel(instruction=i, strategy=s)))
        for i in data["instruction"].values
        for s in data["strategy"].values
    ]
    np.testing.assert_allclose([y for _, y in drawn], expected)


@pytest.mark.parametrize("variable", ["rho", "amplitude_ratio", "rmse"])
def test_box_plots_are_labelled_simulated(variable: str) -> None:
    figure = box_plots(cube(), variable=variable)
    assert "simulated recordings" in title_of(figure)
    assert [panel.get_xlabel() for panel in figure.axes] == ["volunteer", "instruction", "marker"]
    assert ("[mm]" in figure.axes[0].get_ylabel()) == (variable == "rmse")


def test_values_not_shown_are_counted() -> None:
    """act_all: one marker undefined and three trials of three markers failed."""
    legend = box_plots(cube()).legends[0]
    assert [text.get_text() for text in legend.get_texts()] == [
        "act_all (n = 14, not drawn 10)",
        "act_3 (n = 21, not drawn 3)",
        "act_rel (n = 21, not drawn 3)",
    ]


def test_a_group_without_values_is_empty() -> None:
    data = cube()
    data["rho"].loc[{"volunteer": "v2", "strategy": "act_all"}] = np.nan
    panel = box_plots(data, by=("volunteer",)).axes[0]
    assert sum(line.get_linewidth() == 1.6 for line in panel.get_lines()) == 5


def test_synchronisation_before_and_after() -> None:
    aligned = align(trajectory(shift=0.2, origin="simulated", volunteer="v1"), trajectory())
    figure = synchronisation(aligned)
    assert "v1 (simulated recordings)" in title_of(figure)
    before, after = figure.axes
    model, given = (line.get_ydata() for line in before.get_lines())
    _, moved = (line.get_ydata() for line in after.get_lines())
    np.testing.assert_allclose(given, 1e3 * aligned["b_measured"], atol=1e-9)
    inside = np.isfinite(moved)
    np.testing.assert_allclose(moved[inside], model[inside], atol=0.2)
    assert "shift 200 ms" in after.get_title()


def test_saved_file_carries_its_title(tmp_path) -> None:
    path = save(box_plots(cube(), by=("volunteer",)), tmp_path / "rho.png", dpi=60)
    with Image.open(path) as image:
        assert "simulated recordings" in image.info["Title"]
        assert image.size[0] == 480
    again = save(box_plots(cube(), by=("volunteer",)), tmp_path / "again.png", dpi=60)
    assert path.read_bytes() == again.read_bytes()
    assert save(synchronisation(align(trajectory(), trajectory())), tmp_path / "b.svg").exists()
    assert save(synchronisation(align(trajectory(), trajectory())), tmp_path / "b.pdf").exists()


def test_unknown_names() -> None:
    with pytest.raises(CubeError, match="cannot draw 'status', expected one of rho"):
        box_plots(cube(), variable="status")
    with pytest.raises(CubeError, match="panels by strategy"):
        box_plots(cube(), by=("strategy",))
    with pytest.raises(CubeError, match="lacks b_measured"):
        synchronisation(cube())


def test_few_values_are_points_and_many_a_box() -> None:
    """Below 8 values, every one is drawn, with the median as a line."""
    from analysis.figures.style import LEAST_OF_BOX, blank, boxes

    panel = blank(3.0, 2.0).subplots()
    few, many = np.array([0.1, 0.5, 0.2]), np.arange(float(LEAST_OF_BOX))
    boxes(panel, {0.0: few, 1.0: many}, 0.8, 0)
    (points,) = panel.collections
    np.testing.assert_array_equal(points.get_offsets().data, [[0.0, v] for v in few])
    assert len(panel.patches) == 1  # the box of the many
    lines = [line for line in panel.lines if set(np.ravel(line.get_xdata())) == {-0.4, 0.4}]
    assert [set(line.get_ydata()) for line in lines] == [{0.2}]


def test_ratios_are_drawn_on_a_logarithmic_axis_with_named_instructions() -> None:
    data = cube()
    data["amplitude_ratio"] = data["amplitude_ratio"].clip(0.01)
    named = {"A": "first movement"}
    figure = box_plots(data, variable="amplitude_ratio", by=("instruction",), labels=named)
    (panel,) = figure.axes
    assert panel.get_yscale() == "log" and "1" in [t.get_text() for t in panel.get_yticklabels()]
    assert "first movement" in " ".join(t.get_text() for t in panel.get_xticklabels()).replace(
        "\n", " "
    )
    data["amplitude_ratio"][{dim: 0 for dim in data["amplitude_ratio"].dims}] = 0.0
    (panel,) = box_plots(data, variable="amplitude_ratio", by=("volunteer",)).axes
    assert panel.get_yscale() == "symlog" and panel.get_ylim()[0] == 0.0
