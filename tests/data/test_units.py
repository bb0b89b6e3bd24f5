"""Spellings and conversions of units."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from emgface.errors import UnitsError
from emgface.schema.units import quantity_of, spelling, to_si


def array(values: list[float], **attrs: str) -> xr.DataArray:
    return xr.DataArray(values, dims="sample", name="emg", attrs=attrs)


@pytest.mark.parametrize(
    ("unit", "quantity", "expected", "si"),
    [
        ("V", "voltage", 3.0, "V"),
        ("mV", "voltage", 3e-3, "V"),
        ("uV", "voltage", 3e-6, "V"),
        ("\u00b5V", "voltage", 3e-6, "V"),  # micro sign
        ("\u03bcV", "voltage", 3e-6, "V"),  # Greek mu
        ("\u00c2\u00b5V", "voltage", 3e-6, "V"),  # UTF-8 read as Latin-1
        (" Microvolts ", "voltage", 3e-6, "V"),
        ("mm", "length", 3e-3, "m"),
        ("MM", "length", 3e-3, "m"),
        ("cm", "length", 3e-2, "m"),
        ("metre", "length", 3.0, "m"),
        ("ms", "time", 3e-3, "s"),
        ("sec", "time", 3.0, "s"),
    ],
)
def test_known_units_become_si(unit: str, quantity: str, expected: float, si: str) -> None:
    converted = to_si(array([3.0, np.nan], units=unit, label="kept"), quantity)
    # Division by an exact power of ten gives the nearest double.
    assert converted.values[0] == expected
    assert np.isnan(converted.values[1])
    assert converted.attrs == {"units": si, "label": "kept"}
    assert quantity_of(unit) == quantity


@pytest.mark.parametrize("unit", ["MV", "furlong", "N", "mm2", "mS", "Mm"])
def test_an_unknown_unit_is_refused(unit: str) -> None:
    assert quantity_of(unit) is None
    with pytest.raises(
        UnitsError, match=f"emg is in '{unit}', which is not a unit of voltage; expected V or"
    ):
        to_si(array([1.0], units=unit), "voltage")


def test_a_unit_of_another_quantity_is_refused() -> None:
    with pytest.raises(UnitsError, match="emg is in 'mm', which is not a unit of voltage"):
        to_si(array([1.0], units="mm"), "voltage")


@pytest.mark.parametrize("attrs", [{}, {"units": ""}, {"units": "  "}])
def test_a_missing_unit_is_refused(attrs: dict[str, str]) -> None:
    with pytest.raises(UnitsError, match="emg has no unit; expected V or mV"):
        to_si(array([1.0], **attrs), "voltage")


def test_an_unknown_quantity_is_named_with_the_nearest() -> None:
    with pytest.raises(UnitsError, match="'volts'; expected one of .* nearest is 'voltage'"):
        to_si(array([1.0], units="V"), "volts")


def test_integers_are_converted_too() -> None:
    raw = xr.DataArray(np.array([1, 1500], dtype=np.int16), dims="sample", attrs={"units": "mm"})
    np.testing.assert_array_equal(to_si(raw, "length").values, [0.001, 1.5])


def test_unknown_units_are_not_changed() -> None:
    assert spelling(" Nm ") == "Nm"


def test_a_single_channel_has_a_unit_of_its_own(tmp_path: Path) -> None:
    """The others keep theirs; a wrong label is refused, and the advice names the label."""
    from emgface.errors import SchemaError
    from emgface.recordings.dataset import read_recording
    from tests.data.test_brainvision import make

    header = make(tmp_path)
    whole = read_recording(header)
    text = header.read_text(encoding="utf-8")
    assert "Ch2=DAO,,0.001,mV" in text
    header.write_text(text.replace("Ch2=DAO,,0.001,mV", "Ch2=DAO,,0.001,C"), encoding="utf-8")
    with pytest.raises(SchemaError, match="by an entry 'DAO' in the table 'units'"):
        read_recording(header, mapping={"channels": {"DAO": "ZYG_L"}})
    again = read_recording(header, mapping={"units": {"DAO": "mV"}})
    np.testing.assert_array_equal(again["emg"].values, whole["emg"].values)
    with pytest.raises(SchemaError, match="units' names 'nothing'"):
        read_recording(header, mapping={"units": {"nothing": "uV"}})
