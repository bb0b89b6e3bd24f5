"""Motions of jaw, hyoid and published tongue compared with those of another simulator.

Three cases of python -m benchmarks tongue_coupled, at most until 0.1 s.
"""

import pytest

from benchmarks.tongue_coupled import repeated

TOLERATED = 0.0175
"""Penetration of one-sided constraints that the other program does not correct [mm]."""


@pytest.mark.usefixtures("shared")
@pytest.mark.parametrize(
    ("name", "until"),
    [
        ("jh_rest_gravity", 0.1),
        ("jht_element_GGP_0.2_nocontact", 0.05),
        ("jht_line_GGP_0.2_nocontact", 0.05),
    ],
)
def test_motions_of_jaw_hyoid_and_tongue(name, until):
    """Points within twice the tolerance of that program; nodes of the tongue within 0.1 mm."""
    row = repeated(name, until=until)
    assert float(row["points"]) < 2.0 * TOLERATED
    assert float(row["hyoid"]) < 2.0 * TOLERATED
    assert float(row.get("tongue", 0.0)) < 0.1
