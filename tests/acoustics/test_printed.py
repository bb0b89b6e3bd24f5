"""Transfer functions of printed tracts: the layout of files, maxima of known functions, refusals."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.printed_tract import PRINTED, comparison, read_areas
from emgface.acoustics import formants, read_transfer_function, transfer
from emgface.acoustics.errors import AcousticsError
from emgface.acoustics.printed import TransferFunction, nearest_maxima

LENGTH = 0.17
AREAS = 1e-4 * np.interp(
    np.linspace(0.0, 1.0, 60), [0.0, 0.2, 0.45, 0.75, 1.0], [1.5, 1.0, 2.0, 6.0, 3.5]
)
STEP = 10.766602  #: of the published files [Hz]


def simulated(path: Path, *, noise: float = 0.0, **changes: object) -> Path:
    """Write a simulated file in the layout of the Dresden group."""
    f = STEP * np.arange(1, 600)
    h = transfer(f, AREAS, LENGTH, medium=PRINTED)
    h = h * np.exp(noise * np.random.default_rng(5).standard_normal(f.size))
    rows = [(0.0, 1.0, 0.0), *zip(f, np.abs(h), np.angle(h), strict=True)]
    between = str(changes.get("between", "  "))
    lines = [
        between.join(f"{v:.6f}" for v in row[: int(str(changes.get("columns", 3)))]) for row in rows
    ]
    head = changes.get("head", ["num_points: 4096", "frequency_Hz  magnitude  phase_rad"])
    path.write_text("\n".join([*head, *lines]) + "\n")  # pyright: ignore[reportGeneralTypeIssues]
    return path


def test_the_layout_of_the_group_is_read(tmp_path: Path) -> None:
    response = read_transfer_function(simulated(tmp_path / "a.txt"))
    f = STEP * np.arange(1, 600)
    exact = transfer(f, AREAS, LENGTH, medium=PRINTED)
    assert response.has_phase and response.frequency[0] == 0.0
    assert np.allclose(response.value[1:], exact, rtol=1e-4, atol=2e-6)


@pytest.mark.parametrize(
    "changes",
    [
        {"head": [], "columns": 2},
        {"between": ", ", "head": ["frequency_Hz, magnitude, phase_rad"]},
        {"between": "\t", "head": ["num_points:\t600", "frequency_Hz\tmagnitude\tphase_rad"]},
    ],
)
def test_other_tables_have_the_same_maxima(tmp_path: Path, changes: dict[str, object]) -> None:
    usual = read_transfer_function(simulated(tmp_path / "a.txt")).peaks()[0]
    maxima = read_transfer_function(simulated(tmp_path / "b.txt", **changes)).peaks()[0]
    assert np.allclose(maxima, usual, rtol=1e-6)


def test_levels_in_decibel_are_ratios(tmp_path: Path) -> None:
    f = 10.0 * np.arange(1, 40)
    path = tmp_path / "db.csv"
    rows = [f"{a:.1f},{20.0 * np.log10(a):.9f}" for a in f]
    path.write_text("\n".join(["frequency_Hz,magnitude_dB", *rows]))
    assert np.allclose(np.abs(read_transfer_function(path).value), f)


def test_maxima_and_bandwidths_are_those_of_a_resonance() -> None:
    """H = 1/(1 - (f/F)^2 + j f B/F^2): maximum near F, 3 dB apart by B for B much smaller than F."""
    f = np.arange(5.0, 4000.0, 5.0)
    for F, B in ((700.0, 60.0), (1500.0, 90.0)):
        h = 1.0 / (1.0 - (f / F) ** 2 + 1j * f * B / F**2)
        at, width = TransferFunction(f, h, True).peaks()
        assert at == pytest.approx([F], rel=3e-3) and width == pytest.approx([B], rel=0.02)


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_formants_of_the_same_tube_are_found_in_a_simulated_file(
    tmp_path: Path, noise: float
) -> None:
    """Poles and maxima differ by less than 0.5 %, with noise of 2 % by less than 1 %."""
    measured = read_transfer_function(simulated(tmp_path / "a.txt", noise=noise))
    frequency, bandwidth = formants(AREAS, LENGTH, medium=PRINTED)
    maxima, difference = nearest_maxima(measured, frequency)
    assert np.isfinite(maxima).all() and len(maxima) >= 4
    assert np.abs(difference).max() < (0.01 if noise else 0.005)
    if not noise:
        peaks, widths = measured.peaks()
        assert widths[: len(bandwidth)] == pytest.approx(bandwidth, rel=0.15)
        shifted, _ = nearest_maxima(measured, 1.05 * frequency)  # a longer tube is detected by 5 %
        assert np.allclose(1.05 * frequency / shifted - 1.0, 0.05, atol=0.006) and len(peaks) >= 4


def test_formants_without_a_maximum_are_undefined(tmp_path: Path) -> None:
    measured = read_transfer_function(simulated(tmp_path / "a.txt"))
    maxima, _ = nearest_maxima(measured, np.array([100.0]))
    assert np.isnan(maxima).all()


def test_the_command_compares_an_area_function(tmp_path: Path) -> None:
    measured = read_transfer_function(simulated(tmp_path / "a.txt"))
    table = tmp_path / "areas.csv"
    each = 100.0 * LENGTH / 60
    table.write_text("area_cm2,length_cm\n" + "\n".join(f"{1e4 * a:.6f},{each:.9f}" for a in AREAS))
    areas, length = read_areas(table, None)
    assert length == pytest.approx(LENGTH) and np.allclose(areas, AREAS, rtol=1e-5)
    rows = comparison(measured, areas, length)
    assert rows["difference [%]"].abs().max() < 0.5
    table.write_text("area\n1\n")
    with pytest.raises(AcousticsError, match="expected area_cm2"):
        read_areas(table, None)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frequency_Hz magnitude phase_rad\n" + "1 2 3\n" * 9, "do not increase"),
        ("num_points: 4\n" + "\n".join(f"{k} 1 0" for k in range(20)), "not whole"),
        ("a b c\n" + "\n".join(f"{k} 1 0" for k in range(20)), "has the columns"),
        ("\n".join(f"{k} -1 0" for k in range(20)), "magnitude_dB"),
        ("\n".join(f"{k} nan 0" for k in range(20)), "not finite"),
        ("\n".join(f"{k} 1 0 0" for k in range(20)), "rows of"),
        ("1 1 0\n2 1 0\n", "at least"),
        ("", "at least"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "x.txt"
    path.write_text(text)
    with pytest.raises(AcousticsError, match=message):
        read_transfer_function(path)
