"""A jaw of one body without published files: a bar below a plane, with a muscle on each side."""

import numpy as np

from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import JawBody, JawJoint, JawLine, build_jaw

_MUSCLE = {
    "force_max": 10.0,
    "stretch_max": 1.3,
    "tendon_ratio": 0.0,
    "passive_fraction": 0.015,
    "damping": 0.5,
}


def small_jaw(**changes):
    """The jaw, with changes of the arguments of `build_jaw`."""
    points = {
        "lower_incisor": ("jaw", (0.0, 0.05, 0.0)),
        "upper_incisor": ("skull", (0.0, 0.05, 0.002)),
        "hyoid": ("skull", (0.0, 0.0, -0.03)),
        "head_centre": ("skull", (0.0, -0.06, 0.02)),
        **{f"condyle_{s}": ("jaw", (x, -0.03, 0.03)) for s, x in (("L", -0.05), ("R", 0.05))},
        **{f"bite_{s}": ("jaw", (x, 0.02, 0.0)) for s, x in (("L", -0.02), ("R", 0.02))},
    }
    muscles = [
        JawLine(
            f"close_{s}",
            ("skull", "jaw"),
            np.array([[x, 0.0, 0.05], [x, 0.01, 0.0]]),
            _MUSCLE,
        )
        for s, x in (("L", -0.03), ("R", 0.03))
    ]
    down = (0.0, 0.0, -1.0)
    joints = [
        JawJoint(f"{k}_{s}", "plane", "skull", points[f"{p}_{s}"][1], down, f"{p}_{s}", k == "bite")
        for s in "LR"
        for k, p in (("tmj", "condyle"), ("bite", "bite"))
    ]
    given = {
        "bodies": [
            JawBody("skull", moves=False),
            JawBody("jaw", 0.2, (0.0, 0.0, 0.01), 1e-4 * np.diag([1.5, 2.5, 3.0]), (10.0, 1e-4)),
        ],
        "muscles": muscles,
        "springs": [
            JawLine(
                "strap",
                ("skull", "jaw"),
                np.array([[0.0, -0.05, 0.0], [0.0, 0.0, 0.0]]),
                {"stiffness": 50.0, "rest_length": 0.05, "damping": 1e-3},
            )
        ],
        "joints": joints,
        "points": points,
        "exciters": exciters_of([m.name for m in muscles], {"all": ("close",)}),
        "name": "small jaw",
        "origin": "generated",
        "source": "test",
    }
    return build_jaw(**given | changes)
