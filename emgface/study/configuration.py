"""A study as one frozen, checked configuration."""

from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator

from emgface.choices import ESKES, OWN, Parameters, choice, parameter
from emgface.errors import FaceError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.resolution import Resolution
from emgface.face.template.volunteers import PRESETS, preset_measures
from emgface.muscles import INSTRUCTIONS
from emgface.signals.parameters import SignalChain, StrategyName
from emgface.study.axes import Axis, Design
from emgface.study.comparison import AlignmentParameters, ScoreParameters
from emgface.study.exclusions import Exclusion

STUDY_VERSION = 1
"""Version of the form of a study file."""
TRUE_STRATEGY = "true"
"""Name under which trials driven by the true activation stand in the cube."""


class RecordingsConfiguration(Parameters):
    """Where the recordings are and which of them take part."""

    folder: Path = choice(
        Path("recordings"),
        "Folder of the recordings; relative to this file.",
    )
    mapping: Path | None = choice(
        None,
        "TOML file that maps labels of foreign files to names; relative to this file.",
    )
    reference_folder: Path | None = choice(
        None,
        "Folder of maximum-effort recordings, for normalisation over a reference.",
    )
    volunteers: tuple[str, ...] | None = choice(
        None,
        "Volunteers that take part; all when absent.",
    )
    instructions: tuple[str, ...] = choice(
        tuple(INSTRUCTIONS), "Instructions that take part.", source=f"{ESKES}, Methods"
    )
    repetitions: tuple[int, ...] | None = choice(
        None,
        "Repetitions that take part; all when absent.",
    )
    exclusions: Path | None = choice(
        None,
        "TOML file of trials that are excluded, with reasons, as 'emgface data check --exclude' "
        "writes it; relative to this file.",
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
    """The parametric lower face, generated."""

    resolution: Resolution = parameter(
        "medium",
        "Number of elements: coarse (576), medium (2448), fine (6480) or about how many.",
        unit="1",
        source=OWN,
    )
    preset: str = choice(
        "adult",
        f"Group of people: {', '.join(PRESETS)}.",
    )
    seed: int | None = parameter(
        None,
        "Seed that draws a random person of the group; the means of the group when absent.",
        unit="1",
        source=OWN,
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
    """Which face model is simulated: a file or the template, which is the default."""

    path: Path | None = choice(
        None,
        "Face model as written by 'emgface face import' or 'emgface face build'; relative to this "
        "file. Without path, the template is generated.",
    )
    template: TemplateParameters | None = Field(
        default=None, description="The parametric lower face; in place of path."
    )

    @model_validator(mode="after")
    def _one_source(self) -> "FaceConfiguration":
        if self.path is not None and self.template is not None:
            raise ValueError(
                "path and template are given, expected one source of the face: delete the other"
            )
        return self


class StudyConfiguration(Parameters):
    """All choices of a study, as study.toml holds them."""

    schema_version: int = parameter(
        STUDY_VERSION, "Version of the form of this file.", unit="1", source=OWN
    )
    name: str = choice(
        "study",
        "Name of the study.",
    )
    strategies: tuple[StrategyName, ...] = choice(
        ("act_all", "act_3", "act_rel"),
        "Activation strategies that are compared.",
        source=f"{ESKES}, Methods",
    )
    activation_source: Literal["estimated", "true"] = choice(
        "estimated",
        "Activation from sEMG, or the true one that simulated recordings carry.",
        note="'true' tests the chain behind the activation; its only strategy is 'true'",
    )
    seed: int = parameter(
        0, "Seed of everything drawn at random (simulated volunteers).", unit="1", source=OWN, ge=0
    )
    recordings: RecordingsConfiguration = Field(
        default=RecordingsConfiguration(), description="Recordings that take part."
    )
    face: FaceConfiguration = Field(default=FaceConfiguration(), description="Face model.")
    signals: SignalChain = Field(default=SignalChain(), description="From recording to activation.")
    simulation: SimulationParameters = Field(
        default=SimulationParameters(), description="Mechanics of the face."
    )
    alignment: AlignmentParameters = Field(
        default=AlignmentParameters(), description="Synchronisation, Eqs 9-10."
    )
    score: ScoreParameters = Field(default=ScoreParameters(), description="Scores, Eqs 11-13.")
    axis_design: Design = choice(
        "one_at_a_time",
        "Which combinations of the levels of several axes are run: one off its reference at a "
        "time, or all.",
    )
    axis: tuple[Axis, ...] = Field(
        default=(),
        description="Choices that are varied, to see what they change; one table each. Each is a "
        "dim of the cube.",
    )
    exclude: tuple[Exclusion, ...] = Field(
        default=(), description="Trials that are excluded; one table each. They stay in the cube."
    )

    @field_validator("schema_version")
    @classmethod
    def _present(cls, version: int) -> int:
        if version != STUDY_VERSION:
            raise ValueError(
                f"the study file follows version {version} of its form, expected version "
                f"{STUDY_VERSION}: write it again with 'emgface study template'"
            )
        return version

    @field_validator("strategies")
    @classmethod
    def _some(cls, values: tuple[str, ...]) -> tuple[str, ...]:
        if not values or len(set(values)) < len(values):
            raise ValueError("strategies must name at least one strategy, and each only once")
        return values

    @property
    def strategy_names(self) -> tuple[str, ...]:
        """Strategies along the dim of the cube."""
        return (TRUE_STRATEGY,) if self.activation_source == "true" else self.strategies
