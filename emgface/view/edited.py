"""Motion of the reduced face for edited curves, with its score, as one message to a page."""

import json
import struct
import time
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from analysis.align import align
from analysis.errors import AnalysisError
from analysis.scores import correlation_3d, score
from emgface.errors import DataError
from emgface.pictures.body import Skin
from emgface.pictures.surface import SurfaceProbe
from emgface.reduced.model import ReducedFace
from emgface.reduced.motion import simulate_reduced
from emgface.schema.netcdf import kind_of
from emgface.study.configuration import StudyConfiguration
from emgface.study.measured import measured_during
from emgface.view.curves import Curves, curves_of, read_curves
from emgface.view.live import quanta
from sim import Activation

Floats = NDArray[np.float64]

OUTPUT: Final = 0.02  #: time between the frames of an edited motion [s]
KNOTS: Final = 0.05  #: time between the knots of curves that come from a recording [s]


class EditedMotion:
    """Computes the motion of curves; scores it if a recording with markers is given.

    Time t [s] of the curves is ``start + pace t`` in the recording.
    """

    def __init__(
        self,
        reduced: ReducedFace,
        skin: Skin,
        centre: Floats,
        *,
        step: float,
        recording: xr.Dataset | None = None,
        start: float = 0.0,
        pace: float = 1.0,
    ) -> None:
        self._reduced, self._centre, self._step, self._recording = reduced, centre, step, recording
        self._skin, self._study = SurfaceProbe(skin.node), StudyConfiguration()
        self._aligned: xr.DataArray | None = None
        self._timing = {"recorded_start": start, "recorded_pace": pace, "sigma_max": 0.0}

    def __call__(self, curves: Curves, *, preview: bool = False) -> bytes:
        """Simulate curves; errors as `emgface.reduced.motion.simulate_reduced`.

        A preview has steps as long as the time between its frames, and its score uses the alignment
        of the last complete motion. The message is the length of its header as a 4-byte integer,
        the header in JSON, and the positions of skin and markers (frames, n, 3) as int16.
        """
        begun = time.perf_counter()
        muscles = self._reduced.model.system.muscles
        instants, values = curves.activation(muscles)
        count = max(round(curves.duration / OUTPUT), 1)
        motion = simulate_reduced(
            self._reduced,
            Activation(instants, values),
            count * OUTPUT,
            step=OUTPUT if preview else self._step,
            output=OUTPUT,
            further=(self._skin,),
        )
        simulated = time.perf_counter()
        frames = motion["surface_position"].transpose("time", "surface_node", "axis").values
        markers = motion["position"].transpose("time", "marker", "axis").values
        at = motion["time"].values
        levels = np.stack([curves.at(name, at) for name in muscles], axis=1)
        header = {
            "kind": "motion",
            "preview": preview,
            "time": [round(float(t), 4) for t in at],
            "bound": float(motion["reduction_error"].max()),
            "doubt": str(motion.attrs["reduction_doubt"]),
            "clipped": curves.clipped,
            "activation": np.round(levels, 4).tolist(),
            **self._scores(motion.drop_vars("surface_position"), preview=preview),
            "simulated": simulated - begun,
            "total": 0.0,
        }
        body = quanta(frames - self._centre) + quanta(markers - self._centre)
        header["total"] = time.perf_counter() - begun
        text = json.dumps(header).encode()
        return struct.pack("<I", len(text)) + text + body

    def _scores(self, motion: xr.Dataset, *, preview: bool) -> dict[str, Any]:
        """Correlation of every lip marker, None where it is undefined, or why there is none."""
        if self._recording is None:
            return {"rho": {}}
        position = motion["position"]
        if preview:
            if self._aligned is None:
                return {"rho": {}}
            measured = self._aligned.reindex(
                time=position["time"].values, method="nearest", tolerance=1e-6
            )
            return {
                "rho": _by_name(correlation_3d(measured, position.sel(marker=measured["marker"])))
            }
        trajectory = motion.assign_attrs(self._timing)
        try:
            measured = measured_during(
                self._recording, trajectory, self._reduced.face, self._study.signals.head_frame
            )
            aligned = align(measured, trajectory, **self._study.alignment.arguments())
        except (DataError, AnalysisError) as error:
            return {"rho": {}, "why": str(error)}
        self._aligned = aligned["position"]
        found = score(aligned, trajectory, **self._study.score.model_dump())
        return {"rho": _by_name(found["rho"])}


def _by_name(rho: xr.DataArray) -> dict[str, float | None]:
    """Values by marker for JSON."""
    return {
        str(name): None if np.isnan(value) else round(float(value), 4)
        for name, value in zip(rho["marker"].values, rho.values, strict=True)
    }


def curves_and_recording(
    path: Path | None, mapping: Path | None
) -> tuple[Curves | None, dict[str, Any]]:
    """Curves of a file, and, if it is a recording, it with the start and pace of its motion.

    A recording is converted to activations by the default signal chain; the curves then have a knot
    every `KNOTS` seconds.
    """
    if path is None:
        return None, {}
    named = kind_of(path) if path.suffix.lower() == ".nc" else ""
    if path.is_dir() or path.suffix.lower() == ".csv" or named == "activation":
        return read_curves(path), {}
    import emgface as ef

    recording = ef.read(path, mapping=mapping)
    activation = ef.activate(recording)
    whole = curves_of(activation)
    time = np.linspace(0.0, whole.duration, max(round(whole.duration / KNOTS), 1) + 1)
    rows = {m: np.column_stack([time, whole.at(m, time)]) for m in whole.knots}
    compared: dict[str, Any] = {}
    if "position" in recording:
        compared = {"recording": recording, "start": float(activation["time"][0])}
    return Curves(rows, whole.duration), compared
