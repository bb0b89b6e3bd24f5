"""Configuration of a study, immutable and validated."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from emgface.anatomy.airway.parameters import TractParameters
from emgface.choices import ESKES, Parameters, choice, parameter
from emgface.errors import FaceError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.resolution import Resolution
from emgface.face.template.volunteers import PRESETS, preset_measures
from emgface.inverse.configuration import InverseConfiguration
from emgface.muscles import INSTRUCTIONS
from emgface.signals.parameters import SignalChain
from emgface.signals.truth import TRUE_STRATEGY
from emgface.study.axes import Axis, Design
from emgface.study.comparison import AlignmentParameters, ScoreParameters
from emgface.study.exclusions import Exclusion

VOLUNTEER = "{volunteer}"  #: part of a path that stands for the name of a volunteer
STUDY_VERSION = 1  #: version of the format of a study file
StudyStrategy = Literal["act_all", "act_3", "act_rel", "act_threshold", "inverse", "assisted"]
"""Strategies of the signal chain, and those that follow the markers."""


class RecordingsConfiguration(Parameters):
    """Folder and selection of the recordings."""

    folder: Path = choice(Path("recordings"), "Folder of the recordings; relative to this file.")
    mapping: Path | None = choice(
        None,
        "TOML file that maps the labels of other formats to names, relative to this file; or a pattern "
        "of file names such as '{volunteer}_{instruction}_{repetition}.c3d'.",
    )
    reference_folder: Path | None = choice(
        None, "Folder of maximum-effort recordings, for normalisation over a reference."
    )
    volunteers: tuple[str, ...] | None = choice(None, "Volunteers to include; default: all.")
    instructions: tuple[str, ...] = choice(
        tuple(INSTRUCTIONS), "Instructions to include.", source=f"{ESKES}, Methods"
    )
    repetitions: tuple[int, ...] | None = choice(None, "Repetitions to include; default: all.")
    exclusions: Path | None = choice(
        None,
        "TOML file of excluded trials with reasons, as written by 'emgface check "
        "--exclude'; relative to this file.",
    )

    @field_validator("instructions")
    @classmethod
    def _known(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        unknown = [value for value in values if value not in INSTRUCTIONS]
        if unknown:
            raise ValueError(
                f"instruction {', '.join(unknown)} is unknown, expected some of "
                f"{', '.join(INSTRUCTIONS)}"
            )
        return values


class TemplateParameters(Parameters):
    """Parameters of the generated lower face."""

    resolution: Resolution = parameter(
        "medium",
        "Number of elements: coarse (576), medium (2448), fine (6480), or an approximate number.",
    )
    preset: str = choice("adult", f"Group of people: {', '.join(PRESETS)}.")
    seed: int | None = parameter(
        None,
        "Seed for drawing a random person of the group; default: the means of the group.",
        ge=0,
    )

    @field_validator("preset")
    @classmethod
    def _known(cls, value: str) -> str:
        try:
            preset_measures(value)
        except FaceError as error:
            raise ValueError(str(error)) from error
        return value


class FaceConfiguration(Parameters):
    """Face model to simulate: a file or the template, which is the default."""

    path: Path | None = choice(
        None,
        "Face model written by 'emgface import face' or 'emgface build face'; relative to "
        "this file. Without a path, the template is generated.",
        note="with {volunteer} in it, such as 'faces/{volunteer}.nc', every volunteer has a face",
    )
    head: Path | None = choice(
        None,
        "Head with face and jaw (emgface build head), instead of path: recordings with channels of the "
        "jaw move it, others its face alone.",
        note="motions of a head take linearly implicit steps of 5 ms, and are repeated with 10 ms "
        "for their error",
    )
    template: TemplateParameters | None = Field(
        default=None, description="Parameters of the generated face, instead of path."
    )

    @property
    def per_volunteer(self) -> bool:
        """True if every volunteer has a face of his or her own."""
        return self.path is not None and VOLUNTEER in str(self.path)

    @model_validator(mode="after")
    def _one_source(self) -> "FaceConfiguration":
        given = {"path": self.path, "head": self.head, "template": self.template}
        named = [name for name, value in given.items() if value is not None]
        if len(named) > 1:
            raise ValueError(
                f"both {' and '.join(named)} are specified, expected one source of the face: remove the "
                "other"
            )
        return self


class StudyConfiguration(Parameters):
    """All parameters of a study, as in study.toml."""

    schema_version: int = parameter(STUDY_VERSION, "Version of the format of this file.")
    name: str = choice("study", "Name of the study.")
    strategies: tuple[StudyStrategy, ...] = choice(
        ("act_all", "act_3", "act_rel"),
        "Activation strategies to compare.",
        source=f"{ESKES}, Methods",
        note="inverse and assisted follow the markers, without and with sEMG; each pair of markers "
        "is scored with the activation estimated without it",
    )
    activation_source: Literal["estimated", "true"] = choice(
        "estimated",
        "Source of the activation: estimated from sEMG, or the true activation of simulated recordings.",
        note="'true' tests the steps after the activation; its only strategy is 'true'",
    )
    seed: int = parameter(0, "Seed of all random numbers (simulated volunteers).", ge=0)
    recordings: RecordingsConfiguration = Field(
        default=RecordingsConfiguration(), description="Recordings to include."
    )
    face: FaceConfiguration = Field(default=FaceConfiguration(), description="Face model.")
    signals: SignalChain = Field(
        default=SignalChain(), description="Parameters from recording to activation."
    )
    simulation: SimulationParameters = Field(
        default=SimulationParameters(), description="Parameters of the simulation."
    )
    inverse: InverseConfiguration = Field(
        default=InverseConfiguration(),
        description="Parameters of the strategies inverse and assisted.",
    )
    alignment: AlignmentParameters = Field(
        default=AlignmentParameters(), description="Synchronisation, Eqs 9-10."
    )
    score: ScoreParameters = Field(default=ScoreParameters(), description="Scores, Eqs 11-13.")
    tract: TractParameters | None = Field(
        default=None,
        description="Vocal tract behind the lips, whose formants are computed for every trial. "
        "Without this table there are none.",
    )
    axis_design: Design = choice(
        "one_at_a_time",
        "Combinations of the levels of several axes: one axis at a time differs from its "
        "reference, or all combinations.",
    )
    axis: tuple[Axis, ...] = Field(
        default=(),
        description="Choices to vary, one table each. Each is a dimension of the cube.",
    )
    exclude: tuple[Exclusion, ...] = Field(
        default=(), description="Trials to exclude, one table each. They remain in the cube."
    )

    @field_validator("schema_version")
    @classmethod
    def _present(cls, version: int) -> int:
        if version != STUDY_VERSION:
            raise ValueError(
                f"the study file has version {version} of its format, expected version {STUDY_VERSION}:"
                f" write it again with 'emgface study template'"
            )
        return version

    @field_validator("strategies")
    @classmethod
    def _some(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        if not values or len(set(values)) < len(values):
            raise ValueError("strategies must contain at least one strategy, and each only once")
        return values

    @property
    def strategy_names(self) -> tuple[str, ...]:
        """Strategies along the dim of the cube."""
        return (TRUE_STRATEGY,) if self.activation_source == "true" else self.strategies
