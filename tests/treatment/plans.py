"""Plans and parameters of tests of treatments."""

import json

from emgface.choices import configure
from emgface.face.lip_shape import lip_rim
from emgface.face.simulation_parameters import SimulationParameters

FREE = {"contact": {"method": "none"}}
QUICK = configure(SimulationParameters, {"accuracy": "draft", **FREE, "sigma_max": 100e3})


def wedge(**given):
    step = {"kind": "wedge", "width": 12.0, "height": 11.0, "place": 0.44} | given
    return {"step": [step]}


def report(face):
    return json.loads(face.attrs["treatment"])[-1]["steps"][-1]


def ball_in_lower_lip(face, depth):
    """Sphere of 3 mm, `depth` mm below the middle of the lower margin and 1 mm behind it [mm]."""
    import trimesh

    rim = lip_rim(face)
    at = face["position"].values[rim.lower[len(rim.lower) // 2]] * 1e3
    ball = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    ball.apply_translation(at + [0.0, -1.0, -depth])
    return ball
