"""Lip rounding by orbicularis oris, with and without stress stiffening, with and without teeth."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import pandas as pd
import xarray as xr

from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.support import WALL
from studies.mechanics.equilibria import LEVELS, equilibria

STIFFENING: Final = (1.0, 10.0)  #: factors on the passive moduli; 1 is no stiffening
_UNIT: Final = {
    "width": ("mm", 1e3),
    "height": ("mm", 1e3),
    "area": ("mm2", 1e6),
    "overlap": ("mm2", 1e6),
    "roundness": ("1", 1.0),
    "protrusion": ("mm", 1e3),
    "margin_protrusion": ("mm", 1e3),
}
"""Unit of each measure of `lip_shape` in the table, and the factor to it."""


@dataclass(frozen=True)
class Rounding:
    """Lip rounding of one face."""

    #: one row per support, stiffening and activation: the measures of `lip_shape` in mm and mm^2,
    #: the displacement of the corners [mm] and the smallest det F
    table: pd.DataFrame
    #: (support, stiffening) to the Dataset of `equilibria`
    motion: Mapping[tuple[bool, float], xr.Dataset]


def round_lips(
    face: xr.Dataset,
    *,
    levels: Sequence[float] = LEVELS,
    progress: Callable[[str], None] | None = None,
) -> Rounding:
    """Activate the peripheral orbicularis oris of both sides in steps and measure the mouth.

    The runs are without and with walls behind the lips instead of teeth and bone, and without and
    with a stiffening of the muscle's elements, a factor of 10 on their passive moduli at full
    activation. sigma_max is 100 kPa, without gravity and contact; `levels` are activations.
    `progress` receives a sentence per run.

    The lips may pass through each other; their overlap is reported. Errors are those of
    `equilibria` and `lip_rim`. Source of the experiment: Stavness et al., Lip stiffness enables
    protrusion and rounding, Fig. 11.10; Teeth support lip protrusion, Fig. 11.12.
    """
    base = SimulationParameters(sigma_max=SIGMA_MAX, gravity=False, contact=NO_CONTACT)
    rim = lip_rim(face)
    left = int(face["marker_node"].values[list(face["marker"].values).index("corner_left")])
    rows: list[dict[str, float | bool]] = []
    motion: dict[tuple[bool, float], xr.Dataset] = {}
    for behind in (False, True):
        for factor in STIFFENING:
            if progress is not None:
                progress(f"{'walls' if behind else 'no walls'}, stiffening {factor:g}")
            changes = {"stiffening": factor, "support": WALL if behind else 0.0}
            changed = base.model_copy(update=changes)
            states = equilibria(face, {"OOP_L": 1.0, "OOP_R": 1.0}, changed, levels=levels)
            motion[behind, factor] = states
            for k, level in enumerate(levels):
                q = states["node_position"].values[k]
                shape = lip_shape(face, rim, q)
                moved = q[left] - face["position"].values[left]
                rows.append(
                    {"support": behind, "stiffening": factor, "activation": level}
                    | {
                        f"{name} ({_UNIT[name][0]})": value * _UNIT[name][1]
                        for name, value in shape.items()
                    }
                    | {
                        "corner medially (mm)": 1e3 * float(moved[0]),
                        "corner forward (mm)": 1e3 * float(moved[1]),
                        "smallest det F": float(states["smallest_J"].values[k]),
                    }
                )
    return Rounding(pd.DataFrame(rows), motion)
