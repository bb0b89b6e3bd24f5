"""Write simulated recordings as a BIDS dataset, with their true activations."""

import json
from collections.abc import Iterable
from pathlib import Path

import pandas as pd
import xarray as xr

from emgface.files import named_file, write_text
from emgface.recordings.bids import write_bids
from emgface.recordings.dataset import read_recording, write_recording
from emgface.schema.netcdf import write_netcdf


def write_truth(recording: xr.Dataset, path: Path) -> Path:
    """Write the true activation of a simulated recording as an activation file (netCDF).

    `recording` contains ``true_activation(muscle, time_true)``. The file has the strategy "true";
    person, sigma_max and failed electrodes are attributes. Raises DataError if it cannot be
    written.
    """
    activation = recording["true_activation"].rename(time_true="time")
    keep = ("volunteer", "instruction", "repetition", "origin", "world", "source", "person", "mismatch",
            "settings", "true_sigma_max", "electrode_failures")  # fmt: skip
    attrs = {name: recording.attrs[name] for name in keep if name in recording.attrs}
    truth = activation.to_dataset(name="activation").assign_attrs(attrs, strategy="true")
    return write_netcdf(truth, path, "activation")


def write_session(session: xr.Dataset, events: pd.DataFrame, folder: Path) -> Path:
    """Write an uncut session, with a table of its events, and return the path of the recording.

    `events` has the columns ``onset``, ``duration`` [s] and ``label``. The files are
    ``<volunteer>_<instruction>.nc`` and ``..._events.tsv``, for
    `emgface.recordings.events.read_events`. Raises DataError if they cannot be written.
    """
    names = session.attrs["volunteer"], session.attrs["instruction"]
    path = write_recording(session, named_file(folder, *names, suffix=".nc"))
    table = events.rename(columns={"label": "trial_type"})
    text = table.to_csv(sep="\t", index=False, lineterminator="\n")
    write_text(named_file(folder, *names, suffix="_events.tsv"), text)
    return path


def write_set_as_bids(paths: Iterable[Path], root: Path, truth: Path) -> list[Path]:
    """Convert simulated recordings (netCDF) to EMG-BIDS and Motion-BIDS in the folder `root`.

    `truth` is a folder outside `root` for the true activations, which BIDS cannot represent.
    Returns the files with signals; raises DataError if a recording cannot be read or a file cannot
    be written.
    """
    written: list[Path] = []
    for path in paths:
        recording = read_recording(path)
        settings = json.loads(str(recording.attrs["settings"]))
        written += write_bids(
            recording,
            root,
            name="Simulated volunteers: surface EMG and lip markers",
            emg={"PowerLineFrequency": settings["mains_frequency"], "Manufacturer": "simulated"},
            motion={"Manufacturer": "simulated"},
        )
        write_truth(recording, truth / path.name)
    return written
