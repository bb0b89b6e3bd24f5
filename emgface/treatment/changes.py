"""Factors on the stiffness and strength of regions and muscles."""

from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.spatial import KDTree

from emgface.errors import TreatmentError
from emgface.face.lip_shape import lip_rim
from emgface.face.quality import element_centres
from emgface.treatment.plan import Change, Palsy

Floats = NDArray[np.float64]

LIP: Final = 14e-3  #: distance from a margin within which an element belongs to the lip [m]
#: largest and inverse smallest factor of several steps on one element [1]
LARGEST_CHANGE_FACTOR: Final = 1e3
STRONGEST: Final = 10.0  #: largest factor of several steps on one muscle [1]


def with_factor(face: xr.Dataset, factor: Floats) -> xr.Dataset:
    """Face whose passive moduli are multiplied by a factor of every element (elements,)."""
    before = face["tissue_factor"].values if "tissue_factor" in face else 1.0
    values = before * factor
    if (outside := (values > LARGEST_CHANGE_FACTOR) | (values < 1.0 / LARGEST_CHANGE_FACTOR)).any():
        raise TreatmentError(
            "stiffness",
            f"the stiffness of {int(outside.sum())} elements is up to {values[outside].max():.3g} times "
            f"that of the face, expected {1.0 / LARGEST_CHANGE_FACTOR:g} to "
            f"{LARGEST_CHANGE_FACTOR:g}: factors of several steps and of scars multiply, choose "
            "smaller ones",
        )
    return face.assign(tissue_factor=("element", values, {"units": "1"}))


def with_share(face: xr.Dataset, factor: Floats) -> xr.Dataset:
    """Face whose muscles fill their elements by a factor of every row (bundle_element,)."""
    n = face.sizes["bundle_element"]
    before = face["bundle_weight"].values if "bundle_weight" in face else np.ones(n)
    return face.assign(bundle_weight=("bundle_element", before * factor, {"units": "1"}))


def with_strength(face: xr.Dataset, factor: Floats) -> xr.Dataset:
    """Face whose muscles have their active stress multiplied by a factor (muscles,)."""
    before = face["muscle_strength"].values if "muscle_strength" in face else 1.0
    values = before * factor
    if (values > STRONGEST).any():
        raise TreatmentError(
            "strength",
            f"the strength of a muscle is {values.max():.3g} times that of the face, expected at most "
            f"{STRONGEST:g}: factors of several steps multiply, choose smaller ones",
        )
    return face.assign(muscle_strength=("muscle", values, {"units": "1"}))


def apply_change(face: xr.Dataset, step: Change) -> tuple[xr.Dataset, dict[str, Any]]:
    """Apply a change to a region, to muscles, or to the muscles within a region.

    A strength in a region multiplies the share of the muscle in its elements, and with it the passive
    stress of the fibres there. Raises TreatmentError if the region contains no element.
    """
    region = _region(face, step)
    names = [str(m) for m in face["muscle"].values]
    chosen = np.array([not step.muscles or name in step.muscles for name in names])
    element, muscle = face["bundle_index"].values, face["bundle_muscle"].values
    rows = chosen[muscle]
    if region is not None:
        rows &= region[element]
        if step.muscles and not rows.any():
            raise TreatmentError(
                "too small",
                f"no part of {', '.join(step.muscles)} is in the region, expected some: check lip, "
                "centre and radius, or omit the muscles",
            )
    if step.stiffness != 1.0:
        inside = np.ones(face.sizes["element"], dtype=bool) if region is None else region.copy()
        if step.muscles:
            of_muscle = np.zeros_like(inside)
            of_muscle[element[rows]] = True
            inside &= of_muscle
        face = with_factor(face, np.where(inside, step.stiffness, 1.0))
    if step.strength != 1.0:
        if region is None:
            face = with_strength(face, np.where(chosen, step.strength, 1.0))
        else:
            face = with_share(face, np.where(rows, step.strength, 1.0))
    return face, {"rows_of_muscles": int(rows.sum())}


def _region(face: xr.Dataset, step: Change) -> NDArray[np.bool_] | None:
    """Mask of the elements of the region; None without one."""
    if step.lip is None and step.centre is None:
        return None
    position = face["position"].values
    centres = element_centres(position, face["connectivity"].values)
    inside = np.ones(len(centres), dtype=bool)
    if step.lip is not None:
        rim = lip_rim(face)
        away = {
            lip: KDTree(position[getattr(rim, lip)]).query(centres)[0] for lip in ("upper", "lower")
        }
        other = away["lower" if step.lip == "upper" else "upper"]
        inside &= (away[step.lip] < LIP) & (away[step.lip] < other)
    if step.centre is not None:
        inside &= (
            np.linalg.norm(centres - 1e-3 * np.array(step.centre), axis=1) < 1e-3 * step.radius
        )
    if not inside.any():
        raise TreatmentError(
            "too small",
            f"no element is within {step.radius:g} mm of {step.centre} mm, expected some: check centre "
            "and radius, in mm in the frame of the face",
        )
    return inside


def apply_palsy(face: xr.Dataset, step: Palsy) -> tuple[xr.Dataset, dict[str, Any]]:
    """Multiply the active stress of the weakened muscles by 1 - degree."""
    weak = step.weakened()
    names = [str(m) for m in face["muscle"].values]
    factor = np.where(np.isin(names, weak), 1.0 - step.degree, 1.0)
    if step.degree == 0.0:
        return face, {"effect": "none: the degree is 0"}
    return with_strength(face, factor), {"muscles": list(weak)}
