"""Damaged inputs: a located error, a doubt, or a checked face near the person; never a silent face."""

from collections import Counter

import pytest

from benchmarks.fit_ends import BAD, REFUSED, end_of
from benchmarks.fit_inputs import DAMAGES, damaged

PER_KIND = 3
ALWAYS_REFUSED = {"sides_exchanged", "mirrored", "wrong_unit", "wrong_side", "empty", "huge"}
NEVER_REFUSED = {"flipped_part", "flipped_all", "debris", "cropped"}


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES, ids=[d.__name__ for d in DAMAGES])
def test_a_damaged_input_gives_an_error_or_a_checked_face(generic, person, damage):
    outcomes = Counter()
    for number in range(PER_KIND):
        name, marks, points, triangles = damaged(person, number, damage)
        end = end_of(generic, person, marks, (points, triangles))
        assert not end.startswith(BAD), (name, number, end)
        outcomes["error" if end.startswith(REFUSED) else "face"] += 1
    assert not (name in ALWAYS_REFUSED and outcomes["face"])
    assert not (name in NEVER_REFUSED and outcomes["error"])
