"""Motion of the reduced face for edited curves, with its score, as one message to a page."""

import json
import struct
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.muscle_force import MuscleForces
from emgface.pictures.body import Skin
from emgface.pictures.encoding import measured_markers, quanta, whole
from emgface.reduced.model import ReducedFace
from emgface.reduced.motion import step_ends
from emgface.schema.netcdf import kind_of
from emgface.view.curves import Curves, curves_of, read_curves
from emgface.view.motions import Frames, Motions
from emgface.view.scored import Scorer
from sim import Activation
from sim.activation import Driven
from sim.errors import SimulationError
from sim.threads import one_blas_thread

Floats = NDArray[np.float64]

EDITED_OUTPUT: Final = 0.02  #: time between the frames of an edited motion [s]
KNOTS: Final = 0.05  #: time between the knots of curves that come from a recording [s]


class _Unwanted(Exception):
    """A motion that was computed ahead is not wanted any more."""


class EditedMotion:
    """Computes the motion of curves; scores it if a recording with markers is given.

    A motion whose activation equals that of the last motion until some instant branches from the last
    frame before it (`emgface.view.motions`).
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
        self._reduced, self._centre, self._step = reduced, centre, step
        forces = MuscleForces.from_face(reduced.face, reduced.parameters)
        modes = reduced.modes[..., : reduced.moving]
        self._forces, self._known = forces.on_modes(reduced.rest, modes), forces.known
        self._scorer = (
            None if recording is None else Scorer(recording, reduced.face, start=start, pace=pace)
        )
        # Curves whose complete motion was computed ahead, its message and its alignment.
        self._ready: tuple[Curves, bytes, xr.Dataset | None] | None = None
        self._markers = [str(m) for m in reduced.face["marker"].values]
        self._motions = Motions(reduced, skin, EDITED_OUTPUT, step)
        # Long steps in contact are not accurate.
        self._previews = (
            None if reduced.contact else Motions(reduced, skin, EDITED_OUTPUT, 2.0 * EDITED_OUTPUT)
        )

    def __call__(self, curves: Curves, *, preview: bool = False) -> bytes:
        """Simulate curves; errors as `emgface.reduced.motion.simulate_reduced`.

        A preview (`emgface.view.motions`) has long steps and no forces, and its score uses the
        alignment of the last complete motion. The message is the length of its header as a 4-byte
        integer, the header in JSON, and the positions of skin and markers (frames, n, 3) as int16;
        after a complete motion with measured markers, these as well.
        """
        if preview and self._previews is not None:
            return self._preview(curves, self._previews)
        if self._ready is not None and self._ready[0].same(curves):
            if self._scorer is not None:
                self._scorer.aligned = self._ready[2]
            return self._ready[1]
        return self._complete(curves, preview=preview)

    def _preview(self, curves: Curves, previews: Motions) -> bytes:
        """Message of a preview."""
        begun, scores = time.perf_counter(), dict[str, Any](rho={})
        shown = previews(curves)
        simulated = time.perf_counter()
        if self._scorer is not None:
            scores = self._scorer.preview(self._markers, shown.markers)
        scored = time.perf_counter()
        header = {
            "preview": True,
            "time": np.round(shown.time, 4).tolist(),
            "bound": shown.bound,
            "doubt": self._doubt(curves),
            "clipped": curves.clipped,
            "branched": shown.since,
            "forces": None,
            **scores,
        }
        return self._message(header, shown.skin, shown.markers, (begun, simulated, scored))

    def _complete(
        self, curves: Curves, watch: Callable[[], None] | None = None, *, preview: bool = False
    ) -> bytes:
        """Message of a complete motion; `watch` may end it by an error between its parts."""
        begun, measured, scores = time.perf_counter(), b"", dict[str, Any](rho={})
        shown = self._motions(curves, watch)
        force = one_blas_thread(self._forces)(shown.coordinates, shown.levels)
        simulated = time.perf_counter()
        if watch:
            watch()
        if self._scorer is not None:
            motion = self._scored(shown)
            scores = self._scorer(motion)
            if (aligned := self._scorer.aligned) is not None:
                at = measured_markers(aligned, motion)
                measured = whole(at, self._centre).astype("<i2").tobytes()
        scored = time.perf_counter()
        header = {
            "preview": preview,
            "time": np.round(shown.time, 4).tolist(),
            "bound": shown.bound,
            "doubt": self._doubt(curves),
            "clipped": curves.clipped,
            "branched": shown.since,
            "forces": np.round(force[:, self._known], 4).tolist(),
            **scores,
        }
        times = begun, simulated, scored
        return self._message(header, shown.skin, shown.markers, times) + measured

    def _scored(self, shown: Frames) -> xr.Dataset:
        """Positions of the markers for the score."""
        dims, metre = ("time", "marker", "axis"), {"units": "m"}
        coords = {"time": shown.time, "marker": self._markers, "axis": ["x", "y", "z"]}
        attrs = {"origin": "simulated"}
        return xr.Dataset({"position": (dims, shown.markers, metre)}, coords, attrs)

    def _message(
        self,
        header: Mapping[str, Any],
        skin: Floats,
        markers: Floats,
        times: tuple[float, float, float],
    ) -> bytes:
        """Length of the header, the header with its times [s], and positions of skin and markers."""
        begun, simulated, scored = times
        body = quanta(skin - self._centre) + quanta(markers - self._centre)
        spent = {
            "simulated": simulated - begun,
            "scored": scored - simulated,
            "total": time.perf_counter() - begun,
        }
        text = json.dumps({"kind": "motion", **header, **spent}).encode()
        return struct.pack("<I", len(text)) + text + body

    def _doubt(self, curves: Curves) -> str:
        """Reason not to trust the complete motion of curves, or an empty text."""
        system = self._reduced.model.system
        ends = step_ends(max(round(curves.duration / EDITED_OUTPUT), 1) * EDITED_OUTPUT, self._step)
        driven = Driven(system, Activation(*curves.activation(system.muscles)))
        return self._reduced.trained.doubt(ends, driven.at_ends([0.0, *ends.tolist()]))

    def ahead(self, curves: Curves, unwanted: Callable[[], bool]) -> None:
        """Compute the complete motion of curves that a preview showed, until it is unwanted.

        `unwanted` is asked every some frames. The motion is then ready if the same curves are asked
        for; until then, previews use the alignment of the former. One that fails does so again when it
        is asked for.
        """
        if self._previews is None:
            return
        aligned = None if self._scorer is None else self._scorer.aligned

        def watch() -> None:
            if unwanted():
                raise _Unwanted

        with suppress(_Unwanted, SimulationError):
            message = self._complete(curves, watch)
            self._ready = curves, message, self._scorer and self._scorer.aligned
        if self._scorer is not None:
            self._scorer.aligned = aligned


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
