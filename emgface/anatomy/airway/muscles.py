"""Sensitivity of formants to the muscles of a face, each activated alone before a fixed tract."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.airway.area_function import with_lips
from emgface.anatomy.airway.sound import with_formants
from emgface.face.mouth import Mouth
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.actions import steady_positions
from emgface.muscles import MODELLED


def formants_by_muscle(
    face: xr.Dataset,
    tract: xr.Dataset,
    *,
    activation: float = 0.1,
    muscles: Sequence[str] = MODELLED,
    parameters: SimulationParameters | None = None,
) -> pd.DataFrame:
    """Change of lips and formants by every muscle pair (names without side), per activation.

    (F(a) - F(0))/a in steady states (`steady_positions`) from rest: the derivative at rest to first
    order in `activation`, which is above 0 and at most 1. The first row, "rest", has the values at
    rest and the others changes per activation of 1: ``area`` [mm^2], ``protrusion`` [mm], ``F1`` to
    ``F4`` [Hz]. Raises FaceError if the face has no mouth opening.
    """
    mouth = Mouth.from_face(face)
    runs = [{}, *({f"{muscle}_{side}": activation for side in "LR"} for muscle in muscles)]
    position, _ = steady_positions(face, runs, parameters=parameters)
    area, forward = np.array([mouth.measure(q) for q in position]).T
    time = np.arange(float(len(runs)))
    moved = with_formants(with_lips(tract, area, forward, time))
    values = np.column_stack([1e6 * area, 1e3 * forward, moved["formant_frequency"].values])
    values[1:] = (values[1:] - values[0]) / activation
    columns = ["area", "protrusion", *(f"F{k}" for k in moved["formant"].values)]
    return pd.DataFrame(values, index=["rest", *muscles], columns=columns).rename_axis("muscle")
