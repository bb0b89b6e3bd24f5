"""Parameters of the band-pass and of the amplitude feature."""

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import model_validator

from emgface.choices import ESKES, Parameters, choice, parameter

BUCHANAN = "Buchanan et al. 2004, J Appl Biomech 20:367-395"


def give_way(values: Any, default_name: str, alternative: str) -> Any:
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
    threshold_rest: float | None = parameter(
        None,
        "Threshold as a multiple of the RMS of each channel or muscle in the quietest tenth of the "
        "windows of a recording, instead of `threshold`.",
        source="Waris and Kamavuako 2018, Biomed Signal Process Control 45:267-273",
        note="they found 0.1 to 1 times the RMS at rest best for the classification of surface EMG; "
        "the recording must contain some rest, and each recording has its own threshold",
        gt=0,
        le=100,
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
        values = give_way(values, "threshold", "threshold_baseline")
        return give_way(values, "threshold", "threshold_rest")

    @model_validator(mode="after")
    def _consistent(self) -> "FeatureParameters":
        thresholds = (self.threshold, self.threshold_baseline, self.threshold_rest)
        if sum(one is not None for one in thresholds) != 1:
            raise ValueError(
                "exactly one of threshold [V], threshold_baseline [1] and threshold_rest [1] is "
                "required: remove the others"
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
