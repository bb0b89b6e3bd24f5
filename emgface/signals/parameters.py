"""Parameters from recording to activation, with default, unit and source.

If the publication is silent or contradicts itself, the choice is a parameter here. A study file
contains one `SignalChain`.
"""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from emgface.choices import ESKES, Parameters, choice, parameter
from emgface.signals.montage import MontageParameters

BUCHANAN = "Buchanan et al. 2004, J Appl Biomech 20:367-395"

StrategyName = Literal["act_all", "act_3", "act_rel", "act_threshold"]


def _give_way(values: Any, default_name: str, alternative: str) -> Any:
    """Remove the default of one of two alternatives if the other is specified."""
    if isinstance(values, Mapping) and values.get(alternative) is not None:
        return {default_name: None, **values}
    return values


class FilterParameters(Parameters):
    """Butterworth band-pass of the sEMG signals."""

    order: int = parameter(
        4,
        "Design order of the Butterworth band-pass.",
        source=f"{ESKES}, Methods",
        note="a band-pass of design order n has 2 n poles and is applied twice if phase is 'zero'",
        ge=1,
        le=12,
    )
    low: float = parameter(
        15.0, "Lower edge of the pass-band.", unit="Hz", source=f"{ESKES}, Methods", gt=0
    )
    high: float = parameter(
        500.0, "Upper edge of the pass-band.", unit="Hz", source=f"{ESKES}, Methods", gt=0
    )
    phase: Literal["zero", "causal"] = choice(
        "zero",
        "Forward and backward (zero) or forward only (causal).",
        source="the paper does not specify it",
        note="the gain at the edges is -6 dB for 'zero' and -3 dB for 'causal'",
    )

    @model_validator(mode="after")
    def _ordered(self) -> "FilterParameters":
        if self.low >= self.high:
            raise ValueError(
                f"low = {self.low:g} Hz is not below high = {self.high:g} Hz: exchange them"
            )
        return self


class FeatureParameters(Parameters):
    """Amplitude feature of the filtered signals."""

    kind: Literal["wamp", "rms", "mav", "envelope"] = choice(
        "wamp",
        "Amplitude feature: Willison amplitude, root mean square, mean absolute value, or "
        "linear envelope with the neural transfer function of Buchanan.",
        source=f"{ESKES}, Methods and Eq. 7; {BUCHANAN}",
    )
    window: float = parameter(
        0.2,
        "Length of the sliding window of wamp, rms and mav, which is moved by one sample.",
        unit="s",
        source=f"{ESKES}, Methods",
        note="rounded to whole samples (0.2 s at 2048 Hz is 409.6); the rounding is recorded",
        gt=0,
    )
    label: Literal["centre", "start", "end"] = choice(
        "centre",
        "Instant of the window to which its feature is assigned.",
        source=f"{ESKES}, Eq. 7 prints 'start'",
        note="with 'start', the feature uses later samples; with 'end', earlier samples only; "
        "'centre' has no lag",
    )
    threshold: float | None = parameter(
        10e-6,
        "Threshold s_lim of the Willison amplitude.",
        unit="V",
        source=f"{ESKES}, Methods",
        note="printed as 10 mV, about 1000 times the amplitude of facial sEMG; 10 uV is plausible",
        gt=0,
    )
    threshold_baseline: float | None = parameter(
        None,
        "Threshold as a multiple of the baseline RMS of each channel, instead of `threshold`.",
        gt=0,
    )
    baseline_start: float | None = parameter(
        None, "Start of the rest interval for the baseline RMS.", unit="s"
    )
    baseline_stop: float | None = parameter(
        None, "End of the rest interval for the baseline RMS.", unit="s"
    )
    comparison: Literal[">=", ">"] = choice(
        ">=",
        "Comparison of |s(t+n-1) - s(t+n)| with the threshold.",
        source=f"{ESKES}, Eq. 7",
        note="other implementations use '>'; the results differ where a difference equals the "
        "threshold exactly",
    )
    envelope_cutoff: float = parameter(
        6.0,
        "Low-pass edge of the linear envelope.",
        unit="Hz",
        source=f"{BUCHANAN} (3-10 Hz)",
        gt=0,
    )
    envelope_order: int = parameter(
        2, "Design order of the envelope's Butterworth low-pass.", ge=1, le=8
    )
    delay: float = parameter(
        0.04,
        "Electromechanical delay d of the neural transfer function.",
        unit="s",
        source=f"{BUCHANAN} (0.01-0.1 s)",
        note="not calibrated for facial muscles; rounded to whole samples",
        ge=0,
        le=0.5,
    )
    C1: float = parameter(
        -0.97,
        "First recursive coefficient; |C1| < 1 for stability.",
        source=f"{BUCHANAN} gives the form, not a value",
        note="per sample: -0.97 is a time constant of 16 ms at 2048 Hz; not calibrated",
        gt=-1,
        lt=1,
    )
    C2: float = parameter(
        -0.97,
        "Second recursive coefficient; |C2| < 1 for stability.",
        source=f"{BUCHANAN} gives the form, not a value",
        note="per sample: -0.97 is a time constant of 16 ms at 2048 Hz; not calibrated",
        gt=-1,
        lt=1,
    )
    A: float = parameter(
        -1.5,
        "Nonlinear shape from neural to muscle activation, 0 is linear.",
        source=f"{BUCHANAN} (-3 to 0)",
        note="middle of the published range; acts after normalisation, where it maps 0-1 to 0-1",
        ge=-3,
        le=0,
    )

    @model_validator(mode="before")
    @classmethod
    def _one_threshold(cls, values: Any) -> Any:
        return _give_way(values, "threshold", "threshold_baseline")

    @model_validator(mode="after")
    def _consistent(self) -> "FeatureParameters":
        if (self.threshold is None) == (self.threshold_baseline is None):
            raise ValueError(
                "exactly one of threshold [V] and threshold_baseline [1] is required: remove one"
            )
        interval = (self.baseline_start, self.baseline_stop)
        if self.threshold_baseline is not None and None in interval:
            raise ValueError(
                "threshold_baseline requires a rest interval: specify baseline_start and baseline_stop"
            )
        if interval[0] is not None and interval[1] is not None and interval[0] >= interval[1]:
            raise ValueError(
                f"baseline_start = {interval[0]:g} s is not before baseline_stop = "
                f"{interval[1]:g} s: exchange them"
            )
        return self


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
        return _give_way(values, "steps", "period")

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
