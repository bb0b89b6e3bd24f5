"""Damaged inputs: a located error, a doubt, or a checked face near the person; never a silent face."""

import hashlib
from collections import Counter

import numpy as np
import pytest

from benchmarks.fit_ends import BAD, REFUSED, end_of
from benchmarks.fit_inputs import DAMAGES, damaged
from emgface.errors import EmgfaceError
from emgface.fit.person import scan_of

PER_KIND = 3
ALWAYS_REFUSED = {"sides_exchanged", "mirrored", "wrong_unit", "wrong_side", "empty", "huge"}
NEVER_REFUSED = {"flipped_part", "flipped_all", "debris", "cropped"}


def prepared(marks, points, triangles) -> str:
    """Digest of what is fitted: turned triangles, for example, are the same for any number of them."""
    try:
        surface = scan_of((points, triangles), None, "skin").surface
        points, triangles = surface.points, surface.triangles
    except EmgfaceError:
        pass  # refused, in no time
    digest = hashlib.sha256("".join(marks).encode())
    for array in (points, triangles, *marks.values()):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


@pytest.mark.slow
@pytest.mark.parametrize("damage", DAMAGES, ids=[d.__name__ for d in DAMAGES])
def test_a_damaged_input_gives_an_error_or_a_checked_face(generic, person, damage):
    outcomes, ends = Counter(), dict[str, str]()
    for number in range(PER_KIND):
        name, marks, points, triangles = damaged(person, number, damage)
        same = prepared(marks, points, triangles)
        if same not in ends:
            ends[same] = end_of(generic, person, marks, (points, triangles))
        assert not ends[same].startswith(BAD), (name, number, ends[same])
        outcomes["error" if ends[same].startswith(REFUSED) else "face"] += 1
    assert not (name in ALWAYS_REFUSED and outcomes["face"])
    assert not (name in NEVER_REFUSED and outcomes["error"])
