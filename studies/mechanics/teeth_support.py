"""Protrusion of the lips with and without support by teeth, and with and without contact of the lips."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import pandas as pd
import xarray as xr

from emgface.face.contact_parameters import ContactParameters
from emgface.face.lip_shape import lip_rim, lip_shape
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.penetration import Penetration
from emgface.face.simulation_parameters import SimulationParameters
from studies.mechanics.equilibria import equilibria

LEVELS: Final = (0.0, 0.125, 0.25, 0.375, 0.5, 0.75, 1.0)
BACKING: Final[Mapping[str, tuple[str, ...]]] = {
    "nothing": (),
    "lips alone": ("lips",),
    "lips and teeth": ("lips", "teeth"),
}
"""Contact surfaces of the lips, by name."""


def protrude_lips(
    face: xr.Dataset,
    *,
    backing: Mapping[str, tuple[str, ...]] = BACKING,
    stiffening: Sequence[float] = (1.0,),
    progress: Callable[[str], None] | None = None,
) -> tuple[pd.DataFrame, dict[tuple[str, float], xr.Dataset]]:
    """Activate the peripheral orbicularis oris in steps, with several contact surfaces.

    `face` has `lip_opening_node` and arches. `backing` maps a name to contact surfaces, "lips" or
    "teeth" or both; none for no contact. `stiffening` are factors on the passive moduli of the
    muscle's elements at full activation.
    sigma_max is 100 kPa, without gravity. `progress` receives a sentence per run.

    The table has one row per backing, stiffening and activation with the measures of `lip_shape` in
    mm and mm^2, the depths of lips in each other and in the teeth [mm], and the smallest det F;
    returned in addition is the Dataset of `equilibria` by (backing, stiffening). Errors are those
    of `equilibria` and `Penetration`. Source of the experiment: Stavness et al., Teeth support lip
    protrusion, Fig. 11.12, where contact with the teeth is switched off.
    """
    base = SimulationParameters(sigma_max=SIGMA_MAX, gravity=False)
    rim, penetration = lip_rim(face), Penetration(face)
    rows: list[dict[str, object]] = []
    motion: dict[tuple[str, float], xr.Dataset] = {}
    for name, between in backing.items():
        values = {"between": between} if between else {"method": "none"}
        contact = ContactParameters.model_validate(values)
        for factor in stiffening:
            if progress is not None:
                progress(f"lips may touch {name}, stiffening {factor:g}")
            changed = base.model_copy(update={"contact": contact, "stiffening": factor})
            states = equilibria(face, {"OOP_L": 1.0, "OOP_R": 1.0}, changed, levels=LEVELS)
            motion[name, factor] = states
            for k, level in enumerate(LEVELS):
                q = states["node_position"].values[k]
                shape = lip_shape(face, rim, q)
                rows.append(
                    {
                        "touching": name,
                        "stiffening": factor,
                        "activation": level,
                        "protrusion (mm)": 1e3 * shape["protrusion"],
                        "margins forward (mm)": 1e3 * shape["margin_protrusion"],
                        "width (mm)": 1e3 * shape["width"],
                        "height (mm)": 1e3 * shape["height"],
                        "area (mm2)": 1e6 * shape["area"],
                        "lips over each other (mm2)": 1e6 * shape["overlap"],
                        "roundness (1)": shape["roundness"],
                        "lips in lips (mm)": 1e3 * penetration.lips(q),
                        "lips in teeth (mm)": 1e3 * penetration.teeth(q),
                        "smallest det F": float(states["smallest_J"].values[k]),
                    }
                )
    return pd.DataFrame(rows), motion
