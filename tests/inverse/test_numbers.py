"""Every number of an inversion is checked where it is given, so that none changes a result unnoticed."""

from dataclasses import fields

import pytest

from emgface.errors import ConfigurationError
from emgface.inverse.assumptions import Assumptions
from emgface.inverse.parameters import InverseParameters

BOTH = (InverseParameters, Assumptions)
NUMBERS = [
    (kind, one.name)
    for kind in BOTH
    for one in fields(kind)
    if isinstance(one.default, int | float) or one.name == "model_error"
]
ELSEWHERE = {("emg_weight", -1.0), ("delay", -1.0)}
"""Values that are valid, or are refused by `emgface.inverse.variants.trust_of`."""


@pytest.mark.parametrize("value", [float("nan"), -1.0, "0.1", True])
@pytest.mark.parametrize(("kind", "name"), NUMBERS)
def test_a_number_that_cannot_be_is_refused(kind, name, value):
    if (name, value) in ELSEWHERE:
        return
    with pytest.raises(ConfigurationError, match="expected"):
        kind(**{name: value})


def test_numbers_of_both_are_walked_and_a_delay_in_milliseconds_is_refused():
    assert len(NUMBERS) >= 18
    with pytest.raises(ConfigurationError, match="the delay of the sEMG is 40 s, expected at most"):
        InverseParameters(delay=40.0)
