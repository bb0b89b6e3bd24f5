"""Plan of a treatment: its steps, their parameters, and the reader of its file."""

import json
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import BeforeValidator, Discriminator, Field, field_validator, model_validator

from emgface.choices import Parameters, choice, configure, parameter
from emgface.errors import ConfigurationError
from emgface.muscles import MODELLED, MUSCLES
from emgface.texts import read_toml
from emgface.treatment.lengths import Lengths

PLAN_VERSION: Final = 1
CLINICAL: Final = "Mosebo et al., plastsurgeon.com: primary closure up to about 30 % of a lip"
NOT_VALIDATED: Final = "research model, not validated on patients; not for treatment decisions"
"""Sentence on every page and in every file of a treatment."""


def _several(value: Any) -> Any:
    """One name as the only one of a list, other values as they are."""
    return (value,) if isinstance(value, str) else value


Muscles = Annotated[tuple[str, ...], BeforeValidator(_several)]


def _known(values: Muscles) -> Muscles:
    """Muscles with side; a name without side stands for both sides."""
    muscles: list[str] = []
    for value in values:
        both = [f"{value}_L", f"{value}_R"] if value in MODELLED else [value]
        if both[0] not in MUSCLES:
            raise ValueError(
                f"muscle {value} is unknown, expected some of {', '.join(MODELLED)}, with _L or _R for "
                "one side"
            )
        muscles += both
    return tuple(dict.fromkeys(muscles))


class Scar(Lengths):
    """Healed tissue around a suture. No measured values exist: vary both numbers."""

    radius: float = parameter(
        3.0, "Distance from the suture up to which tissue is scar.", unit="mm", ge=0, le=20
    )
    stiffness: float = parameter(
        3.0,
        "Factor on the passive moduli of the scar.",
        note="no source: vary it, for example from 1 to 10",
        ge=0.1,
        le=100,
    )


class Sutured(Lengths):
    """Part of every step that cuts the lip."""

    lip: Literal["upper", "lower"] = choice("lower", "Lip.")
    place: float = parameter(
        0.5,
        "Place along the margin, from the left corner (0) to the right corner (1) of the subject.",
        ge=0,
        le=1,
    )
    method: Literal["conforming", "elements"] = choice(
        "conforming",
        "'conforming' divides elements along the cut; 'elements' removes those whose centre is inside, "
        "and an incision then follows the nearest edges.",
    )
    rejoin: Literal["all", "none"] | Muscles = choice(
        "all",
        "Muscles whose cut fibres are joined across the suture; those of the others end at it.",
        source=CLINICAL.split(":")[0] + ": the ring of orbicularis oris must be joined",
    )
    retraction: float = parameter(
        6.0,
        "Distance from the suture over which a cut fibre that is not joined has no active stress.",
        unit="mm",
        note="no source: vary it",
        ge=0,
        le=30,
    )
    scar: Scar | None = Field(default=Scar(), description="Scar, or none with `scar = false`.")

    @field_validator("scar", mode="before")
    @classmethod
    def _without(cls, value: Any) -> Any:
        if value is True:
            return Scar()
        if value is not False and value is not None and not isinstance(value, Mapping | Scar):
            raise ValueError(
                f"scar = {value!r}: expected a table such as {{radius = 3.0, stiffness = 3.0}}, or false"
            )
        return None if value is False else value

    @field_validator("rejoin", mode="before")
    @classmethod
    def _rejoined(cls, value: Any) -> Any:
        if value in ("all", "none") or not isinstance(value, str | list | tuple):
            return value
        return _known(tuple(map(str, _several(value))))

    def joins(self, muscle: str) -> bool:
        """Return True if the fibres of a muscle are joined across the suture."""
        return self.rejoin == "all" or (self.rejoin != "none" and muscle in self.rejoin)


class Incision(Sutured):
    """Cut from the margin into the lip that removes nothing."""

    kind: Literal["incision"] = "incision"
    height: float = parameter(8.0, "Length of the cut.", unit="mm", ge=0, le=40)


Shape = Literal["V", "W", "shield", "rectangle"]


class Wedge(Sutured):
    """Excision of a part of a lip, and closure of its edges."""

    kind: Literal["wedge"] = "wedge"
    shape: Shape = choice("V", "Shape in the skin.", source=CLINICAL)
    width: float = parameter(12.0, "Length of the margin that is removed.", unit="mm", ge=0, le=80)
    height: float = parameter(12.0, "Depth from the margin.", unit="mm", ge=0, le=40)
    layers: Literal["all", "outer", "outer and centre"] = choice(
        "all", "Layers that are removed, from the skin inwards."
    )


WEDGE_NUMBERS: Final = ("place", "width", "height")
"""Names of the numbers of a wedge that contains a tumour, in it and in the report of the step."""


class Tumour(Sutured):
    """Excision of the smallest shape that contains a tumour with a margin."""

    kind: Literal["tumour"] = "tumour"
    shape: Shape = choice("shield", "Shape in the skin.", source=CLINICAL)
    centre: tuple[float, float, float] | None = parameter(
        None, "Centre of an ellipsoid, in the frame of the face.", unit="mm"
    )
    radii: tuple[float, float, float] = parameter(
        (4.0, 4.0, 4.0), "Radii of the ellipsoid along x, y and z.", unit="mm"
    )
    surface: str | None = choice(None, "File of a closed surface (.stl or .obj), in place of it.")
    unit: Literal["mm", "m"] = choice("mm", "Unit of the surface.")
    margin: float = parameter(5.0, "Margin of healthy tissue.", unit="mm", ge=0, le=20)

    @model_validator(mode="after")
    def _given_once(self) -> "Tumour":
        if (self.centre is None) == (self.surface is None):
            raise ValueError(
                "a tumour has either centre and radii or a surface, expected one of them"
            )
        if min(self.radii) <= 0.0:
            raise ValueError(f"radii = {self.radii}: expected positive lengths in mm")
        return self

    def wedge(self, drawn: Mapping[str, float]) -> Wedge:
        """Wedge of the same shape and suture, with the place and size `WEDGE_NUMBERS`."""
        own: dict[str, Any] = {n: getattr(self, n) for n in (*Sutured.model_fields, "shape")}
        return Wedge.model_validate(own | {name: drawn[name] for name in WEDGE_NUMBERS})


class Change(Lengths):
    """Factor on stiffness or strength: radiotherapy, fibrosis, training, botulinum toxin."""

    kind: Literal["change"] = "change"
    muscles: Muscles = choice((), "Muscles; empty: all.")
    lip: Literal["upper", "lower"] | None = choice(None, "Lip, as a region; default: none.")
    centre: tuple[float, float, float] | None = parameter(
        None, "Centre of a spherical region, in the frame of the face.", unit="mm"
    )
    radius: float = parameter(10.0, "Radius of the region.", unit="mm", gt=0, le=200)
    stiffness: float = parameter(1.0, "Factor on the passive moduli.", ge=0.01, le=100)
    strength: float = parameter(1.0, "Factor on the active stress.", ge=0, le=5)

    _muscles = field_validator("muscles")(_known)

    @model_validator(mode="after")
    def _changes(self) -> "Change":
        if self.stiffness == 1.0 and self.strength == 1.0:
            raise ValueError("stiffness and strength are 1, expected a factor on one of them")
        if self.strength > 1.0 and (self.lip or self.centre):
            raise ValueError(
                f"strength = {self.strength} in a region, expected at most 1 there: larger factors "
                "apply to whole muscles, without lip and centre"
            )
        return self


BRANCHES: Final = {
    "all": MODELLED,
    "zygomatic": ("ZYG", "LLSAN", "LAO"),
    "buccal": ("RIS", "BUC", "OOP", "OOM", "LLSAN", "LAO"),
    "mandibular": ("DAO", "DLI", "MEN"),
}
"""Muscles of the model by branch of the facial nerve; the innervation of some varies."""


class Palsy(Lengths):
    """Weakness of the muscles of one or both sides."""

    kind: Literal["palsy"] = "palsy"
    branch: Literal["all", "zygomatic", "buccal", "mandibular"] = choice(
        "all", "Branch of the facial nerve.", source="standard anatomy; several muscles have two"
    )
    muscles: Muscles = choice((), "Muscles, in place of a branch.")
    side: Literal["left", "right", "both"] = choice("left", "Side of the subject.")
    degree: float = parameter(1.0, "Share of the active stress that is lost.", ge=0, le=1)

    _muscles = field_validator("muscles")(_known)

    def weakened(self) -> Muscles:
        """Names of the muscles, with side."""
        named = self.muscles or _known(BRANCHES[self.branch])
        sides = {"left": "L", "right": "R"}
        return tuple(m for m in named if self.side == "both" or m[-1] == sides[self.side])

    @model_validator(mode="after")
    def _reaches(self) -> "Palsy":
        if not self.weakened():
            raise ValueError(
                f"none of the muscles {', '.join(self.muscles)} is on side = '{self.side}', expected one"
            )
        return self


class Resection(Parameters):
    """Loss of one side of the mandible, of a jaw model instead of a face."""

    kind: Literal["resection"] = "resection"
    side: Literal["left", "right"] = choice("left", "Side of the subject.")
    reconstruction: Literal["none", "plate", "graft"] = choice(
        "none",
        "'none' leaves the segment of bone and the joint of that side out; 'plate' restores both, "
        "'graft' also the middle and posterior temporalis.",
        source="resection models of the published collection",
    )
    scar_stiffness: float = parameter(
        800.0,
        "Stiffness of each of three scars between jaw and skull; 0 is none.",
        unit="N/m",
        source="default of a published demonstration, without measured origin",
        note="vary it",
        ge=0,
        le=1e5,
    )
    scar_place: Literal["ramus", "border"] = choice(
        "ramus",
        "Scars along the ramus, between molar and condyle, or at its lower 'border', as in the "
        "published demonstration.",
        note="the direction of the opening depends on it: vary it",
    )
    hyoid: Literal["free", "fixed"] = choice(
        "free",
        "'free' leaves hyoid and larynx as they are in the jaw model; 'fixed' holds them, as the "
        "published demonstration does.",
    )


Step = Annotated[Wedge | Tumour | Incision | Change | Palsy | Resection, Discriminator("kind")]
CUTS: Final = (Wedge, Tumour, Incision)


class Plan(Parameters):
    """Steps of a treatment, in their order."""

    schema_version: Literal[1] = parameter(PLAN_VERSION, "Version of the format.", unit="-")
    name: str = choice("plan", "Name of the plan.")
    step: tuple[Step, ...] = Field(default=(), description="Steps.", max_length=50)

    @field_validator("step", mode="before")
    @classmethod
    def _listed(cls, value: Any) -> Any:
        if isinstance(value, Mapping):
            raise ValueError(
                "step is one table, expected a list of steps: write [[step]] before each"
            )
        return value

    @field_validator("name")
    @classmethod
    def _short(cls, value: str) -> str:
        if len(value) > 80 or not value.isprintable():
            raise ValueError("the name of the plan is not printable or longer than 80 characters")
        return value


def _stated(plan: Any) -> Plan:
    """Plan of a file; ConfigurationError if it is none, as one of a later version."""
    return plan if isinstance(plan, Plan) else configure(Plan, plan, where="plan of a treatment")


def applied_plan(entry: Mapping[str, Any]) -> Plan:
    """Plan of a treatment (`emgface.face.identity.treatments`), with wedges in place of tumours.

    The wedge around a tumour is that of the report of the step; it requires no file of a surface.
    """
    plan = _stated(entry["plan"])
    steps = [
        step.wedge(report)
        if isinstance(step, Tumour) and set(WEDGE_NUMBERS) <= set(report)
        else step
        for step, report in zip(plan.step, entry["steps"], strict=True)
    ]
    return plan.model_copy(update={"step": tuple(steps)})


def steps_digest(plans: Iterable[Any]) -> str:
    """Digest of the steps of some plans (as data) one after another, whatever their names are."""
    steps = [step for plan in plans for step in _stated(plan).step]
    text = json.dumps([step.model_dump(mode="json") for step in steps], sort_keys=True)
    return f"steps-{sha256(text.encode()).hexdigest()[:12]}"  # no number in a table


def read_plan(path: Path) -> Plan:
    """Read a plan from TOML; ConfigurationError if it is not valid."""
    values = read_toml(path)
    if values and not set(values) & set(Plan.model_fields):
        raise ConfigurationError(
            f"{path} is no plan of a treatment: it has {', '.join(values)}, expected a name and steps, "
            "each after [[step]] with its kind"
        )
    return configure(Plan, values, where=str(path))


def plan_schema_text() -> str:
    """JSON Schema of a plan, as the text of ``data_schema/treatment.json``."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "version": PLAN_VERSION,
        **Plan.model_json_schema(),
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
