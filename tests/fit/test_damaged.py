"""Damaged inputs: a located error, or a checked face near the true skin; never a silent face."""

from collections import Counter

import numpy as np
import pytest

from benchmarks.fit_inputs import DAMAGES, damaged
from emgface.errors import EmgfaceError
from emgface.face.validity import check_face
from emgface.fit.measures import distances
from emgface.fit.person import fit_face
from emgface.fit.targets import Target, sheets
from emgface.fit.triangulated import Surface

PER_KIND = 3
ALWAYS_REFUSED = {"sides_exchanged", "mirrored", "wrong_unit", "wrong_side", "empty", "huge"}
NEVER_REFUSED = {"flipped_part", "flipped_all", "debris"}


def true_skin(face, person, fitted) -> Target:
    """Skin of the person in the frame of the fitted face."""
    import json

    motion = np.array(json.loads(fitted.face.attrs["fit_frame"])).reshape(3, 4)
    skin = person.surface()
    moved = skin.points @ motion[:, :3].T + motion[:, 3]
    return Target("skin", sheets(face)["skin"], Surface(moved, skin.triangles))


@pytest.mark.slow
@pytest.mark.parametrize("kind", range(len(DAMAGES)), ids=[d.__name__ for d in DAMAGES])
def test_a_damaged_input_gives_an_error_or_a_checked_face(generic, person, kind):
    outcomes = Counter()
    for k in range(PER_KIND):
        name, marks, points, triangles = damaged(person, kind + k * len(DAMAGES))
        try:
            found = fit_face(generic, marks, skin=(points, triangles), simulated=True)
        except EmgfaceError as error:
            outcomes["error"] += 1
            text = str(error)
            assert ":" in text and len(text) > 40, text  # what was found, and what to try
            continue
        outcomes["face"] += 1
        check_face(found.face)
        # a coarse mesh is 0.34 mm from an undamaged scan
        apart = distances(true_skin(generic, person, found), found.face["position"].values)
        if name not in ("self_intersection", "doubled", "other_pose"):
            assert apart["mean"] < 1.2, (name, apart)
    assert not (name in ALWAYS_REFUSED and outcomes["face"])
    assert not (name in NEVER_REFUSED and outcomes["error"])
