"""Trial that a recording states, and the refusals of recordings that state none."""

import pytest
import xarray as xr

from emgface.errors import DataError
from emgface.study.table import place_of

STATED = {"volunteer": "V1", "instruction": "A", "repetition": 2}


def test_a_recording_states_its_trial() -> None:
    assert place_of(xr.Dataset(attrs=STATED), "a.nc") == ("V1", "A", 2)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"instruction": "G"},
            r"a.nc is of instruction 'G', expected one of A .purse lips., B ",
        ),
        (
            {"instruction": "smile"},
            r'let a mapping state the letter .\[instructions\], "smile" = "A"',
        ),
        ({"volunteer": None}, r"a.nc does not specify its volunteer, expected"),
        ({"instruction": None, "repetition": None}, r"its instruction and repetition, .*names = "),
    ],
)
def test_another_trial_is_refused(changed: dict, said: str) -> None:
    attrs = {name: value for name, value in (STATED | changed).items() if value is not None}
    with pytest.raises(DataError, match=said):
        place_of(xr.Dataset(attrs=attrs), "a.nc")
