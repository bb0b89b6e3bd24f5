"""Plans and parameters of tests of treatments."""

import json

from emgface.choices import configure
from emgface.face.simulation_parameters import SimulationParameters

FREE = {"contact": {"method": "none"}}
QUICK = configure(SimulationParameters, {"accuracy": "draft", **FREE, "sigma_max": 100e3})


def wedge(**given):
    step = {"kind": "wedge", "width": 12.0, "height": 11.0, "place": 0.44} | given
    return {"step": [step]}


def report(face):
    return json.loads(face.attrs["treatment"])[-1]["steps"][-1]
