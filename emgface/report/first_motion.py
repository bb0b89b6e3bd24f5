"""Page with the first moving picture of a study, before its other trials are computed."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from analysis.cube import TRIAL_DIMS
from emgface.files import write_text
from emgface.pictures.body import skin_of
from emgface.pictures.page import motion_page
from emgface.pictures.surface import with_surface
from emgface.run.store import Store
from emgface.study.configuration import StudyConfiguration
from emgface.study.stages import Laboratory
from emgface.study.table import load_recording


class FirstMotion:
    """Simulation of the first trial of a study, and its page.

    The page `page` of a `study` is written by its simulation in the folder `out`, where the study
    will reuse the results. `ready` receives the page, or the error that prevented it. The
    simulation runs in a thread if `threaded`, that is, if other processes do the other work;
    otherwise on request.
    """

    def __init__(
        self,
        study: StudyConfiguration,
        out: Path,
        page: Path,
        ready: Callable[[Path | Exception], None],
        *,
        threaded: bool = True,
    ) -> None:
        self._study, self._out, self._page, self._ready = study, out, page, ready
        self._thread = ThreadPoolExecutor(1, "first motion") if threaded else None
        self._laboratory: Laboratory | None = None
        self._begun = False
        if self._thread is not None:
            self._thread.submit(self._settled)

    def begin(self, recording: Path) -> None:
        """Begin with the strategy of the study that is named first; later calls have no effect."""
        if self._begun:
            return
        self._begun = True
        if self._thread is None:
            self._written(recording)
        else:
            self._thread.submit(self._written, recording)

    def end(self) -> None:
        """Wait for what has begun."""
        if self._thread is not None:
            self._thread.shutdown(wait=True)

    def _settled(self) -> Laboratory:
        """Settle the face of the study, for which the numerical kernels are compiled."""
        if self._laboratory is None:
            store = Store(self._out / "store", report=lambda text: None)
            laboratory = Laboratory.of_study(store, self._study, lambda text: None, ())
            laboratory.rest(self._study.simulation)
            self._laboratory = laboratory
        return self._laboratory

    def _written(self, path: Path) -> None:
        try:
            laboratory, strategy = self._settled(), self._study.strategies[0]
            recording = load_recording(path, self._study.recordings)
            if self._study.face.per_volunteer:
                own = (laboratory.store, self._study, lambda text: None, [recording.place[0]])
                laboratory = Laboratory.of_study(*own)
            label = f"{recording.label} {strategy}"
            activation = laboratory.activation(recording, strategy).dataset
            drive = activation["activation"]
            attrs = laboratory.motion(drive, label).dataset.attrs
            moved = laboratory.skin_motion(drive, float(attrs["sigma_max"]), label).dataset
            time = moved["time"].values
            named = {
                name: activation.attrs[name] for name in TRIAL_DIMS if name in activation.attrs
            }
            moved = moved.assign_attrs(attrs | named | {"output": float(time[1] - time[0])})
            drawn = with_surface(moved, laboratory.face, skin_of(laboratory.face))
            write_text(self._page, motion_page(drawn, activation))
        except Exception as error:  # the study reports the failure of the trial
            self._ready(error)
        else:
            self._ready(self._page)
