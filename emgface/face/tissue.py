"""Tissue laws of a face by layer, muscle and element."""

import re
from dataclasses import is_dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import AfterValidator, WithJsonSchema, field_validator, model_validator
from scipy.spatial import KDTree

from emgface.choices import Parameters, choice, parameter, positive
from emgface.errors import ConfigurationError, FaceError
from emgface.face.parts import CENTRE, INNER, OUTER
from emgface.face.quality import element_centres
from emgface.face.tension_lines import skin_axes
from emgface.muscles import MUSCLES
from emgface.plugins import names_schema, plugins, require_name
from sim import CoRotational, LinearElastic, Material, Prony, SceneError
from sim.laws import ISOCHORIC_LAWS, TENSOR_LAWS, BulkLaw, IsochoricLaw, TensorLaw
from sim.laws.parameters import units

TISSUE_LAWS: dict[str, Any] = {
    re.sub(r"(?<!^)(?=[A-Z])", "_", law.__name__).lower().removesuffix("_elastic"): law
    for law in (*ISOCHORIC_LAWS, *TENSOR_LAWS)
}
"""Laws of passive tissue, by their name in a study file, such as "neo_hooke" and "linear"."""

NODES_BY_LAYER = {"inner": INNER, "centre": CENTRE, "outer": OUTER}

Coefficient = float | tuple[float, ...]


class Tissue(Parameters):
    """Tissue of the elements that meet all conditions, which replaces that of the whole face."""

    layers: tuple[Literal["inner", "centre", "outer"], ...] = choice(
        (), "Layers of elements; empty: all."
    )
    muscles: tuple[str, ...] = choice(
        (), "Muscles, with side, to any of which the elements belong; empty: all elements."
    )
    elements: tuple[int, ...] = choice((), "Ids of elements of the face model; empty: all.")
    law: Annotated[
        str,
        AfterValidator(lambda name: require_name("law", name, TISSUE_LAWS)),
        WithJsonSchema(names_schema(TISSUE_LAWS)),
    ] = choice(
        "mooney_rivlin",
        "Law of the passive tissue.",
        note="the first axis of 'fung' is the tension line of the nearest skin; 'linear' is "
        "valid for small rotations only",
    )
    coefficients: dict[str, Coefficient] = parameter(
        {},
        "Coefficients of the law, with the names of its class in sim; default: those of the class.",
        unit="Pa",
        source="the class of the law",
    )
    stiffness: float = positive(
        1.0,
        "Factor on all coefficients of the law that are stresses.",
        note="with the defaults of 'fung', 0.5 is young and 2 is old skin",
    )
    kappa: float | None = positive(
        None,
        "Bulk modulus; default: that of the face.",
        unit="Pa",
        note="'linear' and 'co_rotational' have no separate bulk modulus",
    )
    density: float | None = positive(None, "Density; default: that of the face.", unit="kg/m^3")
    relaxing: tuple[float, ...] = parameter(
        (),
        "Fractions of the stress that relax (Prony series); empty: elastic.",
        note="the coefficients are then the instantaneous moduli",
    )
    times: tuple[float, ...] = parameter((), "Relaxation time of each fraction.", unit="s")

    @field_validator("muscles")
    @classmethod
    def _known(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [value for value in values if value not in MUSCLES]
        if unknown:
            raise ValueError(
                f"muscle {', '.join(unknown)} is unknown, expected some of {', '.join(MUSCLES)}"
            )
        return values

    @model_validator(mode="after")
    def _possible(self) -> "Tissue":
        names = units(law_named(self.law))
        unknown = [name for name in self.coefficients if name not in names]
        if unknown:
            raise ValueError(
                f"coefficient {', '.join(unknown)} of law '{self.law}' is unknown, expected some of "
                f"{', '.join(names)}"
            )
        try:
            material = self.material(None, 1000.0)
        except (SceneError, TypeError) as error:
            raise ValueError(str(error)) from error
        if material.bulk is None and self.kappa is not None:
            raise ValueError(
                f"law '{self.law}' determines the volume change itself: remove kappa and "
                "specify poisson among its coefficients"
            )
        return self

    def passive_law(self) -> IsochoricLaw | TensorLaw:
        """Law with its coefficients, times the stiffness."""
        law = law_named(self.law)(**self.coefficients)
        if self.stiffness == 1.0:
            return law
        moduli = [name for name, unit in units(law).items() if unit == "Pa"]
        return replace(law, **{n: _times(self.stiffness, getattr(law, n)) for n in moduli})

    def material(self, bulk: BulkLaw | None, density: float) -> Material:
        """Material, with the bulk law and density [kg/m^3] of the face unless specified for the tissue.

        `bulk` is the pointwise law of the volume for an isochoric law, or None.
        """
        law = self.passive_law()
        own = None if isinstance(law, LinearElastic | CoRotational) else bulk
        prony = Prony(self.relaxing, self.times) if self.relaxing or self.times else None
        return Material(law, own, self.density or density, prony)

    def stiffened(self, factor: float) -> "Tissue":
        """Tissue with all moduli, including the bulk modulus, multiplied by a factor."""
        kappa = None if self.kappa is None else factor * self.kappa
        return self.model_copy(update={"stiffness": factor * self.stiffness, "kappa": kappa})

    def __str__(self) -> str:
        """Describe the location and the law of the tissue."""
        phrases = [f"law {self.passive_law()} (stresses in Pa)"]
        if self.kappa is not None:
            phrases.append(f"kappa {self.kappa / 1e3:g} kPa")
        if self.density is not None:
            phrases.append(f"density {self.density:g} kg/m³")
        if self.relaxing:
            pairs = zip(self.relaxing, self.times, strict=True)
            phrases.append(
                "relaxation of " + " and ".join(f"{100 * g:g} % with {tau:g} s" for g, tau in pairs)
            )
        return f"{self._where()} had {', '.join(phrases)}"

    def _where(self) -> str:
        conditions = [f"the {', '.join(self.layers)} layer"] if self.layers else []
        conditions += [f"the muscles {', '.join(self.muscles)}"] if self.muscles else []
        conditions += [f"{len(self.elements)} listed elements"] if self.elements else []
        return " within ".join(conditions) or "the whole face"

    def chosen(self, face: xr.Dataset) -> NDArray[np.bool_]:
        """Mask of the elements of a face to which the tissue applies, shape (n_elements,).

        Raises FaceError if the face lacks a listed element, or no element meets the conditions.
        """
        chosen = np.ones(face.sizes["element"], dtype=bool)
        if self.layers:
            chosen &= np.isin(face["layer"].values, [NODES_BY_LAYER[name] for name in self.layers])
        if self.muscles:
            rows = np.isin(face["muscle"].values[face["bundle_muscle"].values], self.muscles)
            inside = np.zeros_like(chosen)
            inside[face["bundle_index"].values[rows]] = True
            chosen &= inside
        if self.elements:
            ids = face["element_id"].values
            missing = np.setdiff1d(self.elements, ids)
            if missing.size:
                raise FaceError(
                    f"a tissue lists element {missing[0]}, which is not in the face: expected ids from "
                    f"{ids.min()} to {ids.max()}"
                )
            chosen &= np.isin(ids, self.elements)
        if not chosen.any():
            raise FaceError(
                f"no element is in layers {list(self.layers)}, muscles {list(self.muscles)} "
                "and the listed elements: expected at least one, check the conditions of "
                "the tissue"
            )
        return chosen


def law_named(name: str) -> Any:
    """Class of a law of this package or of another one.

    Raises ConfigurationError if that of another package is no dataclass of quantities with a law of
    `sim` as its base, whose element loop computes it.
    """
    if name in TISSUE_LAWS:
        return TISSUE_LAWS[name]
    plugin = plugins("law")[name]
    law = plugin.load()
    if not (
        isinstance(law, type) and is_dataclass(law) and issubclass(law, tuple(TISSUE_LAWS.values()))
    ):
        raise ConfigurationError(
            f"the law '{name}' of {plugin.packages} is {law!r}, expected a dataclass with a law of sim "
            f"as its base ({', '.join(one.__name__ for one in TISSUE_LAWS.values())}): use another law"
        )
    return law


def scaled(material: Material, factor: float) -> Material:
    """Material with all moduli of its law and of its volume multiplied by a factor."""
    if factor == 1.0:
        return material
    law: Any = material.law
    bulk: Any = material.bulk
    moduli = [name for name, unit in units(law).items() if unit == "Pa"]
    law = replace(law, **{n: _times(factor, getattr(law, n)) for n in moduli})
    bulk = None if bulk is None else replace(bulk, kappa=factor * bulk.kappa)
    return replace(material, law=law, bulk=bulk)


def _times(factor: float, value: Coefficient) -> Coefficient:
    return tuple(factor * x for x in value) if isinstance(value, tuple) else factor * value


def material_axes(face: xr.Dataset) -> NDArray[np.float64]:
    """Axes (elements, 3, 3) of every element in columns, those of the nearest element of the skin.

    The columns are along the tension line, across it, and outwards. Raises FaceError if the face
    has no skin or no fibres.
    """
    element, axes = skin_axes(face)
    centres = element_centres(face["position"].values, face["connectivity"].values)
    nearest = KDTree(centres[element]).query(centres)[1]
    return np.ascontiguousarray(axes[nearest].transpose(0, 2, 1))
