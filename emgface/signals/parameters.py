"""Parameters from recording to activation, with default, unit and source.

If the publication is silent or contradicts itself, the choice is a parameter here. A study file
contains one `SignalChain`.
"""

from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from emgface.choices import ESKES, Parameters, choice, parameter
from emgface.plugins import names_schema, require_name
from emgface.signals.feature_parameters import FeatureParameters, FilterParameters, give_way
from emgface.signals.montage import MontageParameters

STRATEGIES: Final = ("act_all", "act_3", "act_rel", "act_threshold")  #: those of this package
StrategyName = Annotated[
    str,
    AfterValidator(lambda name: require_name("strategy", name, STRATEGIES)),
    WithJsonSchema(names_schema(STRATEGIES)),
]
"""Name of a strategy of this package or of another one."""


class MappingParameters(Parameters):
    """Mapping of seven measured to ten modelled muscles per side (Eqs 2-6)."""

    mapping_stage: Literal["signal", "feature", "activation"] = choice(
        "signal",
        "Quantity that Eqs 2-6 combine: filtered signals, features, or normalised features.",
        source=f"{ESKES}, Eqs 2-6 are printed for the signals s",
        note="Eq. 8 removes any factor applied before it, so that at 'feature' LAO equals LLSAN, DLI "
        "equals DAO and OOM equals OOP; at 'activation' the factors keep their meaning",
    )
    oom: Literal["text", "as_printed"] = choice(
        "text",
        "OOM = 0.10 (OOS + OOI), a fifth of OOP (text), or 0.10 (OOP + OOI) (as printed).",
        source=f"{ESKES}, text after Eq. 6; Eq. 3",
    )


class NormalisationParameters(Parameters):
    """Min-max normalisation to 0-1 (Eq. 8)."""

    reach: Literal["trial", "session", "reference"] = choice(
        "trial",
        "Data for the minimum and maximum: the trial, all trials of the volunteer, "
        "or a maximum-effort recording.",
        source=f"{ESKES}, Eq. 8 (over the time index of each trial)",
        note="'trial' amplifies the noise of an inactive muscle to 0-1",
    )
    silent: Literal["error", "zero"] = choice(
        "error",
        "Treatment of a channel with a constant value, or of a feature that is constant "
        "above zero, for which Eq. 8 is 0/0.",
        note="'zero' gives activation 0 and records the names",
    )
    resting: Literal["zero", "error"] = choice(
        "zero",
        "Treatment of a muscle whose signal never reaches the Willison threshold, for which "
        "Eq. 8 is also 0/0.",
        note="a muscle at rest is not an error; at mapping_stage 'signal' OOM, a fifth of OOP, "
        "is the first to fall below the threshold; the names are recorded, and it is an "
        "error if no muscle reaches the threshold",
    )
    outside: Literal["error", "clip"] = choice(
        "error",
        "Treatment of values outside the range of the session or the reference.",
        note="'clip' limits to 0-1 and records the fraction of clipped samples",
    )


class StrategyParameters(Parameters):
    """Selection of the muscles that are activated."""

    name: StrategyName = choice(
        "act_all",
        "Strategy used where a call or a study specifies none.",
        source=f"{ESKES}, Methods, Table 1 and Discussion (act_threshold)",
    )
    n: int = parameter(
        3,
        "Number of muscles per side that act_3 selects.",
        source=f"{ESKES}, Methods",
        note="those with the largest variance of the bilateral mean; ties are resolved by the "
        "order of emgface.muscles",
        ge=1,
        le=10,
    )
    threshold: float = parameter(
        0.5,
        "act_threshold selects muscles whose standard deviation of the bilateral mean feature "
        "exceeds this fraction of the most active muscle's.",
        source=f"{ESKES}, Discussion proposes a threshold, without a value",
        ge=0,
        lt=1,
    )


class HeadFrameParameters(Parameters):
    """Removal of the head's rigid motion with the six face markers."""

    max_gap: float = parameter(
        0.1,
        "Longest gap of a marker that is interpolated.",
        unit="s",
        note="10 frames at 100 frames per second",
        ge=0,
    )
    own_reference: Literal["first", "mean"] = choice(
        "first",
        "Reference configuration if none is specified: the first frame with the largest "
        "number of face markers, or the mean of all frames aligned to it.",
    )


class ResamplingParameters(Parameters):
    """Sampling of activation and positions at the times of the simulation."""

    steps: int | None = parameter(
        160,
        "Number of equal simulation steps per instruction.",
        source=f"{ESKES}, Discussion",
        note="results in steps + 1 samples, the first at the start of the simulation",
        ge=1,
    )
    period: float | None = parameter(None, "Sampling period, instead of `steps`.", unit="s", gt=0)

    @model_validator(mode="before")
    @classmethod
    def _one_rule(cls, values: Any) -> Any:
        return give_way(values, "steps", "period")

    @model_validator(mode="after")
    def _consistent(self) -> "ResamplingParameters":
        if (self.steps is None) == (self.period is None):
            raise ValueError("exactly one of steps [1] and period [s] is required: remove one")
        return self


class SignalChain(Parameters):
    """All parameters from recording to activation, as in a study file."""

    filter: FilterParameters = Field(default=FilterParameters(), description="Band-pass.")
    feature: FeatureParameters = Field(default=FeatureParameters(), description="Feature.")
    montage: MontageParameters = Field(
        default=MontageParameters(), description="Muscles that were not recorded."
    )
    mapping: MappingParameters = Field(default=MappingParameters(), description="Eqs 2-6.")
    normalisation: NormalisationParameters = Field(
        default=NormalisationParameters(), description="Eq. 8."
    )
    strategy: StrategyParameters = Field(default=StrategyParameters(), description="Muscles used.")
    head_frame: HeadFrameParameters = Field(
        default=HeadFrameParameters(), description="Head motion."
    )
    resampling: ResamplingParameters = Field(
        default=ResamplingParameters(), description="Times of the simulation."
    )
