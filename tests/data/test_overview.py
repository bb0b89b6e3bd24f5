"""Overview page: all rows with their verdicts, and the label of simulated data."""

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from emgface.recordings.check import check_recording
from emgface.recordings.quality.figure import VERDICT_COLOURS, overview_figure
from tests.data.made_recordings import MARKERS, face, noise, recording


def texts(figure: Figure) -> list[str]:
    suptitle = figure.get_suptitle()
    return [suptitle, *(t.get_text() for axes in figure.axes for t in axes.texts)]


def labels(figure: Figure) -> dict[str, str]:
    return {
        label.get_text(): label.get_color()
        for axes in figure.axes
        for label in axes.get_yticklabels()
        if label.get_text()
    }


def faulty() -> xr.Dataset:
    values, places = noise(), face(800)
    values[3], places[4, :, 100:130] = 0.0, np.nan
    values[5] += 2e-3 * np.linspace(0, 1, values.shape[1])
    named = {"volunteer": "V03", "instruction": "D", "repetition": 2}
    return recording(values, places).assign_attrs(named)


def test_the_page_names_trial_rows_and_findings() -> None:
    trial = faulty()
    table = check_recording(trial)
    figure = overview_figure(trial, table)
    assert texts(figure)[0] == "V03 D 2 (SIMULATED): 27 ok, 1 warning, 2 error"
    label_names = labels(figure)
    assert set(MARKERS) <= set(label_names) and len(label_names) >= 30
    assert (label_names["ZYG_L"], label_names["nasion"]) == (
        VERDICT_COLOURS["error"],
        VERDICT_COLOURS["error"],
    )
    assert (label_names["DAO_L"], label_names["MEN_L"]) == (
        VERDICT_COLOURS["warning"],
        VERDICT_COLOURS["ok"],
    )
    words = " ".join(texts(figure))
    for part in (
        "error: channel ZYG_L: constant",
        "marker nasion: lost for 0.3 s",
        "DAO_L: drifts",
    ):
        assert part in words
    lost = [line for line in figure.axes[2].lines if line.get_marker() == "|"]
    assert sum(len(np.asarray(line.get_xdata())) for line in lost) == 30
    figure.canvas.draw()


def test_a_page_needs_neither_both_parts_nor_findings() -> None:
    trial = recording(noise(), face(800))
    for part in (trial[["emg"]], trial[["position"]]):
        figure = overview_figure(part.assign_attrs(origin="measured", source="a.c3d"))
        assert texts(figure)[0].startswith("a.c3d (measured): ")
        assert "No findings." in texts(figure)
        figure.canvas.draw()


def test_rows_beyond_the_page_are_counted() -> None:
    many = xr.concat([recording(noise(14))["emg"] for _ in range(3)], "channel")
    many = many.assign_coords(channel=[f"c{i}" for i in range(42)])
    figure = overview_figure(xr.Dataset({"emg": many}, attrs={"origin": "simulated"}))
    assert "18 more are not drawn" in texts(figure)


def test_spectra_hang_from_their_strongest_line() -> None:
    """It is half a row above the middle, and the weakest that is drawn 60 dB lower."""
    figure = overview_figure(recording(noise()))
    (panel,) = (axes for axes in figure.axes if "Hz" in axes.get_xlabel())
    for row, line in enumerate(panel.lines[:14]):  # those of muscle bands follow
        drawn = np.asarray(line.get_ydata()) + row
        assert abs(drawn.max() - 0.5) < 1e-9 and -0.4 <= drawn.min() < 0.4
