"""Parameters of the comparison of measured and simulated motion."""

from typing import Any, Literal

from pydantic import model_validator

from analysis.matching import CLEAR_COSINE
from analysis.noise import SMALLEST_SNR
from analysis.trajectory import SMALLEST_MOTION
from emgface.choices import ESKES, Parameters, choice, parameter


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
