"""Identification of the recordings of a study: when they are read, and when they are known."""

import shutil
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr

from emgface.muscles import AXES, CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.dataset import write_recording
from emgface.run.journal import Journal
from emgface.study import intake
from emgface.study.configuration import RecordingsConfiguration

LINE = {"origin": "simulated", "world": "", "channels": CHANNELS}
FACTS = {"study": "stub", "trials": 0, "workers": 1, "store": "store"}


def recording(seconds: float = 3.0) -> xr.Dataset:
    """Noise of the size and form of a recording."""
    rng = np.random.default_rng(0)
    markers = FACE_MARKERS + LIP_MARKERS
    emg, frames = np.arange(int(2048 * seconds)) / 2048, np.arange(int(100 * seconds)) / 100
    signal = 1e-4 * rng.normal(size=(len(CHANNELS), emg.size))
    position = 0.01 * rng.normal(size=(len(markers), 3, frames.size))
    return xr.Dataset(
        {"emg": (("channel", "time_emg"), signal, {"units": "V"}),
         "position": (("marker", "axis", "time_marker"), position, {"units": "m"})},
        {"channel": list(CHANNELS), "marker": list(markers), "axis": list(AXES),
         "time_emg": ("time_emg", emg, {"units": "s"}),
         "time_marker": ("time_marker", frames, {"units": "s"})},
        {"origin": "simulated", "volunteer": "S00000", "instruction": "A", "repetition": 1},
    )  # fmt: skip


def recordings(folder: Path, volunteers: int = 10_000, read: int = 100) -> list[dict[str, Any]]:
    """Processor time of reading `read` recordings, and of knowing one of each of the volunteers."""
    shutil.rmtree(folder, ignore_errors=True)
    first = write_recording(recording(), folder / "read" / "S00000.nc")
    for k in range(1, read):
        copy = shutil.copy(first, first.with_name(f"S{k:05d}.nc"))
        with h5py.File(copy, "a") as opened:
            opened.attrs["volunteer"] = f"S{k:05d}"
    began = time.process_time()
    found = intake.take_in(RecordingsConfiguration(folder=folder / "read"))
    reading = (time.process_time() - began) / len(found.recordings)

    known = folder / "known"
    known.mkdir()
    journal = Journal(folder / "study", FACTS)
    reader = intake.reader_digest(None)
    for k in range(volunteers):
        path = known / f"S{k:05d}.nc"  # not opened, because its line is in the journal
        path.write_bytes(b"stub")
        line = {"file": intake.file_of(path), "reader": reader, "digest": f"{k:032x}"}
        journal.write("recording", place=(f"S{k:05d}", "A", 1), **line, **LINE)
    journal.end("finished", [])
    began = time.process_time()
    again = intake.take_in(RecordingsConfiguration(folder=known), study=folder / "study")
    knowing = (time.process_time() - began) / volunteers
    assert len(again.recordings) == volunteers and not again.read
    size = sum(path.stat().st_size for path in (folder / "study" / "runs").iterdir()) / volunteers
    shutil.rmtree(folder)
    rows = [
        ("recordings of 3 s that are read", read),
        ("processor ms of a recording that is read", 1e3 * reading),
        ("recordings that are known, one for each volunteer", volunteers),
        ("processor ms of a recording that is known", 1e3 * knowing),
        ("journal per recording [kB]", size / 1e3),
    ]
    return [{"quantity": name, "value": value} for name, value in rows]
