"""Facial expressions: held activations, displacement of landmarks, and effect of the skin."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from emgface.face.check import sheet_nodes
from emgface.face.contact_parameters import NO_CONTACT
from emgface.face.muscle_parameters import SIGMA_MAX
from emgface.face.parts import OUTER
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.support import WALL
from studies.mechanics.equilibria import equilibria

Floats = NDArray[np.float64]

EXPRESSIONS: Final[Mapping[str, Mapping[str, float]]] = {
    "closed-mouth smile": {"ZYG": 0.5, "RIS": 0.3, "LAO": 0.3, "OOM": 0.1},
    "open-mouth smile": {"ZYG": 0.6, "RIS": 0.4, "LAO": 0.3, "LLSAN": 0.2, "DLI": 0.2},
    "pursing of the lips": {"OOP": 0.5, "OOM": 0.1},
    "lips turned downwards": {"DAO": 0.7},
}
"""Muscles of both sides and their activation [1]. The four are those of Stavness et al., Facial
expression simulations; the activations, which are not stated there, were chosen."""

LEVELS: Final = (0.0, 0.25, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Skin:
    """Variant of the skin: its name and its changes to `SimulationParameters`."""

    name: str
    changes: Mapping[str, Any]


SKINS: Final = (
    Skin("as the tissue beneath", {}),
    Skin("2 x stiffer", {"skin": {"stiffness": 2.0}}),
    Skin("4 x stiffer", {"skin": {"stiffness": 4.0}}),
    Skin(
        "4 x stiffer, tension 15.9 kPa",
        {
            "skin": {"stiffness": 4.0, "kappa": 250e3},
            "prestress": {"method": "stretch", "along": 15.9e3},
        },
    ),
    Skin("inner sheet displaced from 0.97", {"prestress": {"method": "displaced"}}),
    *(
        Skin(
            f"anisotropic, {name}",
            {
                "tissues": [
                    {"layers": ["outer"], "law": "fung", "kappa": 250e3, "stiffness": factor}
                ]
            },
        )
        for name, factor in (("young", 0.5), ("mature", 1.0), ("old", 2.0))
    ),
)
"""Variants of the skin: isotropic and stiffer, under tension, and the orthotropic skin of the
publication at three ages; the tissue beneath is the same in all."""


def landmarks(face: xr.Dataset) -> dict[str, int]:
    """Names and nodes of the skin landmarks whose displacement is reported.

    The ten lip markers; the margins of both lips in the midline; chin: the foremost midline node of
    the skin at least 10 mm below the lower lip margin; cheeks: the nodes nearest to 25 mm lateral
    and 20 mm above the mouth corners.
    """
    position = face["position"].values
    nodes = {
        str(name): int(node)
        for name, node in zip(face["marker"].values, face["marker_node"].values, strict=True)
    }
    upper, lower = (int(node) for node in face["lip_opening_node"].values)
    nodes |= {"upper_margin": upper, "lower_margin": lower}
    skin = sheet_nodes(face, OUTER)
    at = position[skin]
    chin = skin[(np.abs(at[:, 0]) < 1e-3) & (at[:, 2] < position[lower, 2] - 0.01)]
    nodes["chin"] = int(chin[np.argmax(position[chin, 1])])
    for side, sign in (("left", -1.0), ("right", 1.0)):
        wanted = position[nodes[f"corner_{side}"]] + np.array([sign * 0.025, 0.0, 0.02])
        # The nearest node in front view, because the skin recedes laterally.
        away = np.linalg.norm((at - wanted)[:, [0, 2]], axis=1)
        front = at[:, 1] > np.median(position[:, 1])
        nodes[f"cheek_{side}"] = int(skin[np.argmin(np.where(front, away, np.inf))])
    return nodes


def express(
    face: xr.Dataset,
    *,
    expressions: Mapping[str, Mapping[str, float]] = EXPRESSIONS,
    skins: tuple[Skin, ...] = SKINS,
    progress: Callable[[str], None] | None = None,
) -> tuple[pd.DataFrame, dict[tuple[str, str], Floats]]:
    """Hold expressions with several skins and measure the displacements of landmarks.

    `expressions` map a name to muscles (without side) and activations. sigma_max is 100 kPa, with
    walls instead of teeth and bone, and without gravity and contact, so that the lips may pass
    through each other. `progress` receives a sentence per run.

    The table has one row per expression, skin and landmark: displacement [mm] from the equilibrium
    without activation and its components medially, forward and up. Returned in addition are the
    node positions (nodes, 3) [m] by (expression, skin). Errors are those of `equilibria`.
    """
    base = SimulationParameters(
        sigma_max=SIGMA_MAX, gravity=False, support=WALL, contact=NO_CONTACT
    )
    points = landmarks(face)
    rows: list[dict[str, object]] = []
    positions: dict[tuple[str, str], Floats] = {}
    for skin in skins:
        changed = SimulationParameters.model_validate(base.model_dump() | dict(skin.changes))
        for name, muscles in expressions.items():
            if progress is not None:
                progress(f"{name}, skin {skin.name}")
            drive = {f"{m}_{side}": level for m, level in muscles.items() for side in "LR"}
            positions_by_level = equilibria(face, drive, changed, levels=LEVELS)[
                "node_position"
            ].values
            positions[name, skin.name] = positions_by_level[-1]
            for landmark, node in points.items():
                moved = 1e3 * (positions_by_level[-1] - positions_by_level[0])[node]
                medially = -np.sign(face["position"].values[node, 0]) * moved[0]
                rows.append(
                    {
                        "expression": name,
                        "skin": skin.name,
                        "landmark": landmark,
                        "displacement (mm)": float(np.linalg.norm(moved)),
                        "medially (mm)": float(medially),
                        "forward (mm)": float(moved[1]),
                        "up (mm)": float(moved[2]),
                    }
                )
    return pd.DataFrame(rows), positions


def summary(table: pd.DataFrame) -> pd.DataFrame:
    """Displacement of the corners (mean), of all landmarks (mean) and of the one with the largest [mm].

    One row per expression and skin of a table of `express`.
    """
    rows: list[dict[str, object]] = []
    for (name, skin), own in table.groupby(["expression", "skin"], sort=False):
        size = own.set_index("landmark")["displacement (mm)"]
        most = str(size.idxmax())
        rows.append(
            {
                "expression": name,
                "skin": skin,
                "corners (mm)": float(size[["corner_left", "corner_right"]].mean()),
                "all landmarks (mm)": float(size.mean()),
                "moves most": most.removesuffix("_left").removesuffix("_right"),
                "largest (mm)": float(size.max()),
            }
        )
    return pd.DataFrame(rows)
