"""Trial record for a cube."""

import re
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import xarray as xr

from analysis.errors import CubeError

STATUS: Final = re.compile(r"ok|missing|excluded|failed:\w+")

Origin = Literal["measured", "simulated"]


@dataclass(frozen=True)
class Trial:
    """Result of one trial: its scores, or the reason for their absence.

    Attributes
    ----------
    volunteer, instruction, repetition, strategy
        Labels; repetitions are counted from 1.
    scores : xarray.Dataset, optional
        Result of `analysis.scores.score` if `status` is "ok".
    status : str
        "ok", "failed:<ErrorName>", "excluded" (by a person, who gave the reason) or "missing".
    reason : str
        Reason for missing scores, or a remark on them.
    sigma_max : float
        Maximum muscle stress [Pa].
    steps : float
        Number of time steps.
    run_time : float
        Computing time [s].
    numerical_error : float
        Estimated error of the time steps [m].
    motion : float
        Largest displacement of a simulated marker [m].
    reduced : float
        1 if a reduced face moved, 0 if full order replaced it, NaN without one.
    origin : {"measured", "simulated"}, optional
        By default that of the scores.
    computed : str
        UTC date of the last result, ISO 8601.
    environments : tuple of str
        JSON objects that describe the computing environments.

    Raises
    ------
    CubeError
        Unknown status, or scores that contradict it.
    """

    volunteer: str
    instruction: str
    repetition: int
    strategy: str
    scores: xr.Dataset | None = None
    status: str = "ok"
    reason: str = ""
    sigma_max: float = np.nan
    steps: float = np.nan
    run_time: float = np.nan
    numerical_error: float = np.nan
    motion: float = np.nan
    reduced: float = np.nan
    origin: Origin | None = None
    computed: str = ""
    environments: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the status against the scores."""
        if not STATUS.fullmatch(self.status):
            raise CubeError(
                f"trial {self.label} has status {self.status!r}, expected 'ok', 'missing', "
                "'excluded' or 'failed:<ErrorName>'"
            )
        if (self.status == "ok") != (self.scores is not None):
            content = "no scores" if self.scores is None else "scores"
            raise CubeError(f"trial {self.label} has status {self.status!r} but {content}")

    @property
    def label(self) -> str:
        """Volunteer, instruction, repetition and strategy, for messages."""
        return f"{self.volunteer}/{self.instruction}/{self.repetition}/{self.strategy}"

    @property
    def inaccurate(self) -> float:
        """1 if the numerical error exceeds a tenth of the motion, otherwise 0; NaN if unknown."""
        known = np.isfinite(self.numerical_error) and np.isfinite(self.motion)
        return float(self.numerical_error > 0.1 * self.motion) if known else np.nan

    @classmethod
    def failed(
        cls,
        volunteer: str,
        instruction: str,
        repetition: int,
        strategy: str,
        error: Exception,
        **rest: Any,
    ) -> "Trial":
        """Record a failure by the name and the message of its error; `rest` are further attributes."""
        status = f"failed:{type(error).__name__}"
        return cls(volunteer, instruction, repetition, strategy, None, status, str(error), **rest)
