"""Resection of one side of a mandible: muscles and joint lost, scar springs, plate or graft.

Source: the resection models of the published collection; their stiffness of the scar, 800 N/m, is a
default of a demonstration and has no measured origin. The bone keeps its shape and mass here.
"""

from typing import Any, Final

import numpy as np
import xarray as xr

from emgface.anatomy.jaw.model import Floats
from emgface.errors import JawError
from emgface.treatment.plan import Resection

LOST: Final = ("at", "mt", "pt", "ip", "sp", "dm", "sm", "am", "pm", "mp")
"""Muscles that are lost on the resected side; ad, gh, pd and sh remain."""
ATTACHED: Final = {"none": (), "plate": (), "graft": ("mt", "pt")}
"""Muscles of that side that are attached again; plate and graft also restore the joint."""
GUIDES: Final = ("tmj", "posterior", "lateral")  #: joints of one side
FAR: Final = 1.0
"""Distance of the ends of a scar spring [m], at which its direction is constant in practice."""


def resect(jaw: xr.Dataset, step: Resection) -> tuple[xr.Dataset, dict[str, Any]]:
    """Resect one side of a jaw model.

    Each scar is an isotropic translational spring between jaw and skull at rest, represented by three
    long perpendicular springs. Raises JawError if the jaw lacks the muscles or points of that side.
    """
    side = "L" if step.side == "left" else "R"
    lost = [f"{m}_{side}" for m in LOST if m not in ATTACHED[step.reconstruction]]
    names = [str(m) for m in jaw["muscle"].values]
    absent = [m for m in lost if m not in names]
    needed = [f"bite_{side}", f"condyle_{side}"]
    points = [str(p) for p in jaw["point"].values]
    if absent or any(p not in points for p in needed):
        raise JawError(
            f"the jaw has no {', '.join(absent or needed)}, expected the muscles and points of the "
            "side to be resected: generate or import the jaw"
        )
    open_joint = step.reconstruction == "none"
    joints = [str(j) for j in jaw["joint"].values]
    gone = [f"{j}_{side}" for j in GUIDES if open_joint and f"{j}_{side}" in joints]
    capsule = [s for s in map(str, jaw["spring"].values) if open_joint and s == f"capsule_{side}"]
    left = jaw.drop_sel(muscle=lost, joint=gone, spring=capsule)
    left = left.sel(exciter=(left["exciter_gain"] > 0.0).any("muscle"))
    bite, condyle = (
        jaw["point_position"].values[points.index(p)] for p in (f"bite_{side}", f"condyle_{side}")
    )
    places = [bite + share * (condyle - bite) for share in (0.1, 0.4, 0.7)]
    if step.scar_stiffness > 0.0:
        left = _with_scars(left, np.array(places), step.scar_stiffness)
    left.attrs["name"] = f"{jaw.attrs['name']}, simulated resection of the {step.side} side"
    return left, {
        "lost_muscles": lost,
        "lost_joints": gone,
        "scar_springs": 3.0 * (step.scar_stiffness > 0),
    }


def _with_scars(jaw: xr.Dataset, places: Floats, stiffness: float) -> xr.Dataset:
    """Add springs along x, y and z at points of the jaw."""
    bodies = [str(b) for b in jaw["body"].values]
    start = np.repeat(places, 3, axis=0)
    along = np.tile(np.eye(3), (len(places), 1))
    n = len(start)
    own: dict[str, Any] = {
        "spring_body": np.tile([bodies.index("jaw"), bodies.index("skull")], (n, 1)),
        "spring_position": np.stack([start, start + FAR * along], axis=1),
        "spring_stiffness": np.full(n, stiffness),
        "spring_rest_length": np.full(n, FAR),
        "spring_damping": np.zeros(n),
        "spring_one_sided": np.zeros(n),
    }
    columns = [v for v in jaw.data_vars if jaw[v].dims[:1] == ("spring",)]
    added = xr.Dataset(
        {v: (jaw[v].dims, own[str(v)].astype(jaw[v].dtype), jaw[v].attrs) for v in columns},
        coords={"spring": [f"scar{k}_{axis}" for k in range(len(places)) for axis in "xyz"]},
    )
    springs = xr.concat([jaw[columns], added], dim="spring")
    kept = jaw.drop_dims("spring")
    return kept.assign({v: springs[v].assign_attrs(jaw[v].attrs) for v in columns})
