"""Motion of the reduced face for edited curves, with its score, as one message to a page."""

import json
import struct
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.face.muscle_force import FORCE, MuscleForces
from emgface.pictures.body import Skin
from emgface.pictures.encoding import measured_markers, whole
from emgface.pictures.surface import without_surface
from emgface.reduced.model import ReducedFace
from emgface.reduced.motion import reduced_outputs, step_ends, with_error
from emgface.schema.netcdf import kind_of
from emgface.view.curves import Curves, curves_of, read_curves
from emgface.view.live import quanta
from emgface.view.previewed import Previews
from emgface.view.scored import Scorer
from sim import Activation, Positions, State
from sim.activation import Driven
from sim.errors import SimulationError
from sim.threads import one_blas_thread

Floats = NDArray[np.float64]

OUTPUT: Final = 0.02  #: time between the frames of an edited motion [s]
CHECKPOINT: Final = 5  #: number of frames between the checkpoints from which a motion branches
KNOTS: Final = 0.05  #: time between the knots of curves that come from a recording [s]


@dataclass(frozen=True, eq=False)
class _Former:
    """The last motion with steps of one length: activation at their ends, outputs, checkpoints."""

    levels: Floats
    outputs: xr.Dataset
    states: Mapping[int, State]


class _Unwanted(Exception):
    """A motion that was computed ahead is not wanted any more."""


class EditedMotion:
    """Computes the motion of curves; scores it if a recording with markers is given.

    A motion whose activation equals that of the last motion until some instant branches from the last
    checkpoint before it; it is bitwise identical to a motion from the start.
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
        forces = MuscleForces.of(reduced.face, reduced.parameters)
        modes = reduced.modes[..., : reduced.moving]
        self._forces, self._known = forces.on_modes(reduced.rest, modes), forces.known
        self._rest = reduced.rest[skin.node]
        self._skin = np.ascontiguousarray(modes[skin.node]).reshape(-1, reduced.moving)
        self._scorer = (
            None if recording is None else Scorer(recording, reduced.face, start=start, pace=pace)
        )
        self._former: dict[float, _Former] = {}
        # Curves whose complete motion was computed ahead, its message and its alignment.
        self._ready: tuple[Curves, bytes, xr.Dataset | None] | None = None
        self._markers = [str(m) for m in reduced.face["marker"].values]
        self._previews = None if reduced.contact else Previews(reduced, skin, OUTPUT)

    def __call__(self, curves: Curves, *, preview: bool = False) -> bytes:
        """Simulate curves; errors as `emgface.reduced.motion.simulate_reduced`.

        A preview (`emgface.view.previewed`) has long steps and no forces, and its score uses the
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

    def _preview(self, curves: Curves, previews: Previews) -> bytes:
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
        self, curves: Curves, watch: Callable[[], None] = lambda: None, *, preview: bool = False
    ) -> bytes:
        """Message of a complete motion; `watch` may end it by an error between its parts."""
        begun, measured, scores = time.perf_counter(), b"", dict[str, Any](rho={})
        motion, branched = self.motion(curves, self._step, watch)
        simulated = time.perf_counter()
        watch()
        if self._scorer is not None:
            scores = self._scorer(without_surface(motion))
            if (aligned := self._scorer.aligned) is not None:
                at = measured_markers(aligned, motion)
                measured = whole(at, self._centre).astype("<i2").tobytes()
        scored = time.perf_counter()
        force = motion[FORCE].transpose("time", "muscle").values
        header = {
            "preview": preview,
            "time": np.round(motion["time"].values, 4).tolist(),
            "bound": float(motion["reduction_error"].max()),
            "doubt": str(motion.attrs["reduction_doubt"]),
            "clipped": curves.clipped,
            "branched": branched,
            "forces": np.round(force[:, self._known], 4).tolist(),
            **scores,
        }
        skin = motion["surface_position"].transpose("time", "surface_node", "axis").values
        markers = motion["position"].transpose("time", "marker", "axis").values
        return self._message(header, skin, markers, (begun, simulated, scored)) + measured

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
        ends = step_ends(max(round(curves.duration / OUTPUT), 1) * OUTPUT, self._step)
        driven = Driven(system, Activation(*curves.activation(system.muscles)))
        return self._reduced.trained.doubt(ends, driven.at_ends([0.0, *ends.tolist()]))

    def ahead(self, curves: Curves, unwanted: Callable[[], bool]) -> None:
        """Compute the complete motion of curves that a preview showed, until it is unwanted.

        `unwanted` is asked at every checkpoint. The motion is then ready if the same curves are asked
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

    def motion(
        self, curves: Curves, step: float, watch: Callable[[], None] = lambda: None
    ) -> tuple[xr.Dataset, float]:
        """Motion of curves with steps [s], and the time [s] from which it was computed anew."""
        computed, activation, since = self._outputs(curves, step, watch)
        drawn = self._drawn(computed, activation)
        return with_error(self._reduced, drawn, activation, step=step), since

    def _outputs(
        self, curves: Curves, step: float, watch: Callable[[], None]
    ) -> tuple[xr.Dataset, Activation, float]:
        """Outputs, activation, and the time since which they are new; `watch` may end it by an error."""
        system = self._reduced.model.system
        activation = Activation(*curves.activation(system.muscles))
        count = max(round(curves.duration / OUTPUT), 1)
        ends = step_ends(count * OUTPUT, step)
        levels = Driven(system, activation).at_ends([0.0, *ends.tolist()])
        former, first = self._former.get(step), 0
        states, outputs = dict[int, State](), None
        if former is not None:
            n = min(len(levels), len(former.levels))
            same = (levels[:n] == former.levels[:n]).all(axis=1)
            steps = n if same.all() else int(np.argmin(same))
            # The first steps of a motion as long as the former, and its checkpoints, remain.
            frame = int(steps * step / OUTPUT + 1e-9)
            states = {k: state for k, state in former.states.items() if k <= frame}
            first = max((k for k in states if k < count), default=0)
            outputs = former.outputs.isel(time=slice(first + 1))
        made: list[State] = []

        def keep(state: State) -> None:
            made.append(state)
            watch()

        computed = reduced_outputs(
            self._reduced,
            activation,
            (count - first) * OUTPUT,
            step=step,
            output=OUTPUT,
            own=(Positions(),),
            initial=states.get(first),
            checkpoint=CHECKPOINT,
            at_checkpoint=keep,
        )
        if first and outputs is not None:
            computed = _joined(outputs, computed)
        states |= {first + CHECKPOINT * (k + 1): state for k, state in enumerate(made)}
        self._former[step] = _Former(levels, computed, states)
        return computed, activation, first * OUTPUT

    @one_blas_thread
    def _drawn(self, computed: xr.Dataset, activation: Activation) -> xr.Dataset:
        """Outputs with positions of the skin and forces of the muscles instead of the coordinates."""
        name = "node_position"
        y = computed[name].transpose("time", "node", "axis").values.reshape(-1, self._skin.shape[1])
        skin = self._rest + (y @ self._skin.T).reshape(len(y), -1, 3)
        force = self._forces(y, activation.at_all(computed["time"].values))
        return computed.drop_vars(name).assign({
            "surface_position": (("time", "surface_node", "axis"), skin, {"units": "m"}),
            FORCE: (("time", "muscle"), force, {"units": "N"}),
        })  # fmt: skip


def _joined(before: xr.Dataset, after: xr.Dataset) -> xr.Dataset:
    """Outputs until a checkpoint, and those from it without its own."""
    later = after.isel(time=slice(1, None))
    joined = {
        str(name): (one.dims, np.concatenate([before[name].values, one.values], one.dims.index("time")))
        for name, one in later.data_vars.items()
    }  # fmt: skip
    time = np.concatenate([before["time"].values, later["time"].values])
    known = {name: coord for name, coord in after.coords.items() if name != "time"}
    found = xr.Dataset(joined, coords={**known, "time": time}, attrs=after.attrs)
    for name, one in after.variables.items():
        found[name].attrs = one.attrs
    return found


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
