"""Configuration of a study, immutable and validated: comparison, varied choices, all parameters."""

from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, field_validator, model_validator

from analysis.baselines import BASELINE_VARIABLES
from analysis.cube import MARKER_DIMS, OF_INCISOR, PER_MARKER, PER_TRIAL
from analysis.formants import FORMANT_VARIABLES
from analysis.matching import CLEAR_COSINE
from analysis.noise import SMALLEST_SNR
from analysis.trajectory import SMALLEST_MOTION
from emgface.anatomy.airway.parameters import TractParameters
from emgface.choices import ESKES, Parameters, choice, parameter
from emgface.errors import FaceError
from emgface.face.simulation_parameters import SimulationParameters
from emgface.face.template.resolution import Resolution
from emgface.face.template.volunteers import GROUP_PRESETS, preset_measures
from emgface.inverse.configuration import InverseConfiguration
from emgface.muscles import INSTRUCTIONS, LETTERS
from emgface.plugins import names_schema, require_name
from emgface.recordings.exclusions import Exclusion
from emgface.signals.parameters import STRATEGIES, SignalChain
from emgface.signals.truth import TRUE_STRATEGY


class AlignmentParameters(Parameters):
    """Synchronisation of measured with simulated motion (Eqs 9-10)."""

    scaling: Literal["length", "search", "none"] = choice(
        "length",
        "Scaling of the measured time: to the simulated duration, in addition searched, or none.",
        source=f"{ESKES}, Synchronisation",
    )
    scale_range: tuple[float, float] = parameter(
        (0.8, 1.25),
        "Smallest and largest factor of the search; scales outside this range are flagged.",
    )
    scale_step: float = parameter(0.01, "Relative step of the search.", gt=0, lt=0.5)
    max_shift: float | None = parameter(
        None,
        "Largest shift in either direction; default: bounded by least_overlap.",
        unit="s",
        ge=0,
    )
    least_overlap: float = parameter(
        0.75, "Fraction of the shorter trajectory that must overlap.", gt=0, le=1
    )
    least_gain: float = parameter(
        0.2,
        "Fraction of the unexplained variance that a larger shift or a scaling must remove "
        "to be chosen.",
        ge=0,
        lt=1,
    )
    cutoff: float = parameter(
        10.0,
        "Low-pass edge of the coefficient vectors for matching; 0 is no filter.",
        unit="Hz",
        note="the positions that are scored are not filtered",
        ge=0,
    )
    sign: Literal["direction", "correlation"] = choice(
        "direction",
        "Rule for the arbitrary sign of a principal component: the direction of the two "
        "components where it is clear, or the larger maximum of the correlation.",
        source="the paper does not specify it",
        note="with 'correlation', left-right-left may match its mirror image",
    )
    clear_cosine: float = parameter(
        CLEAR_COSINE,
        "Absolute cosine of the two components above which their direction determines the "
        "sign; below, the correlation determines it.",
        note="95 % point between random directions in six dimensions",
        ge=0,
        le=1,
    )
    centred: bool = choice(
        True,
        "Centre positions before the singular value decomposition.",
        source="the paper does not specify it",
        note="without centring, the first component is the mean posture",
    )
    subsample: bool = choice(True, "Refine the shift between samples.")

    def arguments(self) -> dict[str, Any]:
        """Return the options of `analysis.align.align`."""
        return {**self.model_dump(), "cutoff": self.cutoff or None}

    @model_validator(mode="after")
    def _spanning(self) -> "AlignmentParameters":
        if not 0 < self.scale_range[0] <= 1 <= self.scale_range[1]:
            raise ValueError(
                f"scale_range = {list(self.scale_range)} does not span 1: expected 0 < least <= 1 "
                "<= greatest"
            )
        return self


class ScoreParameters(Parameters):
    """Parameters of the 3D correlation (Eqs 11-13)."""

    form: Literal["consistent", "as_printed"] = choice(
        "consistent",
        "Divisors of covariance and standard deviations: equal, so that rho(v, v) = 1, or n "
        "and n - 1 as printed.",
        source=f"{ESKES}, Eqs 12-13",
    )
    reference: Literal["mean", "first", "origin"] = choice(
        "mean", "Origin of the positions in the root-mean-square error."
    )
    smallest_motion: float = parameter(
        SMALLEST_MOTION,
        "Root-mean-square displacement below which a marker is regarded as not moving and has no rho.",
        unit="m",
        note="for simulated markers, which have no noise; above the tolerance of the solver",
        ge=0,
    )
    smallest_snr: float = parameter(
        SMALLEST_SNR,
        "Variance of the motion of a measured marker divided by that of its noise, below "
        "which it has no rho.",
        note="with a ratio of 1, noise alone multiplies a correlation by 0.71",
        ge=0,
    )


Design = Literal["one_at_a_time", "factorial"]
Value = bool | int | float | str
Label = str | float

CUBE_NAMES = {
    *MARKER_DIMS, *PER_MARKER, *PER_TRIAL, *OF_INCISOR, *BASELINE_VARIABLES, *FORMANT_VARIABLES,
    "formant", "instant", "status", "reason", "marker_reason", "skill_reason",
}  # fmt: skip
"""Names used in a cube."""


class Axis(Parameters):
    """Varied choice. Its levels are a dimension of the cube, the first is the reference."""

    parameters: tuple[str, ...] = choice(
        (),
        "Parameters to vary, with their tables, such as 'signals.mapping.mapping_stage'; "
        "several are varied together.",
    )
    levels: tuple[Value | tuple[Value, ...], ...] = choice(
        (),
        "Values, the reference first; for several parameters, lists of one value for each.",
        note="in the unit of the parameter; with several parameters, the values of the first "
        "label the dimension",
    )
    name: str | None = choice(
        None,
        "Name of the dimension; default: the last part of the first parameter, with its "
        "table if the cube already has that name.",
    )

    @property
    def dim(self) -> str:
        """Name of the dim."""
        if self.name is not None:
            return self.name
        table, _, last = self.parameters[0].rpartition(".")
        # The cube has a variable sigma_max, the value with which a trial was simulated.
        return f"{table.rpartition('.')[2]}_{last}" if last in CUBE_NAMES else last

    def values(self) -> list[tuple[Value, ...]]:
        """Return one value per parameter, for each level."""
        return [level if isinstance(level, tuple) else (level,) for level in self.levels]

    def labels(self) -> list[Label]:
        """Return the labels along the dim: numbers, text, or file names without suffix."""
        names: list[Label] = []
        for first, *_ in self.values():
            if isinstance(first, bool):
                names.append(str(first).lower())
            elif isinstance(first, int | float):
                names.append(float(first))
            elif self.parameters[0] == "face.path":
                names.append(_file_label(first))
            else:
                names.append(first)
        return names


def _file_label(name: str) -> str:
    """Name of a file without suffix; of one file per volunteer, what precedes the volunteer."""
    path = PurePosixPath(name.replace("\\", "/"))
    own = path.stem.replace("{volunteer}", "").strip("_-. ")
    return own or path.parent.name.replace("{volunteer}", "").strip("_-. ") or path.stem


VOLUNTEER = "{volunteer}"  #: part of a path that stands for the name of a volunteer
STUDY_VERSION = 1  #: version of the format of a study file
OF_STUDIES: Final = (*STRATEGIES, "inverse", "assisted")
"""Strategies of the signal chain, and those that follow the markers."""
StudyStrategy = Annotated[
    str,
    AfterValidator(lambda name: require_name("strategy", name, OF_STUDIES)),
    WithJsonSchema(names_schema(OF_STUDIES)),
]


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
                f"instruction {', '.join(unknown)} is unknown, expected some of {LETTERS}"
            )
        return values


class TemplateParameters(Parameters):
    """Parameters of the generated lower face."""

    resolution: Resolution = parameter(
        "medium",
        "Number of elements: coarse (576), medium (2448), fine (6480), or an approximate number.",
    )
    preset: str = choice("adult", f"Group of people: {', '.join(GROUP_PRESETS)}.")
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

    @model_validator(mode="after")
    def _calibrated(self) -> "StudyConfiguration":
        followed = [name for name in self.strategies if name in ("inverse", "assisted")]
        if self.simulation.sigma_max_policy.calibration != "none" and followed:
            raise ValueError(
                f"simulation.sigma_max_policy.calibration = 'repetitions' cannot be combined with the "
                f"strategy {followed[0]}, whose activations are relative to sigma_max: omit one of them"
            )
        return self

    @property
    def strategy_names(self) -> tuple[str, ...]:
        """Strategies along the dim of the cube."""
        return (TRUE_STRATEGY,) if self.activation_source == "true" else self.strategies
