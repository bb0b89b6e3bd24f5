"""Scores of edited motions: rho of the lip markers against one recording, for many motions of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.align import align
from analysis.errors import AnalysisError
from analysis.scores import MOTION_ROUNDING
from emgface.errors import DataError
from emgface.face.measured import measured_during
from emgface.study.configuration import StudyConfiguration

Floats = NDArray[np.float64]


class Scorer:
    """Correlations of motions with the markers of a recording.

    Time t [s] of a motion is ``start + pace t`` in the recording. What does not depend on the motion is
    computed once for all motions of one duration.
    """

    def __init__(
        self, recording: xr.Dataset, face: xr.Dataset, *, start: float = 0.0, pace: float = 1.0
    ) -> None:
        self._recording, self._face, self._study = recording, face, StudyConfiguration()
        self._timing = {"recorded_start": start, "recorded_pace": pace, "sigma_max": 0.0}
        self._measured: xr.Dataset | None = None
        #: Measured positions aligned with the last complete motion, None if there are none.
        self.aligned: xr.Dataset | None = None

    def __call__(self, motion: xr.Dataset) -> dict[str, Any]:
        """Correlation ``rho`` by lip marker, None where it is undefined, or ``why`` there is none."""
        trajectory = motion.assign_attrs(self._timing)
        try:
            self.aligned = self._align(trajectory)
        except (DataError, AnalysisError) as error:
            self.aligned = None
            return {"rho": {}, "why": str(error)}
        names = [str(m) for m in trajectory["marker"].values]
        return self.preview(
            names, trajectory["position"].transpose("time", "marker", "axis").values
        )

    def preview(self, markers: Sequence[str], position: Floats) -> dict[str, Any]:
        """The same for positions (n, n_markers, 3) [m], with the alignment of the last motion."""
        if self.aligned is None:
            return {"rho": {}}
        names = [str(m) for m in self.aligned["marker"].values]
        w = position[:, [markers.index(name) for name in names]].transpose(1, 2, 0)
        v = self.aligned["position"].transpose("marker", "axis", "time").values
        score = self._study.score
        rho = correlations(
            _of_length(v, w.shape[2]),
            w,
            self.aligned["noise"].values,
            smallest_motion=score.smallest_motion,
            smallest_snr=score.smallest_snr,
        )
        values = zip(names, rho.tolist(), strict=True)
        return {"rho": {n: None if np.isnan(r) else round(r, 4) for n, r in values}}

    def _align(self, trajectory: xr.Dataset) -> xr.Dataset:
        known = self._measured
        if known is None or not np.array_equal(known["time"].values, trajectory["time"].values):
            known = self._measured = measured_during(
                self._recording, trajectory, self._face, self._study.signals.head_frame
            )
        return align(known, trajectory, **self._study.alignment.arguments())


def correlations(
    measured: Floats,
    simulated: Floats,
    noise: Floats,
    *,
    smallest_motion: float,
    smallest_snr: float,
) -> Floats:
    """Correlations rho (n_markers,) of positions (n_markers, 3, n) [m], as by `analysis.scores.score`.

    `noise` (n_markers,) [m] is that of the measured positions. The score is over the instants from the
    first to the last with a measured marker.
    """
    seen = np.flatnonzero(np.isfinite(measured).any(axis=(0, 1)))
    if len(seen) < 2:
        return np.full(len(measured), np.nan)
    span = slice(int(seen[0]), int(seen[-1]) + 1)
    given = measured[..., span], simulated[..., span]
    centred = [x - x.mean(axis=2, keepdims=True) for x in given]
    squares = [(x**2).sum(axis=(1, 2)) for x in centred]
    defined = np.isfinite(squares[0] + squares[1])
    for x, square in zip(given, squares, strict=True):
        root = np.sqrt(square / x.shape[2])
        defined &= (root > MOTION_ROUNDING * np.abs(x).max(axis=(1, 2))) & ~(root < smallest_motion)
    defined &= ~(squares[0] / given[0].shape[2] < (1.0 + smallest_snr) * noise**2)
    product = (centred[0] * centred[1]).sum(axis=(1, 2))
    norm = np.where(defined, np.sqrt(squares[0]) * np.sqrt(squares[1]), np.nan)
    return np.clip(product / norm, -1.0, 1.0)


def _of_length(values: Floats, n: int) -> Floats:
    """The first n instants, NaN after the last."""
    missing = max(n - values.shape[2], 0)
    return np.pad(values[..., :n], ((0, 0), (0, 0), (0, missing)), constant_values=np.nan)
