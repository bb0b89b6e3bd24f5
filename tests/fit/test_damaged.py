"""Damaged inputs: a located error, a doubt, or a checked face near the person; never a silent face."""

import hashlib
from collections import Counter

import numpy as np
import pytest

from benchmarks.fit_ends import BAD, REFUSED, end_of, judged
from benchmarks.fit_inputs import DAMAGES, damaged
from emgface.errors import EmgfaceError
from emgface.fit.person import fit_face, scan_of

PER_KIND = 3
ALWAYS_REFUSED = {"sides_exchanged", "mirrored", "wrong_unit", "wrong_side", "empty", "huge"}
NEVER_REFUSED = {"flipped_part", "flipped_all", "debris", "cropped"}
REPAIRED = {"flipped_part", "flipped_all", "debris"}
"""Damage that is removed: the fit is that of the sound scan."""
POINTS = 1.5
"""Largest distance of named points with a repaired scan [mm]: 0.8 as without damage.

Landmarks alone give 2.9 mm, and nearly the same mean distance of the skin, 0.49 and 0.46 mm.
"""


def farthest_point(end: str) -> float:
    """Largest distance of a named point in the end of a fit that gave a face [mm]."""
    return float(end.partition("points ")[2].partition(" mm")[0])


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
        if name in REPAIRED:
            assert farthest_point(ends[same]) <= POINTS, ends[same]
        outcomes["error" if ends[same].startswith(REFUSED) else "face"] += 1
    assert not (name in ALWAYS_REFUSED and outcomes["face"])
    assert not (name in NEVER_REFUSED and outcomes["error"])


@pytest.mark.slow
def test_a_fit_that_ignored_the_skin_would_be_noticed(generic, person):
    """Negative control: landmarks alone give a face that is near, but not that of a repaired scan."""
    fit = fit_face(generic, person.landmarks, simulated=True)
    assert farthest_point(judged(fit.face, person, fit.doubts)) > POINTS
